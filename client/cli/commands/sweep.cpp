// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "client/cli/commands/command.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/apply_report.h"
#include "client/cli/output/cell_options.h"
#include "client/cli/output/error_json.h"
#include "client/cli/output/format.h"
#include "client/cli/output/gates.h"
#include "client/cli/output/result_json.h"
#include "client/cli/sweep/sweep_designs.h"
#include "client/cli/sweep/sweep_output.h"
#include "client/design.h"

namespace deform::cli {

namespace {

struct SweepOptions {
  PrepareInput input;
  std::string designs;
  std::string output;
  int parallel = 2;
  int batch = 0;
  double patience = 30;  ///< seconds
  bool keep_going = true;
  bool keep_bad = false;
  OutputOptions encoding;
  CellOptions cells;
  DesignGates gates;
};

/// The extension of the results is that of the original, .gz included. Results of an OpenFOAM mesh are time folders, with the
/// name of the points that io::write_mesh_file() gives them.
std::string full_extension(const io::MeshFile& source, const std::filesystem::path& path) {
  if (source.format() == io::Format::openfoam) return openfoam_result;
  const std::string last = path.extension().string();
  return last == ".gz" ? path.stem().extension().string() + last : last;
}

/// The summary at the end.
struct SweepReport {
  std::size_t designs = 0, written = 0, skipped = 0;
  std::uint64_t bytes_received = 0;
  double max_error = 0;
  double seconds = 0;
  std::map<std::string, std::string> failed;                 ///< designs without a result, and why
  std::map<std::string, std::string> discarded;              ///< bad ones that were not written
  std::map<std::string, std::vector<std::string>> bad;       ///< why
  std::map<std::string, std::vector<std::string>> doubtful;  ///< and of bad ones, what would have made them so
  std::map<std::string, std::vector<std::string>> gate;      ///< gates that failed
  std::map<std::string, std::vector<std::string>> warnings;
  /// The largest error of the results whose errors are known, relative to the motion, and whose it is; empty if none is.
  struct WorstError {
    std::string name;
    double estimated_error = 0, relative_error = 0;
  } worst;
  std::map<std::string, double> inverted;  ///< designs with inverted cells, and their safe amplitudes
  std::map<std::string, double> partial;   ///< written ones whose split did not arrive, and how much of the motion they made

  ExitCode exit_code() const {
    if (!failed.empty()) return exit_failed;
    return discarded.empty() && bad.empty() && gate.empty() ? exit_ok : exit_verdict;
  }
  void add(const std::string& name, const ResultVerdicts& verdicts) {
    if (!verdicts.reasons.empty()) bad.emplace(name, verdicts.reasons);
    if (!verdicts.doubts.empty()) doubtful.emplace(name, verdicts.doubts);
    if (!verdicts.warnings.empty()) warnings.emplace(name, verdicts.warnings);
    if (verdicts.safe_amplitude) inverted.emplace(name, *verdicts.safe_amplitude);
    const bool known = verdicts.estimated_error && verdicts.relative_error;
    if (known && (worst.name.empty() || !(*verdicts.relative_error <= worst.relative_error))) {
      worst = {name, *verdicts.estimated_error, *verdicts.relative_error};
    }
    if (verdicts.reached) partial.emplace(name, *verdicts.reached);
    for (const auto& [text, failure] : verdicts.gates) {
      if (!failure.empty()) gate[name].push_back(failure);
    }
  }
};

ResultVerdicts verdicts_of(const v1::DesignResult& result, const DesignGates& gates) {
  ResultVerdicts verdicts;
  verdicts.reasons = bad_reasons(result);
  verdicts.doubts = doubts(result);
  verdicts.warnings = warnings_of(result);
  if (has_inverted_cells(result)) verdicts.safe_amplitude = result.cells().safe_amplitude();
  verdicts.reached = fraction_reached(result);
  if (std::isfinite(result.estimated_error()) && std::isfinite(result.relative_error())) {
    verdicts.estimated_error = result.estimated_error();
    verdicts.relative_error = result.relative_error();
  }
  for (const Gate& gate : gates.gates()) verdicts.gates[gate.text];
  for (const FailedGate& failed : gates.failed(result)) verdicts.gates[failed.text] = to_text(failed);
  return verdicts;
}

/// Several requests in flight: each thread takes the next few designs, and results are written while the rest still arrives.
class Sweep {
 public:
  Sweep(Connection& connection, const PreparedSetup& prepared, const SweepOptions& options)
      : connection_(connection),
        prepared_(prepared),
        options_(options),
        encoding_(options.encoding.named(connection.client(), prepared.system)),
        source_(source_of(prepared)) {
    constexpr std::size_t batch_bytes = std::size_t{64} << 20;
    const std::size_t design_bytes = source_.mesh()->point_count() * sizeof(Vec3) + 1;
    if (options.batch > 0) {
      batch_ = static_cast<std::size_t>(options.batch);
      return;
    }
    const std::uint64_t limit = connection.client().server_info().limits().max_designs();  // 0: of a server that does not say
    batch_ = std::clamp<std::size_t>(batch_bytes / design_bytes, 1, limit == 0 ? 16 : std::min<std::size_t>(16, limit));
  }

