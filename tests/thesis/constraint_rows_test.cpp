// SPDX-License-Identifier: GPL-3.0-or-later
// Constraints inside the deformation: thesis 8.5 to 8.5.2.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <memory>

#include "core/deformers/constrained/constrained_solver.h"
#include "core/deformers/energy/spaces/shell.h"
#include "core/deformers/handles/constraint_points.h"
#include "tests/bench/plain_alternation.h"
#include "tests/core/deformers/energy_cases.h"

namespace deform::constraint_rows_test {
namespace {

using bench::PlainAlternation;
using test::distance;

/// A bent shell with a plane and a rigid patch, as the solver sees it.
struct Case {
  explicit Case(std::vector<Constraint> constraints, std::size_t columns = 31)
      : mesh(test::bumpy_sheet(columns, columns / 2 + 1)) {
    deform::Setup setup = test::sheet_setup();
    setup.method = ShellOptions{};
    const SelectedRegions regions = validate(setup, mesh);
    const double diagonal = bounding_box(mesh.points).diagonal();
    model = shell_model(mesh, constraint_points(mesh, regions).region_of, ShellOptions{}, diagonal);
    EnergySolver::Problem problem;
    problem.energy = model.space.energy;
    problem.coupling = -model.coupling;
    solver = std::make_unique<EnergySolver>(std::move(problem), 0, RunContext{});
    h = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(model.held.size()), 3);
    for (std::size_t j = 0; j < model.held.size(); ++j) {
      const Vec3 &x = mesh.points[model.held[j]], y = transformed(test::turn_and_shift(), x);
      if (x[0] < 1) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        h(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = (y[k] - x[k]) / diagonal;
      }
    }
    for (const Constraint& constraint : constraints) {
      ConstraintSet set{constraint.name, nullptr, select(constraint.regions[0], mesh, "set"), {}, constraint.weight};
      for (const PointId id : set.ids) {
        set.rest.push_back({mesh.points[id][0] / diagonal, mesh.points[id][1] / diagonal, mesh.points[id][2] / diagonal});
      }
      set.projection = make_projection(constraint.kind, std::vector<std::vector<Vec3>>{set.rest});
      sets.push_back(set);
      offsets.resize(offsets.size() + set.ids.size(), Vec3{});
    }
  }
  ConstrainedResult solve(const ConstrainedSolver::Options& options) const {
    return ConstrainedSolver(*solver, model.space.values, sets, options, 0, {}).solve(h, offsets, {});
  }
  PlainAlternation plain(PlainAlternation::Form form = PlainAlternation::Form::translations) const {
    return PlainAlternation(*solver, model.space.values, sets, h, offsets, form);
  }

