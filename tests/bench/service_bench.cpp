// SPDX-License-Identifier: GPL-3.0-or-later
// What a user of the service sees, measured with a deformd process on loopback and clients in this one.
//   service_bench [--quick | --eviction]
// Prints Markdown tables; exit code 1 when a figure misses its limit. Figures need an otherwise idle machine.
#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "client/admin.h"
#include "client/client.h"
#include "tests/bench/bench_case.h"
#include "tests/bench/report.h"
#include "tests/bench/server_process.h"

namespace deform::bench {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

struct Options {
  std::string deformd = DEFORMD_BINARY;
  std::string python = DEFORM_PYTHON;
  std::string scipy_script = SCIPY_SCRIPT;
  std::string folder = (std::filesystem::temp_directory_path() / "service_bench").string();
  CaseSize small{50'000, 2000, 20};
  CaseSize large{465'000, 2000, 20};
  int single_designs = 60;
  int population = 15;
  int load_designs = 400;
  int memory_designs = 10'000;
  bool quick = false;
  bool only_eviction = false;
};

void shrink(Options& options) {
  options.small = {6000, 300, 5};
  options.large = {12'000, 300, 5};
  options.single_designs = 10;
  options.population = 4;
  options.load_designs = 80;
  options.memory_designs = 400;
  options.quick = true;
}

/// A registered and prepared case.
struct Prepared {
  Case model;
  v1::SystemInfo system;
  std::shared_ptr<const Points> points;
};

Prepared prepare(client::Client& client, const CaseSize& size) {
  Prepared out;
  out.model = make_case(size);
  client::GeometryArrays arrays;
  arrays.points = out.model.mesh.points;
  arrays.face_sizes = out.model.mesh.face_sizes;
  arrays.face_points = out.model.mesh.face_points;
  arrays.name = "ahmed";
  const auto geometry = client.register_geometry(arrays);
  out.system = client.prepare(make_setup(out.model, geometry.id()));
  out.points = std::make_shared<const Points>(out.model.mesh.points);
  client.keep_points(geometry.id(), out.points);
  return out;
}

v1::DeformRequest request_for(const Prepared& prepared, v1::Encoding encoding) {
  v1::DeformRequest request;
  request.set_system_id(prepared.system.id());
  request.mutable_output()->set_encoding(encoding);
  request.mutable_output()->set_tolerance(1e-6 * prepared.model.diagonal);
  return request;
}

double percentile(std::vector<double> values, double p) {
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(p * static_cast<double>(values.size())));
  return values.at(std::max<std::size_t>(rank, 1) - 1);
}

// ---- one new design against solving again with SciPy ----

template <typename T>
void write_array(const std::string& file, const std::vector<T>& values) {
  std::ofstream out(file, std::ios::binary);
  out.write(reinterpret_cast<const char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(T)));
  if (!out.flush()) throw std::runtime_error("cannot write " + file);
}

/// Centres and their displacements, as SciPy gets them.
void write_scipy_input(const Prepared& prepared, const std::vector<Affine>& maps, const std::string& folder) {
  Points centres, displacements;
  const auto add = [&](PointId id, const Affine& map) {
    const Vec3& p = prepared.model.mesh.points[id];
    const Vec3 moved = transformed(map, p);
    centres.push_back(p);
    displacements.push_back({moved[0] - p[0], moved[1] - p[1], moved[2] - p[2]});
  };
  for (std::size_t h = 0; h < maps.size(); ++h) {
    for (const PointId id : prepared.model.handles[h].second) add(id, maps[h]);
  }
  for (const PointId id : prepared.model.fixed) add(id, identity_affine);
  write_array(folder + "/points.f64", prepared.model.mesh.points);
  write_array(folder + "/centres.f64", centres);
  write_array(folder + "/displacements.f64", displacements);
}

constexpr std::size_t reference_stride = 7;  // as in the script

Points read_points(const std::string& file, std::size_t count) {
  Points points(count);
  std::ifstream in(file, std::ios::binary);
  const auto bytes = static_cast<std::streamsize>(points.size() * sizeof(Vec3));
  if (!in.read(reinterpret_cast<char*>(points.data()), bytes)) throw std::runtime_error("SciPy left no result in " + file);
  return points;
}

Points every(std::size_t stride, const Points& points) {
  Points some;
  for (std::size_t i = 0; i < points.size(); i += stride) some.push_back(points[i]);
  return some;
}

/// Largest difference relative to the largest displacement.
double relative_difference(const Points& a, const Points& b) {
  double worst = 0, largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      worst = std::max(worst, std::abs(a[i][k] - b[i][k]));
      largest = std::max(largest, std::abs(b[i][k]));
    }
  }
  return worst / largest;
}

