// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/constraint_convergence.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/deformers/constrained/constrained_solver.h"
#include "core/deformers/energy/spaces/shell.h"
#include "core/deformers/handles/constraint_points.h"
#include "tests/bench/constraint_cases.h"
#include "tests/bench/plain_alternation.h"

namespace deform::bench {

namespace {

constexpr double wanted = 1e-4;  // of D, rms
constexpr int most_plain = 20000;

/// The solver of a case, for the shell.
class ShellCase {
 public:
  ShellCase(const ConstraintCase& of, double weight) : mesh_(*of.mesh) {
    Setup setup = with_method(of, ShellOptions{}, weight);
    const SelectedRegions regions = validate(setup, mesh_);
    const Box bounds = bounding_box(mesh_.points);
    const double D = bounds.diagonal();
    const UnitBox box{bounds.min, D};
    const std::vector<RegionIndex> region_of = constraint_points(mesh_, regions).region_of;
    model_ = shell_model(mesh_, region_of, ShellOptions{}, box.scale);
    EnergySolver::Problem problem;
    problem.energy = model_.space.energy;
    problem.coupling = -model_.coupling;
    solver_ = std::make_unique<EnergySolver>(std::move(problem), 0, RunContext{});
    h_ = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(model_.held.size()), 3);
    for (std::size_t j = 0; j < model_.held.size(); ++j) {
      if (region_of[model_.held[j]] == fixed_region) continue;
      const Vec3 &x = mesh_.points[model_.held[j]], y = transformed(std::get<Affine>(of.design.motions[0].value), x);
      for (std::size_t k = 0; k < 3; ++k) {
        h_(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = (y[k] - x[k]) / D;
      }
    }
    for (std::size_t i = 0; i < setup.constraints.size(); ++i) {
      ConstraintSet set{setup.constraints[i].name, nullptr, regions.constraints[i][0], {}, weight};
      for (const PointId id : set.ids) set.rest.push_back(box.to_unit(mesh_.points[id]));
      set.projection = make_projection(setup.constraints[i].kind, std::vector<std::vector<Vec3>>{set.rest});
      offsets_.resize(offsets_.size() + set.ids.size(), Vec3{});
      sets_.push_back(std::move(set));
    }
  }

  ConstrainedResult solve(const ConstrainedSolver::Options& options) const {
    return ConstrainedSolver(*solver_, model_.space.values, sets_, options, 0, {}).solve(h_, offsets_, {});
  }
  PlainAlternation plain() const { return PlainAlternation(*solver_, model_.space.values, sets_, h_, offsets_); }

 private:
  const Mesh& mesh_;
  EnergyModel model_;
  std::unique_ptr<EnergySolver> solver_;
  Eigen::MatrixXd h_;
  std::vector<ConstraintSet> sets_;
  std::vector<Vec3> offsets_;
};

double distance(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) sum += (a[i][k] - b[i][k]) * (a[i][k] - b[i][k]);
  }
  return std::sqrt(sum / static_cast<double>(a.size()));
}

/// Steps of the plain alternation: as many as are needed.
int plain_iterations(const ShellCase& of, const std::vector<Vec3>& solution) {
  PlainAlternation plain = of.plain();
  for (int iterations = 1; iterations < most_plain; ++iterations) {
    plain.step();
    if (distance(plain.state().points, solution) <= wanted) return iterations;
  }
  return most_plain;
}

/// Steps of the default, counted like those: as many steps as bring the points near, whether it knows or not.
int default_steps(const ShellCase& of, const std::vector<Vec3>& solution) {
  for (double tolerance = 0.1; tolerance > 1e-12; tolerance /= 2) {
    ConstrainedSolver::Options options;
    options.tolerance = tolerance;
    const ConstrainedResult result = of.solve(options);
    if (distance(result.after.points, solution) <= wanted) return result.iterations + result.newton_steps;
  }
  return most_plain;
}

