// SPDX-License-Identifier: GPL-3.0-or-later
// Boundary layers on walls that bend, with first cells of 1e-3 and 1e-5 of the model, which rigid columns of cells are to keep.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/constrained/stretched_column.h"
#include "core/deformers/methods.h"
#include "core/deformers/space_map.h"
#include "core/mesh/elements.h"
#include "tests/core/constraints/projection_checks.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/long_tests.h"

namespace deform::test::layers_test {
namespace {

constexpr int kept_layers = 4;

/// The room above a bump, in hexahedra or prisms whose layers grow by 1.3 from the wall z = 0.1 exp(-(4x - 6)^2) upwards.
struct Bump {
  std::size_t nx = 20, ny = 6, nz = 0;
  std::shared_ptr<Mesh> mesh = std::make_shared<Mesh>();

  Bump(double first, ElementType type) {
    std::vector<double> levels{0};
    for (double h = first * std::sqrt(11.0); levels.back() + h < 0.7; h = std::min(0.2, 1.3 * h))
      levels.push_back(levels.back() + h);
    levels.push_back(1);
    nz = levels.size() - 1;
    for (const double z : levels) {
      for (std::size_t j = 0; j <= ny; ++j) {
        for (std::size_t i = 0; i <= nx; ++i) {
          const double x = 3 * static_cast<double>(i) / static_cast<double>(nx);
          mesh->points.push_back(
              {x, static_cast<double>(j) / static_cast<double>(ny), z + 0.1 * std::exp(-std::pow(4 * x - 6, 2)) * (1 - z)});
        }
      }
    }
    auto elements = std::make_shared<Elements>();
    for (std::size_t k = 0; k < nz; ++k) {
      for (std::size_t j = 0; j < ny; ++j) {
        for (std::size_t i = 0; i < nx; ++i) {
          const std::array<PointId, 8> c{at(i, j, k),     at(i + 1, j, k),     at(i + 1, j + 1, k),     at(i, j + 1, k),
                                         at(i, j, k + 1), at(i + 1, j, k + 1), at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)};
          if (type == ElementType::hexahedron) {
            elements->add(type, c);
          } else {
            elements->add(type, std::array{c[0], c[1], c[2], c[4], c[5], c[6]});
            elements->add(type, std::array{c[0], c[2], c[3], c[4], c[6], c[7]});
          }
        }
      }
    }
    BoundaryFaces boundary = boundary_faces(*elements);
    mesh->face_sizes = std::move(boundary.sizes);
    mesh->face_points = std::move(boundary.points);
    mesh->elements = std::move(elements);
  }
  PointId at(std::size_t i, std::size_t j, std::size_t k) const {
    return static_cast<PointId>(i + (nx + 1) * (j + (ny + 1) * k));
  }
  std::vector<PointId> level(std::size_t k) const {
    std::vector<PointId> ids;
    for (std::size_t j = 0; j <= ny; ++j) {
      for (std::size_t i = 0; i <= nx; ++i) ids.push_back(at(i, j, k));
    }
    return ids;
  }

  /// The crest moves and turns; the walls around stay but for the one with the bump.
  Setup setup(const MethodOptions& method) const {
    std::vector<PointId> crest, still = level(nz);
    for (std::size_t j = 0; j <= ny; ++j) {
      for (std::size_t i = nx / 2 - 2; i <= nx / 2 + 2; ++i) crest.push_back(at(i, j, 0));
      for (std::size_t k = 0; k < nz; ++k) still.insert(still.end(), {at(0, j, k), at(nx, j, k)});
    }
    Setup setup;
    setup.method = method;
    setup.handles = {{"crest", {Region::Ids{crest}}}};
    setup.fixed = {{Region::Ids{still}}};
    setup.variables.push_back({"up", "crest", DesignVariable::Translate{{0, 0, 0.1}}});
    setup.variables.push_back({"on", "crest", DesignVariable::Translate{{0.05, 0, 0}}});
    setup.variables.push_back({"aside", "crest", DesignVariable::Translate{{0, 0.02, 0.02}}});
    setup.variables.push_back({"turn", "crest", DesignVariable::Rotate{{0, 1, 0}, {1.5, 0, 0.1}}});
    setup.constraints = {{"layers", {{Region::Ids{level(0)}}}, Rigid{kept_layers}}};
    return setup;
  }