constexpr double agreement = 1e-9;

void against_scipy(client::Client& client, const Prepared& prepared, const Options& options, Report& report) {
  std::mt19937_64 random(1);
  std::vector<double> times;
  Points last;
  std::vector<Affine> maps;
  for (int k = 0; k < options.single_designs; ++k) {
    maps = random_maps(prepared.model, random);
    auto request = request_for(prepared, v1::RAW_F64);
    *request.add_designs() = make_design(prepared.model, maps);
    const auto start = Clock::now();
    auto outcome = client.deform(request);
    times.push_back(seconds_since(start));
    last = std::move(outcome.designs.at(0).points);
  }
  write_scipy_input(prepared, maps, options.folder);
  const std::string command = "'" + options.python + "' '" + options.scipy_script + "' '" + options.folder + "'";
  if (std::system(command.c_str()) != 0) throw std::runtime_error("failed: " + command);
  nlohmann::json scipy;
  std::ifstream(options.folder + "/scipy.json") >> scipy;
  const double solve_again = scipy.at("fit_seconds").get<double>() + scipy.at("evaluate_seconds").get<double>();
  const double ours = percentile(times, 0.5);

  const std::string figure = "a new design end to end, n = " + std::to_string(prepared.system.points()) +
                             ", m = " + std::to_string(prepared.system.centres());
  report.info(figure + ", over loopback (median)", Report::text(ours * 1e3) + " ms");
  report.info("the same, fitted and evaluated by SciPy's RBFInterpolator", Report::text(solve_again * 1e3) + " ms");
  report.at_least(figure + ", against SciPy", solve_again / ours, 100, "x");
  for (std::size_t i = 0; i < last.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) last[i][k] -= (*prepared.points)[i][k];
  }
  const Points scipys = read_points(options.folder + "/result.f64", last.size());
  const Points reference = read_points(options.folder + "/reference.f64", every(reference_stride, last).size());
  const double difference = relative_difference(every(reference_stride, last), reference);
  const double scipys_own = relative_difference(every(reference_stride, scipys), reference);
  report.at_most("against the same interpolant in extended precision, relative", difference, agreement, "");
  report.info("SciPy against it", Report::text(scipys_own));
  report.at_most("agreement with SciPy, relative, beyond SciPy's own error", relative_difference(last, scipys) - scipys_own,
                 agreement, "");
  if (!(difference <= agreement)) throw std::runtime_error("the service is not exact");
}

// ---- large populations ----

/// One streamed population.
struct Streamed {
  double wall = 0, cpu = 0;                                 ///< seconds; cpu of both processes
  double solve = 0, encode = 0, transport = 0, decode = 0;  ///< core seconds; transport is what remains of cpu
  double megabytes = 0;
  double ratio(double cores) const { return wall / (cpu / cores); }
};

Streamed stream_population(client::Client& client, const ServerProcess& server, const v1::DeformRequest& request) {
  const double cpu_before = own_cpu_seconds() + server.cpu_seconds();
  const auto start = Clock::now();
  std::atomic<std::size_t> arrived{0};
  const auto outcome = client.deform(request, {}, [&](std::size_t, client::DeformedDesign&& design) {
    const Points taken = std::move(design.points);  // arrays in the client; let go of at once
    arrived += taken.size();
  });
  Streamed out;
  out.wall = seconds_since(start);
  out.cpu = own_cpu_seconds() + server.cpu_seconds() - cpu_before;
  out.solve = outcome.summary.solve_ms() * 1e-3;
  out.encode = outcome.summary.encode_ms() * 1e-3;
  out.decode = outcome.decode_ms * 1e-3;
  out.transport = out.cpu - out.solve - out.encode - out.decode;
  out.megabytes = static_cast<double>(outcome.summary.bytes()) * 1e-6;
  if (arrived == 0) throw std::runtime_error("no points arrived");
  return out;
}

