// SPDX-License-Identifier: GPL-3.0-or-later
// What the deformation does with geometric constraints (thesis 8.5 and 8.6), required against measured.
//
// usage: constraints_bench [--quick] [--only TEXT] [--data FOLDER] [--work FOLDER]
//   --only   sections with that in their titles
//   --data   the folder of shared meshes; default: the one that was given to CMake (DEFORM_SHARED_DATA); without it there is an
//            Ahmed body for the car, and the other models are left out
//   --work   for OpenFOAM cases and the server's data; default constraints_bench.work
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/constraints/detection/detect.h"
#include "core/deformers/constrained/dense_rows.h"
#include "core/mesh/ahmed.h"
#include "core/numerics/dense/blas_kernels.h"
#include "core/quality/element_quality.h"
#include "tests/bench/constraint_cases.h"
#include "tests/bench/constraint_convergence.h"
#include "tests/bench/constraint_parts.h"
#include "tests/bench/param_case.h"
#include "tests/bench/peak_memory.h"
#include "tests/bench/report.h"
#include "tests/bench/rigid_layers.h"
#include "tests/support/thesis_options.h"
#ifdef DEFORMD_BINARY
#include "tests/bench/constrained_population.h"
#endif

#ifndef DEFORM_SHARED_DATA
#define DEFORM_SHARED_DATA ""
#endif

