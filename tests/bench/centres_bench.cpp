// SPDX-License-Identifier: GPL-3.0-or-later
// Many centres: the iterative solver against its limits, all solvers beside each other, growth, evaluation of many points.
//
// usage: centres_bench [--quick | --solvers | --reduction | --reduction-large [POINTS ...]]
//   --solvers, --reduction: only their tables; --reduction-large: the README's setup from 2,500 to 2,000,000 points
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/deformers/rbf/rbf_system.h"
#include "core/mesh/ahmed.h"
#include "core/numerics/dense/blas_kernels.h"
#include "core/numerics/fast_sums/fast_sums.h"
#include "core/numerics/interpolation/interpolator.h"
#include "core/numerics/interpolation/least_squares_interpolator.h"
#include "core/numerics/kernels/tiles.h"
#include "tests/bench/bordered_lu.h"
#include "tests/bench/centre_reduction.h"
#include "tests/bench/param_case.h"

#ifndef DEFORM_SHARED_DATA
#define DEFORM_SHARED_DATA ""
#endif

extern "C" void dgeqrf_(const int* m, const int* n, double* a, const int* lda, double* tau, double* work, const int* lwork,
                        int* info);

namespace deform {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

double seconds(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

double peak_gib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / (1 << 20);
}

void print(const std::string& figure, const std::string& limit, double value, const char* verdict) {
  std::printf("%-68s %14s %14.4g %s\n", figure.c_str(), limit.c_str(), value, verdict);
}
std::string text(double value) {
  char out[32];
  std::snprintf(out, sizeof out, "%.3g", value);
  return out;
}
void at_most(const std::string& figure, double limit, double value) {
  print(figure, "<= " + text(limit), value, value <= limit ? "PASS" : "MISS");
}
void at_least(const std::string& figure, double limit, double value) {
  print(figure, ">= " + text(limit), value, value >= limit ? "PASS" : "MISS");
}

/// In coordinates where D = 1, so that errors are fractions of D.
std::vector<Vec3> unit(std::vector<Vec3> places) {
  const Box box = bounding_box(places);
  for (Vec3& x : places) {
    for (std::size_t k = 0; k < 3; ++k) x[k] = (x[k] - box.min[k]) / box.diagonal();
  }
  return places;
}

/// The points of a car body, D = 1.
std::vector<Vec3> body(std::size_t count) {
  AhmedOptions options;
  options.target_points = count;
  return unit(ahmed_body(options).points);
}

/// A smooth deformation of 5 % of D, or the roof lifted by that with everything else at rest: it tears neighbours apart.
enum class Data { smooth, torn };

MatrixXd displacements(const std::vector<Vec3>& places, Data data) {
  MatrixXd F(static_cast<Index>(places.size()), 3);
  double top = 0;
  for (const Vec3& x : places) top = std::max(top, x[2]);
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Vec3& x = places[i];
    if (data == Data::smooth) {
      F.row(static_cast<Index>(i)) << 0.05 * std::sin(5 * x[0]), 0.05 * x[1] * x[0], 0.05 * std::cos(4 * x[2] + x[0]);
    } else {
      const double up = x[2] > 0.8 * top && x[0] > 0.3 && x[0] < 0.6 ? 0.05 : 0.0;
      F.row(static_cast<Index>(i)) << 0.2 * up, 0.0, up;
    }
  }
  return F;
}

/// Largest error over all centres by direct summation.
double error_by_summation(const std::vector<Vec3>& places, const MatrixXd& coefficients, const MatrixXd& F) {
  const auto m = static_cast<Index>(places.size());
  const RowMajor weights = coefficients.topRows(m);
  const std::vector<double> sums =
      kernel_sums({}, places, places, {weights.data(), static_cast<std::size_t>(weights.size())}, 3, {});
  const MatrixXd values = Eigen::Map<const RowMajor>(sums.data(), m, 3) +
                          PolynomialSpace(places, 1).matrix(places) * coefficients.bottomRows(coefficients.rows() - m);
  return (values - F).cwiseAbs().maxCoeff();
}

struct Run {
  double prepare = 0, solve = 0, error = 0;
  std::size_t bytes = 0, centres = 0;
  Interpolants interpolants;
};

Run run(const std::vector<Vec3>& places, Solver solver, const MatrixXd& F) {
  Run result;
  InterpolationOptions options;
  options.solver = solver;
  std::unique_ptr<const Interpolator> system;
  result.prepare = seconds([&] { system = make_interpolator(places, options, {}); });
  result.solve = seconds([&] { result.interpolants = system->interpolate(F, 1e-6); });
  result.bytes = system->bytes();
  result.centres = system->size();
  result.error = error_by_summation(places, result.interpolants.coefficients, F);
  return result;
}