void print_stages(const Streamed& s, const Options& options, double cores) {
  const double designs = options.population;
  std::printf(
      "stages, core ms per design: solve %.2f, encode %.2f, transport and the rest %.2f, decode %.2f, sum %.2f; "
      "wall %.2f ms per design on %.0f cores; %.2f MB per design\n",
      s.solve / designs * 1e3, s.encode / designs * 1e3, s.transport / designs * 1e3, s.decode / designs * 1e3,
      s.cpu / designs * 1e3, s.wall / designs * 1e3, cores, s.megabytes / designs);
}

void large_populations(client::Client& client, const ServerProcess& server, const Prepared& prepared, const Options& options,
                       Report& report) {
  const double cores = std::thread::hardware_concurrency();
  std::vector<std::pair<std::string, Streamed>> stages;
  for (const auto encoding : {v1::RAW_F64, v1::DRACO, v1::DELTA_ZSTD}) {
    std::mt19937_64 random(2);
    auto request = request_for(prepared, encoding);
    for (int k = 0; k < options.population; ++k) {
      *request.add_designs() = make_design(prepared.model, random_maps(prepared.model, random));
    }
    stream_population(client, server, request);  // warms up
    std::vector<Streamed> runs;
    for (int k = 0; k < 3; ++k) runs.push_back(stream_population(client, server, request));
    std::sort(runs.begin(), runs.end(), [](const Streamed& a, const Streamed& b) { return a.wall < b.wall; });
    const Streamed& median = runs[runs.size() / 2];
    report.at_most("population of " + std::to_string(options.population) + ", n = " + std::to_string(prepared.system.points()) +
                       ", " + v1::Encoding_Name(encoding) + ": wall / (sum of stage core seconds / cores)",
                   median.ratio(cores), 1.6, "x");
    stages.emplace_back(v1::Encoding_Name(encoding), median);
  }
  for (const auto& [name, s] : stages) {
    std::printf("\n%s: ", name.c_str());
    print_stages(s, options, cores);
  }
}

// ---- many clients ----

struct Load {
  double designs_per_second = 0;
  double p50_ms = 0, p99_ms = 0;
};

/// `clients` clients, each with its own connection, together ask for `designs` single designs.
Load load(const ServerProcess& server, const Prepared& prepared, int clients, int designs) {
  std::vector<std::unique_ptr<client::Client>> all;
  for (int c = 0; c < clients; ++c) {
    client::ClientOptions options;
    options.address = server.address();
    options.retry_seed = static_cast<std::uint64_t>(c + 1);
    all.push_back(std::make_unique<client::Client>(options));
    all.back()->keep_points(prepared.system.geometry_id(), prepared.points);
    (void)all.back()->server_info();  // connects
  }
  std::atomic<int> taken{0};
  std::mutex mutex;
  std::vector<double> latencies;  // under mutex
  std::exception_ptr failure;     // under mutex
  const auto work = [&](int number) {
    std::mt19937_64 random(static_cast<std::uint64_t>(100 + number));
    std::vector<double> own;
    try {
      while (taken.fetch_add(1) < designs) {
        auto request = request_for(prepared, v1::DRACO);
        *request.add_designs() = make_design(prepared.model, random_maps(prepared.model, random));
        const auto start = Clock::now();
        all[static_cast<std::size_t>(number)]->deform(request);
        own.push_back(seconds_since(start));
      }
    } catch (...) {
      const std::lock_guard lock(mutex);
      failure = std::current_exception();
    }
    const std::lock_guard lock(mutex);
    latencies.insert(latencies.end(), own.begin(), own.end());
  };
  const auto start = Clock::now();
  std::vector<std::thread> threads;
  for (int c = 0; c < clients; ++c) threads.emplace_back(work, c);
  for (auto& thread : threads) thread.join();
  const double wall = seconds_since(start);
  if (failure) std::rethrow_exception(failure);
  return {designs / wall, percentile(latencies, 0.5) * 1e3, percentile(latencies, 0.99) * 1e3};
}

std::string load_text(const Load& l) {
  return Report::text(l.designs_per_second) + " designs/s, p50 " + Report::text(l.p50_ms) + " ms, p99 " + Report::text(l.p99_ms) +
         " ms";
}