namespace deform::bench {
namespace {

namespace fs = std::filesystem;

using AnyMethod = decltype(Setup::method);

double seconds(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Products of the values at 2,624 points of 1,200 functions with three columns, which every step of a solution with constraints
/// makes: against the products of Eigen, in turn.
void narrow_products(Report& report) {
  const Eigen::MatrixXd V = Eigen::MatrixXd::Random(2624, 1200), x = Eigen::MatrixXd::Random(1200, 3),
                        y = Eigen::MatrixXd::Random(2624, 3);
  double ours[2] = {1e300, 1e300}, eigen[2] = {1e300, 1e300}, sum = 0;
  for (int turn = 0; turn < 15; ++turn) {
    ours[0] = std::min(ours[0], seconds([&] { sum += dense_product(V, x)(0, 0); }));
    eigen[0] = std::min(eigen[0], seconds([&] { sum -= Eigen::MatrixXd(V * x)(0, 0); }));
    ours[1] = std::min(ours[1], seconds([&] { sum += transposed_product(V, y)(0, 0); }));
    eigen[1] = std::min(eigen[1], seconds([&] { sum -= Eigen::MatrixXd(V.transpose() * y)(0, 0); }));
  }
  report.at_most("V x, over Eigen's", ours[0] / eigen[0], 0.5, "");
  report.at_most("V^T y, over Eigen's", ours[1] / eigen[1], 0.8, "");
  report.at_most("what the two differ by", std::abs(sum), 1e-9, "");
}

using Methods = std::vector<std::pair<const char*, AnyMethod>>;

/// samples: 0 = automatic.
Methods methods(std::size_t samples) {
  MlsOptions mls = test::thesis_mls();
  mls.surface_samples = samples;
  return {{"shell", ShellOptions{}}, {"mls", mls}};
}

std::string counts(const DesignReport& report) {
  return std::to_string(report.iterations) + " iterations, " + std::to_string(report.newton_steps) + " Newton steps" +
         (report.converged ? "" : ", NOT CONVERGED");
}

/// Largest residual (rms) of its constraints over the unconstrained one.
double ratio(const DesignReport& report) {
  double worst = 0;
  for (const ConstraintReport& c : report.constraints) worst = std::max(worst, c.rms / c.rms_before);
  return worst;
}

/// Largest distance of a constrained point from its shape where the points really are, over D.
double largest_distance(const ConstraintCase& of, const Points& points) {
  double worst = 0;
  for (const Constraint& constraint : of.setup.constraints) worst = std::max(worst, misfit(constraint, *of.mesh, points).max);
  return worst / bounding_box(of.mesh->points).diagonal();
}

// ---- every kind ----

struct KindResult {
  std::string name;
  std::vector<double> ratios;  ///< by weight
  double automatic = 0, exact = 0;
  std::string text;
};

constexpr std::array weights{1e3, 1e4, 1e5, 1e6, 1e7, 1e8};

KindResult kind_result(const ConstraintCase& of, const AnyMethod& method, bool quick) {
  KindResult result;
  result.name = of.name;
  double free_rms = 0;
  for (const double weight : weights) {
    if (quick && weight != 1e5) continue;
    const Outcome outcome = solved(*prepare(of.mesh, with_method(of, method, weight)), of.design);
    result.ratios.push_back(ratio(outcome.report));
  }
  const Outcome automatic = solved(*prepare(of.mesh, with_method(of, method)), of.design);
  result.automatic = ratio(automatic.report);
  free_rms = automatic.report.constraints[0].rms_before / bounding_box(of.mesh->points).diagonal();
  const Outcome exact = solved(*prepare(of.mesh, with_method(of, method, 0, Exactness::on)), of.design);
  result.exact = largest_distance(of, exact.points);
  char text[160];
  std::snprintf(text, sizeof text, "%.2e | %s | %.2f s", free_rms, counts(automatic.report).c_str(), automatic.seconds);
  result.text = text;
  return result;
}

void kinds(bool quick, Report& report) {
  const std::vector<ConstraintCase> cases = constraint_cases(quick ? 10 : 30);
  std::vector<std::pair<std::string, KindResult>> all;
  for (const auto& [method_name, method] : methods(800)) {
    std::printf("\n%s: residual (rms) over the unconstrained one by gamma_c; the default is %.0e\n\n| constraint |", method_name,
                Constraint::automatic_weight);
    for (const double weight : weights) {
      if (!quick || weight == 1e5) std::printf(" %.0e |", weight);
    }
    std::printf(" default | exact: largest / D | unconstrained rms / D | default takes | in |\n|---|");
    for (std::size_t k = 0; k < (quick ? 1 : weights.size()); ++k) std::printf("---|");
    std::printf("---|---|---|---|---|\n");
    for (const ConstraintCase& of : cases) {
      const KindResult result = kind_result(of, method, quick);
      std::printf("| %s |", result.name.c_str());
      for (const double value : result.ratios) std::printf(" %.2e |", value);
      std::printf(" %.2e | %.1e | %s |\n", result.automatic, result.exact, result.text.c_str());
      std::fflush(stdout);
      all.emplace_back(method_name, result);
    }
  }
  report.open();
  for (const auto& [method, result] : all) {
    const std::string name = "Thesis 8.5.2, " + result.name + ", " + method;
    report.at_most(name + ", default weight: residual over the unconstrained one", result.automatic, 0.05, "");
    report.at_most(name + ", exact: largest distance from the shape / D", result.exact, 1e-9, "");
  }
}

// ---- models ----

void model(const ConstraintCase& of, Report& report) {
  std::string sets;
  for (const Constraint& constraint : of.setup.constraints) sets += (sets.empty() ? "" : ", ") + constraint.name;
  report.info("Thesis 8.6.1, " + of.name + ": constraints", sets);
  for (const auto& [method_name, method] : methods(0)) {
    const std::string name = "Thesis 8.6.1, " + of.name + ", " + method_name;
    for (const Exactness exact : {Exactness::off, Exactness::on}) {
      const auto system = prepare(of.mesh, with_method(of, method, 0, exact));
      const Outcome outcome = solved(*system, of.design);
      const std::string text = Report::text(outcome.seconds) + " s, " + counts(outcome.report);
      if (exact == Exactness::off) {
        report.info(name + ", default weight: residual over the unconstrained one",
                    Report::text(ratio(outcome.report)) + " (" + text + ")");
      } else {
        report.at_most(name + ", exact: residual over the unconstrained one", ratio(outcome.report), 1e-2, "");
        report.info(name + ", exact: largest distance / D",
                    Report::text(largest_distance(of, outcome.points)) + " (" + text + ")");
      }
    }
  }
}

// ---- a large car ----

/// Designs in steps of one percent, as an optimizer's line search takes them: each by itself, and each from the one before.
void line_search(const System& system, const Design& design, const std::string& name, Report& report) {
  std::vector<Design> line(6, design);
  for (std::size_t i = 0; i < line.size(); ++i) line[i].variables[0] *= 1 + 0.01 * static_cast<double>(i);
  std::vector<double> alone, after;
  std::string last_alone, last_after;
  double apart = 0;
  WarmStart warm;
  for (const Design& at : line) {
    std::unique_ptr<const Evaluation> evaluations[2];
    alone.push_back(seconds([&] { evaluations[0] = system.bind({&at, 1}, EvaluationPath::automatic, {}); }));
    after.push_back(seconds([&] { evaluations[1] = system.bind_sequence({&at, 1}, EvaluationPath::automatic, warm, {}); }));
    Points points[2];
    for (int k = 0; k < 2; ++k) {
      points[k].resize(system.info().points);
      Vec3* const out = points[k].data();
      evaluations[k]->evaluate(0, points[k].size(), 0, {&out, 1});
    }
    for (std::size_t i = 0; i < points[0].size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) apart = std::max(apart, std::abs(points[0][i][k] - points[1][i][k]));
    }
    last_alone = counts(evaluations[0]->report(0));
    last_after = counts(evaluations[1]->report(0));
  }
  std::sort(alone.begin() + 1, alone.end());
  std::sort(after.begin() + 1, after.end());
  report.info(name + "a line search, solved alone (median)", Report::text(alone[3]) + " s, " + last_alone);
  report.info(name + "a line search, from the design before (median)", Report::text(after[3]) + " s, " + last_after);
  report.info(name + "a line search: largest difference / D", Report::text(apart / system.info().diagonal));
}

void large_car(const fs::path& data, bool quick, Report& report) {
  const ConstraintCase car = stretched_car(data, quick ? 30'000 : 465'000);
  MlsOptions options = test::thesis_mls();
  options.surface_samples = quick ? 400 : 4000;
  reset_peak();
  std::shared_ptr<const System> system;
  const double prepared = seconds([&] { system = prepare(car.mesh, with_method(car, options)); });
  const SystemInfo& info = system->info();
  const std::string name = "Thesis 8.6.1, " + car.name + ", " + std::to_string(info.points) + " points, mls: ";
  report.info(name + "samples, cubature points", std::to_string(info.functions) + ", " + std::to_string(info.cubature_points));
  report.info(name + "prepared in", Report::text(prepared) + " s");
  for (const auto& [stage, time] : info.stage_seconds) report.info(name + "of which " + stage, Report::text(time) + " s");
  std::vector<double> times;
  for (const double share : {1.0, 0.7, -0.5}) {
    Design design = car.design;
    design.variables[0] *= share;
    const Outcome outcome = solved(*system, design);
    times.push_back(outcome.seconds);
    report.info(name + "stretched by " + Report::text(design.variables[0]) + " m",
                Report::text(outcome.seconds) + " s, " + counts(outcome.report) + ", residual over the unconstrained one " +
                    Report::text(ratio(outcome.report)));
  }
  std::sort(times.begin(), times.end());
  report.at_most(name + "one constrained design (median of 3)", times[1], 2, " s");
  report.info(name + "peak memory", Report::text(peak_mib()) + " MiB");
  line_search(*system, car.design, name, report);
  system = nullptr;
  system = prepare(car.mesh, with_method(car, options, 0, Exactness::on));
  const Outcome exact = solved(*system, car.design);
  report.at_most(name + "exact: residual over the unconstrained one", ratio(exact.report), 1e-2, "");
  report.info(name + "exact: one design", Report::text(exact.seconds) + " s, " + counts(exact.report));
}

// ---- volumes ----

/// Moving least squares against the RBF (thesis figures 8.12 and 8.13).
class AgainstRbf {
 public:
  AgainstRbf(std::string name, std::shared_ptr<const Mesh> mesh, const Elements& elements, Setup setup, Design design)
      : name_(std::move(name)),
        mesh_(std::move(mesh)),
        elements_(elements),
        setup_(std::move(setup)),
        design_(std::move(design)),
        rbf_(measured().least_scaled_jacobian.value) {}

