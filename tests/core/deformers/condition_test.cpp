// SPDX-License-Identifier: GPL-3.0-or-later
// Boundary layers: centres so close to each other that the condition of the system is 1e12 and far beyond. What a report tells of
// the error is held against solutions in double-double at every point, so that it may say on its own whether a design is good.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "proto/convert/verdict.h"
#include "tests/core/deformers/dense_interpolant.h"
#include "tests/core/deformers/shapes.h"

namespace deform::condition_test {
namespace {

using test::Wide;
using test::WideVec;

/// Columns of points above a bumpy wall, the first of them `first` high and each next one farther by a constant factor, up to 1.
struct Layers {
  std::size_t columns = 9, rows = 4, layers = 18;
  double first = 1e-6;

  std::size_t count() const { return columns * rows * (layers + 1); }
  PointId at(std::size_t i, std::size_t j, std::size_t k) const { return static_cast<PointId>(i + columns * (j + rows * k)); }

  /// The ratio of the heights of the last layers.
  double growth() const {
    double low = 1 + 1e-9, high = 100;
    for (int step = 0; step < 200; ++step) {
      const double middle = 0.5 * (low + high);
      const double total = first * (std::pow(middle, static_cast<double>(layers)) - 1) / (middle - 1);
      (total > 1 ? high : low) = middle;
    }
    return low;
  }

  Mesh mesh() const {
    Mesh mesh;
    const double ratio = growth();
    double height = 0, step = first;
    for (std::size_t k = 0; k <= layers; ++k) {
      for (std::size_t j = 0; j < rows; ++j) {
        for (std::size_t i = 0; i < columns; ++i) {
          const double x = 2.0 * static_cast<double>(i) / static_cast<double>(columns - 1);
          const double y = static_cast<double>(j) / static_cast<double>(rows - 1);
          mesh.points.push_back({x, y, 0.1 * std::sin(3 * x) * std::cos(2 * y) + height});
        }
      }
      height += step;
      step *= ratio;
    }
    return mesh;
  }

  /// The wall in the middle moves; its ends with all layers above them, which are patches of the mesh, and the last layer stay.
  Setup setup(RbfOptions options) const {
    Setup setup;
    std::vector<PointId> wall, still;
    for (std::size_t k = 0; k <= layers; ++k) {
      for (std::size_t j = 0; j < rows; ++j) {
        for (std::size_t i = 0; i < columns; ++i) {
          if (i == 0 || i + 1 == columns || k == layers) {
            still.push_back(at(i, j, k));
          } else if (k == 0 && i >= 2 && i + 2 < columns) {
            wall.push_back(at(i, j, k));
          }
        }
      }
    }
    options.reduction = CentreReduction::off;
    setup.method = options;
    setup.handles = {{"wall", {Region::Ids{wall}}}};
    setup.fixed = {{Region::Ids{still}}};
    setup.variables.push_back({"up", "wall", DesignVariable::Translate{{0.3, 0, 1}}});
    setup.variables.push_back({"turn", "wall", DesignVariable::Rotate{{0, 1, 0}, {1, 0.5, 0}}});
    return setup;
  }
};

struct Case {
  Kernel kernel;
  double first;
  Solver solver;
  BasisMode basis;
};

/// The displacements of the held points, and by the interpolant in double-double those of all.
class Exact {
 public:
  Exact(const Mesh& mesh, const deform::Setup& setup, const System& system, Kernel kernel) : mesh_(mesh) {
    const SelectedRegions regions = validate(setup, mesh);
    test::DenseInterpolant::Problem problem;
    problem.kernel = kernel;
    problem.degree = properties(kernel).default_degree();
    ids_ = regions.fixed;
    ids_.insert(ids_.end(), regions.handles[0].begin(), regions.handles[0].end());
    std::sort(ids_.begin(), ids_.end());
    Box box;
    for (const PointId id : ids_) {
      problem.centres.push_back(test::wide(mesh.points[id]));
      box.add(mesh.points[id]);
    }
    for (const std::string& note : system.info().notes) {
      double share = 0;
      if (std::sscanf(note.c_str(), "The shape is %lf of the diagonal", &share) == 1) problem.shape = share * box.diagonal();
    }
    interpolant_ = std::make_unique<test::DenseInterpolant>(std::move(problem));
  }