Run run_lu(const std::vector<Vec3>& places, const MatrixXd& F) {
  Run result;
  std::unique_ptr<const bench::BorderedLu> lu;
  result.prepare = seconds([&] { lu = std::make_unique<const bench::BorderedLu>(places); });
  result.solve = seconds([&] { result.interpolants.coefficients = lu->solve(F); });
  result.bytes = lu->bytes();
  result.centres = places.size();
  result.error = error_by_summation(places, result.interpolants.coefficients, F);
  return result;
}

void iterative_tier(bool quick) {
  std::printf("\niterative solver, r^3, car body, tolerance 1e-6 D, three columns\n");
  std::printf("%-8s %8s %10s %10s %6s %6s %12s %10s\n", "data", "m", "prepare s", "solve s", "its", "order", "error / D", "MiB");
  const std::vector<std::size_t> sizes =
      quick ? std::vector<std::size_t>{2000, 4000, 8000} : std::vector<std::size_t>{25000, 50000, 100000};
  for (const Data data : {Data::smooth, Data::torn}) {
    std::vector<Run> runs;
    for (const std::size_t size : sizes) {
      const std::vector<Vec3> places = body(size);
      runs.push_back(run(places, Solver::iterative, displacements(places, data)));
      const Run& r = runs.back();
      std::printf("%-8s %8zu %10.2f %10.2f %6d %6d %12.2e %10.0f\n", data == Data::smooth ? "smooth" : "torn", r.centres,
                  r.prepare, r.solve, r.interpolants.iterations, r.interpolants.order, r.error,
                  static_cast<double>(r.bytes) / (1 << 20));
    }
    const Run &first = runs.front(), &last = runs.back();
    const std::string name = std::string(data == Data::smooth ? "smooth" : "torn") + ", m = " + std::to_string(last.centres);
    at_most(name + ": error by direct summation / D", 1e-6, last.error);
    at_most(name + ": seconds", 600, last.prepare + last.solve);
    at_most(name + ": exponent of time from the smallest to the largest m", 1.5,
            std::log((last.prepare + last.solve) / (first.prepare + first.solve)) /
                std::log(static_cast<double>(last.centres) / static_cast<double>(first.centres)));
    at_most(name + ": exponent of memory", 1.1,
            std::log(static_cast<double>(last.bytes) / static_cast<double>(first.bytes)) /
                std::log(static_cast<double>(last.centres) / static_cast<double>(first.centres)));
  }
  at_most("peak memory of the process so far, GiB", 8, peak_gib());
}

