// SPDX-License-Identifier: GPL-3.0-or-later
// Prints the figures of numerics and deformers, each against what it must reach, everything measured in one run.
//
// usage: numerics_bench [--quick | --basis | --nearest] [SPHERE_OFF SPHERE_SELECTION_CSV]
//   --basis: only designs by the handle basis against streaming it, in pairs
//   --nearest: only searches in a k-d tree of 15 million samples
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <memory>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/deformers/rbf/rbf_system.h"
#include "core/io/mesh_file.h"
#include "core/mesh/ahmed.h"
#include "core/numerics/dense/blas_kernels.h"
#include "core/numerics/dense/lapack.h"
#include "core/numerics/dense/packed_cholesky.h"
#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/kernels/tiles.h"
#include "core/numerics/sampling/point_tree.h"
#include "core/quality/flipped_faces.h"
#include "tests/support/scipy_interpolator.h"

namespace deform {
namespace {

using Clock = std::chrono::steady_clock;

double seconds(const std::function<void()>& work) {
  const auto start = Clock::now();
  work();
  return std::chrono::duration<double>(Clock::now() - start).count();
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// Quotients of measurements taken one after the other, so that both sides of a pair meet the same machine.
double median_ratio(const std::vector<double>& ours, const std::vector<double>& theirs) {
  std::vector<double> ratios;
  for (std::size_t i = 0; i < ours.size(); ++i) ratios.push_back(ours[i] / theirs[i]);
  return median(ratios);
}

void print_head() { std::printf("%-68s %14s %14s\n", "figure", "required", "measured"); }
void print_value(const std::string& figure, double value, const char* unit) {
  std::printf("%-68s %14s %14.4g %s\n", figure.c_str(), "", value, unit);
}
void print_at_most(const std::string& figure, double limit, double value) {
  std::printf("%-68s %9s %4.3g %14.3g %s\n", figure.c_str(), "<=", limit, value, value <= limit ? "PASS" : "MISS");
}
void print_at_least(const std::string& figure, double limit, double value) {
  std::printf("%-68s %9s %4.3g %14.3g %s\n", figure.c_str(), ">=", limit, value, value >= limit ? "PASS" : "MISS");
}

// m points of the surface of an Ahmed body in the unit box, evenly taken, with a smooth displacement of each.
struct Samples {
  Points places, displacements;
};

Samples surface_samples(std::size_t count) {
  AhmedOptions options;
  options.target_points = std::max<std::size_t>(2000, count + count / 4);
  const Mesh mesh = ahmed_body(options);
  const Box box = bounding_box(mesh.points);
  Samples samples;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3& x = mesh.points[i * mesh.point_count() / count];
    Vec3 unit{};
    for (std::size_t k = 0; k < 3; ++k) unit[k] = (x[k] - box.min[k]) / (box.max[0] - box.min[0]);
    samples.places.push_back(unit);
    samples.displacements.push_back({0.1 * std::sin(5 * unit[0]), 0.1 * unit[1] * unit[0], 0.1 * std::cos(4 * unit[2])});
  }
  return samples;
}

// Seconds of the factorization alone and of everything before it.
struct FactorTimes {
  double assemble = 0, factor = 0;
  std::size_t bytes = 0;
};

FactorTimes time_cholesky(const SaddleProblem& problem) {
  RunContext context;
  auto assembled = Clock::now(), factored = assembled;
  const auto start = Clock::now();
  context.on_progress = [&](const std::string& stage, double fraction) {
    if (stage == "factor" && fraction == 0) assembled = Clock::now();
    if (stage == "factor" && fraction == 1) factored = Clock::now();
  };
  const auto factor = factor_cholesky(problem, context);
  const std::chrono::duration<double> assemble = assembled - start;
  const std::chrono::duration<double> alone = factored - assembled;
  return {assemble.count(), alone.count(), factor->bytes()};
}

// dsytrf of the bordered matrix, its threads as many as ours.
double time_dsytrf(const SaddleProblem& problem) {
  const std::size_t m = problem.centres.size(), q = problem.polynomials.terms();
  const int n = static_cast<int>(m + q);
  std::vector<double> A(static_cast<std::size_t>(n) * static_cast<std::size_t>(n));
  const Eigen::MatrixXd P = problem.polynomials.matrix(problem.centres);
  for (std::size_t j = 0; j < m; ++j) {
    for (std::size_t i = 0; i < m; ++i) {
      const Vec3 &a = problem.centres[i], &b = problem.centres[j];
      const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
      A[j * (m + q) + i] = value(problem.kernel, x * x + y * y + z * z);
    }
    for (std::size_t t = 0; t < q; ++t) A[j * (m + q) + m + t] = P(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(t));
  }
  std::vector<int> pivots(m + q);
  const int lwork = 64 * n;
  std::vector<double> work(static_cast<std::size_t>(lwork));
  int info = 0;
  lapack::use_one_thread();  // the first call, so that it does not undo the next line later
  openblas_set_num_threads(thread_count({}));
  const double time = seconds([&] { dsytrf_("L", &n, A.data(), &n, pivots.data(), work.data(), &lwork, &info); });
  openblas_set_num_threads(1);
  return time;
}

void bench_cholesky(std::size_t m, int repetitions) {
  const Samples samples = surface_samples(m);
  const PolynomialSpace polynomials(samples.places, 1);
  const SaddleProblem problem{{Kernel::triharmonic, 1}, samples.places, polynomials};
  std::vector<double> alone, total, dsytrf;
  std::size_t bytes = 0;
  for (int i = 0; i < repetitions; ++i) {
    dsytrf.push_back(time_dsytrf(problem));
    const FactorTimes ours = time_cholesky(problem);
    alone.push_back(ours.factor);
    total.push_back(ours.assemble + ours.factor);
    bytes = ours.bytes;
  }
  const std::string size = "m = " + std::to_string(m);
  print_value("dsytrf of the bordered matrix, " + size, median(dsytrf), "s");
  print_value("Cholesky on the complement, factorization alone, " + size, median(alone), "s");
  print_value("  with assembly, " + size, median(total), "s");
  print_at_most("Cholesky against dsytrf, " + size, 0.6, median_ratio(alone, dsytrf));
  print_at_most("  with assembly, against dsytrf without, " + size, 0.6, median_ratio(total, dsytrf));
  const auto square = static_cast<double>(m) * static_cast<double>(m) * 8;
  print_at_most("cached bytes of the factor / 8 m^2, " + size, 0.55, static_cast<double>(bytes) / square);
}

void bench_scipy(std::size_t n, std::size_t m, int repetitions) {
  const Samples samples = surface_samples(m);
  Points points = surface_samples(n).places;
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> jitter(-0.01, 0.01);
  for (Vec3& p : points) {
    for (double& x : p) x += jitter(random);
  }
  InterpolationOptions options;
  const DenseInterpolator system(samples.places, options, {});
  Eigen::MatrixXd F(static_cast<Eigen::Index>(m), 3);
  for (std::size_t j = 0; j < m; ++j) {
    for (std::size_t k = 0; k < 3; ++k)
      F(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = samples.displacements[j][k];
  }
  const Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> W = system.interpolate(F, 0).coefficients;
  const std::span<const double> weights(W.data(), 3 * m);
  std::vector<double> ours, theirs, sums;
  double difference = 0, largest = 0;
  const Eigen::MatrixXd P = system.polynomials().matrix(points);
  for (int i = 0; i < repetitions; ++i) {
    ours.push_back(seconds([&] { sums = kernel_sums(system.kernel(), points, system.centres(), weights, 3, {}); }));
    const test::SciPyResult scipy =
        test::interpolate_with_scipy(DEFORM_PYTHON, DEFORM_SCIPY_SCRIPT, samples.places, samples.displacements, points);
    if (!scipy.error.empty()) {
      std::printf("SciPy could not be run: %s\n", scipy.error.c_str());
      return;
    }
    theirs.push_back(scipy.evaluate_seconds);
    if (i > 0) continue;
    for (std::size_t p = 0; p < n; ++p) {
      const Eigen::RowVector3d tail = P.row(static_cast<Eigen::Index>(p)) * W.bottomRows(P.cols());
      for (std::size_t k = 0; k < 3; ++k) {
        const double value = sums[3 * p + k] + tail[static_cast<Eigen::Index>(k)];
        difference = std::max(difference, std::abs(value - scipy.values[p][k]));
        largest = std::max(largest, std::abs(scipy.values[p][k]));
      }
    }
  }
  print_value("kernel sums r^3, 3 columns, n = " + std::to_string(n) + ", m = " + std::to_string(m), median(ours), "s");
  print_value("  10^9 kernel evaluations a second", static_cast<double>(n) * static_cast<double>(m) / median(ours) * 1e-9, "");
  print_value("  SciPy RBFInterpolator, the same", median(theirs), "s");
  print_at_least("kernel sums against SciPy, times faster", 5, median_ratio(theirs, ours));
  print_at_most("agreement with SciPy, relative", 1e-9, difference / largest);
}

// A body with `handles` small patches as handles, each moved by an affine map; the stilts stay.
struct BasisCase {
  std::shared_ptr<const Mesh> mesh;
  std::shared_ptr<const System> system;
  std::vector<Design> designs;
};

BasisCase basis_case(std::size_t points, std::size_t handles, std::size_t designs, double tolerance = 0) {
  AhmedOptions options;
  options.target_points = points;
  BasisCase result;
  result.mesh = std::make_shared<Mesh>(ahmed_body(options));
  deform::Setup setup;
  for (std::size_t h = 0; h < handles; ++h) {
    const double x = 0.15 + 0.6 * static_cast<double>(h / 4) / static_cast<double>((handles + 3) / 4);
    const double y = -0.15 + 0.1 * static_cast<double>(h % 4);
    setup.handles.push_back({"patch" + std::to_string(h), {Region::InSphere{{x, y, 0.338}, 0.02}}});
  }
  setup.fixed = {{Region::Intersection{{{Region::GroupName{"stilts"}}, {Region::InHalfSpace{{0, 0, 0.005}, {0, 0, -1}}}}}}};
  std::get<RbfOptions>(setup.method).basis_tolerance = tolerance;
  result.system = prepare(result.mesh, setup);
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> uniform(-0.01, 0.01);
  for (std::size_t i = 0; i < designs; ++i) {
    Design design;
    for (std::size_t h = 0; h < handles; ++h) {
      Affine motion = identity_affine;
      for (double& value : motion) value += uniform(random);
      design.motions.push_back({h, motion});
    }
    result.designs.push_back(design);
  }
  return result;
}

// Sum of all doubles: what memory allows, with as many threads as the evaluation has.
__attribute__((target_clones("avx512f", "avx2", "default"))) double sum_of(const double* values, std::size_t count) {
  double sums[64] = {};
  for (std::size_t i = 0; i + 64 <= count; i += 64) {
    for (std::size_t k = 0; k < 64; ++k) sums[k] += values[i + k];
  }
  return std::accumulate(sums, sums + 64, 0.0);
}

double time_stream(const std::vector<double>& values) {
  constexpr std::size_t part = std::size_t{1} << 16;
  std::vector<double> sums((values.size() + part - 1) / part);
  const double time = seconds([&] {
    parallel_for({}, values.size(), part,
                 [&](std::size_t begin, std::size_t end) { sums[begin / part] = sum_of(values.data() + begin, end - begin); });
  });
  if (std::accumulate(sums.begin(), sums.end(), 0.0) == -1) std::printf("\n");  // the sum is needed
  return time;
}

double time_designs(const BasisCase& the, std::size_t first, std::size_t count, std::vector<Points>& out) {
  return seconds([&] {
    const auto evaluation =
        the.system->bind(std::span<const Design>(the.designs).subspan(first, count), EvaluationPath::basis, {});
    parallel_for({}, the.mesh->point_count(), 8192, [&](std::size_t begin, std::size_t end) {
      std::vector<Vec3*> to(count);
      for (std::size_t k = 0; k < count; ++k) to[k] = out[first + k].data() + begin;
      evaluation->evaluate(begin, end, 0, to);
    });
  });
}

void bench_basis(std::size_t points, std::size_t handles, int repetitions) {
  constexpr std::size_t population = 15;
  const BasisCase the = basis_case(points, handles, population);
  const SystemInfo& info = the.system->info();
  const std::string size = "n = " + std::to_string(info.points) + ", m = " + std::to_string(info.centres) + ", " +
                           std::to_string(info.basis_fields) + " fields";
  for (const auto& [stage, time] : info.stage_seconds) print_value("prepare: " + stage + ", " + size, time, "s");
  std::vector<double> stream(info.basis_bytes / sizeof(double), 1.0);
  std::vector<Points> out(population, Points(info.points));
  const FlipCheck flips(*the.mesh, the.mesh->points);
  std::vector<double> streaming, one, singles, together, looking;
  time_designs(the, 0, population, out);  // touches the pages
  for (int i = 0; i < repetitions; ++i) {
    streaming.push_back(time_stream(stream));
    one.push_back(time_designs(the, 0, 1, out));
    double sum = 0;
    for (std::size_t k = 0; k < population; ++k) sum += time_designs(the, k, 1, out);
    singles.push_back(sum);
    together.push_back(time_designs(the, 0, population, out));
    looking.push_back(seconds([&] { flips.flipped(the.mesh->points); }));
  }
  print_value("streaming the basis once, " + std::to_string(info.basis_bytes >> 20) + " MiB", median(streaming) * 1e3, "ms");
  print_value("one design by the basis", median(one) * 1e3, "ms");
  print_at_most("one design / streaming the basis", 1.5, median_ratio(one, streaming));
  // For each point the place, and its line of the result, which is fetched before it is written.
  const double points_bytes = static_cast<double>(info.points) * 3 * sizeof(Vec3);
  print_value("  the same in bytes: the basis, rest points, and the result fetched and written",
              1 + points_bytes / static_cast<double>(info.basis_bytes), "");
  print_value("15 designs one by one", median(singles) * 1e3, "ms");
  print_value("15 designs together", median(together) * 1e3, "ms");
  print_at_most("population of 15 / 15 single designs", 0.35, median_ratio(together, singles));
  print_value("looking for flipped faces, none turned, " + std::to_string(the.mesh->face_count()) + " faces",
              median(looking) * 1e3, "ms");
  print_at_most("the same / one design by the basis", 1.0, median_ratio(looking, one));
}

// The same with all handles only moved, one field of four, and the basis stored to tolerances.
void bench_lean_basis(std::size_t points, std::size_t handles, int repetitions) {
  const BasisCase full = basis_case(points, handles, 1);
  const auto plain_bytes = static_cast<double>(full.system->info().basis_bytes);
  const std::vector<double> stream(full.system->info().basis_bytes / sizeof(double), 1.0);
  std::vector<Points> exact(1, Points(full.mesh->point_count())), out = exact;
  BasisCase moved = full, lifted = full;
  for (Motion& motion : moved.designs[0].motions) motion.value = Affine{1, 0, 0, 0.01, 0, 1, 0, 0.02, 0, 0, 1, 0.01};
  lifted.designs[0].motions = {moved.designs[0].motions[0]};
  time_designs(moved, 0, 1, out);
  std::vector<double> one, all, single;
  for (int i = 0; i < repetitions; ++i) {
    one.push_back(time_designs(full, 0, 1, exact));
    all.push_back(time_designs(moved, 0, 1, out));
    single.push_back(time_designs(lifted, 0, 1, out));
  }
  print_value("one design that moves all handles, a field of four / one of all fields", median_ratio(all, one), "");
  print_value("one design that moves one handle, a field of all / one of all fields", median_ratio(single, one), "");
  for (const auto& [tolerance, share] : {std::pair(1e-8, 0.5), std::pair(1e-6, 0.3)}) {
    const BasisCase lean = basis_case(points, handles, 15, tolerance);
    const std::string name = "basis to " + std::to_string(static_cast<int>(std::lround(std::log10(tolerance)))) + " (log10): ";
    for (const auto& [stage, time] : lean.system->info().stage_seconds) {
      if (stage == "basis") print_value(name + "seconds to make it", time, "s");
    }
    print_at_most(name + "bytes / bytes of doubles", share, static_cast<double>(lean.system->info().basis_bytes) / plain_bytes);
    std::vector<double> against, times, together;
    std::vector<Points> population(15, Points(full.mesh->point_count()));
    time_designs(lean, 0, 15, population);
    for (int i = 0; i < repetitions; ++i) {
      against.push_back(time_stream(stream));
      times.push_back(time_designs(lean, 0, 1, out));
      together.push_back(time_designs(lean, 0, 15, population));
    }
    print_value(name + "one design", median(times) * 1e3, "ms");
    print_value(name + "15 designs together", median(together) * 1e3, "ms");
    print_at_most(name + "one design / streaming the basis of doubles", 1.0, median_ratio(times, against));
    double largest = 0;
    for (std::size_t i = 0; i < exact[0].size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) largest = std::max(largest, std::abs(out[0][i][k] - exact[0][i][k]));
    }
    print_value(name + "largest difference of a coordinate / D", largest / full.system->info().diagonal, "");
  }
}

// The performance case of thesis figure 4.1: 7,800 vertices, 526 handle and 404 fixed ones.
void bench_sphere(const std::string& mesh_path, const std::string& selection_path) {
  const auto mesh = io::read_mesh_file(mesh_path)->mesh();
  Region::Ids handle, fixed;
  std::ifstream file(selection_path);
  for (std::string line; std::getline(file, line);) {
    const auto comma = line.find(',');
    if (line.ends_with("handle")) handle.ids.push_back(static_cast<PointId>(std::stoul(line.substr(0, comma))));
    if (line.ends_with("fixed")) fixed.ids.push_back(static_cast<PointId>(std::stoul(line.substr(0, comma))));
  }
  deform::Setup setup;
  setup.handles = {{"handle", {handle}}};
  setup.fixed = {{fixed}};
  Design design;
  design.motions = {{0, Affine{1, 0, 0, 0.1, 0, 1, 0, 0.1, 0, 0, 1, 0.2}}};
  std::vector<double> preparing, evaluating;
  std::string note;
  for (int i = 0; i < 5; ++i) {
    std::shared_ptr<const System> system;
    preparing.push_back(seconds([&] { system = prepare(mesh, setup); }));
    evaluating.push_back(seconds([&] { system->evaluate(design); }));
    note = std::to_string(system->info().points) + " points, " + std::to_string(handle.ids.size()) + " handle, " +
           std::to_string(fixed.ids.size()) + " fixed, " + std::to_string(system->info().centres) + " centres";
  }
  print_value("thesis figure 4.1, sphere, prepare: " + note, median(preparing) * 1e3, "ms");
  print_value("thesis figure 4.1, sphere, one design", median(evaluating) * 1e3, "ms");
  print_value("thesis figure 4.1, sphere, prepare and five designs", (median(preparing) + 5 * median(evaluating)) * 1e3, "ms");
}

// Thesis 6.2: surfaces of CAD models are sampled, and a k-d tree finds the sample nearest to a node of the mesh. A wavy sheet,
// nodes up to a few spacings off it, in random order.
void bench_nearest(std::size_t samples, std::size_t nodes) {
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> uniform(0, 1);
  const auto side = static_cast<std::size_t>(std::sqrt(static_cast<double>(samples)));
  const auto height = [](double x, double y) { return 0.1 * std::sin(7 * x) * std::cos(5 * y); };
  std::vector<Vec3> points;
  points.reserve(side * side);
  for (std::size_t i = 0; i < side * side; ++i) {
    const double x = static_cast<double>(i % side) / side, y = static_cast<double>(i / side) / side;
    points.push_back({x, y, height(x, y)});
  }
  std::unique_ptr<const PointTree> tree;
  const double build = seconds([&] { tree = std::make_unique<PointTree>(points); });
  std::vector<Vec3> places;
  for (std::size_t i = 0; i < nodes; ++i) {
    const double x = uniform(random), y = uniform(random);
    places.push_back({x, y, height(x, y) + 5.0 / side * uniform(random)});
  }
  double sum = 0;
  const double query = seconds([&] {
    for (const Vec3& place : places) sum += tree->nearest(place).square;
  });
  const std::string count = std::to_string(side * side);
  print_at_most("k-d tree of " + count + " samples, nearest of one node, one thread, us", 10, query / nodes * 1e6);
  print_value("k-d tree of " + count + " samples, building", build, "s");
  print_value("k-d tree of " + count + " samples, mean squared distance", sum / nodes, "");
}

}  // namespace
}  // namespace deform

