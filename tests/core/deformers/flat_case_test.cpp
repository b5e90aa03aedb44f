// SPDX-License-Identifier: GPL-3.0-or-later
// Meshes that are one cell thick between patches of type "empty" stay in their plane.
#include "core/deformers/handles/flat_case.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "core/mesh/elements.h"
#include "tests/core/deformers/shapes.h"
#include "tests/core/mesh/polyhedral.h"
#include "tests/support/expect_error.h"

namespace deform::flat_case_test {
namespace {

using test::box;
using test::shared;
using testing::HasSubstr;

constexpr std::size_t columns = 9, rows = 6;
constexpr double thickness = 0.1;

/// Hexahedra over a plane grid, in a frame; the ids of both planes alternate.
Mesh flat_mesh(const Vec3& a = {1, 0, 0}, const Vec3& b = {0, 1, 0}, const Vec3& n = {0, 0, 1}) {
  Mesh mesh;
  for (std::size_t j = 0; j < rows; ++j) {
    for (std::size_t i = 0; i < columns; ++i) {
      const double x = 0.25 * static_cast<double>(i) + 0.02 * std::sin(static_cast<double>(i * j));
      const double y = 0.2 * static_cast<double>(j);
      for (const double z : {0.0, thickness}) mesh.points.push_back(x * a + y * b + z * n);
    }
  }
  Elements elements;
  const auto at = [](std::size_t i, std::size_t j, std::size_t k) { return static_cast<PointId>(2 * (j * columns + i) + k); };
  for (std::size_t j = 0; j + 1 < rows; ++j) {
    for (std::size_t i = 0; i + 1 < columns; ++i) {
      const std::vector<PointId> corners{at(i, j, 0), at(i + 1, j, 0), at(i + 1, j + 1, 0), at(i, j + 1, 0),
                                         at(i, j, 1), at(i + 1, j, 1), at(i + 1, j + 1, 1), at(i, j + 1, 1)};
      elements.add(ElementType::hexahedron, corners);
    }
  }
  auto cells = std::make_shared<PolyhedralCells>(test::by_faces(elements));
  cells->empty_faces.assign(cells->face_count(), 0);
  for (std::size_t f = cells->internal_faces(); f < cells->face_count(); ++f) {
    std::size_t low = 0;
    for (const PointId id : cells->face(f)) low += id % 2 == 0 ? 1 : 0;
    if (low == 0 || low == cells->face(f).size()) cells->empty_faces[f] = 1;
    mesh.face_sizes.push_back(static_cast<std::uint32_t>(cells->face(f).size()));
    mesh.face_points.insert(mesh.face_points.end(), cells->face(f).begin(), cells->face(f).end());
  }
  mesh.cells = std::move(cells);
  return mesh;
}

deform::Setup setup_of(const MethodOptions& method) {
  deform::Setup setup;
  setup.method = method;
  setup.handles = {{"middle", box({0.9, 0.3, -1}, {1.2, 0.7, 1})}};
  setup.fixed = {box({-1, -1, -1}, {0.1, 2, 1}), box({1.9, -1, -1}, {3, 2, 1})};
  setup.variables = {{"up", "middle", DesignVariable::Translate{{0.1, 1, 0}}},
                     {"turn", "middle", DesignVariable::Rotate{{0, 0, 2}, {1, 0.5, 0.3}}}};
  return setup;
}

std::vector<MethodOptions> methods() {
  MlsOptions mls;
  mls.surface_samples = mls.volume_samples = 60;
  return {RbfOptions{}, FfdOptions{}, mls};
}

TEST(FlatCase, FindsPlanesAndPartners) {
  const double s = std::sqrt(0.5);
  const FlatCase flat(flat_mesh({s, 0, s}, {0, 1, 0}, {-s, 0, s}));
  ASSERT_TRUE(flat.exists());
  EXPECT_NEAR(std::abs(dot(flat.normal(), Vec3{-s, 0, s})), 1, 1e-15);
  EXPECT_EQ(flat.one_sided({4, 5, 8, 9}), "");
  EXPECT_THAT(flat.one_sided({4, 5, 9}), HasSubstr("point 9 is in the region, but not point 8"));
  EXPECT_EQ(flat.leaves({s, 3, s}, 1), "");
  EXPECT_THAT(flat.leaves({0, 0, 1}, 1), HasSubstr("0.70710678"));
  Mesh solid = flat_mesh();
  auto cells = std::make_shared<PolyhedralCells>(*solid.cells);
  cells->empty_faces.clear();
  solid.cells = cells;
  EXPECT_FALSE(FlatCase(solid).exists());
  cells = std::make_shared<PolyhedralCells>(*flat_mesh().cells);
  cells->empty_faces.assign(cells->face_count(), 1);  // all around
  solid.cells = cells;
  EXPECT_FALSE(FlatCase(solid).exists());
}

TEST(FlatCase, StaysInItsPlane) {
  const auto mesh = shared(flat_mesh());
  for (const MethodOptions& method : methods()) {
    const auto system = prepare(mesh, setup_of(method));
    const Points got = system->evaluate(Design{{0.1, 0.3}, {}});
    double away = 0, apart = 0;
    for (std::size_t i = 0; i < got.size(); i += 2) {
      away = std::max({away, std::abs(got[i][2]), std::abs(got[i + 1][2] - thickness)});
      apart = std::max(apart, std::hypot(got[i][0] - got[i + 1][0], got[i][1] - got[i + 1][1]));
    }
    EXPECT_LT(away, 1e-12) << method.index();
    // The samples of moving least squares are not the same in both planes.
    EXPECT_LT(apart, std::holds_alternative<MlsOptions>(method) ? 5e-3 : 1e-13) << method.index();
    EXPECT_GT(test::distance(got, mesh->points), 0.1);
  }
}

/// Constraints pull points out of the planes where these do not hold them: a column that is pressed together turns aside.
TEST(FlatCase, ConstraintsStayInItsPlane) {
  const auto mesh = shared(flat_mesh());
  const Region wall = box({0.2, -0.1, -1}, {1.8, 0.1, 1}), top = box({0.2, 0.9, -1}, {1.8, 1.1, 1});
  for (const MethodOptions& method : {methods()[1], methods()[2]}) {
    for (const bool exact : {false, true}) {
      for (const ConstraintKind& kind : {ConstraintKind{Rigid{1}}, ConstraintKind{Rigid{}}, ConstraintKind{Cylindrical{}}}) {
        const auto* rigid = std::get_if<Rigid>(&kind);
        const bool layers = rigid != nullptr && rigid->layers > 0;
        if (layers && exact) continue;
        SCOPED_TRACE(std::to_string(kind.index()) + (layers ? " layers" : "") + (exact ? " exact" : "") + " method " +
                     std::to_string(method.index()));
        deform::Setup setup = setup_of(method);
        setup.constraints = {{"held", {layers ? wall : top}, kind}};
        setup.constraints[0].exact = exact;
        setup.constraint_options.tolerance = 1e-10;
        const auto system = prepare(mesh, setup);
        const std::vector<double> at{0.1, 0.3}, direction{0.7, -0.4};
        const Design design{at, {}};
        EXPECT_TRUE(system->bind({&design, 1}, EvaluationPath::automatic, {})->report(0).converged);
        const Points got = system->evaluate(design), product = system->jacobian_vector(at, direction, {});
        constexpr double h = 1e-4;
        const Points above = system->evaluate(Design{{at[0] + h * direction[0], at[1] + h * direction[1]}, {}}),
                     below = system->evaluate(Design{{at[0] - h * direction[0], at[1] - h * direction[1]}, {}});
        double away = 0, wrong = 0, left = 0;
        for (std::size_t i = 0; i < got.size(); ++i) {
          away = std::max({away, std::abs(got[i][2] - mesh->points[i][2]), std::abs(product[i][2])});
          for (std::size_t k = 0; k < 3; ++k) {
            wrong = std::max(wrong, std::abs((above[i][k] - below[i][k]) / (2 * h) - product[i][k]));
          }
          left += dot(above[i], product[i]);
        }
        EXPECT_LT(away, 1e-12);
        EXPECT_LT(wrong, 1e-5);
        const std::vector<double> gradient = system->vector_jacobian(at, above, {});
        EXPECT_NEAR(gradient[0] * direction[0] + gradient[1] * direction[1], left, 1e-9 * std::abs(left));
      }
    }
  }
}

TEST(FlatCase, RefusesWhatLeavesIt) {
  const auto mesh = shared(flat_mesh());
  for (const MethodOptions& method : methods()) {
    deform::Setup setup = setup_of(method);
    setup.variables.push_back({"bend", "middle", DesignVariable::Rotate{{0, 1, 0}, {1, 0.5, 0}}});
    const auto system = prepare(mesh, setup);
    test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "\"middle\"", "leaves the plane", "its normal [0, 0, 1]"},
                       [&] {
                         system->evaluate(Design{{0, 0, 0.1}, {}});
                       });
    EXPECT_NO_THROW(system->evaluate(Design{{0.1, 0.1, 0}, {}}));
    Problems problems(Problems::Mode::collect);
    find_problems(*mesh, setup, problems);
    ASSERT_EQ(problems.list().size(), 1u);
    EXPECT_EQ(problems.list()[0].field, "variables[2]");
    EXPECT_THAT(problems.list()[0].message, HasSubstr("\"bend\""));

    setup = setup_of(method);
    setup.handles[0].region = box({0.9, 0.3, -1}, {1.2, 0.7, 0.05});
    test::expect_error(ErrorCode::invalid_argument, {"handles[0].region", "\"middle\"", "opposite", "both planes"},
                       [&] { prepare(mesh, setup); });
    Problems more(Problems::Mode::collect);
    find_problems(*mesh, setup, more);
    ASSERT_GE(more.list().size(), 1u);
    EXPECT_THAT(more.list()[0].message, HasSubstr("handles[0].region"));
    setup = setup_of(method);
    setup.fixed[0] = box({-1, -1, 0.05}, {0.1, 2, 1});
    test::expect_error(ErrorCode::invalid_argument, {"fixed", "opposite"}, [&] { prepare(mesh, setup); });
  }
}

}  // namespace
}  // namespace deform::flat_case_test