/// Largest difference of two solutions, relative to the largest coefficient of its kind.
double difference(const MatrixXd& a, const MatrixXd& b) { return (a - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff(); }

void print_row(const char* solver, double prepare, double solve, std::size_t bytes, std::size_t centres, double error) {
  std::printf("%-14s %10.2f %10.2f %10.0f %8zu %12.2e\n", solver, prepare, solve, static_cast<double>(bytes) / (1 << 20), centres,
              error);
  std::fflush(stdout);
}

/// How many centres have a weight.
std::size_t used(const LeastSquaresInterpolator& qr, const Interpolants& solution) {
  return static_cast<std::size_t>(solution.coefficients.rows()) - qr.polynomials().terms();
}

/// Least squares of a smooth deformation, as many centres as the tolerances need.
void incremental_rows(const std::vector<Vec3>& places) {
  const MatrixXd F = displacements(places, Data::smooth);
  for (const auto& [name, order] : {std::pair{"QR, even", CentreOrder::farthest_point}, {"QR, greedy", CentreOrder::greedy}}) {
    InterpolationOptions options;
    options.order = order;
    options.samples = F;
    options.sample_tolerance = 1e-4;
    options.most_centres = places.size();
    std::unique_ptr<LeastSquaresInterpolator> qr;
    const double prepare = seconds([&] { qr = std::make_unique<LeastSquaresInterpolator>(places, options); });
    Interpolants solution;
    const double solve = seconds([&] { solution = qr->interpolate(F, 1e-4); });
    print_row(name, prepare, solve, qr->bytes(), used(*qr, solution), solution.residual);
    at_most(std::string(name) + ", smooth: RMS error / D", 1e-4, solution.rms);
    at_most(std::string(name) + ", smooth: share of the points that are centres", 0.1,
            static_cast<double>(used(*qr, solution)) / static_cast<double>(places.size()));
  }
}

/// Thesis table 7.3. The places have D = 1.
void solver_table(const std::string& name, const std::vector<Vec3>& places) {
  const MatrixXd F = displacements(places, Data::torn);
  std::printf("\nsolvers, r^3, %s, m = %zu (thesis table 7.3), three columns; QR: smooth data to 1e-4 D\n", name.c_str(),
              places.size());
  std::printf("%-14s %10s %10s %10s %8s %12s\n", "solver", "prepare s", "solve s", "MiB", "centres", "error / D");
  std::map<Solver, Run> runs;
  const Run lu = run_lu(places, F);
  print_row("LU", lu.prepare, lu.solve, lu.bytes, lu.centres, lu.error);
  for (const Solver solver : {Solver::ldlt, Solver::cholesky, Solver::iterative}) {
    const Run& r = runs[solver] = run(places, solver, F);
    print_row(to_string(solver), r.prepare, r.solve, r.bytes, r.centres, r.error);
  }
  incremental_rows(places);
  const Run &ldlt = runs[Solver::ldlt], &cholesky = runs[Solver::cholesky];
  at_most("Cholesky / LDL^T, time of preparation", 0.55, cholesky.prepare / ldlt.prepare);
  at_most("Cholesky / LU, time of preparation", 0.8, cholesky.prepare / lu.prepare);
  at_most("LDL^T / LU, time of preparation", 0.8, ldlt.prepare / lu.prepare);
  at_most("Cholesky / LU, memory", 0.55, static_cast<double>(cholesky.bytes) / static_cast<double>(lu.bytes));
  at_most("LDL^T / LU, memory", 0.55, static_cast<double>(ldlt.bytes) / static_cast<double>(lu.bytes));
  for (const auto& [solver, other] : {std::pair{"LDL^T", &ldlt}, {"Cholesky", &cholesky}}) {
    at_most(std::string(solver) + " against LU, coefficients", 1e-8,
            difference(other->interpolants.coefficients, lu.interpolants.coefficients));
  }
  at_most("iterative, error / D", 1e-6, runs[Solver::iterative].error);
}

/// All points as centres, on one thread, against LAPACK's QR of the same matrix; and how the error falls (thesis 7.5).
void incremental_qr(const std::vector<Vec3>& places) {
  const std::size_t m = places.size();
  std::printf("\nincremental QR, r^3, m = %zu\n", m);
  RunContext one;
  one.threads = 1;
  InterpolationOptions options;
  options.most_centres = m;
  std::unique_ptr<LeastSquaresInterpolator> qr;
  const double ours = seconds([&] { qr = std::make_unique<LeastSquaresInterpolator>(places, options, one); });
  const PolynomialSpace& polynomials = qr->polynomials();
  const auto size = static_cast<Index>(m), q = static_cast<Index>(polynomials.terms());
  MatrixXd A = MatrixXd::Zero(size + q, size + q);
  for (Index j = 0; j < size; ++j) {
    for (Index i = 0; i < size; ++i) {
      const Vec3 &x = places[static_cast<std::size_t>(i)], &y = places[static_cast<std::size_t>(j)];
      A(i, j) = std::pow(std::hypot(x[0] - y[0], x[1] - y[1], x[2] - y[2]), 3);
    }
  }
  A.topRightCorner(size, q) = polynomials.matrix(places);
  A.bottomLeftCorner(q, size) = A.topRightCorner(size, q).transpose();
  const int n = static_cast<int>(size + q), lwork = 64 * n;
  std::vector<double> tau(static_cast<std::size_t>(n)), work(static_cast<std::size_t>(lwork));
  int info = 0;
  const double full = seconds([&] { dgeqrf_(&n, &n, A.data(), &n, tau.data(), work.data(), &lwork, &info); });
  at_most("all points as centres / Householder QR of LAPACK (dgeqrf), time", 1.3, ours / full);
  const MatrixXd F = displacements(places, Data::smooth);
  const std::vector<double> values = qr->values(qr->interpolate(F, 0), places);
  at_most("all points as centres: largest error by direct summation / D", 1e-9,
          (Eigen::Map<const RowMajor>(values.data(), size, 3) - F).cwiseAbs().maxCoeff());
  std::printf("%-12s %10s %12s %12s\n", "tolerance", "centres", "RMS / D", "largest / D");
  for (const double tolerance : {1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7}) {
    const Interpolants solution = qr->interpolate(F, tolerance);
    std::printf("%-12.0e %10zu %12.2e %12.2e\n", tolerance, used(*qr, solution), solution.rms, solution.residual);
  }
}

void solvers(bool quick, const std::filesystem::path& data) {
  incremental_qr(body(quick ? 2000 : 5000));
  solver_table("car body", body(quick ? 2000 : 16000));
  const std::filesystem::path param = data / "B_volume" / "param";
  if (quick) return;
  if (std::filesystem::is_directory(param)) {
    solver_table("boundary of pipe_hex", unit(bench::read_param_case(param, "pipe_hex").places[0]));
  } else {
    std::printf(
        "\nboundary of pipe_hex left out: there is no folder of shared meshes (-DDEFORM_SHARED_DATA=FOLDER for CMake).\n");
  }
}

void evaluation(bool quick) {
  const std::size_t n = quick ? 20000 : 1000000, m = quick ? 2000 : 10000;
  const std::vector<Vec3> centres = body(m);
  std::vector<Vec3> points(n);
  for (std::size_t i = 0; i < n; ++i) {
    const auto t = static_cast<double>(i);
    points[i] = {2 * std::fmod(0.7548776662466927 * t, 1.0), std::fmod(0.5698402909980532 * t, 1.0),
                 std::fmod(0.4301597 * t, 1.0)};
  }
  const std::vector<double> weights(3 * centres.size(), 1e-3);
  const RadialKernel kernel;
  RunContext one, two;
  one.threads = 1;
  two.threads = 2;
  std::printf("\nevaluation of %zu points, m = %zu\n", n, centres.size());
  const double alone = seconds([&] { kernel_sums(kernel, points, centres, weights, 3, one); });
  const double both = seconds([&] { kernel_sums(kernel, points, centres, weights, 3, two); });
  at_least("direct sums, parallel efficiency from 1 to 2 threads", 0.8, alone / both / 2);
  const FastSums fast(kernel, points, centres, {8, 0});
  const double fast_alone = seconds([&] { fast.sums(weights, 3, one); });
  const double fast_both = seconds([&] { fast.sums(weights, 3, two); });
  at_least("fast sums, parallel efficiency from 1 to 2 threads", 0.8, fast_alone / fast_both / 2);
  print("direct sums / fast sums of order 8, two threads", "", both / fast_both, "");
}

Setup car(Solver solver, CentreReduction reduction = CentreReduction::off) {
  deform::Setup setup;
  setup.handles = {{"roof", {Region::GroupName{"roof"}}}};
  setup.handles[0].region = {Region::Difference{
      {{Region::GroupName{"roof"}}, {Region::GroupName{"slant"}}, {Region::GroupName{"nose"}}, {Region::GroupName{"sides"}}}}};
  setup.fixed = {{Region::GroupName{"underbody"}}, {Region::GroupName{"stilts"}}};
  RbfOptions options;
  options.solver = solver;
  options.reduction = reduction;
  options.basis = BasisMode::always;
  setup.method = options;
  return setup;
}

/// Handle motion of the same mesh, from few centres (to the reduction tolerance) and from all constraint points.
void handle_motion(bool quick) {
  AhmedOptions options;
  options.target_points = quick ? 6000 : 60000;
  const auto mesh = std::make_shared<const Mesh>(ahmed_body(options));
  const auto designs_per_second = [&](CentreReduction reduction, std::size_t& centres) {
    const auto system = prepare(mesh, car(Solver::automatic, reduction));
    centres = system->info().centres;
    Design design;
    design.motions.push_back({0, Affine{1, 0, 0, 0.01, 0, 1, 0, 0, 0, 0, 1, 0.02}});
    system->evaluate(design);
    constexpr int repeats = 50;
    return repeats / seconds([&] {
             for (int i = 0; i < repeats; ++i) system->evaluate(design);
           });
  };
  std::size_t few = 0, many = 0;
  const double a = designs_per_second(CentreReduction::tolerance, few);
  const double b = designs_per_second(CentreReduction::off, many);
  std::printf("\nhandle motion of %zu points: designs per second with %zu and with %zu centres\n", mesh->point_count(), few,
              many);
  at_least("with many / with few", 0.8, b / a);
}

}  // namespace
}  // namespace deform

