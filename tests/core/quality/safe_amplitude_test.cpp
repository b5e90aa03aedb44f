// SPDX-License-Identifier: GPL-3.0-or-later
// Amplitudes that are known, and many that are not, against dense sampling of the way by independent measures.
#include "core/quality/safe_amplitude.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>

#include "core/base/vectors.h"
#include "core/quality/element_quality.h"
#include "core/quality/moving_cells.h"
#include "core/quality/polyhedral_quality.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/quality/cell_shapes.h"
#include "tests/support/expect_error.h"

namespace deform::safe_amplitude_test {
namespace {

using namespace test;

std::vector<ElementType> all_types() {
  std::vector<ElementType> all;
  for (std::size_t i = 0; i < element_types; ++i) all.push_back(static_cast<ElementType>(i));
  return all;
}

Points mapped(Points points, const std::function<Vec3(const Vec3&)>& map) {
  for (Vec3& p : points) p = map(p);
  return points;
}

Points between(const Points& X, const Points& Y, double s) {
  Points result(X.size());
  for (std::size_t i = 0; i < X.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[i][k] = X[i][k] + s * (Y[i][k] - X[i][k]);
  }
  return result;
}

TEST(SafeAmplitude, NodeThroughTheOppositeFace) {
  const Elements tetrahedron = one(ElementType::tetrahedron);
  const Points X = reference(ElementType::tetrahedron);
  for (const std::size_t node : {0u, 1u, 2u, 3u}) {
    Points Y = X;
    Vec3 foot{};
    for (std::size_t other = 0; other < 4; ++other) {
      for (std::size_t k = 0; k < 3; ++k) foot[k] += other == node ? 0 : X[other][k] / 3;
    }
    for (std::size_t k = 0; k < 3; ++k) Y[node][k] = 2 * foot[k] - X[node][k];
    const MotionSafety found = safe_amplitude(X, Y, &tetrahedron);
    EXPECT_NEAR(found.amplitude, 0.5, 1e-13);
    EXPECT_LE(found.amplitude, 0.5);
    EXPECT_EQ(found.first_cell, std::optional<std::size_t>(0));
    EXPECT_EQ(found.inverted.count, 1u);
    ASSERT_EQ(found.inverted.worst.size(), 1u);
    EXPECT_EQ(found.inverted.worst[0].value, element_quality(Y, tetrahedron).least_scaled_jacobian.value);
    EXPECT_EQ(found.inverted.least_determinant.value, found.inverted.worst[0].value);
    EXPECT_EQ(found.at_rest.count, 0u);
  }
}

// Every corner and node sees the same affine map: its determinant is 1 - s, (1 - 2 s)^k or 1.
TEST(SafeAmplitude, AffineMotionsOfEveryType) {
  for (const ElementType type : all_types()) {
    SCOPED_TRACE(shape(type).name);
    const Elements element = one(type);
    const Points X = reference(type);
    const auto safety = [&](const std::function<Vec3(const Vec3&)>& map) { return safe_amplitude(X, mapped(X, map), &element); };
    const auto simple = safety([](const Vec3& p) { return Vec3{p[0], p[1], -3 * p[2]}; });
    EXPECT_NEAR(simple.amplitude, 0.25, 1e-12);
    EXPECT_EQ(simple.inverted.count, 1u);
    // Half a turn: a double root, and all is well at the end.
    const auto half_turn = safety([](const Vec3& p) { return Vec3{-p[0], -p[1], p[2]}; });
    EXPECT_NEAR(half_turn.amplitude, 0.5, 1e-6);
    EXPECT_LE(half_turn.amplitude, 0.5);
    EXPECT_EQ(half_turn.inverted.count, 0u);
    EXPECT_TRUE(half_turn.first_cell.has_value());
    const auto triple = safety([](const Vec3& p) { return Vec3{-p[0], -p[1], -p[2]}; });
    EXPECT_NEAR(triple.amplitude, 0.5, 1e-4);
    EXPECT_LE(triple.amplitude, 0.5);
    const auto flat = safety([](const Vec3& p) { return Vec3{p[0], p[1], 0}; });
    EXPECT_NEAR(flat.amplitude, 1, 1e-12);
    EXPECT_LT(flat.amplitude, 1);
    EXPECT_EQ(flat.inverted.count, 1u);
    for (const auto& map : {std::function<Vec3(const Vec3&)>([](const Vec3& p) {
                              return Vec3{p[0] + 7, p[1] - 1e3, p[2]};
                            }),
                            std::function<Vec3(const Vec3&)>([](const Vec3& p) {
                              return Vec3{-p[1], p[0], p[2]};
                            }),
                            std::function<Vec3(const Vec3&)>([](const Vec3& p) {
                              return Vec3{100 * p[0], 1e-3 * p[1], p[2]};
                            }),
                            std::function<Vec3(const Vec3&)>([](const Vec3& p) { return p; })}) {
      const auto fine = safety(map);
      EXPECT_EQ(fine.amplitude, 1);
      EXPECT_FALSE(fine.first_cell.has_value());
      EXPECT_EQ(fine.inverted.count, 0u);
      EXPECT_GT(fine.inverted.least_determinant.value, 0);
    }
  }
}

// Flat cells, small amplitudes: early by the tolerance of 1e-14 over the sine of the cell's angles, until it counts as collapsed.
TEST(SafeAmplitude, SmallAmplitudes) {
  const Elements tetrahedron = one(ElementType::tetrahedron);
  for (const double height : {1e-3, 1e-6, 1e-10, 1e-15}) {
    Points X = reference(ElementType::tetrahedron), Y = X;
    X[3][2] = height;
    Y[3][2] = -1;
    const MotionSafety found = safe_amplitude(X, Y, &tetrahedron);
    EXPECT_EQ(found.at_rest.count, height < 1e-14 ? 1u : 0u);
    if (found.at_rest.count > 0) continue;
    const double exact = height / (1 + height);
    EXPECT_LE(found.amplitude, exact);
    EXPECT_NEAR(found.amplitude / exact, 1, 1e-14 + 1e-14 / height);
  }
}

// A coefficient of the cubic and of the square is 0, or all but the first are.
TEST(SafeAmplitude, LowDegrees) {
  const Elements tetrahedron = one(ElementType::tetrahedron);
  const Points X = reference(ElementType::tetrahedron);
  Points Y = X;
  Y[1] = {0.5, 0, 0};  // 1 - s / 2
  EXPECT_EQ(safe_amplitude(X, Y, &tetrahedron).amplitude, 1);
  Y[2] = {0, -1, 0};  // (1 - s / 2)(1 - 2 s)
  EXPECT_NEAR(safe_amplitude(X, Y, &tetrahedron).amplitude, 0.5, 1e-13);
  Y = X;
  Y[1] = {1, 1, 0};
  Y[2] = {4, 1, 0};  // 1 - 4 s^2
  EXPECT_NEAR(safe_amplitude(X, Y, &tetrahedron).amplitude, 0.5, 1e-13);
  Y[2] = {1 - 1e-9, 1, 0};  // 1 - s^2 + 1e-9 s^2: close to 0, never there
  EXPECT_EQ(safe_amplitude(X, Y, &tetrahedron).amplitude, 1);
}

struct Sampled {
  std::size_t inverting = 0, fine = 0;
};

/// The amplitude of X to Y against `sound` at samples of the way, dense and right around it.
void compare(const Points& X, const Points& Y, const CellSet& cells, const std::function<bool(const Points&)>& sound,
             Sampled& count) {
  ASSERT_TRUE(sound(X));
  const MotionSafety found = safe_amplitude(X, Y, cells);
  ASSERT_EQ(found.at_rest.count, 0u);
  const double t = found.amplitude;
  EXPECT_EQ(found.inverted.count > 0, !sound(Y));
  constexpr int samples = 150;
  for (int k = 0; k <= samples; ++k) {
    const double s = double(k) / samples;
    if (s < t || t == 1) {
      ASSERT_TRUE(sound(between(X, Y, s))) << s << " of " << t;
    }
  }
  EXPECT_TRUE(sound(between(X, Y, t * (1 - 1e-9)))) << t;
  ++(t == 1 ? count.fine : count.inverting);
  if (t < 1) {
    EXPECT_FALSE(sound(between(X, Y, t * (1 + 1e-7)))) << t;
  }
}

TEST(SafeAmplitude, RandomMotionsOfEveryType) {
  for (const ElementType type : all_types()) {
    SCOPED_TRACE(shape(type).name);
    const Elements element = one(type);
    std::mt19937_64 random(17);
    Sampled count;
    for (int i = 0; i < 60; ++i) {
      const Points X = shaken(reference(type), 0.02, random);
      const Points Y = shaken(X, i % 2 ? 0.08 : 1.0, random);
      const auto sound = [&](const Points& points) { return element_quality(points, element).inverted_elements == 0; };
      if (sound(X)) compare(X, Y, &element, sound, count);
    }
    EXPECT_GT(count.inverting, 8u);
    EXPECT_GT(count.fine, 5u);
  }
}

// Where roots are close together the first one counts, and a way that comes near but passes is not stopped.
TEST(SafeAmplitude, NearlyDoubleRoots) {
  const Elements tetrahedron = one(ElementType::tetrahedron);
  const Points X = reference(ElementType::tetrahedron);
  for (const double gap : {1e-3, 1e-6, 1e-9, 1e-12}) {
    // Half a turn in the plane and a lift: determinant (1 - 2 s)^2 +- gap s^2, with 4 edges.
    const auto turned = [&](double sign) { return Points{{0, 0, 0}, {-1, sign * gap, 0}, {-1, -1, 0}, {0, 0, 1}}; };
    const double above = safe_amplitude(X, turned(1), &tetrahedron).amplitude;
    const double below = safe_amplitude(X, turned(-1), &tetrahedron).amplitude;
    // a = (1 - 2 s, +-gap s), b = (-s, 1 - 2 s): (1 - 2 s)^2 +- gap s^2
    EXPECT_EQ(above, 1) << gap;
    EXPECT_NEAR(below, 1 / (2 + std::sqrt(gap)), 1e-13 / std::sqrt(gap)) << gap;
  }
}

TEST(SafeAmplitude, CellsInvertedAtRestAreNamedAndLeftOut) {
  Points X = reference(ElementType::tetrahedron), Y;
  Elements elements = one(ElementType::tetrahedron);
  const PointId turned[] = {0, 2, 1, 3}, collapsed[] = {0, 1, 1, 3};
  elements.add(ElementType::tetrahedron, turned);
  elements.add(ElementType::tetrahedron, collapsed);
  Y = X;
  EXPECT_EQ(safe_amplitude(X, Y, &elements).amplitude, 1);
  Y[3] = {0, 0, -1};
  const MotionSafety found = safe_amplitude(X, Y, &elements);
  EXPECT_EQ(found.at_rest.count, 2u);
  ASSERT_EQ(found.at_rest.worst.size(), 2u);
  EXPECT_EQ(found.at_rest.worst[0].id, 1u);
  EXPECT_EQ(found.at_rest.worst[1].id, 2u);
  EXPECT_LT(found.at_rest.least_determinant.value, 0);
  EXPECT_NEAR(found.amplitude, 0.5, 1e-13);
  EXPECT_EQ(found.first_cell, std::optional<std::size_t>(0));
  EXPECT_EQ(found.inverted.count, 1u);
  EXPECT_EQ(found.inverted.worst[0].id, 0u);

  // Used from another position, a cell that is inverted there and was not at rest leaves nothing.
  const InversionCheck check(X, &elements);
  EXPECT_EQ(check.amplitude(Y, X).amplitude, 0);
}

/// n cubes in a row along x, as elements of a type of hexahedra or as polyhedra.
struct Row {
  Points points;
  Elements elements;
};
Row row_of_cubes(std::uint32_t n) {
  Row row;
  for (std::uint32_t i = 0; i <= n; ++i) {
    for (const auto& [y, z] : {std::pair(0, 0), {1, 0}, {1, 1}, {0, 1}}) row.points.push_back({double(i), double(y), double(z)});
  }
  for (std::uint32_t i = 0; i < n; ++i) {
    const PointId a = 4 * i, b = a + 4;
    const PointId nodes[] = {a, b, b + 1, a + 1, a + 3, b + 3, b + 2, a + 2};
    row.elements.add(ElementType::hexahedron, nodes);
  }
  return row;
}

/// Element e with its nodes in mirrored order: the same corners in space.
void mirror(Elements& elements, std::size_t e) {
  PointId* nodes = elements.points.data() + elements.offsets[e];
  for (int k = 0; k < 4; ++k) std::swap(nodes[k], nodes[4 + k]);
}

// All of it, one of its halves, or a mesh of one cell: they are protected as their mirror images would be.
TEST(SafeAmplitude, LeftHandedCellsAreJudgedByTheChangeOfSign) {
  const auto flattened = [](const Points& X) { return mapped(X, [](const Vec3& p) { return Vec3{p[0], p[1], -3 * p[2]}; }); };
  for (const ElementType type : all_types()) {
    SCOPED_TRACE(shape(type).name);
    const Elements element = one(type);
    const Points X = mapped(reference(type), [](const Vec3& p) { return Vec3{-p[0], p[1], p[2]}; });
    const MotionSafety still = safe_amplitude(X, X, &element);
    EXPECT_EQ(still.at_rest.count, 0u);
    EXPECT_GT(still.inverted.least_determinant.value, 0);
    const MotionSafety found = safe_amplitude(X, flattened(X), &element);
    EXPECT_NEAR(found.amplitude, 0.25, 1e-12);
    EXPECT_EQ(found.inverted.count, 1u);
    EXPECT_EQ(InversionCheck(X, &element).left_handed(), 1u);
  }
  Grid g = grid(3, 3, 3);
  for (Vec3& p : g.points) p[1] = -p[1];
  const MotionSafety polyhedra = safe_amplitude(g.points, flattened(g.points), &g.cells);
  EXPECT_EQ(polyhedra.at_rest.count, 0u);
  EXPECT_NEAR(polyhedra.amplitude, 0.25, 1e-10);
  EXPECT_EQ(polyhedra.inverted.count, 27u);
  EXPECT_EQ(polyhedra.inverted.without_volume, 27u);
  EXPECT_EQ(InversionCheck(g.points, &g.cells).left_handed(), 27u);

  // A part that was mirrored and joined with its original.
  for (const std::uint32_t mirrored : {40u, 20u, 10u, 0u}) {
    Row row = row_of_cubes(40);
    for (std::uint32_t e = 0; e < mirrored; ++e) mirror(row.elements, e);
    const InversionCheck check(row.points, &row.elements);
    EXPECT_EQ(check.left_handed(), mirrored);
    EXPECT_EQ(check.at_rest().count, 0u);
    EXPECT_EQ(check.at_rest().least_determinant.value, 1);
    const Points Y = flattened(row.points);
    EXPECT_EQ(check.inverted(Y).count, 40u);
    EXPECT_NEAR(check.amplitude(row.points, Y).amplitude, 0.25, 1e-12);
  }
}

// What is wrong in a left-handed mesh, too, is wrong: single cells the other way round, and those that are turned inside out.
TEST(SafeAmplitude, MistakesInLeftHandedMeshesAreInvertedAtRest) {
  for (const bool left : {false, true}) {
    Row row = row_of_cubes(40);
    for (std::uint32_t e = 0; e < 40; ++e) {
      if (left != (e == 7 || e == 8)) mirror(row.elements, e);
    }
    const InversionCheck numbered(row.points, &row.elements);
    EXPECT_EQ(numbered.left_handed(), left ? 40u : 0u);
    ASSERT_EQ(numbered.at_rest().count, 2u);
    EXPECT_EQ(numbered.at_rest().worst[0].id, 7u);
    EXPECT_EQ(numbered.at_rest().worst[1].id, 8u);

    row = row_of_cubes(40);
    for (std::uint32_t e = 0; left && e < 40; ++e) mirror(row.elements, e);
    for (PointId p = 4 * 11; p < 4 * 12; ++p) row.points[p][0] = 12.5;  // between cells 10 and 11: 11 is inside out
    const InversionCheck folded(row.points, &row.elements);
    EXPECT_EQ(folded.left_handed(), left ? 40u : 0u);
    ASSERT_EQ(folded.at_rest().count, 1u);
    EXPECT_EQ(folded.at_rest().worst[0].id, 11u);
  }
}

/// The cubes of a row cut into six tetrahedra around a diagonal, or into two prisms; quadratic ones get mid nodes on straight
/// edges.
Elements cut(const Row& row, ElementType type, Points& points) {
  const bool tetrahedra = shape(type).corners == 4;
  constexpr int around[] = {1, 5, 4, 7, 3, 2};  // from node 0 to 6 of a cube
  Elements elements;
  std::map<std::pair<PointId, PointId>, PointId> mid_nodes;
  points = row.points;
  const auto add = [&](std::vector<PointId> nodes) {
    const ElementShape& form = shape(type);
    for (std::size_t i = 0; form.quadratic() && i < form.edges.size(); ++i) {
      const PointId a = nodes[form.edges[i][0]], b = nodes[form.edges[i][1]];
      const auto [found, fresh] = mid_nodes.try_emplace(std::minmax(a, b), static_cast<PointId>(points.size()));
      if (fresh) {
        Vec3 middle;
        for (std::size_t k = 0; k < 3; ++k) middle[k] = 0.5 * (points[a][k] + points[b][k]);
        points.push_back(middle);
      }
      nodes.push_back(found->second);
    }
    elements.add(type, nodes);
  };
  for (std::size_t e = 0; e < row.elements.size(); ++e) {
    const auto cube = row.elements.nodes(e);
    for (std::size_t k = 0; tetrahedra && k < 6; ++k) {
      add({cube[0], cube[static_cast<std::size_t>(around[(k + 1) % 6])], cube[static_cast<std::size_t>(around[k])], cube[6]});
    }
    if (tetrahedra) continue;
    add({cube[0], cube[1], cube[2], cube[4], cube[5], cube[6]});
    add({cube[0], cube[2], cube[3], cube[4], cube[6], cube[7]});
  }
  return elements;
}

// Conforming meshes of triangles and quads as sides, linear and quadratic, the first half mirrored.
TEST(SafeAmplitude, BlocksOfOtherElements) {
  for (const ElementType type :
       {ElementType::tetrahedron, ElementType::prism, ElementType::tetrahedron10, ElementType::prism15}) {
    SCOPED_TRACE(shape(type).name);
    Row row = row_of_cubes(20);
    Points points;
    const std::size_t right = InversionCheck(points = row.points, &row.elements).left_handed();
    EXPECT_EQ(right, 0u);
    for (std::size_t e = 0; e < 10; ++e) mirror(row.elements, e);
    const Elements elements = cut(row, type, points);
    const std::size_t each = elements.size() / 20;
    std::vector<char> expected(elements.size());
    std::fill_n(expected.begin(), 10 * each, char{1});
    EXPECT_EQ(left_handed_cells(points, &elements), expected);
    const InversionCheck check(points, &elements);
    EXPECT_EQ(check.at_rest().count, 0u);
    // One mid or corner node drawn through its cells.
    points.back()[0] -= 5;
    EXPECT_GT(check.inverted(points).count, 0u);
  }
}

TEST(SafeAmplitude, ListsTheWorst) {
  Points X, Y;
  Elements elements;
  for (int e = 0; e < 300; ++e) {
    std::vector<PointId> nodes;
    for (const Vec3& p : reference(ElementType::tetrahedron)) {
      nodes.push_back(static_cast<PointId>(X.size()));
      X.push_back(p);
      // Every second one is inverted, element 2 (37 k % 150) as the k-th worst.
      Y.push_back(p[2] < 0.5 ? p : Vec3{0, e % 2 ? 0.0 : 2.0 * ((e / 2 * 73) % 150), e % 2 ? 0.5 : -1.0});
    }
    elements.add(ElementType::tetrahedron, nodes);
  }
  const MotionSafety found = safe_amplitude(X, Y, &elements);
  EXPECT_EQ(found.inverted.count, 150u);
  ASSERT_EQ(found.inverted.worst.size(), 100u);
  EXPECT_EQ(found.inverted.worst[0].id, 0u);
  for (std::size_t i = 1; i < 100; ++i) {
    EXPECT_LE(found.inverted.worst[i - 1].value, found.inverted.worst[i].value);
    EXPECT_EQ(found.inverted.worst[i].id % 2, 0u);
  }
}

TEST(SafeAmplitude, FacesInThePlane) {
  const Mesh square = make_mesh({{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}}, {{0, 1, 2, 3}});
  Points Y = square.points;
  Y[2] = {0, 0, 1};  // corner 2 over the diagonal 1-3 at s = 0.5, where the area is still positive
  const MotionSafety bent = safe_amplitude(square.points, Y, &square);
  EXPECT_NEAR(bent.amplitude, 0.5, 1e-13);
  EXPECT_EQ(bent.inverted.count, 1u);
  const auto turned = [&](double angle) {
    return mapped(square.points, [&](const Vec3& p) {
      return Vec3{std::cos(angle) * p[0] - std::sin(angle) * p[1], std::sin(angle) * p[0] + std::cos(angle) * p[1], p[2]};
    });
  };
  EXPECT_EQ(safe_amplitude(square.points, turned(3), &square).amplitude, 1);
  EXPECT_NEAR(safe_amplitude(square.points, turned(std::acos(-1)), &square).amplitude, 0.5, 1e-6);

  // Clockwise meshes are no worse; a face against the others is inverted at rest.
  const Mesh clockwise = make_mesh({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {2, 0, 0}}, {{3, 2, 1, 0}, {1, 2, 4}});
  Y = clockwise.points;
  Y[4] = {0, 0, 0};
  const MotionSafety found = safe_amplitude(clockwise.points, Y, &clockwise);
  EXPECT_EQ(found.at_rest.count, 0u);
  EXPECT_NEAR(found.amplitude, 0.5, 1e-13);
  const Mesh mixed = make_mesh(clockwise.points, {{0, 1, 2, 3}, {1, 2, 4}});
  EXPECT_EQ(safe_amplitude(mixed.points, mixed.points, &mixed).at_rest.worst.at(0).id, 1u);
}

// A billionth of the diagonal may be off, in any unit.
TEST(SafeAmplitude, PlanesAreFlatInTheirOwnUnits) {
  for (const double unit : {1e-6, 1.0, 1e6}) {
    SCOPED_TRACE(unit);
    Points points = quad_grid(3, 3).points;
    for (Vec3& x : points) x = {unit * x[0], unit * x[1], 5 * unit};
    const Box box = bounding_box(points);
    EXPECT_TRUE(in_one_plane(points));
    for (const double off : {0.5e-9, -0.5e-9}) {
      Points near = points;
      near[7][2] += off * box.diagonal();
      EXPECT_TRUE(in_one_plane(near));
    }
    for (const double off : {2e-9, -2e-9, std::nan("")}) {
      Points far = points;
      far[7][2] += off * box.diagonal();
      EXPECT_FALSE(in_one_plane(far));
    }
  }
}

// A plate goes where it likes as a whole, with the rounding of its way.
TEST(SafeAmplitude, PlanesMayMoveAsAWhole) {
  const Mesh grid = quad_grid(3, 3);
  Points Y = grid.points;
  for (std::size_t i = 0; i < Y.size(); ++i) Y[i][2] = 0.7 + (i % 2 ? 1e-13 : 0.0);
  const InversionCheck check(grid.points, &grid);
  EXPECT_EQ(check.amplitude(grid.points, Y).amplitude, 1);
  EXPECT_EQ(check.inverted(Y).count, 0u);
  std::swap(Y[5], Y[6]);
  EXPECT_LT(check.amplitude(grid.points, Y).amplitude, 1);
  EXPECT_GT(check.inverted(Y).count, 0u);
  EXPECT_TRUE(in_one_plane(Y));
  Y[3][2] += 1e-6;
  EXPECT_FALSE(in_one_plane(Y));
}

TEST(SafeAmplitude, RandomMotionsInThePlane) {
  Mesh mesh = quad_grid(3, 3);
  mesh.face_sizes.push_back(3);  // beside the grid
  mesh.points.insert(mesh.points.end(), {{10, 0, 0}, {11, 0, 0}, {10, 1, 0}});
  mesh.face_points.insert(mesh.face_points.end(), {16, 17, 18});
  // Least signed area of a corner.
  const auto sound = [&](const Points& points) {
    std::size_t at = 0;
    for (const std::size_t size : mesh.face_sizes) {
      for (std::size_t c = 0; c < size; ++c) {
        const auto corner = [&](std::size_t k) { return points[mesh.face_points[at + k % size]]; };
        const Vec3 p = corner(c), next = corner(c + 1), before = corner(c + size - 1);
        if ((next[0] - p[0]) * (before[1] - p[1]) - (next[1] - p[1]) * (before[0] - p[0]) <= 0) return false;
      }
      at += size;
    }
    return true;
  };
  std::mt19937_64 random(5);
  Sampled count;
  for (int i = 0; i < 60; ++i) {
    Points X = shaken(mesh.points, 0.1, random), Y = shaken(X, i % 2 ? 0.15 : 0.9, random);
    for (Points* points : {&X, &Y}) {
      for (Vec3& p : *points) p[2] = 0;
    }
    compare(X, Y, &mesh, sound, count);
  }
  EXPECT_GT(count.inverting, 15u);
  EXPECT_GT(count.fine, 5u);
}

/// What checkMesh calls errors, without its allowance for small pyramids.
bool has_no_errors(const Points& points, const PolyhedralCells& cells) {
  PolyhedralLimits limits;
  limits.pyramid_volume = 0;
  const PolyhedralQuality q = polyhedral_quality(points, cells, limits);
  return q.wrong_pyramids == 0 && q.negative_volumes == 0;
}

TEST(SafeAmplitude, Polyhedra) {
  const Grid g = grid(1, 1, 1);
  const auto safety = [&](const std::function<Vec3(const Vec3&)>& map) {
    return safe_amplitude(g.points, mapped(g.points, map), &g.cells);
  };
  EXPECT_NEAR(safety([](const Vec3& p) { return Vec3{p[0], p[1], -p[2]}; }).amplitude, 0.5, 1e-10);
  EXPECT_NEAR(safety([](const Vec3& p) { return Vec3{-p[0], -p[1], p[2]}; }).amplitude, 0.5, 1e-5);
  EXPECT_EQ(safety([](const Vec3& p) { return Vec3{-p[0], -p[1], p[2]}; }).inverted.count, 0u);
  EXPECT_EQ(safety([](const Vec3& p) { return Vec3{-p[1] + 5, p[0], p[2]}; }).amplitude, 1);
  EXPECT_EQ(safety([](const Vec3& p) { return Vec3{p[0] + 1e6, p[1], p[2]}; }).amplitude, 1);
  const auto mirrored = safety([](const Vec3& p) { return Vec3{p[0], p[1], -3 * p[2]}; });
  EXPECT_EQ(mirrored.inverted.count, 1u);
  EXPECT_LT(mirrored.inverted.worst.at(0).value, 0);
  // The way from the centre to a face of a cube is along its normal.
  EXPECT_NEAR(safety([](const Vec3& p) { return p; }).inverted.least_determinant.value, 1, 1e-14);
}

// A cell has a volume and a pyramid to each face, and what is inverted is so for one of the two.
TEST(SafeAmplitude, PolyhedraAreInvertedByTheirVolumeOrByAPyramid) {
  Grid g = grid(1, 1, 1);
  g.cells.cell_count = 2;  // the second has no face
  const auto cells = quality::moving_polyhedra(g.cells, g.points.size());
  const auto expect_state = [&](const Points& points, std::size_t cell, bool without_volume, bool wrong_pyramid) {
    const auto state = cells->state(points, cell);
    EXPECT_EQ(state.without_volume, without_volume);
    EXPECT_EQ(state.wrong_pyramid, wrong_pyramid);
    EXPECT_EQ(state.inverted, without_volume || wrong_pyramid);
    EXPECT_EQ(state.determinant > 0, !state.inverted);
  };
  expect_state(g.points, 0, false, false);
  expect_state(g.points, 1, true, false);
  expect_state(mapped(g.points, [](const Vec3& p) { return Vec3{p[0], p[1], -p[2]}; }), 0, true, false);
  expect_state(mapped(g.points, [](const Vec3& p) { return Vec3{p[0], p[1], 0}; }), 0, true, false);
  // Those of checkMesh's formulas.
  g.cells.cell_count = 1;
  PolyhedralLimits limits;
  limits.pyramid_volume = 0;
  std::mt19937_64 random(31);
  std::size_t without_volume = 0, wrong_pyramid = 0;
  for (int i = 0; i < 100; ++i) {
    Points points = shaken(g.points, 0.8, random);
    if (i % 2 == 1) points = mapped(points, [](const Vec3& p) { return Vec3{p[0], p[1], -p[2]}; });
    const PolyhedralQuality q = polyhedral_quality(points, g.cells, limits);
    expect_state(points, 0, q.negative_volumes > 0, q.negative_volumes == 0 && q.wrong_pyramids > 0);
    without_volume += q.negative_volumes > 0;
    wrong_pyramid += q.negative_volumes == 0 && q.wrong_pyramids > 0;
  }
  EXPECT_GT(without_volume, 5u);
  EXPECT_GT(wrong_pyramid, 5u);
}

// Cells 1e4 times as long as high, far away: bounds must not take them for flat.
TEST(SafeAmplitude, SlenderPolyhedra) {
  Grid g = grid(4, 4, 2);
  for (Vec3& p : g.points) p = {p[0] + 100, p[1] - 50, 1e-4 * p[2]};
  const auto rolled = [&](double angle) {
    return mapped(g.points, [&](const Vec3& p) {
      const double x = p[0] - 102;
      return Vec3{102 + std::cos(angle) * x - std::sin(angle) * p[2], p[1], std::sin(angle) * x + std::cos(angle) * p[2]};
    });
  };
  EXPECT_EQ(safe_amplitude(g.points, rolled(0.3), &g.cells).amplitude, 1);
  EXPECT_NEAR(safe_amplitude(g.points, rolled(std::acos(-1)), &g.cells).amplitude, 0.5, 1e-5);
}

TEST(SafeAmplitude, RandomMotionsOfPolyhedra) {
  const Grid g = grid(2, 2, 2);
  std::mt19937_64 random(23);
  Sampled count;
  for (int i = 0; i < 40; ++i) {
    const Points X = shaken(g.points, 0.1, random), Y = shaken(X, i % 2 ? 0.12 : 0.8, random);
    compare(
        X, Y, &g.cells, [&](const Points& points) { return has_no_errors(points, g.cells); }, count);
  }
  EXPECT_GT(count.inverting, 15u);
  EXPECT_GT(count.fine, 5u);
}

// A third of a turn halves the cell across its axis half-way, and there the edge at (1, 1), which is off by `off` at either end,
// is twice as far off and near the opposite one: the faces beside it look away from the cell's centre, though all of it has a
// volume. Where they hardly do, they do so for a short while before and after, which no halving of the way meets.
TEST(SafeAmplitude, PyramidsOfPolyhedraThatAreWrongOnTheWayOnly) {
  const Grid g = grid(1, 1, 1);
  PolyhedralLimits limits;
  limits.pyramid_volume = 0;
  const auto turned = [](const Vec3& p, double degrees) {
    const double c = std::cos(degrees * std::acos(-1) / 180), s = std::sin(degrees * std::acos(-1) / 180);
    return Vec3{c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]};
  };
  const auto way = [&](double off, double t) {
    const auto with_edge = [&](double degrees) {
      const Vec3 away = off * std::sqrt(0.5) * turned({-1, -1, 0}, degrees);
      return mapped(g.points, [&](const Vec3& p) { return p[0] + p[1] > 1.5 ? p + away : p; });
    };
    return between(with_edge(60), mapped(with_edge(-60), [&](const Vec3& p) { return turned(p, 120); }), t);
  };
  const auto sound = [&](const Points& points) { return has_no_errors(points, g.cells); };
  double fine = 0.3, wrong = 0.6;  // at the place where it begins
  for (int k = 0; k < 40; ++k) (sound(way(0.5 * (fine + wrong), 0.4283)) ? fine : wrong) = 0.5 * (fine + wrong);
  Sampled count;
  for (const double more : {-1e-1, -1e-3, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 5e-2}) {
    const Points X = way(wrong + more, 0), Y = way(wrong + more, 1);
    for (int k = 0; k <= 20; ++k) {
      EXPECT_EQ(polyhedral_quality(between(X, Y, k / 20.0), g.cells, limits).negative_volumes, 0u);
    }
    compare(X, Y, &g.cells, sound, count);
  }
  EXPECT_EQ(count.fine, 2u);
  EXPECT_EQ(count.inverting, 7u);
}

/// Cells that have the margin at rest and no longer, cell by cell.
TEST(SafeAmplitude, CountsCellsThatFallBelowAMargin) {
  Grid g = grid(5, 4, 3);
  std::mt19937_64 random(31);
  const Points rest = shaken(g.points, 0.25, random), moved = shaken(rest, 0.3, random);
  Elements cubes;
  for (PointId c = 0; c < 60; ++c) {
    const PointId a = c % 5 + 6 * (c / 5 % 4 + 5 * (c / 20)), up = 30;
    const PointId nodes[] = {a, a + 1, a + 7, a + 6, a + up, a + up + 1, a + up + 7, a + up + 6};
    cubes.add(ElementType::hexahedron, nodes);
  }
  const InversionCheck check(rest, &cubes);
  const auto determinants = [&](const Points& points) {
    std::vector<double> all;
    for (std::size_t e = 0; e < cubes.size(); ++e) {
      Elements alone;
      alone.add(cubes.types[e], cubes.nodes(e));
      all.push_back(InversionCheck(rest, &alone).inverted(points).least_determinant.value);
    }
    return all;
  };
  const std::vector<double> before = determinants(rest), after = determinants(moved);
  for (const double margin : {0.05, 0.3, 0.5, 0.7, 0.9}) {
    std::size_t expected = 0, low = 0;
    for (std::size_t e = 0; e < before.size(); ++e) {
      expected += before[e] >= margin && after[e] < margin;
      low += before[e] < margin;
    }
    EXPECT_EQ(check.below(margin, rest, moved), expected) << margin;
    EXPECT_EQ(check.below(margin, rest, rest), 0u) << margin;
    if (margin == 0.7) {
      EXPECT_GT(expected, 0u);
      EXPECT_GT(low, 0u);
    }
  }
}

TEST(SafeAmplitude, SameBitsForAnyNumberOfThreads) {
  const Grid g = grid(16, 16, 16);
  std::mt19937_64 random(29);
  const Points Y = shaken(g.points, 0.9, random);
  Elements cubes;
  for (PointId c = 0; c < 4096; ++c) {
    const PointId a = c % 16 + 17 * (c / 16 % 16 + 17 * (c / 256)), up = 17 * 17;
    const PointId nodes[] = {a, a + 1, a + 18, a + 17, a + up, a + up + 1, a + up + 18, a + up + 17};
    cubes.add(ElementType::hexahedron, nodes);
  }
  RunContext one;
  one.threads = 1;
  for (const CellSet& cells : {CellSet(&g.cells), CellSet(&cubes)}) {
    const MotionSafety a = safe_amplitude(g.points, Y, cells, one), b = safe_amplitude(g.points, Y, cells);
    EXPECT_GT(a.amplitude, 0);
    EXPECT_LT(a.amplitude, 1);
    EXPECT_EQ(a.amplitude, b.amplitude);
    EXPECT_EQ(a.first_cell, b.first_cell);
    EXPECT_GT(a.inverted.count, 100u);
    EXPECT_EQ(a.inverted.count, b.inverted.count);
    EXPECT_EQ(a.inverted.least_determinant.value, b.inverted.least_determinant.value);
    EXPECT_EQ(a.inverted.worst.back().id, b.inverted.worst.back().id);
    EXPECT_GE(InversionCheck::bytes_for(cells, g.points.size()), 200 * 4096u);
    EXPECT_LE(InversionCheck::bytes_for(cells, g.points.size()), 500 * 4096u);
    EXPECT_GE(InversionCheck::bytes_to_make(cells, g.points.size()), InversionCheck::bytes_for(cells, g.points.size()));
    EXPECT_LE(InversionCheck::bytes_to_make(cells, g.points.size()), 900 * 4096u);
  }
}

TEST(SafeAmplitude, Refuses) {
  const Points X = reference(ElementType::tetrahedron);
  const Elements good = one(ElementType::tetrahedron);
  Elements bad = good;
  bad.points[2] = 4;
  const auto refused = [](const Points& from, const Points& to, const CellSet& cells, const std::vector<const char*>& parts) {
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { safe_amplitude(from, to, cells); });
  };
  refused(X, X, &bad, {"elements[0]", "point 4", "4"});
  const Elements none;
  refused(X, X, &none, {"no cells"});
  refused(X, Points(3), &good, {"points", "expected 4", "got 3"});
  Points spoilt = X;
  spoilt[2][1] = std::nan("");
  refused(X, spoilt, &good, {"points[2]", "finite"});
  refused(spoilt, X, &good, {"points[2]", "finite"});

