// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 2.1.3 for volume meshes: one space deformation for points, surfaces, elements of every type and polyhedra.
#include <gtest/gtest.h>

#include <functional>

#include "core/deformers/system.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "tests/core/deformers/shapes.h"

namespace deform::representations_test {
namespace {

using Corner = std::array<std::size_t, 3>;

/// [0, 2] x [0, 1] x [0, 1] as a lattice of points, and blocks of 2 x 2 x 2 of its cells, which have a node in the middle of
/// every edge, face and in their middle.
class Lattice {
 public:
  static constexpr Corner cells{12, 6, 6};

  PointId at(const Corner& i) const { return static_cast<PointId>(i[0] + (cells[0] + 1) * (i[1] + (cells[1] + 1) * i[2])); }

  Points points() const {
    Points result;
    for (std::size_t k = 0; k <= cells[2]; ++k) {
      for (std::size_t j = 0; j <= cells[1]; ++j) {
        for (std::size_t i = 0; i <= cells[0]; ++i) {
          result.push_back({static_cast<double>(i) / 6.0, static_cast<double>(j) / 6.0, static_cast<double>(k) / 6.0});
        }
      }
    }
    return result;
  }

  void each_cell(std::size_t size, const std::function<void(const Corner&)>& visit) const {
    for (std::size_t k = 0; k < cells[2]; k += size) {
      for (std::size_t j = 0; j < cells[1]; j += size) {
        for (std::size_t i = 0; i < cells[0]; i += size) visit({i, j, k});
      }
    }
  }

  /// Corners of the cube of `size` cells at `from`, in the order of a hexahedron.
  std::array<PointId, 8> corners(const Corner& from, std::size_t size) const {
    std::array<PointId, 8> result{};
    for (std::size_t c = 0; c < 8; ++c) {
      const std::size_t x = c % 4 == 1 || c % 4 == 2, y = c % 4 >= 2, z = c >= 4;
      result[c] = at({from[0] + size * x, from[1] + size * y, from[2] + size * z});
    }
    return result;
  }

  PointId middle(PointId a, PointId b) const {
    Corner middle{};
    std::size_t x = a, y = b;
    for (std::size_t k = 0; k < 3; ++k) {
      middle[k] = (x % (cells[k] + 1) + y % (cells[k] + 1)) / 2;
      x /= cells[k] + 1;
      y /= cells[k] + 1;
    }
    return at(middle);
  }
};

const std::vector<std::vector<std::size_t>> tetrahedra = {{0, 1, 2, 6}, {0, 2, 3, 6}, {0, 3, 7, 6},
                                                          {0, 7, 4, 6}, {0, 4, 5, 6}, {0, 5, 1, 6}};
const std::vector<std::vector<std::size_t>> prisms = {{0, 1, 2, 4, 5, 6}, {0, 2, 3, 4, 6, 7}};
const std::vector<std::vector<std::size_t>> hexahedron = {{0, 1, 2, 3, 4, 5, 6, 7}};
/// Bases of pyramids with their apex in the middle of the cube (number 8), seen from inside counter-clockwise.
const std::vector<std::vector<std::size_t>> pyramids = {{0, 1, 2, 3, 8}, {4, 7, 6, 5, 8}, {0, 4, 5, 1, 8},
                                                        {1, 5, 6, 2, 8}, {2, 6, 7, 3, 8}, {3, 7, 4, 0, 8}};

/// Every cube of `size` cells cut into elements of a type with these corners; mid nodes of quadratic ones from the lattice.
Mesh elements(ElementType type, const std::vector<std::vector<std::size_t>>& parts, std::size_t size) {
  const Lattice lattice;
  Mesh mesh;
  mesh.points = lattice.points();
  auto cells = std::make_shared<Elements>();
  const ElementShape& form = shape(type);
  lattice.each_cell(size, [&](const Corner& from) {
    const auto corners = lattice.corners(from, size);
    for (const auto& part : parts) {
      std::vector<PointId> nodes;
      for (const std::size_t c : part) nodes.push_back(c < 8 ? corners[c] : lattice.middle(corners[0], corners[6]));
      if (form.quadratic()) {
        for (const auto& edge : form.edges) nodes.push_back(lattice.middle(nodes[edge[0]], nodes[edge[1]]));
      }
      cells->add(type, nodes);
    }
  });
  mesh.elements = cells;
  return mesh;
}

/// The cells of the lattice by their faces.
Mesh polyhedra() {
  const Lattice lattice;
  Mesh mesh;
  mesh.points = lattice.points();
  auto cells = std::make_shared<PolyhedralCells>();
  struct Face {
    std::array<PointId, 4> points;
    std::uint32_t owner, neighbour;
  };
  constexpr std::uint32_t none = 0xffffffff;
  std::vector<Face> inside, outside;
  const auto index = [&](const Corner& c) {
    return static_cast<std::uint32_t>(c[0] + Lattice::cells[0] * (c[1] + Lattice::cells[1] * c[2]));
  };
  const std::array<PointId, 4> sides[3][2] = {
      {{0, 3, 7, 4}, {1, 2, 6, 5}}, {{0, 4, 5, 1}, {3, 7, 6, 2}}, {{0, 1, 2, 3}, {4, 5, 6, 7}}};
  lattice.each_cell(1, [&](const Corner& from) {
    const auto corners = lattice.corners(from, 1);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t side = 0; side < 2; ++side) {
        std::array<PointId, 4> face{};
        for (std::size_t k = 0; k < 4; ++k) face[k] = corners[sides[axis][side][k]];
        if (side == 0) std::reverse(face.begin(), face.end());
        Corner next = from;
        if (side == 1) ++next[axis];
        if (side == 1 && next[axis] < Lattice::cells[axis]) {
          inside.push_back({face, index(from), index(next)});
        } else if (side == 1 || from[axis] == 0) {
          outside.push_back({face, index(from), none});
        }
      }
    }
  });
  inside.insert(inside.end(), outside.begin(), outside.end());
  for (const Face& face : inside) {
    cells->face_points.insert(cells->face_points.end(), face.points.begin(), face.points.end());
    cells->face_offsets.push_back(cells->face_points.size());
    cells->owner.push_back(face.owner);
    if (face.neighbour != none) cells->neighbour.push_back(face.neighbour);
  }
  cells->cell_count = Lattice::cells[0] * Lattice::cells[1] * Lattice::cells[2];
  mesh.cells = cells;
  return mesh;
}