  SweepReport run(const DesignTable& table, Progress& progress) {
    open_output(table);
    report_.designs = table.designs.size() + table.bad.size();
    for (const auto& bad : table.bad) {
      output_->fail(bad.name, {bad.reason});
      report_.failed.emplace(bad.name, bad.reason);
    }
    work(progress);
    output_->finish();
    return report_;
  }

 private:
  struct Todo {
    const NamedDesign* design;
    ExpectedResult result;
  };

  void open_output(const DesignTable& table) {
    const bool archive = std::filesystem::path(options_.output).extension() == ".tar";
    std::string extension = full_extension(source_, prepared_.source_path);
    if (archive && extension.ends_with(".gz")) extension.resize(extension.size() - 3);
    const std::string normals = options_.input.turn_normals ? " turned normals" : "";
    const SweepIdentity identity{prepared_.system.id(), encoding_.encoding, encoding_.tolerance, extension + normals,
                                 options_.cells.identity() + encoding_.identity()};
    std::vector<ExpectedResult> expected;
    for (const auto& design : table.designs) expected.push_back({design.name, design_hash(identity, design)});
    output_ = open_sweep_output(options_.output, extension, expected);
    for (std::size_t k = 0; k < expected.size(); ++k) {
      const auto found = output_->find(expected[k]);
      if (found && knows_gates(*found)) {
        ++report_.skipped;
        report_.add(expected[k].name, asked_for(*found));
        continue;
      }
      const auto failure = options_.keep_bad ? std::nullopt : output_->find_failure(expected[k]);
      if (failure && knows_gates(failure->verdicts)) {
        ++report_.skipped;
        report_.discarded.emplace(expected[k].name, failure->reason);
        report_.add(expected[k].name, asked_for(failure->verdicts));
      } else {
        todo_.push_back({&table.designs[k], expected[k]});
      }
    }
  }

  /// What an earlier run found out is enough for this one.
  bool knows_gates(const ResultVerdicts& verdicts) const {
    const auto& gates = options_.gates.gates();
    return std::all_of(gates.begin(), gates.end(), [&](const Gate& gate) { return verdicts.gates.contains(gate.text); });
  }

  /// Without gates that only the earlier run had.
  ResultVerdicts asked_for(ResultVerdicts verdicts) const {
    const auto& gates = options_.gates.gates();
    std::erase_if(verdicts.gates, [&](const auto& item) {
      return std::none_of(gates.begin(), gates.end(), [&](const Gate& gate) { return gate.text == item.first; });
    });
    return verdicts;
  }

  void work(Progress& progress) {
    progress.count("sweep", report_.skipped, report_.skipped + todo_.size());
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
    if (error_) rethrow_with_progress();
  }