int main(int argc, char** argv) {
  deform::lapack::use_kernels_of_processor(argv);
  std::vector<std::string> arguments(argv + 1, argv + argc);
  const bool quick = !arguments.empty() && arguments[0] == "--quick";
  if (quick) arguments.erase(arguments.begin());
  std::printf("%d threads, vector target %s\n", deform::thread_count({}), deform::vector_target());
  deform::print_head();
  std::fflush(stdout);
  if (!arguments.empty() && arguments[0] == "--basis") {
    deform::bench_basis(465000, 20, 15);
    std::fflush(stdout);
    deform::bench_lean_basis(465000, 20, 15);
    return 0;
  }
  if (!arguments.empty() && arguments[0] == "--nearest") {
    deform::bench_nearest(15'000'000, 200'000);
    return 0;
  }
  deform::bench_cholesky(quick ? 1500 : 6000, quick ? 1 : 3);
  std::fflush(stdout);
  deform::bench_scipy(quick ? 5000 : 50000, quick ? 500 : 2000, 3);
  std::fflush(stdout);
  deform::bench_basis(quick ? 30000 : 465000, 20, quick ? 3 : 7);
  std::fflush(stdout);
  deform::bench_lean_basis(quick ? 30000 : 465000, 20, quick ? 3 : 7);
  std::fflush(stdout);
  deform::bench_nearest(quick ? 1'000'000 : 15'000'000, quick ? 20'000 : 200'000);
  if (arguments.size() == 2) deform::bench_sphere(arguments[0], arguments[1]);
  return 0;
}