void many_clients(const ServerProcess& server, const Prepared& prepared, const Options& options, Report& report) {
  std::vector<double> ratios;
  Load one, eight;
  for (int repeat = 0; repeat < 3; ++repeat) {  // in turns: what disturbs one disturbs the other
    one = load(server, prepared, 1, options.load_designs);
    eight = load(server, prepared, 8, options.load_designs);
    ratios.push_back(eight.designs_per_second / one.designs_per_second);
  }
  const std::string n = "n = " + std::to_string(prepared.system.points()) + ", DRACO";
  report.info("1 client, single designs, " + n, load_text(one));
  report.info("8 clients, single designs, " + n, load_text(eight));
  report.at_least("8 clients against 1, designs per second in total (median of 3)", percentile(ratios, 0.5), 1.0, "x");
}

void flat_memory(const ServerProcess& server, const Prepared& prepared, const Options& options, Report& report) {
  load(server, prepared, 8, options.memory_designs / 10);  // every buffer has been as large as it gets
  const double before = server.resident_bytes();
  load(server, prepared, 8, options.memory_designs);
  const double after = server.resident_bytes();
  report.info("resident set of deformd", Report::text(before * 1e-6) + " MB before, " + Report::text(after * 1e-6) + " MB after");
  report.at_most("growth of it over " + std::to_string(options.memory_designs) + " designs from 8 clients",
                 100 * (after - before) / before, 2, " %");
}

/// The share of what the process grew by for a system that is still resident when the system was evicted. A first system is
/// evicted before that: buffers of libraries, and the mesh, are there from then on.
void memory_after_eviction(client::Client& client, const ServerProcess& server, const Options& options, Report& report) {
  const CaseSize size = options.large;
  client::Admin admin(client);
  const auto settled = [&] {  // the server looks at its memory once a second
    std::this_thread::sleep_for(std::chrono::seconds(options.quick ? 1 : 4));
    return server.resident_bytes();
  };
  const double start = server.resident_bytes();
  prepare(client, size);
  const double first = server.resident_bytes();
  admin.evict_all();
  const double before = settled();
  std::vector<double> shares;
  double taken = 0;
  for (int repeat = 0; repeat < 3; ++repeat) {
    prepare(client, size);
    const double full = server.resident_bytes();
    admin.evict_all();
    taken = full - before;
    shares.push_back((settled() - before) / taken);
  }
  const auto mebi = [](double bytes) { return Report::text(bytes / (1 << 20)); };
  report.info("resident set of deformd: before, with the first system, after its eviction",
              mebi(start) + ", " + mebi(first) + ", " + mebi(before) + " MiB");
  report.info("growth by a prepared system, n = " + std::to_string(size.points), mebi(taken) + " MiB");
  report.at_most("of that, still resident after it was evicted (median of 3)", 100 * percentile(shares, 0.5), 10, " %");
}

int run(const Options& options) {
  std::filesystem::remove_all(options.folder);
  std::filesystem::create_directories(options.folder);
  const ServerProcess server(options.deformd, options.folder);
  client::ClientOptions settings;
  settings.address = server.address();
  client::Client client(settings);

  Report report("The service, " + std::to_string(std::thread::hardware_concurrency()) + " cores");
  if (options.only_eviction) {
    memory_after_eviction(client, server, options, report);
    return report.missed();
  }
  const Prepared small = prepare(client, options.small);
  against_scipy(client, small, options, report);
  many_clients(server, small, options, report);
  flat_memory(server, small, options, report);
  const Prepared large = prepare(client, options.large);
  large_populations(client, server, large, options, report);
  report.open();
  memory_after_eviction(client, server, options, report);
  return options.quick ? 0 : report.missed();
}

}  // namespace
}  // namespace deform::bench

int main(int argc, char** argv) {
  deform::bench::Options options;
  CLI::App app("Measures deformd end to end over loopback");
  app.add_option("--deformd", options.deformd, "Server to measure")->capture_default_str();
  app.add_option("--python", options.python, "Python with SciPy")->capture_default_str();
  app.add_option("--scipy-script", options.scipy_script, "Script that solves with SciPy")->capture_default_str();
  app.add_option("--folder", options.folder, "Folder to work in; emptied first")->capture_default_str();
  bool quick = false;
  app.add_flag("--quick", quick, "Small meshes and few designs: shows that it works, the figures mean nothing");
  app.add_flag("--eviction", options.only_eviction, "Only what is left of the memory of a system that was evicted");
  CLI11_PARSE(app, argc, argv);
  if (quick) shrink(options);
  try {
    return deform::bench::run(options) == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::cerr << "service_bench: " << error.what() << std::endl;
    return 2;
  }
}
