// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/constrained_population.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <memory>
#include <mutex>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "client/client.h"
#include "client/design.h"
#include "tests/bench/constraint_cases.h"
#include "tests/bench/server_process.h"

namespace deform::bench {

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t clients = 4, designs = 15;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

void half_space(v1::Region& region, double x, double direction) {
  for (const double value : {x, 0.0, 0.0}) region.mutable_half_space()->add_point(value);
  for (const double value : {direction, 0.0, 0.0}) region.mutable_half_space()->add_normal(value);
}

v1::Setup plate_setup(const std::string& geometry, std::size_t around) {
  v1::Setup setup;
  setup.set_geometry(geometry);
  setup.mutable_method()->mutable_mls()->set_surface_samples(1000);
  auto* handle = setup.add_handles();
  handle->set_name("right");
  half_space(*handle->mutable_region(), 1.9, 1);
  half_space(*setup.add_fixed(), 0.1, -1);
  for (const auto& [name, axis] : {std::pair{"pull", 0}, {"lift", 2}}) {
    auto* variable = setup.add_variables();
    variable->set_name(name);
    variable->set_handle("right");
    for (int k = 0; k < 3; ++k) variable->add_translate(k == axis ? 1 : 0);
  }
  auto* constraint = setup.add_constraints();
  constraint->set_name("bore");
  constraint->mutable_circular();
  auto* ids = constraint->add_regions()->mutable_ids();
  for (std::size_t k = 0; k < around; ++k) ids->Add(static_cast<std::uint32_t>(k));
  return setup;
}

/// What one client saw.
struct Seen {
  v1::SystemInfo system;
  std::vector<double> latencies;
  std::vector<double> ratios;  ///< residual of the constraint over the unconstrained one
  std::size_t not_converged = 0;
  std::vector<Points> points;  ///< in order of the designs
  double slowest = 0;          ///< seconds
  std::string about_slowest;
};

class Fleet {
 public:
  Fleet(const std::string& address, const v1::Setup& setup) : setup_(setup) {
    for (std::size_t c = 0; c < clients; ++c) {
      client::ClientOptions options;
      options.address = address;
      options.retry_seed = c + 1;
      clients_.push_back(std::make_unique<client::Client>(options));
      (void)clients_.back()->server_info();  // connects
    }
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> pull(0.1, 0.4), lift(-0.2, 0.2);
    for (std::size_t k = 0; k < designs; ++k) {
      const double values[] = {pull(random), lift(random)};
      population_.push_back(client::variables_design(values));
    }
  }

  /// All at once: every one of them prepares.
  double prepare() {
    return together([&](std::size_t c) { seen_[c].system = clients_[c]->prepare(setup_); });
  }
  /// Every one of them asks for all designs.
  double deform() {
    return together([&](std::size_t c) {
      for (std::size_t k = 0; k < designs; ++k) deform_one(c, k);
    });
  }
  client::Client& first() { return *clients_[0]; }
  const std::vector<Seen>& seen() const { return seen_; }

 private:
  void deform_one(std::size_t c, std::size_t k) {
    v1::DeformRequest request;
    request.set_system_id(seen_[c].system.id());
    request.mutable_output()->set_encoding(v1::RAW_F64);
    *request.add_designs() = population_[k];
    const auto start = Clock::now();
    auto outcome = clients_[c]->deform(request);
    const double took = seconds_since(start);
    seen_[c].latencies.push_back(took);
    auto& design = outcome.designs.at(0);
    const auto& report = design.result.constraints();
    if (took > seen_[c].slowest) {
      seen_[c].slowest = took;
      seen_[c].about_slowest = Report::text(took) + " s, of which solved " + Report::text(1e-3 * outcome.summary.solve_ms()) +
                               " s, " + std::to_string(report.iterations()) + " iterations, " +
                               std::to_string(report.newton_steps()) + " Newton steps";
    }
    seen_[c].not_converged += report.converged() ? 0 : 1;
    seen_[c].ratios.push_back(report.residuals(0).rms() / report.residuals(0).free_rms());
    seen_[c].points.push_back(std::move(design.points));
  }

