// SPDX-License-Identifier: GPL-3.0-or-later
// Half models with constraints: against whole ones that are made here, and shapes measured on what is delivered.
#include "core/deformers/mirrored_constraints.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <string>
#include <vector>

#include "tests/core/deformers/mirrored_sheet.h"
#include "tests/support/expect_error.h"
#include "tests/support/linear_algebra.h"

namespace deform::mirrored_constraints_test {
namespace {

using test::across;
using test::half_setup;
using test::shared;
using test::WholeSheet;

MlsOptions few_samples() {
  MlsOptions options;
  options.surface_samples = 80;
  options.volume_samples = 40;
  return options;
}

/// So that no set has two fits that are about as good: which one is found would be a matter of rounding.
const Design mild{{0.02, 0.1, 0.05, -0.1}, {}};

/// "roof" reaches the plane, "side" does not, "rail" is along it, "slope" slides in a given plane.
deform::Setup constrained(const decltype(deform::Setup::method)& method, bool exact) {
  deform::Setup setup = half_setup(method);
  setup.constraints = {
      {"roof", {test::box({0.45, -1, -1}, {0.75, 0.35, 1})}, Planar{}, 0, exact},
      {"side", {test::box({1.2, 0.6, -1}, {1.5, 0.9, 1})}, Planar{}, 0, exact},
      {"slope", {test::box({0.5, 0.75, -1}, {0.7, 0.95, 1})}, FixedPlane{{0.6, 0.8, 0.05}, {0.1, 0.2, 1}}, 0, exact},
      {"rail", {test::box({1.2, -1, -1}, {1.5, 0.01, 1})}, Straight{}, 0, exact},
  };
  setup.constraint_options.tolerance = 1e-11;
  return setup;
}

/// Largest distance of points from the plane of total least squares.
double off_plane(const std::vector<Vec3>& points) {
  Eigen::MatrixXd x(points.size(), 3);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) x(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = points[i][k];
  }
  x.rowwise() -= x.colwise().mean().eval();
  return (x * test::thin_svd(x).V.col(2)).cwiseAbs().maxCoeff();
}

class MirroredConstraintsOf : public testing::TestWithParam<MethodOptions> {};

TEST_P(MirroredConstraintsOf, AreThoseOfTheWholeModel) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  const MethodOptions& method = GetParam();
  for (const bool exact : {false, true}) {
    SCOPED_TRACE(std::string(exact ? "exact " : "soft ") + std::to_string(method.index()));
    const deform::Setup setup = constrained(method, exact);
    if (exact && std::holds_alternative<MlsOptions>(method)) {
      test::expect_error(ErrorCode::invalid_argument, {"constraints[0].exact", "method.mls", "method.shell or method.ffd"},
                         [&] { prepare(half, setup); });
      continue;
    }
    WholeSheet whole(*half, setup, mild);
    const auto ids = validate(setup, *half).constraints;
    const auto region = [&](std::size_t i, bool own, bool image) {
      std::vector<PointId> all;
      for (const PointId id : ids[i][0]) {
        if (own) all.push_back(id);
        if (image && !(own && whole.image[id] == id)) all.push_back(whole.image[id]);
      }
      return Region{Region::Ids{all}};
    };
    whole.setup.constraints = {
        {"roof", {region(0, true, true)}, Planar{}, 0, exact},
        {"left", {region(1, true, false)}, Planar{}, 0, exact},
        {"right", {region(1, false, true)}, Planar{}, 0, exact},
        {"left slope", {region(2, true, false)}, FixedPlane{{0.6, 0.8, 0.05}, {0.1, 0.2, 1}}, 0, exact},
        {"right slope", {region(2, false, true)}, FixedPlane{{0.6, -0.8, 0.05}, {0.1, -0.2, 1}}, 0, exact},
        {"rail", {region(3, true, false)}, Straight{}, 0, exact},
    };
    const Points expected = prepare(whole.mesh, whole.setup)->evaluate(whole.design);
    const auto system = prepare(half, setup);
    const Points got = system->evaluate(mild);
    double off = 0, moved_by = 0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      off = std::max(off, distance(got[i], lerp(expected[i], across(expected[whole.image[i]]), 0.5)));
    }
    deform::Setup plain = setup;
    plain.constraints.clear();
    const Points without = prepare(half, plain)->evaluate(mild);
    for (const PointId id : ids[0][0]) moved_by = std::max(moved_by, distance(got[id], without[id]));
    EXPECT_LT(off, 1e-7);
    EXPECT_GT(moved_by, 1e-3) << "the constraint changes something";
    EXPECT_THAT(system->info().notes, testing::Contains(testing::HasSubstr("Constraint roof continues through symmetry[0]")));
    EXPECT_THAT(system->info().notes, testing::Not(testing::Contains(testing::HasSubstr("Constraint side continues"))));

