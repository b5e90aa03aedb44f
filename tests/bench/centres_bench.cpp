// Many centres: the iterative solver against its limits and against the direct ones, growth, evaluation of many points.
//
// usage: centres_bench [--quick]
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/deformers/rbf.h"
#include "core/mesh/ahmed.h"
#include "core/numerics/fast_sums.h"
#include "core/numerics/interpolation_system.h"
#include "core/numerics/iterative_system.h"
#include "core/numerics/tiles.h"

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

/// The points of a car body in coordinates where D = 1, so that errors are fractions of D.
std::vector<Vec3> body(std::size_t count) {
  AhmedOptions options;
  options.target_points = count;
  const Mesh mesh = ahmed_body(options);
  const Box box = bounding_box(mesh.points);
  std::vector<Vec3> places;
  for (const Vec3& x : mesh.points) {
    Vec3 unit{};
    for (std::size_t k = 0; k < 3; ++k) unit[k] = (x[k] - box.min[k]) / box.diagonal();
    places.push_back(unit);
  }
  return places;
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
double error_by_summation(const InterpolationSystem& system, const MatrixXd& coefficients, const MatrixXd& F) {
  const auto m = static_cast<Index>(system.size());
  const RowMajor weights = coefficients.topRows(m);
  const std::vector<double> sums = kernel_sums(system.kernel(), system.centres(), system.centres(),
                                               {weights.data(), static_cast<std::size_t>(weights.size())}, 3, {});
  const MatrixXd values = Eigen::Map<const RowMajor>(sums.data(), m, 3) +
                          system.polynomials().matrix(system.centres()) * coefficients.bottomRows(coefficients.rows() - m);
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
  std::unique_ptr<InterpolationSystem> system;
  result.prepare = seconds([&] { system = std::make_unique<InterpolationSystem>(places, options, RunContext()); });
  result.solve = seconds([&] { result.interpolants = system->interpolate(F, 1e-6); });
  result.bytes = system->bytes();
  result.centres = system->size();
  result.error = error_by_summation(*system, result.interpolants.coefficients, F);
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

void solver_table(bool quick) {
  const std::vector<Vec3> places = body(quick ? 1500 : 16000);
  const MatrixXd F = displacements(places, Data::torn);
  std::printf("\nsolvers, r^3, m = %zu (thesis table 7.3), three columns\n", places.size());
  std::printf("%-10s %10s %10s %10s %12s\n", "solver", "prepare s", "solve s", "MiB", "error / D");
  double ldlt = 0, cholesky = 0, lu = 0;
  for (const Solver solver : {Solver::lu, Solver::ldlt, Solver::cholesky, Solver::iterative}) {
    const Run r = run(places, solver, F);
    std::printf("%-10s %10.2f %10.2f %10.0f %12.2e\n", to_string(solver), r.prepare, r.solve,
                static_cast<double>(r.bytes) / (1 << 20), r.error);
    if (solver == Solver::lu) lu = r.prepare;
    if (solver == Solver::ldlt) ldlt = r.prepare;
    if (solver == Solver::cholesky) cholesky = r.prepare;
  }
  at_most("Cholesky / LDL^T, time of preparation", 0.55, cholesky / ldlt);
  at_most("Cholesky / LU, time of preparation", 0.8, cholesky / lu);
}

void evaluation(bool quick) {
  const std::size_t n = quick ? 20000 : 1000000, m = quick ? 1000 : 10000;
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

Setup car(Solver solver) {
  deform::Setup setup;
  setup.handles = {{"roof", {Region::GroupName{"roof"}}}};
  setup.handles[0].region = {Region::Difference{
      {{Region::GroupName{"roof"}}, {Region::GroupName{"slant"}}, {Region::GroupName{"nose"}}, {Region::GroupName{"sides"}}}}};
  setup.fixed = {{Region::GroupName{"underbody"}}, {Region::GroupName{"stilts"}}};
  RbfOptions options;
  options.solver = solver;
  options.reduction = CentreReduction::off;
  options.basis = BasisMode::always;
  setup.method = options;
  return setup;
}

/// Handle motion of the same number of points, from few centres and from many.
void handle_motion(bool quick) {
  const auto designs_per_second = [](std::size_t size, std::size_t& centres, double& points) {
    AhmedOptions options;
    options.target_points = size;
    const auto system = prepare(std::make_shared<const Mesh>(ahmed_body(options)), car(Solver::automatic));
    centres = system->info().centres;
    points = static_cast<double>(system->info().points);
    Design design;
    design.motions.push_back({0, Affine{1, 0, 0, 0.01, 0, 1, 0, 0, 0, 0, 1, 0.02}});
    system->evaluate(design);
    constexpr int repeats = 20;
    return repeats / seconds([&] {
             for (int i = 0; i < repeats; ++i) system->evaluate(design);
           });
  };
  std::size_t few = 0, many = 0;
  double few_points = 0, many_points = 0;
  const double a = designs_per_second(quick ? 3000 : 10000, few, few_points);
  const double b = designs_per_second(quick ? 6000 : 60000, many, many_points);
  std::printf("\nhandle motion: points per second with %zu and with %zu centres\n", few, many);
  at_least("with many / with few", 0.7, b * many_points / (a * few_points));
}

}  // namespace
}  // namespace deform

int main(int argc, char** argv) {
  const bool quick = argc > 1 && std::strcmp(argv[1], "--quick") == 0;
  std::printf("%d threads, %s\n", deform::thread_count({}), deform::vector_target());
  deform::iterative_tier(quick);
  deform::solver_table(quick);
  deform::evaluation(quick);
  deform::handle_motion(quick);
  return 0;
}
