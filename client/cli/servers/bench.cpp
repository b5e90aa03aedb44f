// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <iostream>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "client/cli/commands/command.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/design.h"

namespace deform::cli {

namespace {

struct BenchOptions {
  PrepareInput input;
  int clients = 1;
  int population = 1;
  int designs = 100;
  std::uint64_t seed = 1;
  OutputOptions encoding;
};

/// A random design within the bounds; +-0.01 where there are none. Without variables every handle is shifted a little.
v1::Design random_design(const v1::SystemInfo& system, std::mt19937_64& random) {
  std::vector<double> values;
  for (const auto& variable : system.setup().variables()) {
    const double lower = variable.has_lower() ? variable.lower() : -0.01;
    const double upper = variable.has_upper() ? variable.upper() : 0.01;
    values.push_back(std::uniform_real_distribution<double>(lower, upper)(random));
  }
  v1::Design design = client::variables_design(values);
  if (!values.empty()) return design;
  std::uniform_real_distribution<double> shift(-0.01 * system.diagonal(), 0.01 * system.diagonal());
  for (const auto& handle : system.setup().handles()) {
    Affine map = identity_affine;
    for (const std::size_t k : {3, 7, 11}) map[k] = shift(random);
    *design.add_motions() = client::affine_motion(handle.name(), map);
  }
  return design;
}

/// What all clients measured.
struct Measured {
  std::vector<double> latencies_ms;  ///< of requests
  std::size_t designs = 0;
  double queue_ms = 0, solve_ms = 0, encode_ms = 0, decode_ms = 0;
  std::uint64_t wire_bytes = 0;
  double max_error = 0;
  double seconds = 0;
};

class Bench {
 public:
  Bench(Connection& connection, const CommonOptions& common, const v1::SystemInfo& system, const BenchOptions& options)
      : connection_(connection), common_(common), system_(system), options_(options) {}

  Measured run(Progress& progress) {
    std::vector<std::unique_ptr<client::Client>> clients;
    const auto points =
        std::make_shared<const Points>(connection_.client().get_points(system_.geometry_id(), connection_.call()));
    for (int c = 0; c < options_.clients; ++c) {
      auto settings = common_.client_options();
      settings.retry_seed = static_cast<std::uint64_t>(c + 1);
      clients.push_back(std::make_unique<client::Client>(settings));
      clients.back()->keep_points(system_.geometry_id(), points);
      clients.back()->share_copies(connection_.client());
      std::mt19937_64 random(options_.seed);
      request(*clients.back(), random, 1);  // connects, and prepares again what was evicted
    }
    const auto start = std::chrono::steady_clock::now();
    std::vector<std::thread> threads;
    for (int c = 0; c < options_.clients; ++c) {
      threads.emplace_back(
          [&, c] { one_client(*clients[static_cast<std::size_t>(c)], static_cast<std::uint64_t>(c), progress); });
    }
    for (auto& thread : threads) thread.join();
    if (error_) std::rethrow_exception(error_);
    measured_.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return measured_;
  }

 private:
  client::DeformOutcome request(client::Client& client, std::mt19937_64& random, int designs) {
    v1::DeformRequest request;
    request.set_system_id(system_.id());
    options_.encoding.set(request);
    for (int k = 0; k < designs; ++k) *request.add_designs() = random_design(system_, random);
    return client.deform(request, connection_.call());
  }

  void one_client(client::Client& client, std::uint64_t number, Progress& progress) {
    std::mt19937_64 random(options_.seed + 1000 * (number + 1));
    try {
      while (true) {
        const int first = taken_.fetch_add(options_.population);
        if (first >= options_.designs || stop_) return;
        const int count = std::min(options_.population, options_.designs - first);
        note(request(client, random, count), progress);
      }
    } catch (...) {
      const std::lock_guard lock(mutex_);
      if (!error_) error_ = std::current_exception();
      stop_ = true;
    }
  }

  void note(const client::DeformOutcome& outcome, Progress& progress) {
    const std::lock_guard lock(mutex_);
    measured_.latencies_ms.push_back(outcome.wall_ms);
    measured_.designs += outcome.designs.size();
    measured_.queue_ms += outcome.summary.queue_ms();
    measured_.solve_ms += outcome.summary.solve_ms();
    measured_.encode_ms += outcome.summary.encode_ms();
    measured_.decode_ms += outcome.decode_ms;
    measured_.wire_bytes += outcome.summary.bytes();
    for (const auto& design : outcome.designs) measured_.max_error = std::max(measured_.max_error, design.result.max_error());
    progress.count("bench", measured_.designs, static_cast<std::size_t>(options_.designs));
  }