/// Boundary of the hexahedra as quads, or as triangles.
Mesh surface(bool triangles) {
  const Mesh volume = elements(ElementType::hexahedron, hexahedron, 1);
  const BoundaryFaces faces = boundary_faces(*volume.elements);
  Mesh mesh;
  mesh.points = volume.points;
  for (std::size_t f = 0; f < faces.sizes.size(); ++f) {
    const PointId* q = faces.points.data() + 4 * f;
    if (triangles) {
      for (const PointId id : {q[0], q[1], q[2], q[0], q[2], q[3]}) mesh.face_points.push_back(id);
      mesh.face_sizes.insert(mesh.face_sizes.end(), {3, 3});
    } else {
      mesh.face_points.insert(mesh.face_points.end(), q, q + 4);
      mesh.face_sizes.push_back(4);
    }
  }
  return mesh;
}

TEST(Representations, VolumesOfEveryElementType) {
  std::vector<std::pair<const char*, Mesh>> meshes;
  Mesh cloud;
  cloud.points = Lattice().points();
  meshes.emplace_back("points", cloud);
  meshes.emplace_back("quads", surface(false));
  meshes.emplace_back("triangles", surface(true));
  meshes.emplace_back("polyhedra", polyhedra());
  const struct {
    ElementType type;
    const std::vector<std::vector<std::size_t>>& parts;
    std::size_t size;
  } kinds[] = {{ElementType::tetrahedron, tetrahedra, 1},   {ElementType::prism, prisms, 1},
               {ElementType::hexahedron, hexahedron, 1},    {ElementType::pyramid, pyramids, 2},
               {ElementType::tetrahedron10, tetrahedra, 2}, {ElementType::prism15, prisms, 2},
               {ElementType::hexahedron20, hexahedron, 2}};
  for (const auto& kind : kinds) meshes.emplace_back(shape(kind.type).name, elements(kind.type, kind.parts, kind.size));

  deform::Setup setup = test::sheet_setup();
  RbfOptions options;
  options.reduction = CentreReduction::off;  // which looks at the faces
  setup.method = options;
  const Design design{{}, {{0, test::turn_and_shift()}}};
  Points expected;
  for (const auto& [name, mesh] : meshes) {
    ASSERT_NO_THROW(mesh.validate()) << name;
    const auto kept = test::shared(mesh);
    const Points got = prepare(kept, setup)->evaluate(design);
    if (expected.empty()) expected = got;
    EXPECT_TRUE(got == expected) << name;
    EXPECT_EQ(kept->face_points, mesh.face_points) << name;
    EXPECT_TRUE(kept->points == mesh.points) << name;
  }
  EXPECT_GT(test::distance(expected, cloud.points), 0.1);
}

}  // namespace
}  // namespace deform::representations_test