  Grid g = grid(1, 1, 1);
  g.cells.owner[3] = 7;
  refused(g.points, g.points, &g.cells, {"faces[3]", "cell 7", "1"});
  g = grid(1, 1, 1);
  g.cells.face_points[9] = 8;
  refused(g.points, g.points, &g.cells, {"faces[2]", "point 8"});

  const Mesh pentagon = make_mesh({{0, 0, 0}, {1, 0, 0}, {2, 1, 0}, {1, 2, 0}, {0, 1, 0}}, {{0, 1, 2, 3, 4}});
  refused(pentagon.points, pentagon.points, &pentagon, {"faces[0]", "5 corners", "triangles and quads"});
  const Mesh raised = test::tetrahedron();
  refused(raised.points, raised.points, &raised, {"points[3]", "plane z = constant"});
  const Mesh flat = quad_grid(1, 1);
  refused(flat.points, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0.1}}, &flat, {"points[3]", "0.1", "plane z = constant"});

  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  test::expect_error(ErrorCode::cancelled, {}, [&] { safe_amplitude(X, X, &good, context); });
}

TEST(SafeAmplitude, EveryCheckRefusesWrongPoints) {
  const Points X = reference(ElementType::tetrahedron);
  const Elements tetrahedron = one(ElementType::tetrahedron);
  const InversionCheck check(X, &tetrahedron);
  Points spoilt = X;
  spoilt[3][2] = std::numeric_limits<double>::infinity();
  for (const auto& [wrong, parts] : {std::pair{Points(X.begin(), X.end() - 1), std::vector{"points", "expected 4", "got 3"}},
                                     {spoilt, {"points[3]", "finite"}}}) {
    const auto refused = [&, &parts = parts](const auto& use) { test::expect_error(ErrorCode::invalid_argument, parts, use); };
    refused([&, &wrong = wrong] { check.inverted(wrong); });
    refused([&, &wrong = wrong] { check.below(0.1, wrong, X); });
    refused([&, &wrong = wrong] { check.below(0.1, X, wrong); });
    refused([&, &wrong = wrong] { check.amplitude(wrong, X); });
    refused([&, &wrong = wrong] { check.amplitude(X, wrong); });
  }
}

}  // namespace
}  // namespace deform::safe_amplitude_test
