// Constraints inside the deformation: thesis 8.5 to 8.5.2.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <memory>

#include "core/deformers/constrained/constrained_solver.h"
#include "core/deformers/energy/spaces/shell.h"
#include "core/deformers/handles/constraint_points.h"
#include "tests/core/deformers/energy_cases.h"

namespace deform {
namespace {

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

ConstrainedSolver::Options plain() {
  ConstrainedSolver::Options options;
  options.acceleration = ConstrainedSolver::Acceleration::none;
  options.most_iterations = options.patience = 20000;
  return options;
}

// Thesis 8.5: the objective never rises; the accelerated iteration has the same fixed point and takes fewer steps.
TEST(Alternation, AlternationDescendsToOneFixedPoint) {
  const Case c({patch(Planar{}, 1.2, 1.6, 1e4), patch(Rigid{}, 0.5, 1.25, 1e4)});
  ConstrainedSolver::Options slow = plain();
  slow.tolerance = 1e-8;
  const ConstrainedResult alternating = c.solve(slow);
  const ConstrainedResult accelerated = c.solve({});
  ASSERT_TRUE(alternating.converged);
  ASSERT_TRUE(accelerated.converged);
  RecordProperty("iterations", std::to_string(alternating.iterations) + " " + std::to_string(accelerated.iterations));
  EXPECT_LT(accelerated.iterations, alternating.iterations);
  EXPECT_LT(distance(alternating.after.points, accelerated.after.points), 1e-6);
  for (const ConstrainedResult* result : {&alternating, &accelerated}) {
    for (std::size_t i = 1; i < result->objectives.size(); ++i) {
      EXPECT_LE(result->objectives[i], result->objectives[i - 1] + 1e-12 * std::abs(result->objectives[i]));
    }
  }
}

// Thesis 8.5: overlapping sets with stiff weights end with Gauss-Newton, at a point that the alternation leaves alone.
TEST(Alternation, StiffWeightsFallBackToGaussNewton) {
  const Case c({patch(Planar{}, 1.2, 1.6, 1e8), patch(Rigid{}, 0.5, 1.25, 1e8)}, 21);
  const ConstrainedResult result = c.solve({});
  EXPECT_TRUE(result.converged);
  EXPECT_GT(result.newton_steps, 0);
  ConstrainedSolver::Options more = plain();
  more.most_iterations = more.patience = 1000;
  EXPECT_LE(result.after.objective, c.solve(more).after.objective + 1e-9);
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
  ConstrainedSolver::Options options = plain();
  options.tolerance = 0;
  ConstrainedState state = c.solve(plain()).before;
  for (int iterations = 1; iterations <= 5; ++iterations) {
    Eigen::MatrixXd b = c.solver->right_side(c.h);
    std::size_t first = 0;
    for (std::size_t t = 0; t < c.sets.size(); ++t) {
      Eigen::MatrixXd y(static_cast<Eigen::Index>(c.sets[t].ids.size()), 3);
      for (Eigen::Index i = 0; i < y.rows(); ++i) {
        for (Eigen::Index a = 0; a < 3; ++a) {
          const auto at = static_cast<std::size_t>(i), axis = static_cast<std::size_t>(a);
          y(i, a) = state.targets[first + at][axis] - c.sets[t].rest[at][axis];
        }
      }
      b += weighted[t] * y;
      first += c.sets[t].ids.size();
    }
    const Eigen::MatrixXd expected = factor.solve(b);
    options.most_iterations = options.patience = iterations;
    const ConstrainedResult result = c.solve(options);
    state = result.after;
    EXPECT_LT((result.w - expected).cwiseAbs().maxCoeff(), 1e-9) << iterations;
  }
}

// Thesis 8.5.1: the thesis' own forms. The mean-centred one has the same iterates; subtracting one point instead has another
// fixed point, farther from the shapes.
TEST(SparseConstraintRows, FormsOfTheThesis) {
  const Case c({patch(Planar{}, 1.2, 1.6, 1e4), patch(Rigid{}, 0.5, 1.25, 1e4)}, 21);
  const auto solved = [&](ConstrainedSolver::Form form, int iterations) {
    ConstrainedSolver::Options options = plain();
    options.form = form;
    options.tolerance = iterations > 0 ? 0 : 1e-9;
    if (iterations > 0) options.most_iterations = iterations;
    return c.solve(options);
  };
  for (const int iterations : {1, 7, 50}) {
    EXPECT_LT(distance(solved(ConstrainedSolver::Form::mean_centred, iterations).after.points,
                       solved(ConstrainedSolver::Form::bordered, iterations).after.points),
              1e-9)
        << iterations;
  }
  const ConstrainedResult bordered = solved(ConstrainedSolver::Form::bordered, 0);
  const ConstrainedResult anchored = solved(ConstrainedSolver::Form::anchored, 0);
  EXPECT_GT(distance(bordered.after.points, anchored.after.points), 1e-6);
  EXPECT_LT(bordered.after.objective, anchored.after.objective);
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
}  // namespace deform
