#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "client/cli/cell_options.h"
#include "client/cli/command.h"
#include "client/cli/format.h"
#include "client/cli/result_json.h"
#include "client/cli/sweep_designs.h"
#include "client/cli/sweep_output.h"
#include "client/cli/workspace.h"
#include "client/design.h"

namespace deform::cli {

namespace {

struct SweepOptions {
  PrepareInput input;
  std::string designs;
  std::string output;
  int parallel = 2;
  int batch = 0;
  OutputOptions encoding;
  CellOptions cells;
};

/// The extension of the results is that of the original, .gz included. Results of an OpenFOAM mesh are time folders.
std::string full_extension(const io::MeshFile& source, const std::filesystem::path& path) {
  if (source.format() == io::Format::openfoam) return source.compressed ? "/polyMesh/points.gz" : "/polyMesh/points";
  const std::string last = path.extension().string();
  return last == ".gz" ? path.stem().extension().string() + last : last;
}

/// Several requests in flight: each thread takes the next few designs, and results are written while the rest still arrives.
class Sweep {
 public:
  Sweep(Connection& connection, const PreparedSetup& prepared, const SweepOptions& options)
      : connection_(connection), prepared_(prepared), options_(options), source_(source_of(prepared)) {
    constexpr std::size_t batch_bytes = std::size_t{64} << 20;
    const std::size_t design_bytes = source_.mesh()->point_count() * sizeof(Vec3) + 1;
    batch_ =
        options.batch > 0 ? static_cast<std::size_t>(options.batch) : std::clamp<std::size_t>(batch_bytes / design_bytes, 1, 16);
  }

  struct Result {
    std::size_t written = 0, skipped = 0;
    std::uint64_t bytes_received = 0;
    double max_error = 0;
    std::map<std::string, double> inverted;  // designs with inverted cells, and their safe amplitudes
  };

  Result run(const std::vector<NamedDesign>& designs, Progress& progress) {
    const bool archive = std::filesystem::path(options_.output).extension() == ".tar";
    std::string extension = full_extension(source_, prepared_.source_path);
    if (archive && extension.ends_with(".gz")) extension.resize(extension.size() - 3);
    const SweepIdentity identity{prepared_.system.id(), options_.encoding.encoding, options_.encoding.tolerance, extension,
                                 options_.cells.identity() + options_.encoding.identity()};
    ExpectedResults expected;
    for (const auto& design : designs) expected[design.name] = design_hash(identity, design);
    output_ = open_sweep_output(options_.output, extension, expected);
    for (const auto& design : designs) {
      if (output_->has(design.name, expected[design.name])) {
        ++result_.skipped;
      } else {
        todo_.push_back({&design, expected[design.name]});
      }
    }
    work(progress);
    output_->finish();
    return result_;
  }

 private:
  struct Todo {
    const NamedDesign* design;
    std::string hash;
  };

  void work(Progress& progress) {
    std::vector<std::thread> threads;
    const auto batches = (todo_.size() + batch_ - 1) / batch_;
    const auto count = std::min<std::size_t>(static_cast<std::size_t>(options_.parallel), batches);
    for (std::size_t t = 0; t < count; ++t) {
      threads.emplace_back([this, &progress] {
        try {
          while (next_batch(progress)) {
          }
        } catch (...) {
          const std::lock_guard lock(mutex_);
          if (!error_) error_ = std::current_exception();
          stop_ = true;
        }
      });
    }
    for (auto& thread : threads) thread.join();
    if (error_) std::rethrow_exception(error_);
  }

