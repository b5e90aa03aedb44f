// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <chrono>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/given_design.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/apply_report.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/compiled_file.h"
#include "client/cli/setup/point_table.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

struct EvaluateOptions {
  PrepareInput input;
  std::string points;
  GivenDesign design;
  std::string output;
  OutputOptions encoding;
  bool keep_bad = false;
};

/// The points of a file, where they go, and the file that they are written to when all is well.
class PointFile {
 public:
  virtual ~PointFile() = default;
  virtual std::size_t read(std::span<Vec3> points) = 0;
  virtual void write(std::uint64_t first, std::span<const Vec3> points) = 0;
  virtual void commit() = 0;
};

/// A table, of which a few lines are in memory.
class TableFile : public PointFile {
 public:
  TableFile(const std::string& input, const std::string& output) : lines_(input, output) {}
  std::size_t read(std::span<Vec3> points) override { return lines_.read(points); }
  void write(std::uint64_t, std::span<const Vec3> points) override { lines_.write(points); }
  void commit() override { lines_.commit(); }

 private:
  PointTable lines_;
};

/// A mesh file, of which only the coordinates change.
class OtherMesh : public PointFile {
 public:
  OtherMesh(const std::string& input, std::string output)
      : source_(io::read_mesh_file(input, own_process())), output_(std::move(output)), moved_(source_->mesh()->points.size()) {
    io::check_output(input, output_);
  }
  std::size_t read(std::span<Vec3> points) override {
    const auto& all = source_->mesh()->points;
    const std::size_t count = std::min(points.size(), all.size() - read_);
    std::copy_n(all.begin() + static_cast<std::ptrdiff_t>(read_), count, points.begin());
    read_ += count;
    return count;
  }
  void write(std::uint64_t first, std::span<const Vec3> points) override {
    std::copy(points.begin(), points.end(), moved_.begin() + static_cast<std::ptrdiff_t>(first));
  }
  void commit() override { io::write_mesh_file(*source_, moved_, output_); }

 private:
  const std::shared_ptr<const io::MeshFile> source_;
  const std::string output_;
  Points moved_;
  std::size_t read_ = 0;  ///< by the thread that asks for points
};

std::unique_ptr<PointFile> point_file(const EvaluateOptions& options) {
  if (PointTable::is_table(options.points)) return std::make_unique<TableFile>(options.points, options.output);
  return std::make_unique<OtherMesh>(options.points, options.output);
}

nlohmann::ordered_json evaluated_json(const v1::EvaluateResult& result, const std::string& file, bool written, double seconds) {
  nlohmann::ordered_json json;
  json["file"] = file;
  json["written"] = written;
  json["points"] = result.points();
  json["max_displacement"] = result.max_displacement();
  json["still"] = result.still();
  json["estimated_error"] = result.estimated_error();
  json["sums_error"] = result.sums_error();
  json["max_error"] = result.max_error();
  json["interpolation_residual"] = result.interpolation_residual();
  json["reduction_error"] = result.reduction_error();
  json["converged"] = result.converged();
  json["doubts"] = std::vector<std::string>(result.doubts().begin(), result.doubts().end());
  json["warnings"] = std::vector<std::string>(result.warnings().begin(), result.warnings().end());
  json["seconds"] = {{"queue", result.queue_ms() * 1e-3},
                     {"bind", result.bind_ms() * 1e-3},
                     {"solve", result.solve_ms() * 1e-3},
                     {"encode", result.encode_ms() * 1e-3},
                     {"total", seconds}};
  return json;
}

void print_evaluated(const v1::EvaluateResult& result, const std::string& file, bool written, double seconds) {
  std::cout << (written ? "wrote " : "did not write ") << printable(file) << ": " << result.points()
            << " points, which move by up to " << number_text(result.max_displacement()) << "\n  estimated error "
            << number_text(result.estimated_error()) << " where the mesh of the setup has points";
  if (result.sums_error() > 0) std::cout << ", and " << number_text(result.sums_error()) << " of the sums at these points";
  std::cout << "; encoding " << number_text(result.max_error()) << '\n';
  print_reduction_error(result.reduction_error(), std::cout);
  for (const auto& doubt : result.doubts()) std::cout << "  doubtful: " << printable(doubt) << '\n';
  if (result.still() > 0) {
    std::cout << "  " << result.still() << " points lie outside of the lattice and stay where they are\n";
  }
  std::cout << "  " << duration_text(seconds) << ", of which solve " << duration_text(result.solve_ms() * 1e-3)
            << " of processor time" << std::endl;
}