    // What is delivered is measured here.
    const auto evaluation = system->bind({&mild, 1}, EvaluationPath::automatic, {});
    const DesignReport& report = evaluation->report(0);
    ASSERT_EQ(report.constraints.size(), 4u);
    EXPECT_TRUE(report.converged) << report.iterations << " iterations, error " << report.convergence_error;
    std::vector<Vec3> roof, side;
    for (const PointId id : ids[0][0]) {
      roof.push_back(got[id]);
      if (whole.image[id] != id) roof.push_back(across(got[id]));
    }
    for (const PointId id : ids[1][0]) side.push_back(got[id]);
    EXPECT_NEAR(report.constraints[0].max, off_plane(roof), 1e-9);
    EXPECT_NEAR(report.constraints[1].max, off_plane(side), 1e-9);
    EXPECT_GT(report.constraints[0].max_before, 1e-3);
    if (exact) {
      EXPECT_LT(off_plane(roof), 1e-9);
      EXPECT_LT(off_plane(side), 1e-9);
      for (const PointId id : ids[2][0]) {
        EXPECT_LT(std::abs(dot(got[id] - Vec3{0.6, 0.8, 0.05}, {0.1, 0.2, 1})), 1e-9);
      }
      for (const ConstraintReport& each : report.constraints) EXPECT_FALSE(each.missed);
    }
    for (std::size_t i = 0; i < got.size(); ++i) {
      if (half->points[i][1] == 0) {
        EXPECT_EQ(got[i][1], 0);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, MirroredConstraintsOf,
                         testing::Values(MethodOptions(ShellOptions{}), MethodOptions(few_samples()),
                                         MethodOptions(FfdOptions{})),
                         [](const auto& tested) { return std::to_string(tested.param.index()); });

TEST(MirroredConstraints, Derivatives) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  for (const bool exact : {false, true}) {
    const auto system = prepare(half, constrained(ShellOptions{}, exact));
    test::check_jacobians(*system, 1e-9, 1e-5);
  }
}

/// A half of a strip bent about the x axis: z = height(y).
template <typename Height>
std::shared_ptr<const Mesh> strip(const Height& height) {
  Mesh mesh = test::bumpy_sheet(21, 11);
  for (Vec3& x : mesh.points) x[2] = height(x[1]);
  return shared(std::move(mesh));
}

deform::Setup with(const ConstraintKind& kind) {
  deform::Setup setup = half_setup(ShellOptions{});
  setup.handles.pop_back();
  setup.variables.resize(2);
  setup.constraints = {{"set", {test::box({0.5, -1, -9}, {1.2, 0.65, 9})}, kind, 0, false}};
  return setup;
}

std::vector<Constraint> of_whole(const std::shared_ptr<const Mesh>& half, const deform::Setup& setup) {
  const SelectedRegions regions = validate(setup, *half);
  return MirroredConstraints(setup, *half, regions, MirroredMesh(*half, regions.symmetry)).constraints;
}

TEST(MirroredConstraints, WhatContinuesThroughAPlaneIsOneShape) {
  const auto gabled = strip([](double y) { return 0.4 - 0.5 * y + 1e-3 * std::sin(40 * y); });
  const auto round = strip([](double y) { return std::sqrt(1.44 - y * y); });
  const auto off_centre = strip([](double y) { return std::sqrt(1.44 - (y - 0.3) * (y - 0.3)); });
  EXPECT_EQ(of_whole(gabled, with(Planar{})).size(), 2u) << "two slopes";
  EXPECT_EQ(of_whole(round, with(Cylindrical{})).size(), 1u) << "one bore";
  EXPECT_EQ(of_whole(off_centre, with(Cylindrical{})).size(), 2u) << "two bores that meet in the plane";
  EXPECT_EQ(of_whole(gabled, with(Rigid{})).size(), 1u) << "one part";
  EXPECT_EQ(of_whole(round, with(Extent{{0, 1, 0}, Bound::maximum, 0.6})).size(), 2u) << "its words are about the half model";
  const std::vector<Constraint> extents = of_whole(round, with(Extent{{1, 1, 0}, Bound::maximum, 0.6}));
  EXPECT_EQ(std::get<Extent>(extents[1].kind).axis, (Vec3{1, -1, 0}));
  EXPECT_EQ(extents[1].name, "set (image 1)");
  deform::Setup in_plane = with(FixedPlane{{0, 0, 0.4}, {0, 0.3, 1}});
  in_plane.constraints[0].regions = {test::box({0.5, -1, -9}, {1.2, 0.01, 9})};
  EXPECT_EQ(of_whole(gabled, in_plane).size(), 2u) << "points in the plane slide along both images of the given one";
  in_plane.constraints[0].kind = Straight{};
  EXPECT_EQ(of_whole(gabled, in_plane).size(), 1u);
}

TEST(MirroredConstraints, ErrorsNameTheHalfModel) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  deform::Setup setup = constrained(ShellOptions{}, false);
  setup.constraints.push_back({"pairs", {test::box({0.45, 0.05, -1}, {0.75, 0.35, 1})}, Symmetric{}, 0, false});
  std::get<Symmetric>(setup.constraints.back().kind).plane = Symmetric::Plane{{0.5, 0, 0}, {1, 0, 0}};
  test::expect_error(ErrorCode::invalid_argument, {"constraints[4]"}, [&] { prepare(half, setup); });
  const deform::Setup good = constrained(ShellOptions{}, true);
  const Estimate expected = estimate(*half, good);
  EXPECT_GE(expected.resident_bytes, prepare(half, good)->info().bytes);
}

}  // namespace
}  // namespace deform::mirrored_constraints_test