  /// The least and the largest height of the first cells over that at rest: of hexahedra their height above the plane through
  /// the middles of the edges of the wall face, on average.
  std::array<double, 2> heights(const Points& points, std::size_t first = 0, std::size_t end = kept_layers) const {
    const auto height = [&](const Points& x, std::size_t i, std::size_t j, std::size_t k) {
      const Vec3 normal = cross(x[at(i + 1, j + 1, k)] - x[at(i, j, k)], x[at(i, j + 1, k)] - x[at(i + 1, j, k)]);
      Vec3 sum{};
      for (const std::size_t a : {0, 1}) {
        for (const std::size_t b : {0, 1}) sum = sum + (x[at(i + a, j + b, k + 1)] - x[at(i + a, j + b, k)]);
      }
      return deform::dot(normal, sum) / (4 * length(normal));
    };
    std::array<double, 2> range{1e300, -1e300};
    for (std::size_t k = first; k < end; ++k) {
      for (std::size_t j = 0; j < ny; ++j) {
        for (std::size_t i = 0; i < nx; ++i) {
          const double ratio = height(points, i, j, k) / height(mesh->points, i, j, k);
          range = {std::min(range[0], ratio), std::max(range[1], ratio)};
        }
      }
    }
    return range;
  }
};

const std::vector<double> large{0.8, 0.3, 0.5, 0.15}, small{0.2, 0.1, 0.1, 0.03};

struct Designed {
  Points points;
  DesignReport report;
};
Designed designed(const Bump& bump, const Setup& setup, const std::vector<double>& variables) {
  const auto system = prepare(bump.mesh, setup);
  const Design design{variables, {}};
  const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
  Designed result{Points(bump.mesh->point_count()), evaluation->report(0)};
  Vec3* const out[] = {result.points.data()};
  evaluation->evaluate(0, result.points.size(), 0, out);
  return result;
}

void expect_kept(const MethodOptions& method, double first, ElementType type, const std::vector<double>& variables,
                 double tolerance) {
  SCOPED_TRACE(std::string(shape(type).name) + " of " + std::to_string(first));
  const Bump bump(first, type);
  deform::Setup with = bump.setup(method), without = with;
  without.constraints.clear();
  const Designed free = designed(bump, without, variables), kept = designed(bump, with, variables);
  const auto before = bump.heights(free.points), after = bump.heights(kept.points);
  EXPECT_LT(before[0], 1 - 10 * tolerance) << "without the constraint";
  EXPECT_GT(after[0], 1 - tolerance);
  EXPECT_LT(after[1], 1 + tolerance);
  // What the layers take or give is spread over the cells above.
  const auto next_before = bump.heights(free.points, kept_layers, kept_layers + 1);
  const auto next = bump.heights(kept.points, kept_layers, kept_layers + 1);
  EXPECT_GT(next[0], 1 - 1.1 * std::max(1 - next_before[0], next_before[1] - 1));
  EXPECT_LT(next[1], 1 + 1.1 * std::max(1 - next_before[0], next_before[1] - 1));
  const ConstraintReport& report = kept.report.constraints[0];
  ASSERT_TRUE(report.heights && report.heights_before);
  const double same = type == ElementType::hexahedron ? 2e-4 : 5e-3;  // other normals: of both faces, and of triangles
  EXPECT_NEAR(report.heights->least, after[0], same);
  EXPECT_NEAR(report.heights->largest, after[1], same);
  EXPECT_NEAR(report.heights_before->least, before[0], 10 * same);
  EXPECT_NEAR(report.heights_before->largest, before[1], 10 * same);
  // The wall is where its handle is.
  for (std::size_t j = 0; j <= bump.ny; ++j) {
    EXPECT_LT(distance(kept.points[bump.at(bump.nx / 2, j, 0)], free.points[bump.at(bump.nx / 2, j, 0)]), 1e-12);
  }
}

TEST(Layers, KeepTheirHeightsOnAWallThatBends) {
  for (const ElementType type : {ElementType::hexahedron, ElementType::prism}) {
    for (const double first : {1e-3, 1e-5}) {
      if (type == ElementType::prism && first > 1e-4 && !long_tests()) continue;
      expect_kept(FfdOptions{}, first, type, small, 1e-3);
      // At the edge of the handle faces meet at another angle than at rest.
      expect_kept(FfdOptions{}, first, type, large, 6e-3);
    }
  }
}

TEST(Layers, KeepTheirHeightsWithMovingLeastSquares) {
  MlsOptions options;
  options.surface_samples = 300;
  options.volume_samples = 200;
  expect_kept(options, 1e-4, ElementType::hexahedron, large, 6e-3);
}

TEST(Layers, HaveDerivatives) {
  for (const ElementType type : {ElementType::hexahedron, ElementType::prism}) {
    if (type == ElementType::hexahedron && !long_tests()) continue;  // HaveDerivativesBesideAPlane is of these
    const Bump bump(1e-3, type);
    deform::Setup setup = bump.setup(FfdOptions{});
    setup.constraint_options.tolerance = 1e-12;
    check_jacobians(*prepare(bump.mesh, setup), 1e-9, 1e-6);
  }
}

/// The solver sees points of the plane where they are delivered, those of columns where the functions have them; the plane holds
/// points of both.
TEST(Layers, HaveDerivativesBesideAPlane) {
  const Bump bump(1e-2, ElementType::hexahedron);
  deform::Setup setup = bump.setup(FfdOptions{});
  std::vector<PointId> plane = bump.level(kept_layers + 1);
  for (std::size_t j = 0; j <= bump.ny; ++j) plane.push_back(bump.at(3, j, 2));
  setup.constraints.push_back({"plane", {{Region::Ids{plane}}}, Planar{}, 1e4});
  setup.constraint_options.tolerance = 1e-12;
  check_jacobians(*prepare(bump.mesh, setup), 1e-11, 5e-6);
}

/// Handles that give way have no correction; the report compares with the deformation without the constraint all the same.
TEST(Layers, HeightsBeforeAreToldWithSoftHandles) {
  FfdOptions soft;
  soft.handles = HandleMode::soft;
  const Bump bump(1e-3, ElementType::hexahedron);
  deform::Setup with = bump.setup(soft), without = with;
  without.constraints.clear();
  const Designed free = designed(bump, without, large), kept = designed(bump, with, large);
  const auto before = bump.heights(free.points);
  ASSERT_TRUE(kept.report.constraints[0].heights_before);
  EXPECT_NEAR(kept.report.constraints[0].heights_before->least, before[0], 2e-3);
  EXPECT_NEAR(kept.report.constraints[0].heights_before->largest, before[1], 2e-3);
}

/// A point above the wall that is held does not follow it: heights change, which the report tells.
TEST(Layers, ThatAreLiftedOffTheWallAreTold) {
  const Bump bump(1e-3, ElementType::hexahedron);
  deform::Setup setup = bump.setup(FfdOptions{});
  const PointId wall = bump.at(3, 2, 0), above = bump.at(3, 2, 1);
  setup.fixed.push_back({Region::Ids{{wall}}});
  setup.handles.push_back({"lifted", {Region::Ids{{above}}}});
  const double height = bump.mesh->points[above][2] - bump.mesh->points[wall][2];
  setup.variables.push_back({"lift", "lifted", DesignVariable::Translate{{0, 0, height}}});
  const Designed design = designed(bump, setup, {0, 0, 0, 0, 0.5});
  // An eighth of the corners of a cell is half as high again.
  const auto heights = bump.heights(design.points);
  EXPECT_NEAR(heights[1], 1 + 0.5 / 4, 1e-2);
  EXPECT_NEAR(design.report.constraints[0].heights->largest, heights[1], 1e-2);
}

/// The wall and the layers are where the map of space puts them, and a point above moves with them.
TEST(Layers, AreThoseOfTheMapOfSpace) {
  const Bump bump(1e-3, ElementType::hexahedron);
  const auto system = prepare(bump.mesh, bump.setup(FfdOptions{}));
  const Design design{large, {}};
  const Points points = system->evaluate(design, {});
  const auto map = system->bind_in_space(design, {});
  Points mapped(points.size());
  map->evaluate(bump.mesh->points, 0, mapped, {});
  double apart = 0;
  for (std::size_t i = 0; i < points.size(); ++i) apart = std::max(apart, distance(points[i], mapped[i]));
  EXPECT_LT(apart, 1e-12);
}

/// Right above a column the map of space is where its last level is: what the layers are moved by goes on into the room above.
TEST(Layers, DoNotTearOffWhatIsAboveThem) {
  const Bump bump(1e-3, ElementType::hexahedron);
  const auto map = prepare(bump.mesh, bump.setup(FfdOptions{}))->bind_in_space({large, {}}, {});
  const deform::Setup setup = bump.setup(FfdOptions{});
  deform::Setup without = setup;
  without.constraints.clear();
  const Designed kept = designed(bump, setup, large), free = designed(bump, without, large);
  Points places;
  double height = 0, moved_on = 0;
  for (std::size_t i = 1; i < bump.nx; ++i) {
    const PointId wall = bump.at(i, 3, 0), last = bump.at(i, 3, kept_layers);
    const auto& rest = bump.mesh->points;
    height = distance(rest[last], rest[wall]);
    const Vec3 free_edge = free.points[last] - free.points[wall], edge = kept.points[last] - kept.points[wall];
    moved_on = std::max(moved_on, length(edge - free_edge));
    places.push_back(rest[last] + 1e-6 * (rest[last] - rest[wall]));
  }
  EXPECT_GT(moved_on, 0.03 * height) << "else this shows nothing";
  Points above(places.size());
  map->evaluate(places, 0, above, {});
  for (std::size_t i = 1; i < bump.nx; ++i) {
    EXPECT_LT(distance(above[i - 1], kept.points[bump.at(i, 3, kept_layers)]), 1e-4 * height) << i;
  }
}

Points column_of(double height) {
  Points points;
  for (int level = 0; level < 3; ++level) {
    for (const auto& [x, y] : {std::pair{0.0, 0.0}, {1.0, 0.1}, {1.1, 1.2}, {0.0, 1.0}}) {
      points.push_back({x, y + 0.1 * level * height, height * level * (1 + 0.1 * x)});
    }
  }
  points.push_back({0.5, 0.05, height});  // a node between two corners
  return points;
}

TEST(StretchedColumn, IsRigidIfItsPointsAre) {
  const Points rest = column_of(1e-4);
  StretchedColumn::Corners corners{4, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}};
  const StretchedColumn column(corners, rest);
  const Points turned = moved(rest, tilted(1.1));
  Points projected(rest.size());
  ShapeParameters shape;
  EXPECT_LT(column.projection().project(column.stretched(turned), projected, shape), 1e-20);
  // A tenth of a height counts as a tenth of the width, which is 1.05 on average.
  Points higher = turned;
  for (std::size_t c = 8; c < 12; ++c) higher[c] = higher[c] + 0.1 * (turned[c] - turned[c - 4]);
  EXPECT_GT(column.projection().project(column.stretched(higher), projected, shape), 4 * 0.1 * 0.1 / 2);
  const auto heights = column.relative_heights(higher);
  EXPECT_NEAR(heights[0], 1, 1e-9);
  EXPECT_NEAR(heights[1], 1.1, 1e-3);
}

TEST(StretchedColumn, IsALinearMapWithItsInverseAndTranspose) {
  const Points rest = column_of(1e-3);
  const StretchedColumn column({4, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}}, rest);
  const Points x = noisy(rest, 0.1, 3), y = noisy(rest, 0.1, 5);
  const Points there = column.stretched(x), back = column.unstretched(there), transposed = column.adjoint(y);
  Points rows(x.size(), Vec3{});
  column.for_each_row([&](std::size_t row, std::span<const StretchedColumn::Entry> entries) {
    double sum = 0;
    for (const auto& [place, factor] : entries) {
      rows[row] = rows[row] + factor * x[place];
      sum += factor;
    }
    EXPECT_NEAR(sum, 1, 1e-9);
  });
  double left = 0, right = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    EXPECT_LT(distance(back[i], x[i]), 1e-12);
    EXPECT_LT(distance(rows[i], there[i]), 1e-9);
    left += deform::dot(y[i], there[i]);
    right += deform::dot(transposed[i], x[i]);
  }
  EXPECT_NEAR(left, right, 1e-9 * std::abs(left));
}

}  // namespace
}  // namespace deform::test::layers_test