  Connection& connection_;
  const CommonOptions& common_;
  const v1::SystemInfo& system_;
  const BenchOptions& options_;
  std::atomic<int> taken_{0};
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  // under mutex_
  Measured measured_;
  std::exception_ptr error_;
};

nlohmann::ordered_json bench_json(Measured measured, const BenchOptions& options, const v1::SystemInfo& system) {
  std::sort(measured.latencies_ms.begin(), measured.latencies_ms.end());
  const auto percentile = [&](double p) {
    const auto rank = static_cast<std::size_t>(std::ceil(p * static_cast<double>(measured.latencies_ms.size())));
    return measured.latencies_ms[std::max<std::size_t>(rank, 1) - 1];
  };
  const auto designs = static_cast<double>(measured.designs);
  const double point_bytes = designs * static_cast<double>(system.points()) * sizeof(Vec3);
  nlohmann::ordered_json json;
  json["points"] = system.points();
  json["centres"] = system.centres();
  json["clients"] = options.clients;
  json["population"] = options.population;
  json["encoding"] = options.encoding.encoding;
  json["designs"] = measured.designs;
  json["seconds"] = measured.seconds;
  json["designs_per_second"] = designs / measured.seconds;
  json["megabytes_per_second"] = point_bytes * 1e-6 / measured.seconds;
  json["wire_megabytes_per_second"] = static_cast<double>(measured.wire_bytes) * 1e-6 / measured.seconds;
  json["latency_ms"] = {{"p50", percentile(0.5)}, {"p99", percentile(0.99)}, {"max", measured.latencies_ms.back()}};
  json["stages_ms_per_design"] = {
      {"solve", measured.solve_ms / designs}, {"encode", measured.encode_ms / designs}, {"decode", measured.decode_ms / designs}};
  json["queue_ms_per_request"] = measured.queue_ms / static_cast<double>(measured.latencies_ms.size());
  json["max_error"] = measured.max_error;
  return json;
}

void print_bench(const nlohmann::ordered_json& json) {
  const auto number = [](const nlohmann::ordered_json& value) { return number_text(value.get<double>()); };
  std::cout << json["designs"] << " designs of " << json["points"] << " points, " << json["clients"] << " clients, population "
            << json["population"] << ", " << json["encoding"].get<std::string>() << '\n'
            << "  designs/s     " << number(json["designs_per_second"]) << '\n'
            << "  points        " << number(json["megabytes_per_second"]) << " MB/s as doubles, "
            << number(json["wire_megabytes_per_second"]) << " MB/s on the wire\n"
            << "  request       p50 " << number(json["latency_ms"]["p50"]) << " ms, p99 " << number(json["latency_ms"]["p99"])
            << " ms, max " << number(json["latency_ms"]["max"]) << " ms\n"
            << "  queue         " << number(json["queue_ms_per_request"]) << " ms per request\n";
  for (const auto& [stage, ms] : json["stages_ms_per_design"].items()) {
    std::cout << "  " << stage << std::string(14 - stage.size(), ' ') << number(ms) << " core ms per design\n";
  }
  std::cout << "  max error     " << number(json["max_error"]) << std::endl;
}

ExitCode run_bench(const BenchOptions& given, const CommonOptions& common) {
  Connection connection(common);
  Progress preparing;
  const PreparedSetup prepared = open_setup(connection, given.input, preparing);
  BenchOptions options = given;
  options.encoding = given.encoding.named(connection.client(), prepared.system);
  Progress progress;
  const Measured measured = Bench(connection, common, prepared.system, options).run(progress);
  progress.clear();
  const auto json = bench_json(measured, options, prepared.system);
  if (common.style() == Style::json) {
    print(json);
  } else {
    print_bench(json);
  }
  return exit_ok;
}

}  // namespace

void add_bench_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<BenchOptions>();
  options->encoding.encoding = "draco";
  auto* command = app.add_subcommand("bench", "Measure how fast a server deforms for a setup");
  command->add_option("SETUP", options->input.setup, "Setup file, or the id of a prepared system")->required();
  command->add_option("--clients", options->clients, "Clients at once, each with its own connection")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  command->add_option("--population", options->population, "Designs per request")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  command->add_option("--designs", options->designs, "Designs in total")->check(CLI::Range(1, 10000000))->capture_default_str();
  command->add_option("--seed", options->seed, "Seed of the random designs")->capture_default_str();
  options->encoding.add_to(*command);
  command->footer(
      "Designs are random within the bounds of the variables (+-0.01 where there are none).\n"
      "Example: deform bench setup.yaml --clients 8 --population 15 --designs 600");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_bench(*options, common); }; });
}

}  // namespace deform::cli
