// SPDX-License-Identifier: GPL-3.0-or-later
// The RBF system with the iterative solver: what holds for the others holds to its tolerance.
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/error.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/shapes.h"

namespace deform::iterative_test {
namespace {

constexpr double tolerance = 1e-7;

Setup iterative_setup(BasisMode basis) {
  deform::Setup setup = test::sheet_setup();
  RbfOptions options;
  options.solver = Solver::iterative;
  options.tolerance = tolerance;
  options.reduction = CentreReduction::off;
  options.basis = basis;
  setup.method = options;
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0, 0, 1}}});
  setup.variables.push_back({"turn", "end", DesignVariable::Rotate{{0, 0, 1}, {2, 0.5, 0}}});
  return setup;
}

struct Prepared {
  std::shared_ptr<const Mesh> mesh = test::shared(test::bumpy_sheet(100, 51));
  double diagonal = bounding_box(mesh->points).diagonal();
  std::shared_ptr<const System> system(BasisMode basis) const { return prepare(mesh, iterative_setup(basis)); }
};

TEST(Iterative, BothPathsAgreeWithCholesky) {
  const Prepared prepared;
  deform::Setup exact = iterative_setup(BasisMode::always);
  std::get<RbfOptions>(exact.method).solver = Solver::cholesky;
  const auto reference = prepare(prepared.mesh, exact);
  const Design design{{0.2, 0.3}, {}};
  const Points expected = reference->evaluate(design);
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    const auto system = prepared.system(basis);
    EXPECT_EQ(system->info().solver, Solver::iterative);
    EXPECT_GT(system->info().centres, 1000u);
    EXPECT_LE(system->info().factor_bytes, estimate(*prepared.mesh, iterative_setup(basis)).factor_bytes);
    // The error between the centres is about that at the centres.
    EXPECT_LE(test::distance(system->evaluate(design), expected), 20 * tolerance * prepared.diagonal);
    const Design designs[] = {design};
    const auto evaluation = system->bind(designs, EvaluationPath::automatic, {});
    EXPECT_LE(evaluation->report(0).interpolation_residual, 4 * tolerance * prepared.diagonal);
    for (const std::string& note : system->info().notes) EXPECT_EQ(note.find("did not reach"), std::string::npos) << note;
  }
}

TEST(Iterative, DisplacementsPerPointAndRangesAndPopulations) {
  const Prepared prepared;
  const auto system = prepared.system(BasisMode::always);
  const SelectedRegions regions = validate(iterative_setup(BasisMode::always), *prepared.mesh);
  std::vector<Vec3> bump;
  for (const PointId id : regions.handles[0]) {
    const Vec3& x = prepared.mesh->points[id];
    bump.push_back({0, 0, 0.1 * std::sin(3 * x[1])});
  }
  Design free;
  free.motions.push_back({0, bump});
  const std::vector<Design> designs{Design{{0.1, 0}, {}}, free, Design{{0, 0.2}, {}}, free};
  const std::vector<Points> together = system->evaluate(designs);
  for (std::size_t i = 0; i < designs.size(); ++i) EXPECT_EQ(test::distance(together[i], system->evaluate(designs[i])), 0) << i;
  for (std::size_t k = 0; k < bump.size(); ++k) {
    const PointId id = regions.handles[0][k];
    EXPECT_EQ(together[1][id][2], prepared.mesh->points[id][2] + bump[k][2]);
  }
  const auto evaluation = system->bind(designs, EvaluationPath::automatic, {});
  Points part(700);
  Vec3* out = part.data();
  evaluation->evaluate(1234, 1934, 1, std::span<Vec3* const>(&out, 1));
  for (std::size_t i = 0; i < part.size(); ++i) ASSERT_EQ(part[i], together[1][1234 + i]);
}

TEST(Iterative, JacobianProductsAreAdjoint) {
  const Prepared prepared;
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    const auto system = prepared.system(basis);
    const std::vector<double> at{0.1, 0.2}, direction{0.7, -0.4};
    Points cotangent(prepared.mesh->point_count());
    for (std::size_t i = 0; i < cotangent.size(); ++i) {
      const double t = static_cast<double>(i);
      cotangent[i] = {std::sin(t), std::cos(2 * t), std::sin(3 * t)};
    }
    const Points forward = system->jacobian_vector(at, direction, {});
    const std::vector<double> backward = system->vector_jacobian(at, cotangent, {});
    double left = 0, right = 0, size = 0;
    for (std::size_t i = 0; i < cotangent.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        left += forward[i][k] * cotangent[i][k];
        size += std::abs(forward[i][k] * cotangent[i][k]);
      }
    }
    for (std::size_t k = 0; k < 2; ++k) right += backward[k] * direction[k];
    EXPECT_NEAR(left, right, 10 * tolerance * size);
  }
}

TEST(Iterative, ToleranceIsChecked) {
  for (const double bad : {-1.0, 1e-11, 0.1, std::nan("")}) {
    deform::Setup setup = iterative_setup(BasisMode::never);
    std::get<RbfOptions>(setup.method).tolerance = bad;
    try {
      prepare(test::shared(test::bumpy_sheet(20, 10)), setup);
      FAIL() << bad;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("method.rbf.tolerance"), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace deform::iterative_test
