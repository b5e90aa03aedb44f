// SPDX-License-Identifier: GPL-3.0-or-later
// First layers of known height and slant, as polyhedra and as elements.
#include "core/quality/wall_quality.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>

#include "core/quality/boundary_owners.h"
#include "core/quality/element_quality.h"
#include "core/quality/polyhedral_quality.h"
#include "tests/support/expect_error.h"

namespace deform::wall_quality_test {
namespace {

constexpr double degrees = 180 / std::numbers::pi;

/// Layers of columns x columns hexahedra above z = 0; layer k begins at heights[k]. Element type and what the base is cut into
/// differ.
struct Block {
  Mesh mesh;
  Elements elements;
  std::vector<FaceId> bottom, side;
};

template <typename Place>
Block block(std::uint32_t columns, const std::vector<double>& heights, ElementType type, const Place& place) {
  Block block;
  const std::uint32_t n = columns + 1;
  for (const double z : heights) {
    for (std::uint32_t j = 0; j < n; ++j) {
      for (std::uint32_t i = 0; i < n; ++i) block.mesh.points.push_back(place(double(i), double(j), z));
    }
  }
  const auto id = [&](std::uint32_t i, std::uint32_t j, std::size_t k) { return static_cast<PointId>(i + n * (j + n * k)); };
  const auto add = [&](ElementType t, std::initializer_list<PointId> nodes) {
    block.elements.add(t, std::vector<PointId>(nodes));
  };
  for (std::size_t k = 0; k + 1 < heights.size(); ++k) {
    for (std::uint32_t j = 0; j < columns; ++j) {
      for (std::uint32_t i = 0; i < columns; ++i) {
        const PointId a = id(i, j, k), b = id(i + 1, j, k), c = id(i + 1, j + 1, k), d = id(i, j + 1, k);
        const PointId e = id(i, j, k + 1), f = id(i + 1, j, k + 1), g = id(i + 1, j + 1, k + 1), h = id(i, j + 1, k + 1);
        if (type == ElementType::hexahedron) {
          add(type, {a, b, c, d, e, f, g, h});
        } else if (type == ElementType::prism) {
          add(type, {a, b, c, e, f, g});
          add(type, {a, c, d, e, g, h});
        } else {  // six tetrahedra around the diagonal a-g
          add(type, {a, b, c, g});
          add(type, {a, c, d, g});
          add(type, {a, d, h, g});
          add(type, {a, h, e, g});
          add(type, {a, e, f, g});
          add(type, {a, f, b, g});
        }
      }
    }
  }
  const BoundaryFaces faces = boundary_faces(block.elements);
  block.mesh.face_sizes = faces.sizes;
  block.mesh.face_points = faces.points;
  const auto offsets = block.mesh.face_offsets();
  for (FaceId f = 0; f < block.mesh.face_count(); ++f) {
    const auto on = [&](const auto& test) {
      for (std::uint64_t c = offsets[f]; c < offsets[f + 1]; ++c) {
        if (!test(block.mesh.face_points[c])) return false;
      }
      return true;
    };
    if (on([&](PointId p) { return p < n * n; })) block.bottom.push_back(f);
    if (on([&](PointId p) { return p % n == 0; })) block.side.push_back(f);
  }
  return block;
}

const auto straight = [](double x, double y, double z) { return Vec3{x, y, z}; };

WallQuality quality_of(const Block& block, std::span<const FaceId> wall) {
  const ElementQuality q = element_quality(block.mesh.points, block.elements);
  return wall_quality({block.mesh, wall, q.volume}, block.elements);
}

TEST(WallQuality, HeightsOfLayers) {
  for (const ElementType type : {ElementType::hexahedron, ElementType::prism, ElementType::tetrahedron}) {
    SCOPED_TRACE(shape(type).name);
    const Block b = block(4, {0, 0.01, 0.5}, type, straight);
    const WallQuality q = quality_of(b, b.bottom);
    EXPECT_EQ(q.faces, type == ElementType::hexahedron ? 16u : 32u);
    EXPECT_NEAR(q.least_height.value, 0.01, 1e-14);
    EXPECT_NEAR(q.largest_height.value, 0.01, 1e-14);
    EXPECT_NEAR(q.average_height, 0.01, 1e-14);
    EXPECT_GE(q.points, 24u) << "every point of the bottom, but for tetrahedra two corners";
    EXPECT_NEAR(q.least_angle.value, 0, 1e-9);
  }
}

TEST(WallQuality, NamesTheThinnest) {
  Block b = block(4, {0, 0.01, 0.5}, ElementType::hexahedron, straight);
  for (const PointId p : {25u + 12, 25u + 13, 25u + 17, 25u + 18}) b.mesh.points[p][2] = 0.004;  // above cell (2, 2)
  const WallQuality q = quality_of(b, b.bottom);
  EXPECT_NEAR(q.least_height.value, 0.004, 1e-14);
  EXPECT_EQ(boundary_owners(b.mesh, b.elements)[q.least_height.id].cell, 2 + 4 * 2u);
  EXPECT_NEAR(q.largest_height.value, 0.01, 1e-14);
  EXPECT_LT(q.average_height, 0.01);
}

TEST(WallQuality, AnglesOfAShearedLayer) {
  for (const double slope : {0.0, 0.5, 2.0}) {
    const Block b = block(4, {0, 0.1, 1}, ElementType::hexahedron, [&](double x, double y, double z) {
      return Vec3{x + slope * z, y, z};
    });
    const WallQuality q = quality_of(b, b.bottom);
    EXPECT_EQ(q.points, 25u);
    EXPECT_NEAR(q.least_angle.value, std::atan(slope) * degrees, 1e-9);
    EXPECT_NEAR(q.largest_angle.value, std::atan(slope) * degrees, 1e-9);
    EXPECT_NEAR(q.average_angle, std::atan(slope) * degrees, 1e-9);
    EXPECT_NEAR(q.least_height.value, 0.1, 1e-13) << "shear keeps volumes";
  }
}

TEST(WallQuality, InvertedLayersAreNegative) {
  const Block b = block(2, {0, -0.1, 1}, ElementType::prism, straight);
  const WallQuality q = quality_of(b, b.bottom);
  EXPECT_NEAR(q.least_height.value, -0.1, 1e-14);
  EXPECT_NEAR(q.largest_angle.value, 180, 1e-9);
}

// In the corner between two walls no edge leaves both; the points of the corner have no angle.
TEST(WallQuality, TwoWalls) {
  const Block b = block(3, {0, 1, 2, 3}, ElementType::hexahedron, straight);
  std::vector<FaceId> both = b.bottom;
  both.insert(both.end(), b.side.begin(), b.side.end());
  const WallQuality q = quality_of(b, both);
  EXPECT_EQ(q.faces, 18u);
  EXPECT_EQ(q.points, 2 * 12u);
  EXPECT_NEAR(q.largest_angle.value, 0, 1e-9);
}

// The 27-node hexahedron shows four faces for a side; they are one wall face.
TEST(WallQuality, QuadraticSidesAreOneFace) {
  Mesh mesh;
  Elements elements;
  std::vector<PointId> nodes(27);
  std::iota(nodes.begin(), nodes.end(), 0u);
  elements.add(ElementType::hexahedron27, nodes);
  const ElementShape& form = shape(ElementType::hexahedron27);
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 0.2}, {1, 0, 0.2}, {1, 1, 0.2}, {0, 1, 0.2}};
  mesh.points.resize(27);
  const auto mean = [&](const std::vector<std::uint8_t>& of) {
    Vec3 sum{};
    for (const auto p : of) {
      for (int k = 0; k < 3; ++k) sum[k] += mesh.points[p][k] / static_cast<double>(of.size());
    }
    return sum;
  };
  for (std::size_t i = 0; i < form.edges.size(); ++i) mesh.points[8 + i] = mean({form.edges[i][0], form.edges[i][1]});
  for (std::size_t f = 0; f < 6; ++f) {
    const auto& around = form.faces[f];
    mesh.points[form.face_centre(f)] = mean({around[0], around[2], around[4], around[6]});
  }
  mesh.points[26] = mean({0, 1, 2, 3, 4, 5, 6, 7});
  const BoundaryFaces faces = boundary_faces(elements);
  mesh.face_sizes = faces.sizes;
  mesh.face_points = faces.points;
  ASSERT_EQ(mesh.face_count(), 24u);
  const ElementQuality q = element_quality(mesh.points, elements);
  const std::vector<FaceId> bottom{0, 1, 2, 3};  // of the first side, 0321
  const WallQuality wall = wall_quality({mesh, bottom, q.volume}, elements);
  EXPECT_EQ(wall.faces, 1u);
  EXPECT_NEAR(wall.least_height.value, 0.2, 1e-14);
  EXPECT_EQ(wall.points, 4u);
  EXPECT_NEAR(wall.largest_angle.value, 0, 1e-9);
}