  bool next_batch(Progress& progress) {
    if (stop_) return false;
    const std::size_t first = next_.fetch_add(batch_);
    if (first >= todo_.size()) return false;
    const std::size_t end = std::min(first + batch_, todo_.size());
    v1::DeformRequest request;
    request.set_system_id(prepared_.system.id());
    options_.encoding.set(request);
    options_.cells.set(request);
    for (std::size_t k = first; k < end; ++k) *request.add_designs() = client::variables_design(todo_[k].design->values);
    const auto outcome =
        connection_.client().deform(request, connection_.call(), [&](std::size_t k, client::DeformedDesign&& design) {
          const Todo& todo = todo_[first + k];
          output_->put(todo.design->name, todo.hash, source_.with_points(design.points));
          const std::lock_guard lock(mutex_);
          ++result_.written;
          result_.max_error = std::max(result_.max_error, design.result.max_error());
          if (has_inverted_cells(design.result)) {
            result_.inverted.emplace(todo.design->name, design.result.cells().safe_amplitude());
          }
          progress.count("sweep", result_.written, todo_.size());
        });
    const std::lock_guard lock(mutex_);
    result_.bytes_received += outcome.summary.bytes();
    return true;
  }

  Connection& connection_;
  const PreparedSetup& prepared_;
  const SweepOptions& options_;
  const io::MeshFile& source_;
  std::size_t batch_ = 1;
  std::unique_ptr<SweepOutput> output_;
  std::vector<Todo> todo_;
  std::atomic<std::size_t> next_{0};
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  // under mutex_
  Result result_;
  std::exception_ptr error_;
};

ExitCode run_sweep(const SweepOptions& options, const CommonOptions& common) {
  Connection connection(common);
  Progress preparing;
  const PreparedSetup prepared = open_setup(connection, options.input, preparing);
  const auto designs = read_designs(read_csv(options.designs), prepared.system.setup());
  const auto start = std::chrono::steady_clock::now();
  Progress progress;
  const auto result = Sweep(connection, prepared, options).run(designs, progress);
  progress.clear();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (common.style() == Style::json) {
    nlohmann::ordered_json json;
    json["output"] = options.output;
    json["designs"] = designs.size();
    json["written"] = result.written;
    json["skipped"] = result.skipped;
    json["seconds"] = seconds;
    json["bytes_received"] = result.bytes_received;
    json["max_error"] = result.max_error;
    json["inverted"] = result.inverted;
    print(json);
    return exit_ok;
  }
  std::cout << "wrote " << result.written << " of " << designs.size() << " designs to " << options.output << " in "
            << duration_text(seconds) << (result.skipped > 0 ? ", " + std::to_string(result.skipped) + " were there already" : "")
            << std::endl;
  for (const auto& [name, amplitude] : result.inverted) {
    std::cout << "  " << name << " has inverted cells; none before " << number_text(amplitude) << " of the motion\n";
  }
  return exit_ok;
}

}  // namespace

void add_sweep_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<SweepOptions>();
  auto* command = app.add_subcommand("sweep", "Deform for every line of a table of designs");
  command->add_option("SETUP", options->input.setup, "Setup file, or the id of a prepared system")->required();
  command->add_option("--designs", options->designs, "CSV file: header with names of design variables, a design per line")
      ->required();
  command->add_option("-o,--output", options->output, "Folder for one file per design, or an archive when it ends in .tar")
      ->required();
  command->add_option("--source", options->input.source, "Mesh file of a setup that names its geometry by id");
  command->add_option("--parallel", options->parallel, "Requests in flight")->check(CLI::Range(1, 64))->capture_default_str();
  command->add_option("--batch", options->batch, "Designs per request; 0: as many as fit into 64 MiB, at most 16")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  options->encoding.add_to(*command);
  options->cells.add_to(*command);
  command->footer(
      "A column \"name\" names the results, else they are design_0001, ...; variables without a column stay 0.\n"
      "Resumable: run the same command again after an interruption and only what is missing is computed. What is finished is\n"
      "recorded in FOLDER/sweep.manifest or ARCHIVE.manifest with a hash of system, encoding and values; changed designs are\n"
      "computed again. A file has its name only when it is complete; an archive is ARCHIVE.part until then.\n"
      "Example: deform sweep setup.yaml --designs designs.csv -o results/");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_sweep(*options, common); }; });
}

}  // namespace deform::cli