  /// What ended the sweep, and that nothing finished is lost.
  [[noreturn]] void rethrow_with_progress() const {
    try {
      std::rethrow_exception(error_);
    } catch (const Error& error) {
      const std::size_t done = report_.skipped + done_;
      if (done == 0) throw;
      client::throw_reworded(error, std::string(error.what()) + "; " + std::to_string(done) + " of " +
                                        std::to_string(report_.designs) + " designs are done: run it again for the rest");
    }
  }

  bool next_batch(Progress& progress) {
    if (stop_) return false;
    const std::size_t first = next_.fetch_add(batch_);
    if (first >= todo_.size()) return false;
    const std::size_t end = std::min(first + batch_, todo_.size());
    v1::DeformRequest request;
    request.set_system_id(prepared_.system.id());
    request.set_failures(v1::FAILURES_PER_DESIGN);
    encoding_.set(request);
    options_.cells.set(request);
    for (std::size_t k = first; k < end; ++k) *request.add_designs() = client::variables_design(todo_[k].design->values);
    const auto outcome =
        connection_.client().deform(request, connection_.call(), [&](std::size_t k, client::DeformedDesign&& design) {
          take(todo_[first + k], design);
          const std::lock_guard lock(mutex_);
          progress.count("sweep", report_.skipped + ++done_, report_.skipped + todo_.size());
        });
    const std::lock_guard lock(mutex_);
    report_.bytes_received += outcome.summary.bytes();
    return true;
  }

  void take(const Todo& todo, const client::DeformedDesign& design) {
    if (design.error) return fail(todo, *design.error);
    const std::string& name = todo.result.name;
    const ResultVerdicts verdicts = verdicts_of(design.result, options_.gates);
    if (!verdicts.reasons.empty() && !options_.keep_bad) {
      const std::string reason = todo.design->where + verdicts.reasons.front() + "; not written without --keep-bad";
      output_->fail(name, {reason, todo.result.hash, verdicts});
      const std::lock_guard lock(mutex_);
      report_.discarded.emplace(name, reason);
      report_.add(name, verdicts);
      return;
    }
    std::string bytes;
    try {
      bytes = source_.with_points(design.points);
    } catch (const Error& error) {
      return fail(todo, error);  // points that this kind of file cannot hold
    }
    output_->put(todo.result, verdicts, bytes);
    const std::lock_guard lock(mutex_);
    ++report_.written;
    report_.max_error = std::max(report_.max_error, design.result.max_error());
    report_.add(name, verdicts);
  }

  void fail(const Todo& todo, const Error& error) {
    const std::string reason = todo.design->where + error.what();
    output_->fail(todo.result.name, {reason});
    if (!options_.keep_going) client::throw_reworded(error, reason);
    const std::lock_guard lock(mutex_);
    report_.failed.emplace(todo.result.name, reason);
  }

