// SPDX-License-Identifier: GPL-3.0-or-later
// Functions in space for large models (thesis 8.3, figure 8.4): time and memory to prepare against the number of functions. With
// --samples instead whether the default number of samples is enough on real closed surfaces, all or those named (minutes each).
//
// usage: mls_bench [--quick | --samples [FILE...]]
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "core/deformers/energy/spaces/mls.h"
#include "core/deformers/energy/spaces/subspace.h"
#include "core/mesh/ahmed.h"
#include "core/numerics/dense/blas_kernels.h"
#include "core/numerics/sampling/subspace.h"
#include "core/numerics/sparse/sparse_cholesky.h"
#include "tests/bench/report.h"
#include "tests/bench/sample_doubling.h"
#include "tests/support/thesis_options.h"

namespace deform {
namespace {

using bench::Report;

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

std::size_t bytes_of(std::int64_t entries) { return static_cast<std::size_t>(entries) * 16; }

struct Measured {
  double space = 0, factor = 0, solve = 0;  ///< seconds
  double bytes = 0;                         ///< functions, energy and factor
  double prepare() const { return space + factor; }
};

/// The body is held behind the slant and at the nose, which is lifted.
Measured prepare(const Mesh& mesh, const std::function<EnergySpace()>& make) {
  Measured measured;
  auto start = std::chrono::steady_clock::now();
  const EnergySpace space = make();
  measured.space = seconds_since(start);

  start = std::chrono::steady_clock::now();
  const auto n = static_cast<Eigen::Index>(mesh.points.size());
  SparseMatrix held(n, n);
  Eigen::VectorXd heights = Eigen::VectorXd::Zero(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double x = mesh.points[static_cast<std::size_t>(i)][0];
    if (x > 0.05 && x < 1.0) continue;
    held.insert(i, i) = 1;
    heights[i] = x < 0.5 ? 0.1 : 0;
  }
  const double weight = 1e5 / static_cast<double>(held.nonZeros());
  const SparseMatrix misfit = weight * projected_lower(held, space.values);
  const SparseCholesky factor(SparseMatrix(space.energy + misfit));
  measured.factor = seconds_since(start);

  start = std::chrono::steady_clock::now();
  const Eigen::VectorXd moved = space.values * factor.solve(weight * (space.values.transpose() * (held * heights)));
  measured.solve = seconds_since(start);
  if (!moved.allFinite()) std::printf("the solution is not finite\n");
  measured.bytes = static_cast<double>(bytes_of(space.values.nonZeros() + space.energy.nonZeros()) + factor.bytes());
  return measured;
}

/// Slope of log y over log x by least squares.
double exponent(const std::vector<double>& x, const std::vector<double>& y) {
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double a = std::log(x[i]), b = std::log(y[i]);
    sx += a;
    sy += b;
    sxx += a * a;
    sxy += a * b;
  }
  const auto n = static_cast<double>(x.size());
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

struct Series {
  std::vector<double> times, bytes;
};

Series growth(const Mesh& mesh, const char* name, std::optional<Kernel> kernel, double cover,
              const std::vector<std::size_t>& counts) {
  Series series;
  for (const std::size_t k : counts) {
    SubspaceOptions options = test::thesis_subspace();
    options.kernel = kernel;
    options.cover = cover;
    options.centres = k;
    options.stretching = 1;
    options.bending = 0.01;
    const Measured measured = prepare(mesh, [&] { return shell_subspace(mesh, options, 1); });
    std::printf("| %s | %zu | %.2f | %.2f | %.3f | %.0f |\n", name, k, measured.space, measured.factor, measured.solve,
                measured.bytes / (1 << 20));
    std::fflush(stdout);
    series.times.push_back(measured.prepare());
    series.bytes.push_back(measured.bytes);
  }
  return series;
}

int run(bool quick) {
  const std::vector<std::size_t> counts =
      quick ? std::vector<std::size_t>{250, 500, 1000, 2000} : std::vector<std::size_t>{1000, 1800, 3200, 5600, 10000};
  // The full matrices of the last counts would take gigabytes and minutes; those before show how they grow.
  const std::vector<std::size_t> fewer(counts.begin(), counts.end() - (quick ? 1 : 2));
  const std::vector<double> x(counts.begin(), counts.end()), x_fewer(fewer.begin(), fewer.end());
  const Mesh mesh = ahmed_body({.target_points = quick ? 3000u : 20000u});
  std::printf("\n## Functions in space (figure 8.4), %zu points\n\n", mesh.points.size());
  std::printf("| functions | count | space s | factor s | solve s | MiB |\n|---|---|---|---|---|---|\n");
  const Series biharmonic = growth(mesh, "biharmonic", Kernel::biharmonic, 5, fewer);
  const Series wendland = growth(mesh, "Wendland s = 50", Kernel::wendland_c2, 50, counts);
  const Series mls = growth(mesh, "MLS s = 5", std::nullopt, 5, counts);

  Report report("Growth with the number of functions (thesis figure 8.4)");
  report.at_most("MLS: exponent of the time", exponent(x, mls.times), 1.5, "");
  report.at_most("MLS: exponent of the memory", exponent(x, mls.bytes), 1.1, "");
  report.at_least("global biharmonic: exponent of the time", exponent(x_fewer, biharmonic.times), 2, "");
  report.info("Wendland: exponents of time and memory",
              Report::text(exponent(x, wendland.times)) + ", " + Report::text(exponent(x, wendland.bytes)));
  const std::size_t last = fewer.size() - 1;
  const std::string count = std::to_string(fewer[last]) + " functions";
  report.at_least("global biharmonic over MLS, " + count, biharmonic.times[last] / mls.times[last], 1, " times");
  report.at_least("global biharmonic over Wendland, " + count, biharmonic.times[last] / wendland.times[last], 1, " times");

  // Energies in space: what a car body and a volume mesh take (thesis 8.6: 4000 samples on 465,000 points).
  const Mesh large = ahmed_body({.target_points = quick ? 5000u : 465000u});
  MlsOptions options = test::thesis_mls();
  options.surface_samples = quick ? 300 : 4000;
  const SpaceBytes estimated = estimate_mls_space(large, options);
  const Measured body = prepare(large, [&] { return mls_space(large, options, 1); });
  report.info(std::to_string(large.points.size()) + " points, " + std::to_string(options.surface_samples) + " samples",
              "space " + Report::text(body.space) + " s, factor " + Report::text(body.factor) + " s, " +
                  Report::text(body.bytes / (1 << 20)) + " MiB");
  report.at_most("its memory over the estimate before", body.bytes / static_cast<double>(2 * estimated.resident), 1, "");
  return report.missed();
}

}  // namespace
}  // namespace deform

int main(int argc, char** argv) {
  deform::lapack::use_kernels_of_processor(argv);
  if (argc > 1 && std::strcmp(argv[1], "--samples") == 0) {
    deform::bench::Report report("MLS: the default number of samples on closed surfaces");
    deform::bench::measure_sample_doubling({argv + 2, argv + argc}, report);
    return report.missed() == 0 ? 0 : 1;
  }
  const bool quick = argc > 1 && std::strcmp(argv[1], "--quick") == 0;
  return deform::run(quick) == 0 || quick ? 0 : 1;
}
