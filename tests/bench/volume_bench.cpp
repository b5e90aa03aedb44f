// SPDX-License-Identifier: GPL-3.0-or-later
// Volume meshes deformed by their boundaries (thesis 7.2 and 7.3.2) on the shared folder of real meshes.
//
// usage: volume_bench [--quick | --checks] [--data FOLDER] [--work FOLDER]
//   --checks what the checks of cells cost, and nothing else
//   --data   the folder of shared meshes; default: the one that was given to CMake (DEFORM_SHARED_DATA)
//   --work   for OpenFOAM cases that are handed to checkMesh; default volume_bench.work
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/deformers/splitting.h"
#include "core/numerics/dense/blas_kernels.h"
#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/quality/element_quality.h"
#include "tests/bench/cell_check_cost.h"
#include "tests/bench/param_case.h"
#include "tests/bench/report.h"
#include "tests/bench/roof_lift.h"

#ifndef DEFORM_SHARED_DATA
#define DEFORM_SHARED_DATA ""
#endif

namespace deform::bench {
namespace {

constexpr Method methods[] = {Method::biharmonic, Method::triharmonic, Method::quintic, Method::harmonic};

using ByMethod = std::vector<Series>;  // in the order of `methods`

ByMethod table(const ParamCase& param, Walk mode, std::size_t stride) {
  ByMethod all;
  for (const Method method : methods) all.push_back(walk(param, method, mode, stride));
  std::printf("\n%s, %s: least scaled Jacobian (inverted elements) after every step\n\n| step |", param.name.c_str(),
              mode == Walk::absolute ? "absolute" : "relative");
  for (const Method method : methods) std::printf(" %s |", to_string(method));
  std::printf("\n|---|---|---|---|---|\n");
  for (std::size_t k = 0; k < all[0].least.size(); ++k) {
    std::printf("| %zu |", k * stride);
    for (const Series& series : all) {
      if (series.inverted[k] > 0) {
        std::printf(" %.4f (%zu) |", series.least[k], series.inverted[k]);
      } else {
        std::printf(" %.4f |", series.least[k]);
      }
    }
    std::printf("\n");
  }
  std::printf("| seconds |");
  for (const Series& series : all) std::printf(" %.2f |", series.seconds);
  std::printf("\n");
  for (const Series& series : all) {
    if (!series.failure.empty()) std::printf("\n%s\n", series.failure.c_str());
  }
  return all;
}

/// 1-norm conditions (thesis 7.2.4): of what Cholesky factors, and of the bordered matrix in unit coordinates and in thousandths
/// of the model's units.
void conditions(const ParamCase& param, Report& report) {
  Box box;
  for (const Vec3& x : param.places[0]) box.add(x);
  const double size = std::max({box.max[0] - box.min[0], box.max[1] - box.min[1], box.max[2] - box.min[2]});
  double before = 0;
  for (const auto& [kernel, degree] : {std::pair{Kernel::biharmonic, 1}, {Kernel::triharmonic, 1}, {Kernel::quintic, 2}}) {
    const auto condition = [&, kernel = kernel, degree = degree](Solver solver, double scale) {
      std::vector<Vec3> centres = param.places[0];
      for (Vec3& x : centres) {
        for (std::size_t k = 0; k < 3; ++k) x[k] = scale * (x[k] - box.min[k]);
      }
      InterpolationOptions options;
      options.kernel.kernel = kernel;
      options.polynomial_degree = degree;
      options.solver = solver;
      try {
        return DenseInterpolator(std::move(centres), options, {}).condition();
      } catch (const Error&) {
        return std::nan("");  // singular to working precision
      }
    };
    const double projected = condition(Solver::cholesky, 1 / size), bordered = condition(Solver::ldlt, 1 / size),
                 raw = condition(Solver::ldlt, 1000);
    const std::string name = "Thesis 7.2.4, " + param.name + ", " + properties(kernel).name + ": condition";
    report.info(name, Report::text(projected) + "; bordered " + Report::text(bordered) + ", in thousandths of the unit " +
                          Report::text(raw) + (projected > 1e13 ? "; WARNING above 1e13" : ""));
    if (before > 0) report.info(name + ", growth per order", Report::text(projected / before));
    before = projected;
  }
}

/// The whole change in one step, or where that inverts elements in as many as it takes.
void full_change(const ParamCase& param, const Series& absolute, const Series& relative, Report& report) {
  const std::string name = "Thesis 7.2, " + param.name + ", r^3, full change: ";
  report.info(name + "inverted elements, in one step / in the steps of the case",
              std::to_string(absolute.inverted.back()) + " / " + std::to_string(relative.inverted.back()));
  if (absolute.inverted.back() == 0) {
    report.at_most(name + "inverted elements", 0, 0, "");
    return;
  }
  SplitProblem problem;
  problem.mesh = param.mesh;
  problem.setup = boundary_setup(param, Kernel::triharmonic);
  problem.cells = param.elements.get();
  const SplitResult split = evaluate_split(problem, boundary_motion(param.places.front(), param.places.back()));
  const ElementQuality quality = element_quality(split.points, *param.elements);
  report.info(name + "splitting was needed: equal steps on the straight way",
              std::to_string(split.steps) + (split.inversion_free ? "" : ", not enough: reached " + Report::text(split.reached)) +
                  ", least scaled Jacobian " + Report::text(quality.least_scaled_jacobian.value));
  report.at_most(name + "inverted elements after splitting",
                 static_cast<double>(split.inversion_free ? quality.inverted_elements : split.full_step.inverted.count), 0, "");
}

double share(const Comparison& c) { return static_cast<double>(c.at_least) / static_cast<double>(c.steps); }

/// Adds to the comparison of all cases.
void summary(const ParamCase& param, const ByMethod& absolute, const ByMethod& relative, Comparison& all, Report& report) {
  const Series& ours = absolute[1];
  report.open();
  full_change(param, ours, relative[1], report);
  for (const auto& [mode, series] : {std::pair{"absolute", &absolute}, {"relative", &relative}}) {
    const Comparison comparison = compare((*series)[1], (*series)[3]);
    const std::string name = std::string("Thesis 7.2, ") + param.name + ", " + mode + ": ";
    report.at_least(name + "share of the steps with r^3 >= harmonic", share(comparison), 0.9, "");
    if (comparison.shortfall > 0) {
      report.info(name + "largest shortfall of r^3, and the share of the way where the last is",
                  Report::text(comparison.shortfall) + ", " +
                      Report::text(static_cast<double>(comparison.last_below) / static_cast<double>(comparison.steps)));
    }
    std::size_t worse = 0;
    const Series &tri = (*series)[1], &fifth = (*series)[2];
    for (std::size_t k = 0; k < tri.inverted.size(); ++k) worse += tri.inverted[k] == 0 && fifth.inverted[k] > 0;
    report.at_most("Thesis table 7.1, " + param.name + ", " + mode + ": steps where r^5 inverts and r^3 does not",
                   static_cast<double>(worse), 0, "");
    all.steps += comparison.steps;
    all.at_least += comparison.at_least;
  }
  report.info("Thesis table 7.1, " + param.name + ", full change in one step: r / r^3 / r^5",
              Report::text(absolute[0].least.back()) + " / " + Report::text(ours.least.back()) + " / " +
                  Report::text(absolute[2].least.back()));
  report.at_most("Thesis 6.3, " + param.name + ", r^3: boundary points off their places / D",
                 std::max(ours.boundary, relative[1].boundary), 1e-9, "");
  report.at_most("Thesis 6.3, " + param.name + ", r^3: interpolant off the boundary's places / D",
                 std::max(ours.residual, relative[1].residual), 1e-9, "");
  conditions(param, report);
}

/// Thesis 8.6.2, figure 8.12; the pipe of figure 8.13 is above.
void inner_sphere(const std::filesystem::path& file, Report& report) {
  report.open();
  for (const double shift : {0.1, 0.2, 0.3}) {
    const InnerSphere ball = read_inner_sphere(file, shift);
    const ElementQuality before = element_quality(ball.mesh->points, *ball.elements);
    const Points points = prepare(ball.mesh, ball.setup)->evaluate(ball.design);
    const ElementQuality after = element_quality(points, *ball.elements);
    const std::string name = "Thesis 8.6.2, ball, " + std::to_string(ball.mesh->point_count()) +
                             " points, r^3, inner sphere moved by " + Report::text(shift) + " radii: ";
    report.info(name + "least scaled Jacobian before and after",
                Report::text(before.least_scaled_jacobian.value) + ", " + Report::text(after.least_scaled_jacobian.value));
    report.at_most(name + "inverted elements", static_cast<double>(after.inverted_elements), 0, "");
  }
}

int run(const std::filesystem::path& data, const std::filesystem::path& work, bool quick) {
  const std::vector<std::string> names =
      quick ? std::vector<std::string>{"bore_tet"} : std::vector<std::string>{"bore_hex", "bore_tet", "pipe_hex", "pipe_tet"};
  Report report;
  Comparison all;
  for (const std::string& name : names) {
    const ParamCase param = read_param_case(data / "B_volume" / "param", name);
    std::printf("\n### %s: %zu points, %zu on the boundary, %zu elements\n", name.c_str(), param.mesh->point_count(),
                param.boundary.size(), param.elements->size());
    const std::size_t stride = quick ? 10 : 1;
    const ByMethod absolute = table(param, Walk::absolute, stride), relative = table(param, Walk::relative, stride);
    summary(param, absolute, relative, all, report);
  }
  report.open();
  report.at_least("Thesis 7.2, all cases, absolute and relative: share of the steps with r^3 >= harmonic", share(all), 0.9, "");
  inner_sphere(data / "B_volume" / "tet_medit" / "sphere.mesh.gz", report);
  if (quick) return 0;
  roof_lift(data / "B_volume" / "openfoam" / "car_fastback", work, report);
  cell_check_cost(data / "B_volume" / "openfoam" / "car_fastback", report);
  return 0;
}

}  // namespace
}  // namespace deform::bench