  Connection& connection_;
  const PreparedSetup& prepared_;
  const SweepOptions& options_;
  const OutputOptions encoding_;  // named
  const io::MeshFile& source_;
  std::size_t batch_ = 1;
  std::unique_ptr<SweepOutput> output_;
  std::vector<Todo> todo_;
  std::atomic<std::size_t> next_{0};
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  // under mutex_
  SweepReport report_;
  std::size_t done_ = 0;
  std::exception_ptr error_;
};

/// One line that says why the exit code is not 0; empty when it is.
std::string complaint(const SweepReport& report) {
  const std::string of = " of " + std::to_string(report.designs) + " designs ";
  if (!report.failed.empty()) {
    return std::to_string(report.failed.size()) + of + "failed, for example: " + report.failed.begin()->second;
  }
  if (!report.discarded.empty()) {
    return std::to_string(report.discarded.size()) + of + "were not written, for example: " + report.discarded.begin()->second;
  }
  std::map<std::string, std::vector<std::string>> all = report.bad;
  for (const auto& [name, failures] : report.gate) all[name].insert(all[name].end(), failures.begin(), failures.end());
  if (all.empty()) return {};
  return std::to_string(all.size()) + of + "are bad, for example: " + all.begin()->first + ": " + all.begin()->second.front();
}

void print_json(const SweepReport& report, const std::string& output) {
  nlohmann::ordered_json json;
  json["output"] = output;
  json["designs"] = report.designs;
  json["written"] = report.written;
  json["skipped"] = report.skipped;
  json["seconds"] = report.seconds;
  json["bytes_received"] = report.bytes_received;
  json["max_error"] = report.max_error;
  if (!report.worst.name.empty()) {
    json["largest_error"] = {{"name", report.worst.name},
                             {"estimated_error", report.worst.estimated_error},
                             {"relative_error", report.worst.relative_error}};
  }
  json["inverted"] = report.inverted;
  json["partial"] = report.partial;
  std::map<std::string, std::string> failed = report.failed;
  failed.insert(report.discarded.begin(), report.discarded.end());
  json["failed"] = failed;
  json["bad"] = report.bad;
  json["doubtful"] = report.doubtful;
  json["gate"] = report.gate;
  json["warnings"] = report.warnings;
  const std::string text = complaint(report);
  if (!report.failed.empty()) {
    json["error"] = error_json(ErrorCode::invalid_argument, text);
  } else if (!text.empty()) {
    json["error"] = verdict_error_json(text);
  }
  print(json);
}

void print_text(const SweepReport& report, const std::string& output) {
  std::cout << "wrote " << report.written << " of " << report.designs << " designs to " << output << " in "
            << duration_text(report.seconds)
            << (report.skipped > 0 ? ", " + std::to_string(report.skipped) + " were there already" : "")
            << (report.partial.empty() ? "" : "; " + std::to_string(report.partial.size()) + " made only a part of their motion")
            << '\n';
  if (!report.worst.name.empty()) {
    std::cout << "  largest estimated error " << number_text(report.worst.estimated_error) << " ("
              << number_text(report.worst.relative_error) << " of the largest displacement), of " << report.worst.name << '\n';
  }
  for (const auto& [name, reasons] : report.bad) {
    for (const auto& reason : reasons) std::cout << "  " << name << " bad: " << reason << '\n';
  }
  for (const auto& [name, reasons] : report.doubtful) {
    for (const auto& reason : reasons) std::cout << "  " << name << " doubtful: " << reason << '\n';
  }
  for (const auto& [name, failures] : report.gate) {
    for (const auto& failure : failures) std::cout << "  " << name << ": " << failure << '\n';
  }
  for (const auto& [name, warnings] : report.warnings) {
    for (const auto& warning : warnings) std::cout << "  " << name << " WARNING: " << warning << '\n';
  }
  for (const auto* without : {&report.discarded, &report.failed}) {
    for (const auto& [name, reason] : *without) std::cout << "  " << name << " FAILED: " << reason << '\n';
  }
  std::cout << std::flush;
}

/// Refuses results of an OpenFOAM mesh that would not be found again, or that would be its own mesh, before anything is computed.
void check_results(const SweepOptions& options, const DesignTable& table, const std::filesystem::path& source) {
  const std::filesystem::path folder = options.output;
  if (folder.extension() == ".tar" || source.empty() || !io::mesh_exists(source)) return;
  for (const NamedDesign& design : table.designs) {
    const std::filesystem::path result = folder / design.name;
    const std::string hint = "; results of a sweep are FOLDER/NAME, so -o may be any folder that is in no OpenFOAM case";
    try {
      io::check_output(source, result);
    } catch (const Error& error) {
      throw Error(error.code(), std::string("-o ") + error.what() + hint);
    }
    if (const auto replaced = io::replaced_source(source, result)) {
      throw Error(ErrorCode::invalid_argument,
                  "-o " + result.string() + ": would replace the source mesh " + replaced->string() + hint);
    }
  }
}

/// The rows of the table, all of them looked at before anything is computed.
DesignTable checked_designs(const SweepOptions& options, const v1::Setup& setup) {
  DesignTable table = read_designs(read_csv(options.designs, BadRows::keep), setup);
  if (options.keep_going || table.bad.empty()) return table;
  const std::string more = std::to_string(table.bad.size() - 1) + " more bad rows";
  throw Error(ErrorCode::invalid_argument,
              table.bad.front().reason + (table.bad.size() > 1 ? "; and " + more : "") + "; nothing was computed");
}

ExitCode run_sweep(const SweepOptions& options, const CommonOptions& common) {
  {
    // A server that is not there at all is reported at once.
    Connection first(common);
    first.client().server_info(first.call());
  }
  Connection connection(common, std::chrono::duration<double>(options.patience));
  Progress preparing;
  LoadedSetup loaded = load_setup(connection, options.input, preparing);
  const DesignTable table = checked_designs(options, loaded.setup);
  const PreparedSetup prepared = prepare_loaded(connection, std::move(loaded), preparing, client::SetupInInfo::omit);
  if (prepared.source && prepared.source->case_parts() > 0) {
    throw Error(ErrorCode::invalid_argument,
                prepared.source_path.string() + ": a result of a sweep is one file, and each of the " +
                    std::to_string(prepared.source->case_parts()) +
                    " parts of this decomposed OpenFOAM case has its own points; run deform apply for every design, or sweep "
                    "the case before it is decomposed");
  }
  check_results(options, table, prepared.source_path);
  const auto start = std::chrono::steady_clock::now();
  Progress progress;
  SweepReport report = Sweep(connection, prepared, options).run(table, progress);
  progress.clear();
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (common.style() == Style::json) {
    print_json(report, options.output);
  } else {
    print_text(report, options.output);
  }
  if (const std::string text = complaint(report); !text.empty()) complain(text);
  return report.exit_code();
}

constexpr char sweep_footer[] =
    R"(A column "name" names the results, else they are design_0001, ...; variables without a column stay 0. Columns are separated by
commas, or by semicolons where the header has no comma; decimals have a point.
Resumable: run the same command again after an interruption and only what is missing is computed. What is finished is
recorded in FOLDER/sweep.manifest or ARCHIVE.manifest with a hash of system, encoding and values; designs whose row has
changed are computed again, the others are kept. A bad design is not written without --keep-bad, recorded with its reasons
(when its split did not arrive, as final with the fraction of its motion that it reached) and not computed again. A file has
its name only when it is complete; an archive is ARCHIVE.part until then, and one that is there is replaced only by a complete one. Files that are not of a sweep are never overwritten.
All rows are looked at before anything is computed. A bad row, and a design that cannot be computed, is named with its file
and line, recorded in the manifest and tried again by the next run; the others go on. Exit code 1 when there are any; else 4
when a design is bad (see `deform apply --help`) or a gate of --fail-on fails, also of designs that were there already; one whose gate an earlier run did not look at is computed again.
Example: deform sweep setup.yaml --designs designs.csv -o results/ --fail-on "flipped_faces>0")";

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
  add_turn_normals(*command, options->input);
  command->add_option("--parallel", options->parallel, "Requests in flight")->check(CLI::Range(1, 64))->capture_default_str();
  command
      ->add_option("--patience", options->patience,
                   "Seconds, about, for which a server that went away is waited for, as while it restarts")
      ->check(CLI::Range(0, 600))
      ->capture_default_str();
  command
      ->add_option("--batch", options->batch,
                   "Designs per request; 0: as many as fit into 64 MiB, at most 16 and what the server takes")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  command->add_flag("--keep-going,!--no-keep-going", options->keep_going,
                    "Go on with the other designs when one fails (default); --no-keep-going ends at the first");
  command->add_flag("--keep-bad", options->keep_bad, "Write bad designs, too; the exit code stays 4");
  options->gates.add_to(*command);
  options->encoding.add_to(*command);
  options->cells.add_to(*command);
  command->footer(sweep_footer);
  command->callback([options, &common, &chosen] {
    if (options->gates.need_intersections()) options->cells.look_for_intersections();
    chosen = [options, &common] { return run_sweep(*options, common); };
  });
}

}  // namespace deform::cli
