#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <chrono>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/cell_options.h"
#include "client/cli/command.h"
#include "client/cli/format.h"
#include "client/cli/motions.h"
#include "client/cli/region_points.h"
#include "client/cli/result_json.h"
#include "client/cli/workspace.h"
#include "client/design.h"

namespace deform::cli {

namespace {

struct ApplyOptions {
  PrepareInput input;
  std::vector<std::string> settings;
  std::vector<std::string> motion_files;
  double match_tolerance = 0;
  std::string output;
  std::string path = "automatic";
  OutputOptions encoding;
  CellOptions cells;
};

v1::Design make_design(const ApplyOptions& options, const PreparedSetup& prepared, const Mesh& mesh) {
  const v1::Setup& setup = prepared.system.setup();
  v1::Design design = client::variables_design(parse_settings(options.settings, setup));
  RestPlaces rest{mesh.points, options.match_tolerance};
  if (rest.tolerance == 0) rest.tolerance = std::max(1e-6 * prepared.system.diagonal(), std::numeric_limits<double>::min());
  for (const auto& file : options.motion_files) {
    const auto motions = read_motions(
        read_csv(file), [&](const std::string& handle) { return handle_points(setup, handle, mesh); }, rest);
    for (const auto& motion : motions) *design.add_motions() = motion;
  }
  return design;
}

v1::EvaluationPath evaluation_path(const std::string& name) {
  return name == "basis" ? v1::PATH_BASIS : name == "direct" ? v1::PATH_DIRECT : v1::PATH_AUTOMATIC;
}

struct Applied {
  std::string file;
  std::size_t points = 0;
  v1::DesignResult result;
  v1::DeformSummary summary;
  std::vector<std::pair<std::string, double>> seconds;
  std::string encoding;
};

nlohmann::ordered_json applied_json(const Applied& applied) {
  nlohmann::ordered_json json;
  json["file"] = applied.file;
  json["points"] = applied.points;
  json["encoding"] = applied.encoding;
  json["max_error"] = applied.result.max_error();
  json["seconds"] = nlohmann::ordered_json::object();
  for (const auto& [stage, seconds] : applied.seconds) json["seconds"][stage] = seconds;
  auto& report = json["report"];
  report["path"] = v1::EvaluationPath_Name(applied.result.path());
  report["interpolation_residual"] = applied.result.interpolation_residual();
  report["max_displacement"] = applied.result.max_displacement();
  report["blocks_fell_back"] = applied.result.blocks_fell_back();
  add_findings(applied.result, report);
  report["bytes"] = applied.summary.bytes();
  report["prepared_again"] = applied.summary.prepared_again();
  report["notes"] = std::vector<std::string>(applied.summary.notes().begin(), applied.summary.notes().end());
  return json;
}

void print_applied(const Applied& applied) {
  std::cout << "wrote " << applied.file << ": " << applied.points << " points, " << bytes_text(applied.summary.bytes())
            << " received as " << applied.encoding << ", encoding error " << number_text(applied.result.max_error())
            << "\n  residual at the centres " << number_text(applied.result.interpolation_residual()) << ", largest displacement "
            << number_text(applied.result.max_displacement()) << "\n ";
  for (const auto& [stage, seconds] : applied.seconds) std::cout << ' ' << stage << ' ' << duration_text(seconds);
  std::cout << '\n';
  print_findings(applied.result, std::cout);
  for (const auto& note : applied.summary.notes()) std::cout << "  note: " << note << '\n';
  std::cout << std::flush;
}

ExitCode run_apply(const ApplyOptions& options, const CommonOptions& common) {
  const auto start = std::chrono::steady_clock::now();
  Connection connection(common);
  Progress progress;
  const PreparedSetup prepared = open_setup(connection, options.input, progress);
  const io::MeshFile& source = source_of(prepared);
  v1::DeformRequest request;
  request.set_system_id(prepared.system.id());
  options.encoding.set(request);
  request.set_path(evaluation_path(options.path));
  options.cells.set(request);
  *request.add_designs() = make_design(options, prepared, *source.mesh());
  const auto outcome = connection.client().deform(request, connection.call());
  const auto& design = outcome.designs.at(0);
  const auto before_write = std::chrono::steady_clock::now();
  io::write_mesh_file(source, design.points, options.output);
  const auto end = std::chrono::steady_clock::now();
  const auto seconds = [](auto from, auto to) { return std::chrono::duration<double>(to - from).count(); };

  Applied applied;
  applied.file = options.output;
  applied.points = design.points.size();
  applied.result = design.result;
  applied.summary = outcome.summary;
  applied.encoding = options.encoding.encoding;
  applied.seconds = {{"read", prepared.times.read},
                     {"register", prepared.times.register_geometry},
                     {"prepare", prepared.times.prepare},
                     {"queue", outcome.summary.queue_ms() * 1e-3},
                     {"solve", outcome.summary.solve_ms() * 1e-3},
                     {"encode", outcome.summary.encode_ms() * 1e-3},
                     {"decode", outcome.decode_ms * 1e-3},
                     {"deform", outcome.wall_ms * 1e-3},
                     {"write", seconds(before_write, end)},
                     {"total", seconds(start, end)}};
  if (common.style() == Style::json) {
    print(applied_json(applied));
  } else {
    print_applied(applied);
  }
  return exit_ok;
}

}  // namespace

void add_apply_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<ApplyOptions>();
  auto* command = app.add_subcommand("apply", "Deform once and write the mesh file with its new coordinates");
  command->add_option("SETUP", options->input.setup, "Setup file, or the id of a prepared system")->required();
  command->add_option("--set", options->settings, "NAME=VALUE of a design variable; may be repeated")->take_all()->expected(1);
  command->add_option("--motions", options->motion_files, "CSV file of handle motions; may be repeated")->take_all()->expected(1);
  command
      ->add_option("--match-tolerance", options->match_tolerance,
                   "How far a place in a motion file may be from its point, model units; 0: 1e-6 of the bounding-box diagonal")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command
      ->add_option("-o,--output", options->output,
                   "File to write, in the format of the original: only its coordinates change; .gz is added or left out at will")
      ->required();
  command->add_option("--source", options->input.source, "Mesh file of a setup that names its geometry by id");
  command->add_option("--path", options->path, "How designs are evaluated")
      ->transform(CLI::IsMember({"automatic", "basis", "direct"}, CLI::ignore_case))
      ->capture_default_str();
  options->encoding.add_to(*command);
  options->cells.add_to(*command);
  command->footer(std::string("Motion files: ") + motion_formats +
                  "\nSeconds of solve, encode and decode are core seconds, the others wall time.\n"
                  "Examples:\n"
                  "  deform apply setup.yaml --set roof_up=0.03 --set slant_turn=0.1 -o out.obj\n"
                  "  deform apply setup.yaml --motions matrices.csv -o out.obj --json");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_apply(*options, common); }; });
}

}  // namespace deform::cli