  /// The largest distance of these displacements from the exact ones, as a fraction of the largest of those.
  double error(const std::vector<WideVec>& displacements) {
    std::vector<WideVec> data;
    for (const PointId id : ids_) data.push_back(displacements[id]);
    if (!interpolant_->solve(data)) return HUGE_VAL;
    double largest = 0, motion = 0;
    for (std::size_t i = 0; i < displacements.size(); ++i) {
      const WideVec exact = interpolant_->value(test::wide(mesh_.points[i]));
      motion = std::max(motion, test::length(exact));
      largest = std::max(largest, test::length(displacements[i] - exact));
    }
    return largest / motion;
  }

 private:
  const Mesh& mesh_;
  std::vector<PointId> ids_;
  std::unique_ptr<test::DenseInterpolant> interpolant_;
};

std::vector<WideVec> displacements(const Points& points, const Points& rest) {
  std::vector<WideVec> result(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[i][k] = test::exact_sum(points[i][k], -rest[i][k]);
  }
  return result;
}

v1::DesignResult judged(const System& system, const DesignReport& report, double moved) {
  v1::DesignResult result;
  result.set_max_displacement(moved);
  result.set_prescribed_displacement(report.prescribed_displacement);
  result.set_estimated_error(report.error);
  result.set_relative_error(report.error / moved);
  v1::Setup setup;
  setup.mutable_method()->mutable_rbf()->set_kernel(v1::TRIHARMONIC);
  convert::set_verdict({system.info().diagonal, system.info().condition, report.converged, 0, 0, convert::method_facts(setup)},
                       result);
  return result;
}

class Condition : public testing::TestWithParam<Case> {
 protected:
  static RbfOptions options() {
    RbfOptions result;
    result.kernel = GetParam().kernel;
    result.solver = GetParam().solver;
    result.basis = GetParam().basis;
    return result;
  }

