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
  std::vector<FilePart> parts_with_points(std::span<const Vec3> points) const override {
    return points_->parts_with_points(points);
  }

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

/// Where the surface elements are in the mesh: faces `first` .. `end`, or no faces.
struct Place {
  FaceId first = 0, end = 0;
};

std::vector<Place> add_surface(const ElementMesh& source, Mesh& mesh) {
  std::vector<Place> places;
  for (const auto& face : source.faces) {
    const auto first = static_cast<FaceId>(mesh.face_sizes.size());
    append(face, mesh);
    places.push_back({first, static_cast<FaceId>(mesh.face_sizes.size())});
  }
  return places;
}

std::vector<PointId> nodes_of(const ElementMesh::Face& face) {
  std::vector<PointId> nodes = face.corners;
  if (face.centre) nodes.push_back(*face.centre);
  return nodes;
}

std::vector<Place> add_boundary(const ElementMesh& source, Mesh& mesh) {
  BoundaryFaces boundary = boundary_faces(source.elements);
  std::map<std::vector<PointId>, std::size_t> sides;
  std::size_t corner = 0;
  for (std::size_t side = 0; side + 1 < boundary.sides.size(); ++side) {
    const std::size_t first = corner;
    for (FaceId f = boundary.sides[side]; f < boundary.sides[side + 1]; ++f) corner += boundary.sizes[f];
    sides.emplace(face_key(std::span(boundary.points).subspan(first, corner - first)), side);
  }
  std::vector<Place> places;
  for (const auto& face : source.faces) {
    const auto found = sides.find(face_key(nodes_of(face)));
    places.push_back(found == sides.end() ? Place{} : Place{boundary.sides[found->second], boundary.sides[found->second + 1]});
  }
  mesh.face_sizes = std::move(boundary.sizes);
  mesh.face_points = std::move(boundary.points);
  return places;
}

void add_to_group(const ElementMesh::Face& face, const Place& place, std::size_t group, FaceGroups& groups) {
  for (FaceId f = place.first; f < place.end; ++f) groups.add_face(group, f);
  if (place.first != place.end) return;
  for (const PointId point : nodes_of(face)) groups.add_point(group, point);
}

void add_faces(const ElementMesh& source, const std::vector<Place>& places, FaceGroups& groups) {
  for (std::size_t f = 0; f < source.faces.size(); ++f) {
    if (source.faces[f].name.empty()) continue;
    add_to_group(source.faces[f], places[f], groups.find_or_add(Kind::group, source.faces[f].name), groups);
  }
}

void add_volumes(const ElementMesh& source, FaceGroups& groups) {
  if (std::set<std::string>(source.volume_names.begin(), source.volume_names.end()).size() < 2) return;
  for (std::size_t e = 0; e < source.elements.size(); ++e) {
    const std::size_t group = groups.find_or_add(Kind::cell_zone, source.volume_names[e]);
    for (const PointId point : source.elements.nodes(e)) groups.add_point(group, point);
  }
}

void add_sets(const ElementMesh& source, const std::vector<Place>& places, FaceGroups& groups) {
  for (const auto& set : source.point_sets) {
    const std::size_t group = groups.find_or_add(set.kind, set.name);
    for (const PointId point : set.points) groups.add_point(group, point);
    for (const std::uint32_t face : set.faces) add_to_group(source.faces[face], places[face], group, groups);
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
    const auto places = source.elements.size() == 0 ? add_surface(source, *mesh) : add_boundary(source, *mesh);
    add_faces(source, places, groups);
    add_volumes(source, groups);
    add_sets(source, places, groups);
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