  template <typename Work>
  double together(const Work& work) {
    seen_.resize(clients);
    std::mutex mutex;
    std::exception_ptr failure;  // under mutex
    const auto start = Clock::now();
    std::vector<std::thread> threads;
    for (std::size_t c = 0; c < clients; ++c) {
      threads.emplace_back([&, c] {
        try {
          work(c);
        } catch (...) {
          const std::lock_guard lock(mutex);
          failure = std::current_exception();
        }
      });
    }
    for (auto& thread : threads) thread.join();
    if (failure) std::rethrow_exception(failure);
    return seconds_since(start);
  }

  v1::Setup setup_;
  std::vector<std::unique_ptr<client::Client>> clients_;
  std::vector<v1::Design> population_;
  std::vector<Seen> seen_;
};

}  // namespace

void constrained_population(const std::filesystem::path& folder, BenchSize size, Report& report) {
  std::filesystem::remove_all(folder);
  const ServerProcess server(DEFORMD_BINARY, folder);
  const std::size_t around = size == BenchSize::quick ? 96 : 480, across = size == BenchSize::quick ? 15 : 60;
  const Mesh plate = plate_with_hole(around, across);
  client::ClientOptions settings;
  settings.address = server.address();
  client::Client owner(settings);
  client::GeometryArrays arrays;
  arrays.points = plate.points;
  arrays.face_sizes = plate.face_sizes;
  arrays.face_points = plate.face_points;
  arrays.name = "plate";
  const std::string geometry = owner.register_geometry(arrays).id();

  Fleet fleet(server.address(), plate_setup(geometry, around));
  const double prepared = fleet.prepare();
  const v1::ServerInfo before = owner.server_info();
  const double seconds = fleet.deform();
  const v1::ServerInfo after = owner.server_info();

  std::set<std::string> preparations;
  std::vector<double> latencies;
  double worst_ratio = 0;
  std::size_t not_converged = 0, different = 0;
  for (const Seen& seen : fleet.seen()) {
    std::string stages;  // measured while preparing: two preparations do not take the same time to the last digit
    for (const auto& stage : seen.system.stages()) stages += stage.SerializeAsString();
    preparations.insert(stages);
    latencies.insert(latencies.end(), seen.latencies.begin(), seen.latencies.end());
    worst_ratio = std::max(worst_ratio, *std::max_element(seen.ratios.begin(), seen.ratios.end()));
    not_converged += seen.not_converged;
    for (std::size_t k = 0; k < designs; ++k) different += seen.points[k] == fleet.seen()[0].points[k] ? 0 : 1;
  }
  std::sort(latencies.begin(), latencies.end());
  const auto rank = [&](double share) {
    return latencies[static_cast<std::size_t>(std::ceil(share * static_cast<double>(latencies.size()))) - 1];
  };
  const std::string name = "population of 15 from 4 clients, " + std::to_string(plate.point_count()) + " points: ";
  report.at_most(name + "preparations seen by the four that prepared at once", static_cast<double>(preparations.size()), 1, "");
  report.at_most(name + "systems missed or evicted while deforming",
                 static_cast<double>(after.cache_misses() - before.cache_misses() + after.cache_evictions()), 0, "");
  report.info(name + "prepared once for all of them", Report::text(prepared) + " s");
  report.info(name + "designs per second", Report::text(static_cast<double>(latencies.size()) / seconds) + ", p50 " +
                                               Report::text(1e3 * rank(0.5)) + " ms, p99 " + Report::text(1e3 * rank(0.99)) +
                                               " ms");
  const Seen& slowest = *std::max_element(fleet.seen().begin(), fleet.seen().end(),
                                          [](const Seen& a, const Seen& b) { return a.slowest < b.slowest; });
  report.info(name + "the slowest", slowest.about_slowest);
  report.at_most(name + "residual over the unconstrained one", worst_ratio, 0.05, "");
  report.at_most(name + "designs that did not converge", static_cast<double>(not_converged), 0, "");
  report.at_most(name + "designs that differ between clients", static_cast<double>(different), 0, "");
}

}  // namespace deform::bench