ConstraintCase overlapping(std::size_t fineness) {
  ConstraintCase plate = constraint_cases(fineness).front();
  const auto region = [&](const std::function<bool(const Vec3&)>& test) {
    Region::Ids ids;
    for (std::size_t i = 0; i < plate.mesh->points.size(); ++i) {
      if (test(plate.mesh->points[i])) ids.ids.push_back(static_cast<PointId>(i));
    }
    return std::vector<Region>{{ids}};
  };
  const auto between = [&](double low, double high) {
    return region([low, high](const Vec3& x) { return low < x[0] && x[0] < high; });
  };
  const auto edge = [&](double y) {
    return region([y](const Vec3& x) { return std::abs(x[1] - y) < 1e-6 && 0.3 < x[0] && x[0] < 1.7; });
  };
  const std::vector<Region> rim = plate.setup.constraints[0].regions;
  plate.setup.constraints = {{"rim", rim, Circular{}},
                             {"rim_line", rim, FeatureLine{}},
                             {"middle", between(0.5, 1.5), Planar{}},
                             {"left", between(0.3, 1), Planar{}},
                             {"right", between(1, 1.7), Planar{}},
                             {"front", edge(0), Straight{}},
                             {"back", edge(1), Straight{}},
                             {"left_block", between(0.4, 0.7), Rigid{}},
                             {"right_block", between(1.3, 1.6), Rigid{}}};
  return plate;
}

ConstraintCase named(const std::string& name, std::size_t fineness) {
  for (ConstraintCase& of : constraint_cases(fineness)) {
    if (of.name == name) return std::move(of);
  }
  return {};
}

}  // namespace

void constraint_convergence(bool quick, Report& report) {
  const std::size_t fineness = quick ? 10 : 30;
  ConstrainedSolver::Options converged, default_to_wanted;
  converged.tolerance = 1e-11;
  converged.most_iterations = 20000;
  default_to_wanted.tolerance = wanted;
  const auto measure = [&](const std::string& name, const ConstraintCase& of, double weight, double most, bool tenth) {
    const ShellCase shell(of, weight);
    const ConstrainedResult solution = shell.solve(converged);
    const ConstrainedResult result = shell.solve(default_to_wanted);
    const int steps = result.iterations + result.newton_steps;
    const std::string figure = "Thesis 8.5, " + name + ", gamma_c = " + Report::text(weight) + ": ";
    report.at_most(figure + "iterations and Newton steps to 1e-4 D", steps, most, "");
    report.at_most(figure + "distance from the solution there / D", distance(result.after.points, solution.after.points), wanted,
                   "");
    const int plain = plain_iterations(shell, solution.after.points);
    const std::string over =
        "over those of the plain alternation (" + std::to_string(plain) + (plain >= most_plain ? " or more)" : ")");
    const int least = default_steps(shell, solution.after.points);
    const std::string near = figure + "steps until the points are that near (" + std::to_string(least) + "), ";
    if (tenth) {
      report.at_most(near + over, static_cast<double>(least) / plain, 0.1, "");
    } else {
      report.info(near + over, Report::text(static_cast<double>(least) / plain));
    }
  };
  measure("circle", named("circular", fineness), 1e5, 50, true);
  measure("cylinder", named("cylindrical", fineness), 1e5, 50, true);
  measure("nine overlapping sets", overlapping(fineness), 1e4, 200, false);
  for (const double weight : {1e6, 1e8}) {
    const ShellCase shell(overlapping(fineness), weight);
    ConstrainedSolver::Options newton;
    newton.tolerance = wanted;
    newton.patience = 8;
    const ConstrainedResult result = shell.solve(newton), solution = shell.solve(converged);
    const std::string figure = "Thesis 8.5, nine overlapping sets, gamma_c = " + Report::text(weight) + ": ";
    report.at_most(figure + "Newton steps to 1e-4 D", result.newton_steps, 15, "");
    report.at_most(figure + "distance from the solution there / D", distance(result.after.points, solution.after.points), wanted,
                   "");
  }
}

}  // namespace deform::bench