/// A tetrahedron and a cube, by their faces.
TEST(WallQuality, PolyhedralCells) {
  const auto closed = [](std::size_t points, const std::vector<std::vector<PointId>>& faces) {
    PolyhedralCells cells;
    cells.cell_count = 1;
    for (const auto& face : faces) {
      cells.face_points.insert(cells.face_points.end(), face.begin(), face.end());
      cells.face_offsets.push_back(cells.face_points.size());
      cells.owner.push_back(0);
    }
    Mesh mesh;
    mesh.points.resize(points);
    for (const auto& face : faces) {
      mesh.face_sizes.push_back(static_cast<std::uint32_t>(face.size()));
      mesh.face_points.insert(mesh.face_points.end(), face.begin(), face.end());
    }
    return std::pair(mesh, cells);
  };
  auto [tetrahedron, tetrahedral] = closed(4, {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}});
  tetrahedron.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0.2, 0.2, 0.3}};
  auto [cube, cubic] = closed(8, {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}});
  cube.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.1, 0, 0.3}, {1.1, 0, 0.3}, {1.1, 1, 0.3}, {0.1, 1, 0.3}};
  const std::vector<FaceId> bottom{0};
  for (const auto& [mesh, cells] : {std::pair(tetrahedron, tetrahedral), std::pair(cube, cubic)}) {
    const PolyhedralQuality q = polyhedral_quality(mesh.points, cells);
    const WallQuality wall = wall_quality({mesh, bottom, q.cell_volume}, cells);
    EXPECT_NEAR(wall.least_height.value, 0.3, 1e-14) << "the distance of the apex, or of the opposite face";
    EXPECT_EQ(wall.points, mesh.point_count() == 4 ? 3u : 4u);
    const double steepest = mesh.point_count() == 8 ? 1.0 / 3 : std::hypot(0.8, 0.2) / 0.3;
    EXPECT_NEAR(wall.largest_angle.value, std::atan(steepest) * degrees, 1e-9);
  }
}

TEST(WallQuality, Refuses) {
  const Block b = block(2, {0, 1}, ElementType::hexahedron, straight);
  const std::vector<double> volumes(4, 1);
  const auto expect = [](std::vector<const char*> parts, const auto& action) {
    test::expect_error(ErrorCode::invalid_argument, parts, action);
  };
  const std::vector<FaceId> none, beyond{99};
  expect({"no faces"}, [&] { wall_quality({b.mesh, none, volumes}, b.elements); });
  expect({"face 99", "16"}, [&] { wall_quality({b.mesh, beyond, volumes}, b.elements); });
  expect({"3 volumes", "4 cells"}, [&] { wall_quality({b.mesh, b.bottom, std::span(volumes).first(3)}, b.elements); });
  Mesh flat = b.mesh;
  for (Vec3& p : flat.points) p = {0, 0, p[2]};
  expect({"area"}, [&] { wall_quality({flat, b.bottom, volumes}, b.elements); });
  Mesh other = b.mesh;
  std::swap(other.face_points[0], other.face_points[20]);
  expect({"faces[", "no element"}, [&] { boundary_owners(other, b.elements); });
}

}  // namespace
}  // namespace deform::wall_quality_test