int main(int argc, char** argv) {
  deform::lapack::use_kernels_of_processor(argv);
  bool quick = false, checks = false;
  std::filesystem::path data = DEFORM_SHARED_DATA, work = "volume_bench.work";
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--quick") == 0) {
      quick = true;
    } else if (std::strcmp(argv[i], "--checks") == 0) {
      checks = true;
    } else if (std::strcmp(argv[i], "--data") == 0 && i + 1 < argc) {
      data = argv[++i];
    } else if (std::strcmp(argv[i], "--work") == 0 && i + 1 < argc) {
      work = argv[++i];
    } else {
      std::fprintf(stderr, "usage: %s [--quick | --checks] [--data FOLDER] [--work FOLDER]\n", argv[0]);
      return 2;
    }
  }
  if (!std::filesystem::is_directory(data / "B_volume")) {
    std::printf("Left out: there is no folder of shared meshes (--data FOLDER, or -DDEFORM_SHARED_DATA=FOLDER for CMake).\n");
    return 0;
  }
  try {
    if (checks) {
      deform::bench::Report report;
      deform::bench::cell_check_cost(data / "B_volume" / "openfoam" / "car_fastback", report);
      return 0;
    }
    return deform::bench::run(data, work, quick);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "volume_bench: %s\n", error.what());
    return 2;
  }
}
