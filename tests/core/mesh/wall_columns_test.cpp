// SPDX-License-Identifier: GPL-3.0-or-later
// Columns of cells on walls: every kind of cell that stands on a face, by its nodes and by its faces, and what ends a column.
#include "core/mesh/wall_columns.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <numeric>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "tests/core/mesh/polyhedral.h"
#include "tests/core/mesh/straight_elements.h"
#include "tests/support/expect_error.h"

namespace deform::wall_columns_test {
namespace {

using testing::UnorderedElementsAreArray;
using Columns = std::vector<std::vector<PointId>>;

Mesh mesh_of(Elements elements) {
  Mesh mesh;
  mesh.points.resize(1 + *std::max_element(elements.points.begin(), elements.points.end()));
  mesh.elements = std::make_shared<const Elements>(std::move(elements));
  return mesh;
}

Mesh by_its_faces(const Mesh& mesh) {
  Mesh other;
  other.points = mesh.points;
  other.cells = std::make_shared<const PolyhedralCells>(test::by_faces(*mesh.elements));
  return other;
}

/// One cell by its faces, which are all boundary.
Mesh one_cell(const std::vector<std::vector<PointId>>& faces) {
  PolyhedralCells cells;
  cells.cell_count = 1;
  Mesh mesh;
  for (const auto& face : faces) {
    cells.face_points.insert(cells.face_points.end(), face.begin(), face.end());
    cells.face_offsets.push_back(cells.face_points.size());
    cells.owner.push_back(0);
    for (const PointId p : face) mesh.points.resize(std::max<std::size_t>(mesh.points.size(), p + 1));
  }
  mesh.cells = std::make_shared<const PolyhedralCells>(std::move(cells));
  return mesh;
}

std::vector<PointId> first_ids(std::size_t n) {
  std::vector<PointId> ids(n);
  std::iota(ids.begin(), ids.end(), 0u);
  return ids;
}

/// side x side columns of `layers` cells; level k has the points [k, k + 1) * (side + 1)^2.
struct Block {
  std::uint32_t side = 3;
  Mesh mesh;

  std::uint32_t level() const { return (side + 1) * (side + 1); }
  PointId at(std::uint32_t i, std::uint32_t j, std::uint32_t k) const { return i + (side + 1) * j + level() * k; }
  std::vector<PointId> bottom() const { return first_ids(level()); }