  const Layers layers{.first = GetParam().first};
  const std::shared_ptr<const Mesh> mesh = test::shared(layers.mesh());
  const deform::Setup setup = layers.setup(options());
  const std::shared_ptr<const System> system = prepare(mesh, setup);
};

// The error that is told, whatever the condition; and where it tells that a design is good, its verdict.
TEST_P(Condition, DoesNotHideErrors) {
  Exact exact(*mesh, setup, *system, GetParam().kernel);
  for (const std::vector<double>& variables : {std::vector<double>{0.05, 0.1}, {0.2, 0}, {0, -0.3}}) {
    const Design design{variables, {}};
    const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
    const DesignReport& report = evaluation->report(0);
    const Points points = system->evaluate(design);
    const double moved = test::distance(points, mesh->points), truth = exact.error(displacements(points, mesh->points));
    char figures[160];
    std::snprintf(figures, sizeof figures, "condition %.2g, told %.2g, true %.2g", system->info().condition, report.error / moved,
                  truth);
    EXPECT_GE(report.error / moved, 0.5 * truth) << figures;
    const v1::DesignResult result = judged(*system, report, moved);
    if (report.converged && report.error < 1e-8 * moved) {
      EXPECT_EQ(result.verdict(), v1::VERDICT_GOOD) << figures;
      EXPECT_EQ(result.notes_size(), system->info().condition > 1e12 ? 1 : 0) << figures;
    } else if (system->info().condition > 1e12) {
      EXPECT_NE(result.verdict(), v1::VERDICT_GOOD) << figures;
    }
  }
}

// Derivatives have no report. They come from the same solutions.
TEST_P(Condition, LeavesDerivativesAsAccurateAsDesigns) {
  const Design some{{0.05, 0.1}, {}};
  if (!system->bind({&some, 1}, EvaluationPath::automatic, {})->report(0).converged) return;  // its designs are bad
  Exact exact(*mesh, setup, *system, GetParam().kernel);
  const std::vector<double> at{0.05, 0.1};
  const std::vector<std::vector<double>> directions{{1, 0}, {0, 1}};
  Points cotangent(mesh->point_count());
  for (std::size_t i = 0; i < cotangent.size(); ++i) {
    const double phase = 0.1 * static_cast<double>(i);
    cotangent[i] = {std::sin(phase), std::cos(3 * phase), std::sin(7 * phase)};
  }
  const std::vector<double> gradient = system->vector_jacobian(at, cotangent, {});
  for (std::size_t v = 0; v < directions.size(); ++v) {
    const Points field = system->jacobian_vector(at, directions[v], {});
    std::vector<WideVec> wide;
    double product = 0, terms = 0;
    for (std::size_t i = 0; i < field.size(); ++i) {
      wide.push_back(test::wide(field[i]));
      product += dot(field[i], cotangent[i]);
      terms += std::abs(dot(field[i], cotangent[i]));
    }
    EXPECT_LE(exact.error(wide), 1e-8) << "condition " << system->info().condition;
    EXPECT_NEAR(gradient[v], product, 1e-8 * terms) << "condition " << system->info().condition;
  }
}

/// A body whose half lies at y >= 0, with a row of points on the plane and one right beside it, as meshes have it that were cut
/// there.
struct CutBody {
  std::vector<Vec3> half, whole;
  explicit CutBody(double beside) {
    std::vector<double> turns{0, beside};
    for (int j = 1; j <= 8; ++j) turns.push_back(1.5 * j / 8);
    for (std::size_t j = 0; j < turns.size(); ++j) {
      for (int i = 0; i < 26; ++i) {
        const double u = 2 * std::numbers::pi * i / 26, c = std::cos(turns[j]);
        const Vec3 x{c * std::cos(u), j == 0 ? 0 : 0.3 * std::sin(turns[j]), 0.4 * c * std::sin(u)};
        half.push_back(x);
        whole.push_back(x);
        if (j > 0) whole.push_back({x[0], -x[1], x[2]});
      }
    }
  }
};

// Half and whole are as good as told although the points beside the plane are 1e-3 to 1e-8 of the body away from it: beyond a
// condition of 1e15 differences between close centres are factored, which have lost fewer digits.
TEST(ConditionOfHalfModels, IsJudgedByTheMeasuredError) {
  for (const double beside : {1e-3, 1e-4, 1e-6, 1e-7, 1e-8}) {
    const CutBody body(beside);
    test::DenseInterpolant::Problem problem;
    const auto held = [](const Vec3& x) { return x[0] >= 0.5 || x[0] <= -0.3; };
    std::vector<Vec3> centres;
    for (const Vec3& x : body.whole) {
      if (!held(x)) continue;
      centres.push_back(x);
      problem.centres.push_back(test::wide(x));
    }
    test::DenseInterpolant oracle(std::move(problem));
    for (const bool is_half : {true, false}) {
      auto mesh = std::make_shared<Mesh>();
      mesh->points = is_half ? body.half : body.whole;
      deform::Setup setup;
      RbfOptions options;
      options.kernel = Kernel::triharmonic;
      setup.method = options;
      setup.handles = {{"nose", test::box({0.5, -9, -9}, {9, 9, 9})}};
      setup.fixed = {test::box({-9, -9, -9}, {-0.3, 9, 9})};
      setup.variables = {{"up", "nose", DesignVariable::Translate{{0.1, 0, 1}}}, {"wide", "nose", Scaling{{0, 0, 0}, {0, 1, 0}}}};
      if (is_half) setup.symmetry = {{SymmetryPlane::Plane{{0, 0, 0}, {0, 1, 0}}}};
      const auto system = prepare(mesh, setup, {});
      for (const std::vector<double>& variables : {std::vector<double>{0.125, 0}, {0, 0.25}}) {
        const Design design{variables, {}};
        const DesignReport report = system->bind({&design, 1}, EvaluationPath::automatic, {})->report(0);
        const Points points = system->evaluate(design);
        std::vector<WideVec> data;
        for (const Vec3& x : centres) {
          WideVec u{};
          if (x[0] >= 0.5) u = {Wide(variables[0]) * Wide(0.1), Wide(variables[1]) * Wide(x[1]), variables[0]};
          data.push_back(u);
        }
        ASSERT_TRUE(oracle.solve(data));
        double truth = 0, moved = 0;
        const std::vector<WideVec> got = displacements(points, mesh->points);
        for (std::size_t i = 0; i < points.size(); ++i) {
          const WideVec exact = oracle.value(test::wide(mesh->points[i]));
          truth = std::max(truth, test::length(got[i] - exact));
          moved = std::max(moved, test::length(exact));
        }
        char figures[160];
        std::snprintf(figures, sizeof figures, "%s, beside %g: condition %.2g, told %.2g, true %.2g", is_half ? "half" : "whole",
                      beside, system->info().condition, report.error / moved, truth / moved);
        if (report.converged) {
          EXPECT_GE(report.error, 0.5 * truth) << figures;
        }
        const v1::Verdict verdict = judged(*system, report, moved).verdict();
        if (report.converged) {
          EXPECT_EQ(verdict, v1::VERDICT_GOOD) << figures;
        } else {
          EXPECT_EQ(verdict, report.error <= 1e-9 * moved ? v1::VERDICT_DOUBTFUL : v1::VERDICT_BAD) << figures;
          if (verdict == v1::VERDICT_DOUBTFUL) {
            EXPECT_LT(truth, 1e-8 * moved) << figures;
          }
        }
        if (beside >= 1e-4) {
          EXPECT_TRUE(report.converged) << figures;
          EXPECT_LT(truth, 1e-11 * moved) << figures;
        }
      }
      EXPECT_LT(system->info().condition, 1e15);
      if (beside >= 1e-3) {
        EXPECT_GT(system->info().condition, 1e12);
      }
    }
  }
}

constexpr Case cases[] = {
    {Kernel::gaussian, 1e-5, Solver::cholesky, BasisMode::always},
    {Kernel::gaussian, 1e-7, Solver::ldlt, BasisMode::never},
    {Kernel::gaussian, 1e-9, Solver::cholesky, BasisMode::never},
    {Kernel::inverse_multiquadric, 1e-5, Solver::cholesky, BasisMode::never},
    {Kernel::inverse_multiquadric, 1e-7, Solver::ldlt, BasisMode::always},
    {Kernel::inverse_multiquadric, 1e-9, Solver::cholesky, BasisMode::always},
    {Kernel::triharmonic, 1e-3, Solver::ldlt, BasisMode::always},       // 2e12
    {Kernel::triharmonic, 1e-4, Solver::cholesky, BasisMode::always},   // 3e14
    {Kernel::triharmonic, 1e-4, Solver::cholesky, BasisMode::never},    //
    {Kernel::triharmonic, 1e-4, Solver::ldlt, BasisMode::never},        // 1e15
    {Kernel::triharmonic, 1e-5, Solver::ldlt, BasisMode::always},       // 1e19: not converged
    {Kernel::quintic, 1e-2, Solver::ldlt, BasisMode::always},           // 2e13
    {Kernel::wendland_c2, 1e-4, Solver::cholesky, BasisMode::always},   // 9e12
    {Kernel::multiquadric, 1e-9, Solver::cholesky, BasisMode::always},  // 9e13
    {Kernel::thin_plate, 1e-6, Solver::cholesky, BasisMode::always},    // 2e14
    {Kernel::thin_plate, 1e-6, Solver::ldlt, BasisMode::never},         // 6e14
    {Kernel::thin_plate, 1e-7, Solver::ldlt, BasisMode::always},        // 6e16
    {Kernel::biharmonic, 1e-9, Solver::cholesky, BasisMode::always},    // 2e11
};

INSTANTIATE_TEST_SUITE_P(Layers, Condition, testing::ValuesIn(cases), [](const auto& info) {
  return std::string(properties(info.param.kernel).name) + "_" + to_string(info.param.solver) + "_" +
         std::to_string(static_cast<int>(-std::log10(info.param.first) + 0.5)) +
         (info.param.basis == BasisMode::always ? "_basis" : "_direct");
});

}  // namespace
}  // namespace deform::condition_test
