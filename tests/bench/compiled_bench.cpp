// SPDX-License-Identifier: GPL-3.0-or-later
// Prints what a compiled deformation takes on one core: an Ahmed body with three handles that move affinely, so that all twelve
// fields count, in populations of 15. Processor time of this program, so that others on the machine count less.
//
// usage: compiled_bench [--quick]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "core/compiled/deformation.h"
#include "core/compiled/reader.h"
#include "core/compiled/records.h"
#include "core/deformers/compiled_form.h"
#include "core/mesh/ahmed.h"
#include "tests/bench/report.h"

namespace deform::bench {
namespace {

constexpr std::size_t population = 15;

/// Seconds of one run, the median of several.
double seconds(const std::function<void()>& work, int repetitions) {
  std::vector<double> times;
  for (int i = 0; i < repetitions; ++i) {
    const std::clock_t start = std::clock();
    work();
    times.push_back(static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
  }
  std::nth_element(times.begin(), times.begin() + repetitions / 2, times.end());
  return times[static_cast<std::size_t>(repetitions / 2)];
}

std::shared_ptr<const System> prepared(std::size_t points) {
  AhmedOptions options;
  options.target_points = points;
  deform::Setup setup;
  RbfOptions rbf;
  rbf.reduction_tolerance = 1e-3;
  rbf.basis = BasisMode::always;
  setup.method = rbf;
  for (int h = 0; h < 3; ++h) {
    const std::string name = "patch" + std::to_string(h);
    const Vec3 centre{0.3 + 0.2 * h, 0, 0.338};
    setup.handles.push_back({name, {Region::InSphere{centre, 0.06}}});
    setup.variables.push_back({"up" + std::to_string(h), name, DesignVariable::Translate{{0, 0, 1}}});
    setup.variables.push_back({"turn" + std::to_string(h), name, DesignVariable::Rotate{{0.3, 1, 0.2}, centre}});
    setup.variables.push_back({"grow" + std::to_string(h), name, DesignVariable::Scale{centre, {}}});
  }
  setup.fixed = {{Region::InBox{{-9, -9, -9}, {9, 9, 0.03}}}};
  return prepare(std::make_shared<const Mesh>(ahmed_body(options)), setup);
}

std::vector<std::byte> file_of(const std::shared_ptr<const System>& system) {
  CompiledForm form(system);
  form.content().geometry_id = form.content().system_id = std::string(64, '0');
  compiled::Records records(form.content(),
                            [&](std::size_t basis, std::size_t first, std::span<double> out) { form.values(basis, first, out); });
  std::vector<std::byte> bytes, piece;
  while (records.next(piece)) bytes.insert(bytes.end(), piece.begin(), piece.end());
  return bytes;
}

int run(bool quick) {
  const int repetitions = quick ? 5 : 25;
  const std::shared_ptr<const System> system = prepared(50000);
  const std::filesystem::path file = std::filesystem::temp_directory_path() / "compiled_bench.deformation";
  const std::vector<std::byte> bytes = file_of(system);
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform(-0.05, 0.05);
  const std::size_t variables = 9;
  std::vector<double> designs(population * variables);
  for (double& x : designs) x = uniform(random);
  const std::span<const double> one(designs.data(), variables);

  Report report("Compiled deformation: " + std::to_string(system->info().points) + " points, " +
                std::to_string(system->info().deformable_points) + " of them follow, " +
                std::to_string(system->info().basis_fields) + " fields, one core");
  std::vector<double> points(population * 3 * system->info().points);
  const std::span<double> first(points.data(), points.size() / population);
  report.at_most("file read and first design", seconds([&] { compiled::Deformation::load(file).evaluate(one, first); }, 5), 0.2,
                 " s");
  const compiled::Deformation deformation = compiled::Deformation::load(file);
  std::filesystem::remove(file);
  const double each = seconds([&] { deformation.evaluate(designs, points); }, repetitions) / population;
  report.at_least("designs a second, populations of 15", 1 / each, 3000, "");
  std::vector<float> floats(points.size());
  report.info("the same in floats",
              Report::text(population / seconds([&] { deformation.evaluate(designs, floats); }, repetitions)));
  report.info("designs a second, one by one", Report::text(1 / seconds([&] { deformation.evaluate(one, first); }, repetitions)));
  report.info("products with the Jacobian a second",
              Report::text(1 / seconds([&] { deformation.jacobian_vector(one, one, first); }, repetitions)));
  std::vector<double> gradient(variables);
  const std::vector<double> cotangent(first.begin(), first.end());
  report.info("with its transpose a second",
              Report::text(1 / seconds([&] { deformation.vector_jacobian(one, std::span<const double>(cotangent), gradient); },
                                       repetitions)));
  std::vector<Design> of_system(population);
  for (std::size_t i = 0; i < population; ++i) {
    of_system[i].variables.assign(designs.begin() + static_cast<std::ptrdiff_t>(i * variables),
                                  designs.begin() + static_cast<std::ptrdiff_t>((i + 1) * variables));
  }
  RunContext context;
  context.threads = 1;
  report.info("the prepared system itself, designs a second",
              Report::text(population /
                           seconds([&] { return system->evaluate(of_system, EvaluationPath::basis, context); }, repetitions)));
  {
    const auto evaluation = system->bind(of_system, EvaluationPath::basis, context);
    std::vector<Vec3> made(population * system->info().points);
    const std::size_t n = system->info().points, slice = 16384;
    report.info("the same into memory that is there, by slices of points as deformd does",
                Report::text(population / seconds(
                                              [&] {
                                                std::vector<Vec3*> out(population);
                                                for (std::size_t begin = 0; begin < n; begin += slice) {
                                                  for (std::size_t d = 0; d < population; ++d)
                                                    out[d] = made.data() + d * n + begin;
                                                  evaluation->evaluate(begin, std::min(n, begin + slice), 0, out);
                                                }
                                              },
                                              repetitions)));
  }
  report.info("file", Report::text(static_cast<double>(bytes.size()) / (1 << 20)) + " MiB");
  return report.missed() == 0 ? 0 : 1;
}

}  // namespace
}  // namespace deform::bench

int main(int argc, char** argv) { return deform::bench::run(argc > 1 && std::string_view(argv[1]) == "--quick"); }