ExitCode run_evaluate(const EvaluateOptions& options, const CommonOptions& common) {
  if (is_compiled_file(options.input.setup)) {
    throw Error(ErrorCode::invalid_argument,
                options.input.setup +
                    ": a compiled deformation knows the points of its mesh only; give the setup file, "
                    "which the server evaluates");
  }
  const auto start = std::chrono::steady_clock::now();
  std::vector<std::filesystem::path> inputs{options.input.setup, options.input.source, options.points};
  inputs.insert(inputs.end(), options.design.motion_files.begin(), options.design.motion_files.end());
  keep_inputs("-o", options.output, inputs);
  if (PointTable::is_table(options.points)) check_folder("-o", options.output);  // a mesh may be a case, whose folders are made
  Connection connection(common);
  Progress progress;
  const PreparedSetup prepared = open_setup(connection, options.input, progress);
  keep_inputs("-o", options.output, {prepared.source_path});
  const std::unique_ptr<PointFile> file = point_file(options);
  v1::DeformRequest named;
  options.encoding.named(connection.client(), prepared.system).set(named);
  v1::EvaluateHeader header;
  header.set_system_id(prepared.system.id());
  *header.mutable_output() = named.output();
  header.set_solver_tolerance(named.solver_tolerance());
  *header.mutable_design() = options.design.design(prepared);
  const v1::EvaluateResult result = connection.client().evaluate(
      header, [&](std::span<Vec3> points) { return file->read(points); },
      [&](std::uint64_t first, std::span<const Vec3> points) { file->write(first, points); }, connection.call());
  const bool written = result.converged() || options.keep_bad;
  if (written) file->commit();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (common.style() == Style::json) {
    print(evaluated_json(result, options.output, written, seconds));
  } else {
    print_evaluated(result, options.output, written, seconds);
  }
  for (const auto& warning : result.warnings()) warn(warning);
  if (result.converged()) return exit_ok;
  complain("the design is bad: the solver did not reach its tolerance" +
           std::string(written ? "" : "; nothing was written, --keep-bad writes it"));
  return exit_verdict;
}

}  // namespace

void add_evaluate_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<EvaluateOptions>();
  auto* command =
      app.add_subcommand("evaluate", "Move other points, of a table or another mesh, as a design of a setup moves space");
  command->add_option("SETUP", options->input.setup, "Setup file, or the id of a prepared system")->required();
  command->add_option("POINTS", options->points, "Table (.csv, .xyz, .txt) or mesh file of the points to move")->required();
  options->design.add_to(*command);
  command->add_option("-o,--output", options->output, "File to write, in the format of POINTS: only coordinates change")
      ->required();
  command->add_flag("--keep-bad", options->keep_bad,
                    "Write the points of a design that did not converge, too; the exit code stays 4");
  command->add_option("--source,--mesh", options->input.source, "Mesh file of a setup that names its geometry by id");
  add_turn_normals(*command, options->input);
  options->encoding.add_to(*command);
  command->footer(
      "The points need not belong to the mesh of the setup: a second mesh, an overset grid, probes, particles. rbf, mls, ffd, "
      "cage "
      "and subspace\n"
      "(with moving least squares or a kernel that decays) are defined off the mesh; shell is not, and the command says so. "
      "Points "
      "outside of a lattice\n"
      "stay; GREEN coordinates end at the cage. At the coordinates of a point of the mesh the result is that of `deform apply "
      "--path "
      "direct`.\n"
      "Tables: .csv with a header that has the columns x, y and z; .xyz and .txt with three numbers per line, separated by "
      "blanks or "
      "commas. Other columns,\n"
      "comments (#) and blank lines are kept. Tables of any length take a few MiB of memory.\n"
      "Examples:\n"
      "  deform evaluate setup.yaml probes.csv --set roof_up=0.03 -o moved.csv\n"
      "  deform evaluate setup.yaml overset.cgns --set roof_up=0.03 -o overset_moved.cgns");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_evaluate(*options, common); }; });
}

}  // namespace deform::cli