  void mls(const std::string& how, const MlsOptions& options, Report& report) {
    setup_.method = options;
    const ElementQuality quality = measured();
    const std::string name = name_ + ", mls, " + how + ": ";
    const double least = quality.least_scaled_jacobian.value;
    report.at_least(name + "least scaled Jacobian less that of r^3 (" + Report::text(least) + " less " + Report::text(rbf_) + ")",
                    least - rbf_, -0.01, "");
    report.at_most(name + "inverted elements", static_cast<double>(quality.inverted_elements), 0, "");
    if (options.handles == HandleMode::soft) report.info(name + "boundary off its places / D", Report::text(misfit_));
  }

 private:
  ElementQuality measured() {
    const Outcome outcome = solved(*prepare(mesh_, setup_), design_);
    misfit_ = outcome.report.interpolation_residual / bounding_box(mesh_->points).diagonal();
    return element_quality(outcome.points, elements_);
  }

  std::string name_;
  std::shared_ptr<const Mesh> mesh_;
  const Elements& elements_;
  Setup setup_;
  Design design_;
  double misfit_ = 0;
  double rbf_;
};

void volumes(const fs::path& data, Report& report) {
  // As in the thesis, where handles are soft; and exactly, for which a change with much detail takes more samples.
  MlsOptions soft = test::thesis_mls(), finer = test::thesis_mls();
  soft.handles = HandleMode::soft;
  soft.fixing = 1e6;
  finer.surface_samples = 8000;
  finer.volume_samples = 4000;
  for (const double shift : {0.1, 0.2, 0.3}) {
    const InnerSphere ball = read_inner_sphere(data / "B_volume" / "tet_medit" / "sphere.mesh.gz", shift);
    AgainstRbf against("Thesis 8.6.2, ball, inner sphere moved by " + Report::text(shift) + " radii", ball.mesh, *ball.elements,
                       ball.setup, ball.design);
    against.mls("hard handles", {}, report);
  }
  const ParamCase pipe = read_param_case(data / "B_volume" / "param", "pipe_hex");
  AgainstRbf against("Thesis 8.6.2, pipe_hex, full change at once", pipe.mesh, *pipe.elements,
                     boundary_setup(pipe, Kernel::triharmonic), boundary_motion(pipe.places.front(), pipe.places.back()));
  against.mls("soft handles (1e6)", soft, report);
  against.mls("hard handles", {}, report);
  against.mls("hard handles, 8000 + 4000 samples", finer, report);
}

// ---- detection ----

void detection(bool quick, Report& report) {
  // Round where it is round: cut into ever smaller pieces, the facets of a coarse mesh would be what there is to find.
  const Mesh mesh = ahmed_body({.target_points = quick ? 30'000u : 250'000u});
  Detection one, two;
  RunContext context;
  context.threads = 1;
  const double alone = seconds([&] { one = detect(mesh, {}, context); });
  context.threads = 2;
  const double both = seconds([&] { two = detect(mesh, {}, context); });
  const std::string name = "Thesis 8.5.3, detection on an Ahmed body of " + std::to_string(mesh.face_count()) + " faces: ";
  report.info(name + "seconds with 1 and 2 threads", Report::text(alone) + ", " + Report::text(both));
  report.info(
      name + "primitives, feature edges, share of the area",
      std::to_string(two.primitives.size()) + ", " + std::to_string(two.edges.size()) + ", " + Report::text(two.coverage));
  std::size_t different = one.primitives.size() == two.primitives.size() && one.edges.size() == two.edges.size() ? 0 : 1;
  for (std::size_t i = 0; i < std::min(one.primitives.size(), two.primitives.size()); ++i) {
    const Primitive &a = one.primitives[i], &b = two.primitives[i];
    different += a.name == b.name && a.faces == b.faces && a.points == b.points ? 0 : 1;
  }
  for (std::size_t i = 0; i < std::min(one.edges.size(), two.edges.size()); ++i) {
    different += one.edges[i].name == two.edges[i].name && one.edges[i].points == two.edges[i].points ? 0 : 1;
  }
  report.at_most(name + "labels that differ between 1 and 2 threads", static_cast<double>(different), 0, "");
}

struct Options {
  bool quick = false;
  std::string only;
  fs::path data = DEFORM_SHARED_DATA, work = "constraints_bench.work";
};

int run(const Options& options) {
  const bool quick = options.quick;
  const fs::path &data = options.data, &work = options.work;
  const bool shared = !data.empty() && fs::is_directory(data / "A_surface") && fs::is_directory(data / "B_volume");
  Report report;
  fs::create_directories(work);
  // A section that cannot be done counts as missed; the others are still worth having.
  int failed = 0;
  const auto section = [&](const std::string& title, const std::function<void()>& work_on) {
    if (title.find(options.only) == std::string::npos) return;
    std::printf("\n## %s\n", title.c_str());
    const double took = seconds([&] {
      try {
        work_on();
      } catch (const Error& error) {
        std::printf("\nMISS: %s\n", error.what());
        ++failed;
      }
    });
    std::printf("\n%s: %.0f s\n", title.c_str(), took);
    std::fflush(stdout);
  };
  section("Constraints: products with three columns", [&] { report.open(), narrow_products(report); });
  section("Constraints: a large car", [&] { report.open(), large_car(data, quick, report); });
  section("Constraints: convergence", [&] { report.open(), constraint_convergence(quick, report); });
  section("Constraints: every kind", [&] { kinds(quick, report); });
  if (shared) {
    section("Constraints: models", [&] {
      report.open();
      model(joint_case(data), report);
      model(fandisk_case(data), report);
    });
    section("Constraints: volumes", [&] { report.open(), volumes(data, report); });
    if (!quick) {
      section("Constraints: rigid layers",
              [&] { rigid_layers(data / "B_volume" / "openfoam" / "car_fastback", work / "layers", report); });
    }
  } else {
    std::printf("\nModels, volumes and rigid layers are left out: there is no folder of shared meshes (--data FOLDER).\n");
  }
#ifdef DEFORMD_BINARY
  section("Constraints: a population", [&] {
    report.open();
    constrained_population(work / "population", quick ? BenchSize::quick : BenchSize::full, report);
  });
#endif
  section("Detection on a large mesh", [&] { report.open(), detection(quick, report); });
  fs::remove_all(work);
  return report.missed() + failed;
}

}  // namespace
}  // namespace deform::bench

int main(int argc, char** argv) {
  deform::lapack::use_kernels_of_processor(argv);
  deform::bench::Options options;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--quick") == 0) {
      options.quick = true;
    } else if (std::strcmp(argv[i], "--only") == 0 && i + 1 < argc) {
      options.only = argv[++i];
    } else if (std::strcmp(argv[i], "--data") == 0 && i + 1 < argc) {
      options.data = argv[++i];
    } else if (std::strcmp(argv[i], "--work") == 0 && i + 1 < argc) {
      options.work = argv[++i];
    } else {
      std::fprintf(stderr, "usage: %s [--quick] [--only TEXT] [--data FOLDER] [--work FOLDER]\n", argv[0]);
      return 2;
    }
  }
  try {
    return deform::bench::run(options) == 0 || options.quick ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "constraints_bench: %s\n", error.what());
    return 2;
  }
}
