// SPDX-License-Identifier: GPL-3.0-or-later
// Evaluate as a user of the service sees it: points that were never registered, streamed through a deformd process on loopback.
//   evaluate_bench [--points N] [--centres M] [--folder F]
// Prints a Markdown table; exit code 1 when a figure misses its limit. Wall times need an otherwise idle machine; the processor
// times that stand beside them do not.
#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <filesystem>
#include <iostream>
#include <string>

#include "client/client.h"
#include "tests/bench/bench_case.h"
#include "tests/bench/report.h"
#include "tests/bench/server_process.h"

namespace deform::bench {
namespace {

using Clock = std::chrono::steady_clock;

struct Options {
  std::string deformd = DEFORMD_BINARY;
  std::string folder = (std::filesystem::temp_directory_path() / "evaluate_bench").string();
  std::size_t points = 10'000'000;
  std::size_t centres = 2000;
};

/// Somewhere around the body, without a memory of its own.
Vec3 place(std::size_t i) {
  const auto t = static_cast<double>(i);
  const auto fraction = [](double x) { return x - std::floor(x); };
  return {1.2 * fraction(0.7548776662466927 * t), 0.5 * fraction(0.5698402909980532 * t) - 0.25,
          0.4 * fraction(0.618033988749895 * t)};
}

struct Measured {
  double wall = 0, server_cpu = 0, client_cpu = 0;
  double resident_before = 0, resident_most = 0;
  v1::EvaluateResult result;
};

Measured stream(client::Client& client, const ServerProcess& server, const v1::EvaluateHeader& header, std::size_t points) {
  Measured measured;
  measured.resident_before = server.resident_bytes();
  const double server_before = server.cpu_seconds(), own_before = own_cpu_seconds();
  const auto start = Clock::now();
  std::size_t sent = 0;
  measured.result = client.evaluate(
      header,
      [&](std::span<Vec3> block) {
        const std::size_t count = std::min(block.size(), points - sent);
        for (std::size_t i = 0; i < count; ++i) block[i] = place(sent + i);
        sent += count;
        return count;
      },
      [&](std::uint64_t, std::span<const Vec3>) {
        measured.resident_most = std::max(measured.resident_most, server.resident_bytes());
      });
  measured.wall = std::chrono::duration<double>(Clock::now() - start).count();
  measured.server_cpu = server.cpu_seconds() - server_before;
  measured.client_cpu = own_cpu_seconds() - own_before;
  return measured;
}

int run(const Options& options) {
  std::filesystem::remove_all(options.folder);
  std::filesystem::create_directories(options.folder);
  const ServerProcess server(options.deformd, options.folder);
  client::ClientOptions client_options;
  client_options.address = server.address();
  client::Client client(client_options);
  const Case model = make_case({50'000, options.centres, 20});
  client::GeometryArrays arrays;
  arrays.points = model.mesh.points;
  arrays.face_sizes = model.mesh.face_sizes;
  arrays.face_points = model.mesh.face_points;
  const v1::SystemInfo system = client.prepare(make_setup(model, client.register_geometry(arrays).id()));
  std::mt19937_64 random(1);
  v1::EvaluateHeader header;
  header.set_system_id(system.id());
  header.mutable_output()->set_encoding(v1::RAW_F64);
  *header.mutable_design() = make_design(model, random_maps(model, random));
  stream(client, server, header, 200'000);  // what is allocated once
  const Measured measured = stream(client, server, header, options.points);
  Report report("Evaluate: " + std::to_string(options.points) + " unregistered points from " + std::to_string(system.centres()) +
                " centres");
  const double mib = 1.0 / (1 << 20), millions = static_cast<double>(options.points) * 1e-6;
  report.at_most("streamed, wall time per 10 million points", measured.wall / millions * 10, 30, " s");
  report.at_most("processor time of the server on 2 cores, per 10 million points", measured.server_cpu / 2 / millions * 10, 30,
                 " s");
  report.info("processor time of the server", Report::text(measured.server_cpu) + " s");
  report.info("of which decoding and encoding", Report::text(measured.result.encode_ms() * 1e-3) + " s");
  report.info("processor time of the client", Report::text(measured.client_cpu) + " s");
  report.info("evaluations of the kernel per second of the server's processor time",
              Report::text(static_cast<double>(options.points * system.centres()) / measured.server_cpu));
  report.at_most("growth of the server's memory while they stream", (measured.resident_most - measured.resident_before) * mib, 64,
                 " MiB");
  return report.missed() == 0 ? 0 : 1;
}

}  // namespace
}  // namespace deform::bench

int main(int argc, char** argv) {
  deform::bench::Options options;
  CLI::App app("Evaluate of deformd, measured");
  app.add_option("--deformd", options.deformd, "Server binary");
  app.add_option("--folder", options.folder, "For the data of the server");
  app.add_option("--points", options.points, "Points that are streamed");
  app.add_option("--centres", options.centres, "Centres of the interpolant");
  try {
    app.parse(argc, argv);
    return deform::bench::run(options);
  } catch (const CLI::ParseError& error) {
    return app.exit(error);
  } catch (const std::exception& error) {
    std::cerr << "evaluate_bench: " << error.what() << '\n';
    return 2;
  }
}