int main(int argc, char** argv) {
  deform::lapack::use_kernels_of_processor(argv);
  const bool quick = argc > 1 && std::strcmp(argv[1], "--quick") == 0;
  const bool solvers_only = argc > 1 && std::strcmp(argv[1], "--solvers") == 0;
  std::printf("%d threads, %s\n", deform::thread_count({}), deform::vector_target());
  if (solvers_only) {
    deform::solvers(false, DEFORM_SHARED_DATA);
    return 0;
  }
  if (argc > 1 && std::strcmp(argv[1], "--reduction") == 0) {
    deform::bench::centre_reduction(deform::bench::ReductionSizes::usual, DEFORM_SHARED_DATA);
    return 0;
  }
  if (argc > 1 && std::strcmp(argv[1], "--reduction-large") == 0) {
    std::vector<std::size_t> sizes;
    for (int k = 2; k < argc; ++k) sizes.push_back(std::strtoul(argv[k], nullptr, 10));
    if (sizes.empty()) sizes = {2500, 10000, 50000, 150000, 500000, 2000000};
    deform::bench::large_reductions(sizes);
    return 0;
  }
  deform::iterative_tier(quick);
  deform::solvers(quick, DEFORM_SHARED_DATA);
  deform::evaluation(quick);
  deform::handle_motion(quick);
  deform::bench::centre_reduction(quick ? deform::bench::ReductionSizes::small : deform::bench::ReductionSizes::usual,
                                  DEFORM_SHARED_DATA);
  return 0;
}