  Mesh mesh;
  EnergyModel model;
  std::unique_ptr<EnergySolver> solver;
  Eigen::MatrixXd h;
  std::vector<ConstraintSet> sets;
  std::vector<Vec3> offsets;
};

Constraint patch(const ConstraintKind& kind, double from, double to, double weight) {
  return {"patch", {test::box({from, 0.1, -9}, {to, 0.9, 9})}, kind, weight};
}

// Thesis 8.5: the objective never rises; the accelerated iteration has the same fixed point and takes fewer steps.
TEST(Alternation, AlternationDescendsToOneFixedPoint) {
  const Case c({patch(Planar{}, 1.2, 1.6, 1e4), patch(Rigid{}, 0.5, 1.25, 1e4)});
  PlainAlternation alternating = c.plain();
  int iterations = 1;
  for (double before = alternating.state().objective; alternating.step() > 1e-9; ++iterations) {
    ASSERT_LT(iterations, 20000);
    EXPECT_LE(alternating.state().objective, before + 1e-12 * std::abs(before));
    before = alternating.state().objective;
  }
  const ConstrainedResult accelerated = c.solve({});
  ASSERT_TRUE(accelerated.converged);
  RecordProperty("iterations", std::to_string(iterations) + " " + std::to_string(accelerated.iterations));
  EXPECT_LT(accelerated.iterations, iterations);
  EXPECT_LT(distance(alternating.state().points, accelerated.after.points), 1e-6);
  for (std::size_t i = 1; i < accelerated.objectives.size(); ++i) {
    EXPECT_LE(accelerated.objectives[i], accelerated.objectives[i - 1] + 1e-12 * std::abs(accelerated.objectives[i]));
  }
}

// Thesis 8.5: overlapping sets with stiff weights end with Gauss-Newton, at a point that the alternation leaves alone.
TEST(Alternation, StiffWeightsFallBackToGaussNewton) {
  const Case c({patch(Planar{}, 1.2, 1.6, 1e8), patch(Rigid{}, 0.5, 1.25, 1e8)}, 21);
  const ConstrainedResult result = c.solve({});
  EXPECT_TRUE(result.converged);
  EXPECT_GT(result.newton_steps, 0);
  PlainAlternation more = c.plain();
  for (int i = 0; i < 1000; ++i) more.step();
  EXPECT_LE(result.after.objective, more.state().objective + 1e-9);
}

// Thesis 8.5.1: one unknown translation per set gives the iterates of the mean-centred form.
TEST(SparseConstraintRows, TranslationsAreMeanCentring) {
  const Case c({patch(Planar{}, 1.2, 1.6, 1e4), patch(Rigid{}, 0.5, 1.25, 1e4)}, 21);
  const auto k = static_cast<Eigen::Index>(c.solver->unknowns());
  const SparseMatrix full = c.solver->matrix().selfadjointView<Eigen::Lower>();
  Eigen::MatrixXd A(full);
  std::vector<Eigen::MatrixXd> weighted;  // g Phi^T C^T C
  for (const ConstraintSet& set : c.sets) {
    const auto n = static_cast<Eigen::Index>(set.ids.size());
    Eigen::MatrixXd Phi = Eigen::MatrixXd::Zero(n, k);
    for (Eigen::Index i = 0; i < n; ++i) {
      for (SparseRows::InnerIterator it(c.model.space.values, set.ids[static_cast<std::size_t>(i)]); it; ++it) {
        Phi(i, it.col()) = it.value();
      }
    }
    const Eigen::MatrixXd C = Eigen::MatrixXd::Identity(n, n) - Eigen::MatrixXd::Constant(n, n, 1.0 / static_cast<double>(n));
    weighted.push_back(set.weight / static_cast<double>(n) * Phi.transpose() * C.transpose() * C);
    A += weighted.back() * Phi;
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(A);
  PlainAlternation plain = c.plain();
  for (int iterations = 1; iterations <= 5; ++iterations) {
    Eigen::MatrixXd b = c.solver->right_side(c.h);
    std::size_t first = 0;
    for (std::size_t t = 0; t < c.sets.size(); ++t) {
      Eigen::MatrixXd y(static_cast<Eigen::Index>(c.sets[t].ids.size()), 3);
      for (Eigen::Index i = 0; i < y.rows(); ++i) {
        for (Eigen::Index a = 0; a < 3; ++a) {
          const auto at = static_cast<std::size_t>(i), axis = static_cast<std::size_t>(a);
          y(i, a) = plain.state().targets[first + at][axis] - c.sets[t].rest[at][axis];
        }
      }
      b += weighted[t] * y;
      first += c.sets[t].ids.size();
    }
    const Eigen::MatrixXd expected = factor.solve(b);
    plain.step();
    EXPECT_LT((plain.w() - expected).cwiseAbs().maxCoeff(), 1e-9) << iterations;
  }
}

// Thesis 8.5.1: the thesis' own forms. The mean-centred one has the same iterates; subtracting one point instead has another
// fixed point, farther from the shapes.
TEST(SparseConstraintRows, FormsOfTheThesis) {
  const Case c({patch(Planar{}, 1.2, 1.6, 1e4), patch(Rigid{}, 0.5, 1.25, 1e4)}, 21);
  PlainAlternation translations = c.plain(), mean_centred = c.plain(PlainAlternation::Form::mean_centred),
                   anchored = c.plain(PlainAlternation::Form::anchored);
  for (int i = 1; i <= 50; ++i) {
    translations.step();
    mean_centred.step();
    if (i != 1 && i != 7 && i != 50) continue;
    EXPECT_LT(distance(mean_centred.state().points, translations.state().points), 1e-9) << i;
  }
  for (PlainAlternation* form : {&translations, &anchored}) {
    for (int i = 0; i < 20000 && form->step() > 1e-10; ++i) continue;
  }
  EXPECT_GT(distance(translations.state().points, anchored.state().points), 1e-6);
  EXPECT_LT(translations.state().objective, anchored.state().objective);
}

// Thesis 8.5.2: the distance from the shape falls like 1 / gamma_c where every point has functions of its own.
TEST(ConstraintWeight, ResidualFallsWithTheWeight) {
  for (const ConstraintKind& kind : {ConstraintKind{Planar{}}, ConstraintKind{Rigid{}}, ConstraintKind{FeatureLine{}}}) {
    double last = 0;
    for (const double weight : {1e8, 1e9}) {
      const ConstrainedResult result = Case({patch(kind, 1.1, 1.5, weight)}, 21).solve({});
      EXPECT_TRUE(result.converged) << kind_name(kind) << weight;
      const double rms = std::sqrt(result.after.squares[0]);
      if (last > 0) {
        EXPECT_NEAR(last / rms, 10, 1.5) << kind_name(kind);
      }
      last = rms;
    }
  }
}

}  // namespace
}  // namespace deform::constraint_rows_test
