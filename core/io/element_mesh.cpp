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

void append(const ElementMesh::Face& face, Mesh& mesh) {
  if (face.centre) {
    append_face(face.corners, *face.centre, mesh.face_sizes, mesh.face_points);
  } else {
    append_face(face.corners, mesh.face_sizes, mesh.face_points);
  }
}

void add_surface(const ElementMesh& source, Mesh& mesh, FaceGroups& groups) {
  for (const auto& face : source.faces) {
    const std::size_t group = groups.find_or_add(Kind::group, face.name), first = mesh.face_sizes.size();
    append(face, mesh);
    for (std::size_t f = first; f < mesh.face_sizes.size(); ++f) groups.add_face(group, static_cast<FaceId>(f));
  }
}

void add_boundary(const ElementMesh& source, Mesh& mesh, FaceGroups& groups) {
  BoundaryFaces boundary = boundary_faces(source.elements);
  std::map<std::vector<PointId>, std::size_t> sides;
  std::size_t corner = 0;
  for (std::size_t side = 0; side + 1 < boundary.sides.size(); ++side) {
    const std::size_t first = corner;
    for (FaceId f = boundary.sides[side]; f < boundary.sides[side + 1]; ++f) corner += boundary.sizes[f];
    sides.emplace(face_key(std::span(boundary.points).subspan(first, corner - first)), side);
  }
  for (const auto& face : source.faces) {
    const std::size_t group = groups.find_or_add(Kind::group, face.name);
    std::vector<PointId> nodes = face.corners;
    if (face.centre) nodes.push_back(*face.centre);
    if (const auto found = sides.find(face_key(nodes)); found != sides.end()) {
      for (FaceId f = boundary.sides[found->second]; f < boundary.sides[found->second + 1]; ++f) groups.add_face(group, f);
    } else {
      for (const PointId point : nodes) groups.add_point(group, point);
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

void add_point_sets(const ElementMesh& source, FaceGroups& groups) {
  for (const auto& set : source.point_sets) {
    const std::size_t group = groups.find_or_add(Kind::point_zone, set.name);
    for (const PointId point : set.points) groups.add_point(group, point);
  }
}

}  // namespace

void ElementMesh::add_face(std::span<const PointId> nodes, const std::string& name) {
  Face face{{nodes.begin(), nodes.end()}, name};
  if (nodes.size() >= 6) {
    const std::size_t n = nodes.size() == 6 ? 3 : 4;
    for (std::size_t c = 0; c < n; ++c) {
      face.corners[2 * c] = nodes[c];
      face.corners[2 * c + 1] = nodes[n + c];
    }
    face.corners.resize(2 * n);
    if (nodes.size() > 2 * n) face.centre = nodes[2 * n];
  }
  faces.push_back(std::move(face));
}

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
    add_point_sets(source, groups);
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
