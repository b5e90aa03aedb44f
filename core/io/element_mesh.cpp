#include "core/io/element_mesh.h"

#include <map>
#include <set>

#include "core/base/error.h"
#include "core/io/face_groups.h"

namespace deform::io {

namespace {

using Kind = FaceGroups::Kind;

class ElementMeshFile : public MeshFile {
 public:
  ElementMeshFile(std::unique_ptr<MeshFile> points, std::shared_ptr<const Elements> elements)
      : points_(std::move(points)), elements_(std::move(elements)) {}

  Format format() const override { return points_->format(); }
  std::shared_ptr<const Mesh> mesh() const override { return points_->mesh(); }
  std::shared_ptr<const Elements> elements() const override { return elements_; }
  std::string with_points(std::span<const Vec3> points) const override { return points_->with_points(points); }

 private:
  const std::unique_ptr<MeshFile> points_;
  const std::shared_ptr<const Elements> elements_;
};

void add_surface(const ElementMesh& source, Mesh& mesh, FaceGroups& groups) {
  for (const auto& face : source.faces) {
    groups.add_face(groups.find_or_add(Kind::group, face.name), static_cast<FaceId>(mesh.face_sizes.size()));
    mesh.face_sizes.push_back(static_cast<std::uint32_t>(face.corners.size()));
    mesh.face_points.insert(mesh.face_points.end(), face.corners.begin(), face.corners.end());
  }
}

void add_boundary(const ElementMesh& source, Mesh& mesh, FaceGroups& groups) {
  BoundaryFaces boundary = boundary_faces(source.elements);
  std::map<std::vector<PointId>, FaceId> ids;
  std::size_t corner = 0;
  for (std::size_t f = 0; f < boundary.sizes.size(); ++f) {
    ids.emplace(face_key(std::span(boundary.points).subspan(corner, boundary.sizes[f])), static_cast<FaceId>(f));
    corner += boundary.sizes[f];
  }
  for (const auto& face : source.faces) {
    const std::size_t group = groups.find_or_add(Kind::group, face.name);
    if (const auto found = ids.find(face_key(face.corners)); found != ids.end()) {
      groups.add_face(group, found->second);
    } else {
      for (const PointId point : face.corners) groups.add_point(group, point);
    }
  }
  mesh.face_sizes = std::move(boundary.sizes);
  mesh.face_points = std::move(boundary.points);
}

void add_volumes(const ElementMesh& source, FaceGroups& groups) {
  if (std::set<std::string>(source.volume_names.begin(), source.volume_names.end()).size() < 2) return;
  for (std::size_t e = 0; e < source.elements.size(); ++e) {
    const std::size_t group = groups.find_or_add(Kind::cell_zone, source.volume_names[e]);
    for (const PointId point : source.elements.nodes(e)) groups.add_point(group, point);
  }
}

}  // namespace

std::unique_ptr<MeshFile> with_elements(ElementMesh&& source, const std::string& name,
                                        const std::function<std::unique_ptr<MeshFile>(std::shared_ptr<const Mesh>)>& make) {
  const auto mesh = std::make_shared<Mesh>();
  try {
    FaceGroups groups;
    if (source.elements.size() == 0) {
      add_surface(source, *mesh, groups);
    } else {
      add_boundary(source, *mesh, groups);
      add_volumes(source, groups);
    }
    mesh->groups = groups.finish();
    mesh->points = std::move(source.points);
    mesh->validate();
  } catch (const Error& error) {
    throw Error(error.code(), name + ": " + error.what());
  }
  if (source.elements.size() == 0) return make(mesh);
  return std::make_unique<ElementMeshFile>(make(mesh), std::make_shared<const Elements>(std::move(source.elements)));
}

}  // namespace deform::io
