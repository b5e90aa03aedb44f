// SPDX-License-Identifier: GPL-3.0-or-later
// Free-form deformation of an Ahmed body of a million points by a lattice of 10^3 control points: designs from stored local
// coordinates, on one and two threads, and beside the path of the handle basis. Processor time of this program where others on
// the machine must not count; ratios are of turns taken one after the other.
//
// usage: lattice_bench [--quick]
#include <algorithm>
#include <chrono>
#include <ctime>
#include <functional>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/parallel.h"
#include "core/deformers/system.h"
#include "core/mesh/ahmed.h"
#include "tests/bench/report.h"

namespace deform::bench {
namespace {

constexpr std::uint32_t handles = 12;

Setup by_controls(BasisMode basis) {
  FfdOptions options;
  options.control = FfdControl::controls;
  options.lattice.points = {10, 10, 10};
  options.basis = basis;
  Setup setup;
  setup.method = options;
  for (std::uint32_t h = 0; h < handles; ++h) {
    const std::string name = "control" + std::to_string(h);
    setup.handles.push_back({name, {Region::ControlIds{{450 + h}}}});
    setup.variables.push_back({"up" + std::to_string(h), name, DesignVariable::Translate{{0, 0, 1}}});
  }
  return setup;
}

std::vector<Design> designs(std::size_t count) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform(-0.05, 0.05);
  std::vector<Design> result(count);
  for (Design& design : result) {
    for (std::uint32_t h = 0; h < handles; ++h) design.variables.push_back(uniform(random));
  }
  return result;
}

struct Seconds {
  double wall = 0, processor = 0;
};

Seconds of(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  const std::clock_t used = std::clock();
  work();
  return {std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(),
          static_cast<double>(std::clock() - used) / CLOCKS_PER_SEC};
}

/// Binds designs and deforms all points, into memory that has been used before.
void deform(const System& system, std::span<const Design> designs, EvaluationPath path, int threads, std::vector<Points>& out) {
  RunContext context;
  context.threads = threads;
  const auto bound = system.bind(designs, path, context);
  parallel_for(context, out[0].size(), 16384, [&](std::size_t begin, std::size_t end) {
    std::vector<Vec3*> to;
    for (std::size_t d = 0; d < designs.size(); ++d) to.push_back(out[d].data() + begin);
    bound->evaluate(begin, end, 0, to);
  });
}

/// What memory alone allows: reads and writes as many bytes for a point, with an addition for each.
void copy(const Points& from, const Points& coordinates, int threads, Points& to) {
  RunContext context;
  context.threads = threads;
  parallel_for(context, to.size(), 16384, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      for (std::size_t c = 0; c < 3; ++c) to[i][c] = from[i][c] + coordinates[i][c];
    }
  });
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

int run(bool quick) {
  AhmedOptions body;
  body.target_points = 1'000'000;
  const auto mesh = std::make_shared<const Mesh>(ahmed_body(body));
  const auto points = static_cast<double>(mesh->point_count());
  const auto direct = prepare(mesh, by_controls(BasisMode::never)), by_basis = prepare(mesh, by_controls(BasisMode::always));
  Report report("Free-form deformation, " + std::to_string(mesh->point_count()) + " points, 10^3 control points");
  report.info("memory beside the mesh, without and with basis",
              Report::text(static_cast<double>(direct->info().bytes) / (1 << 20)) + " and " +
                  Report::text(static_cast<double>(by_basis->info().bytes) / (1 << 20)) + " MiB");
  const auto one = designs(1), many = designs(16);
  std::vector<Points> out(16, mesh->points);
  std::vector<double> processor, ratio, speedup, populations, binding, copies, copy_speedup, work;
  for (int turn = 0; turn < (quick ? 5 : 21); ++turn) {
    const Seconds alone = of([&] { deform(*direct, one, EvaluationPath::direct, 1, out); });
    const Seconds two = of([&] { deform(*direct, one, EvaluationPath::direct, 2, out); });
    const Seconds basis = of([&] { deform(*by_basis, one, EvaluationPath::basis, 1, out); });
    const Seconds sixteen = of([&] { deform(*direct, many, EvaluationPath::direct, 1, out); });
    const Seconds bind = of([&] { (void)direct->bind(one, EvaluationPath::direct, {}); });
    const Seconds copy_alone = of([&] { copy(out[1], out[2], 1, out[0]); });
    const Seconds copy_two = of([&] { copy(out[1], out[2], 2, out[0]); });
    binding.push_back(bind.processor);
    copies.push_back(copy_alone.processor);
    copy_speedup.push_back(copy_alone.wall / copy_two.wall / 2);
    processor.push_back(alone.processor);
    work.push_back(alone.processor / two.processor);
    ratio.push_back(alone.processor / basis.processor);
    speedup.push_back(alone.wall / two.wall / 2);
    populations.push_back(sixteen.processor / 16);
  }
  report.at_least("million points a second on two cores at that efficiency, one design",
                  2 * std::min(1.0, median(speedup)) * points / median(processor) * 1e-6, 50, "");
  report.at_least("efficiency of two threads", median(speedup), 0.8, "");
  report.info("processor time of one thread over that of both, which others on the machine do not count in",
              Report::text(median(work)));
  report.info("million points per second of one core, one design", Report::text(points / median(processor) * 1e-6));
  report.info("the same in populations of 16", Report::text(points / median(populations) * 1e-6));
  report.info("milliseconds of binding it, before any point", Report::text(1e3 * median(binding)));
  report.info("million points per second of one core that memory allows: a sum of points with the same traffic",
              Report::text(points / median(copies) * 1e-6));
  report.info("efficiency of two threads in that", Report::text(median(copy_speedup)));
  report.info("time of the path of stored coordinates over that of the basis of " + std::to_string(handles) + " fields",
              Report::text(median(ratio)));
  return report.missed() == 0 ? 0 : 1;
}

}  // namespace
}  // namespace deform::bench

int main(int argc, char** argv) { return deform::bench::run(argc > 1 && std::string_view(argv[1]) == "--quick"); }