  /// The columns, whose bases are the quads or their halves.
  Columns columns(ElementType type, std::uint32_t layers) const {
    Columns all;
    const auto add = [&](const std::vector<PointId>& base) {
      std::vector<PointId> column;
      for (std::uint32_t k = 0; k <= layers; ++k) {
        for (const PointId p : base) column.push_back(p + level() * k);
      }
      std::sort(column.begin(), column.end());
      all.push_back(column);
    };
    for (std::uint32_t j = 0; j < side; ++j) {
      for (std::uint32_t i = 0; i < side; ++i) {
        const PointId a = at(i, j, 0), b = at(i + 1, j, 0), c = at(i + 1, j + 1, 0), d = at(i, j + 1, 0);
        if (type == ElementType::hexahedron) {
          add({a, b, c, d});
        } else {
          add({a, b, c});
          add({a, c, d});
        }
      }
    }
    return all;
  }
};

/// Layers of `type`, and above them as many layers of tetrahedra (on prisms) or one of pyramids (on hexahedra).
Block block(ElementType type, std::uint32_t layers, std::uint32_t soft = 0) {
  Block block;
  Elements elements;
  PointId apex = block.level() * (layers + 1);
  const auto add = [&](ElementType t, std::vector<PointId> nodes) { elements.add(t, nodes); };
  for (std::uint32_t k = 0; k < layers + soft; ++k) {
    for (std::uint32_t j = 0; j < block.side; ++j) {
      for (std::uint32_t i = 0; i < block.side; ++i) {
        const PointId a = block.at(i, j, k), b = block.at(i + 1, j, k), c = block.at(i + 1, j + 1, k), d = block.at(i, j + 1, k);
        const PointId up = block.level();
        if (type == ElementType::hexahedron) {
          if (k < layers) {
            add(type, {a, b, c, d, a + up, b + up, c + up, d + up});
          } else {
            add(ElementType::pyramid, {a, b, c, d, apex++});
          }
          continue;
        }
        for (const auto& [p, q, r] : {std::array{a, b, c}, std::array{a, c, d}}) {
          if (k < layers) {
            add(type, {p, q, r, p + up, q + up, r + up});
          } else {
            add(ElementType::tetrahedron, {p, q, r, r + up});
            add(ElementType::tetrahedron, {p, q, r + up, q + up});
            add(ElementType::tetrahedron, {p, q + up, r + up, p + up});
          }
        }
      }
    }
  }
  block.mesh = mesh_of(std::move(elements));
  return block;
}

TEST(WallColumns, StandOnEveryFaceOfTheBottom) {
  for (const ElementType type : {ElementType::hexahedron, ElementType::prism}) {
    const Block b = block(type, 4);
    for (const Mesh& mesh : {b.mesh, by_its_faces(b.mesh)}) {
      SCOPED_TRACE(std::string(shape(type).name) + (mesh.elements ? " by nodes" : " by faces"));
      for (const int layers : {1, 2, 4}) {
        const WallColumns walls = wall_columns(mesh, b.bottom(), layers);
        EXPECT_THAT(walls.points, UnorderedElementsAreArray(b.columns(type, static_cast<std::uint32_t>(layers))));
        EXPECT_EQ(walls.faces, walls.points.size());
        ASSERT_EQ(walls.stacks.size(), walls.points.size());
        for (std::size_t c = 0; c < walls.stacks.size(); ++c) {
          const WallColumns::Stack& stack = walls.stacks[c];
          EXPECT_EQ(stack.sides, type == ElementType::hexahedron ? 4u : 3u);
          EXPECT_EQ(stack.layers(), static_cast<std::size_t>(layers));
          for (std::size_t i = 0; i < stack.corners.size(); ++i) {
            EXPECT_EQ(stack.corners[i], stack.corners[i % stack.sides] + b.level() * (i / stack.sides)) << "above the first";
          }
          EXPECT_THAT(stack.corners, UnorderedElementsAreArray(walls.points[c]));
        }
        EXPECT_EQ(walls.shorter, 0u);
        EXPECT_EQ(walls.bare, 0u);
      }
      const WallColumns through = wall_columns(mesh, b.bottom(), most_wall_layers);
      EXPECT_THAT(through.points, UnorderedElementsAreArray(b.columns(type, 4))) << "up to the wall across";
      EXPECT_EQ(through.shorter, through.faces);
    }
  }
}

TEST(WallColumns, EndWhereTheNextCellIsOfAnotherKind) {
  for (const ElementType type : {ElementType::hexahedron, ElementType::prism}) {
    const Block b = block(type, 2, type == ElementType::prism ? 2 : 1);
    for (const Mesh& mesh : {b.mesh, by_its_faces(b.mesh)}) {
      SCOPED_TRACE(std::string(shape(type).name) + (mesh.elements ? " by nodes" : " by faces"));
      const WallColumns two = wall_columns(mesh, b.bottom(), 2);
      EXPECT_THAT(two.points, UnorderedElementsAreArray(b.columns(type, 2)));
      EXPECT_EQ(two.shorter, 0u);
      const WallColumns three = wall_columns(mesh, b.bottom(), 3);
      EXPECT_EQ(three.points, two.points);
      EXPECT_EQ(three.shorter, three.faces);
    }
  }
}

TEST(WallColumns, OnlyFacesWithAllCornersInTheSet) {
  const Block b = block(ElementType::hexahedron, 2);
  std::vector<PointId> left;  // all but one corner of the second row of faces
  for (std::uint32_t j = 0; j <= 3; ++j) left.insert(left.end(), {b.at(1, j, 0), b.at(0, j, 0)});
  left.insert(left.end(), {b.at(2, 0, 0), b.at(0, 0, 0)});
  for (const Mesh& mesh : {b.mesh, by_its_faces(b.mesh)}) {
    const WallColumns walls = wall_columns(mesh, left, 2);
    EXPECT_EQ(walls.faces, 3u);
    ASSERT_EQ(walls.points.size(), 3u);
    EXPECT_THAT(b.columns(ElementType::hexahedron, 2), testing::IsSupersetOf(walls.points));
  }
  const std::vector<PointId> all = first_ids(b.mesh.point_count());
  for (const Mesh& mesh : {b.mesh, by_its_faces(b.mesh)}) {
    const WallColumns walls = wall_columns(mesh, all, 2);
    EXPECT_EQ(walls.faces, 2 * 9u + 4 * 6u) << "the whole boundary, and nothing inside";
    EXPECT_EQ(walls.points.size(), walls.faces);
    EXPECT_EQ(walls.shorter, 0u);
  }
}

/// `count` copies of a straight element on top of each other, common nodes merged.
Mesh tower(ElementType type, int count) {
  Mesh mesh;
  Elements elements;
  std::map<Vec3, PointId> ids;
  for (int k = 0; k < count; ++k) {
    std::vector<PointId> nodes;
    for (Vec3 p : straight_elements().at(type)) {
      p[2] += 2 * k;
      const auto [entry, added] = ids.try_emplace(p, static_cast<PointId>(mesh.points.size()));
      if (added) mesh.points.push_back(p);
      nodes.push_back(entry->second);
    }
    elements.add(type, nodes);
  }
  mesh.elements = std::make_shared<const Elements>(std::move(elements));
  return mesh;
}

TEST(WallColumns, HaveAllNodesOfEveryTypeThatStands) {
  for (const ElementType type : {ElementType::prism, ElementType::hexahedron, ElementType::prism15, ElementType::prism18,
                                 ElementType::hexahedron20, ElementType::hexahedron27}) {
    SCOPED_TRACE(shape(type).name);
    const Mesh mesh = tower(type, 3);
    const auto below = [&](double height) {
      std::vector<PointId> ids;
      for (PointId p = 0; p < mesh.point_count(); ++p) {
        if (mesh.points[p][2] <= height) ids.push_back(p);
      }
      return ids;
    };
    for (const int layers : {1, 2, 3}) EXPECT_EQ(wall_columns(mesh, below(0), layers).points, Columns{below(2 * layers)});
    const std::size_t corners = shape(type).corners / 2;
    EXPECT_EQ(wall_columns(mesh, first_ids(corners), 2).points, Columns{below(4)}) << "corners are enough";
  }
}

TEST(WallColumns, CountsFacesThatCarryNothing) {
  Elements elements;
  elements.add(ElementType::prism, std::vector<PointId>{0, 1, 2, 3, 4, 5});
  elements.add(ElementType::tetrahedron, std::vector<PointId>{6, 7, 8, 9});
  elements.add(ElementType::prism, std::vector<PointId>{10, 11, 12, 13, 14, 15});
  const std::vector<PointId> set{0, 1, 2, 6, 7, 8, 10, 11, 13, 14};  // of the second prism a quad
  const Mesh mesh = mesh_of(std::move(elements));
  for (const Mesh& either : {mesh, by_its_faces(mesh)}) {
    const WallColumns walls = wall_columns(either, set, 3);
    EXPECT_EQ(walls.points, Columns({{0, 1, 2, 3, 4, 5}}));
    EXPECT_EQ(walls.faces, 3u);
    EXPECT_EQ(walls.bare, 2u);
    EXPECT_EQ(walls.shorter, 1u);
  }
}

/// Hexagonal prisms on top of each other, points 6 k .. 6 k + 5 at level k; of the cell `split` a side is two triangles.
Mesh hexagonal(std::uint32_t layers, std::uint32_t split) {
  PolyhedralCells cells;
  cells.cell_count = layers;
  const auto add = [&](std::vector<PointId> corners, std::uint32_t owner) {
    cells.face_points.insert(cells.face_points.end(), corners.begin(), corners.end());
    cells.face_offsets.push_back(cells.face_points.size());
    cells.owner.push_back(owner);
  };
  const auto ring = [&](std::uint32_t k, std::uint32_t turned) {
    std::vector<PointId> corners;
    for (std::uint32_t i = 0; i < 6; ++i) corners.push_back(6 * k + (i + turned) % 6);
    return corners;
  };
  for (std::uint32_t k = 1; k < layers; ++k) {
    add(ring(k, k), k - 1);  // wherever a face begins
    cells.neighbour.push_back(k);
  }
  auto bottom = ring(0, 2);
  std::reverse(bottom.begin(), bottom.end());
  add(bottom, 0);
  add(ring(layers, 5), layers - 1);
  for (std::uint32_t k = 0; k < layers; ++k) {
    for (std::uint32_t i = 0; i < 6; ++i) {
      const PointId a = 6 * k + i, b = 6 * k + (i + 1) % 6;
      if (k == split && i == 4) {
        add({a, b, b + 6}, k);
        add({a, b + 6, a + 6}, k);
      } else {
        add(i % 2 == 0 ? std::vector<PointId>{a, b, b + 6, a + 6} : std::vector<PointId>{b + 6, a + 6, a, b}, k);
      }
    }
  }
  Mesh mesh;
  mesh.points.resize(6 * (std::size_t{layers} + 1));
  mesh.cells = std::make_shared<const PolyhedralCells>(std::move(cells));
  return mesh;
}

TEST(WallColumns, PolyhedraStandOnAnyPolygon) {
  const auto walls = wall_columns(hexagonal(4, 99), first_ids(6), 3);
  EXPECT_EQ(walls.points, Columns{first_ids(24)});
  EXPECT_EQ(walls.shorter, 0u);
  const auto shorter = wall_columns(hexagonal(4, 2), first_ids(6), 3);
  EXPECT_EQ(shorter.points, Columns{first_ids(18)}) << "the third cell has one face too many";
  EXPECT_EQ(shorter.shorter, 1u);
}

TEST(WallColumns, FacesThatDoNotJoinAreNoPrism) {
  const std::vector<std::vector<PointId>> cube{{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                               {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
  const auto stands = [](const std::vector<std::vector<PointId>>& faces) {
    try {
      return wall_columns(one_cell(faces), first_ids(4), 1).points.size() == 1;
    } catch (const Error&) {
      return false;
    }
  };
  EXPECT_TRUE(stands(cube));
  const auto changed = [&](std::size_t face, const std::vector<PointId>& corners) {
    auto faces = cube;
    faces[face] = corners;
    return faces;
  };
  EXPECT_FALSE(stands(changed(1, {4, 6, 5, 7}))) << "top crossed over";
  EXPECT_FALSE(stands(changed(1, {4, 5, 6, 6}))) << "a corner twice";
  EXPECT_FALSE(stands(changed(1, {4, 5, 6, 2}))) << "the opposite face touches the base";
  EXPECT_FALSE(stands(changed(3, {0, 1, 5, 4}))) << "a side twice";
  EXPECT_FALSE(stands(changed(3, {1, 2, 5, 6}))) << "a side crossed over";
  EXPECT_FALSE(stands(changed(3, {1, 6, 2, 5}))) << "a side along diagonals";
  EXPECT_FALSE(stands(changed(3, {1, 2, 6, 8}))) << "a point of its own";
  EXPECT_FALSE(stands(changed(3, {1, 2, 6}))) << "a triangle";
  EXPECT_FALSE(stands({cube.begin(), cube.end() - 1})) << "open";
}

TEST(WallColumns, RefusesWhatHasNoLayers) {
  const Block b = block(ElementType::hexahedron, 2);
  const auto expect = [](const std::vector<const char*>& parts, const std::function<void()>& action) {
    test::expect_error(ErrorCode::invalid_argument, parts, action);
  };
  Mesh surface;
  surface.points.resize(4);
  expect({"constraints[2].rigid.layers", "no cells"}, [&] { wall_columns(surface, first_ids(3), 1, "constraints[2].rigid"); });
  expect({"wall.layers", "0", "1..1000"}, [&] { wall_columns(b.mesh, b.bottom(), 0); });
  expect({"wall.layers", "1001", "1..1000"}, [&] { wall_columns(b.mesh, b.bottom(), 1001); });
  expect({"point 4711", "48"}, [&] { wall_columns(b.mesh, std::vector<PointId>{4711}, 1); });
  const std::vector<PointId> diagonal{b.at(0, 0, 0), b.at(1, 1, 0)}, none;
  const std::vector<PointId> inside{b.at(1, 1, 1), b.at(2, 1, 1), b.at(2, 2, 1), b.at(1, 2, 1)};
  for (const Mesh& mesh : {b.mesh, by_its_faces(b.mesh)}) {
    for (const auto& set : {none, diagonal, inside}) {
      expect({"wall: no face", "all its corners"}, [&] { wall_columns(mesh, set, 1); });
    }
  }
  const Block soft = block(ElementType::prism, 0, 2);
  for (const Mesh& mesh : {soft.mesh, by_its_faces(soft.mesh)}) {
    expect({"wall: no prism or hexahedron", "18 faces"}, [&] { wall_columns(mesh, soft.bottom(), 1); });
  }
}

}  // namespace
}  // namespace deform::wall_columns_test
