// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/commands/apply.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <chrono>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/mesh_reading.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/apply_report.h"
#include "client/cli/output/cell_options.h"
#include "client/cli/output/compiled_result.h"
#include "client/cli/output/gates.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/compiled_file.h"
#include "client/cli/setup/motions.h"
#include "client/cli/setup/reading.h"

namespace deform::cli {

namespace {

v1::EvaluationPath evaluation_path(const std::string& name) {
  return name == "basis" ? v1::PATH_BASIS : name == "direct" ? v1::PATH_DIRECT : v1::PATH_AUTOMATIC;
}

/// The setup file; empty where an id or a compiled deformation is given.
SetupFile setup_file_of(const PrepareInput& input) {
  if (!std::filesystem::exists(input.setup) || is_compiled_file(input.setup)) return {};
  return read_setup_file(input.setup, own_process());
}

/// Refuses to write over the setup, what it names beside the mesh, and the motions.
void keep_what_is_read(const ApplyOptions& options, const SetupFile& file) {
  std::vector<std::filesystem::path> inputs{options.input.setup};
  inputs.insert(inputs.end(), options.design.motion_files.begin(), options.design.motion_files.end());
  inputs.insert(inputs.end(), file.files.begin(), file.files.end());
  keep_inputs("-o", options.output, inputs);
}

/// Where to write. Throws Error(invalid_argument) when that is the source, unless asked for.
std::filesystem::path checked_output(const ApplyOptions& options) {
  const SetupFile file = setup_file_of(options.input);
  keep_what_is_read(options, file);
  std::filesystem::path source = options.input.source;
  if (source.empty()) source = file.geometry_file.value_or(std::filesystem::path());
  if (source.empty() || !io::mesh_exists(source)) {
    if (options.in_place)
      throw Error(ErrorCode::invalid_argument, "--in-place: no mesh file is named, by the setup or by --source");
    return options.output;
  }
  const auto replaced = options.output.empty() ? std::nullopt : io::replaced_source(source, options.output);
  if (options.in_place) {
    if (!options.output.empty() && !replaced) {
      throw Error(ErrorCode::invalid_argument,
                  "--in-place writes to the source mesh " + source.string() + ", -o names " + options.output + "; leave one out");
    }
    return io::source_file(source);
  }
  try {
    if (!options.output.empty()) io::check_output(source, options.output);
  } catch (const Error& error) {
    throw Error(error.code(), std::string("-o ") + error.what());
  }
  if (replaced) {
    throw Error(ErrorCode::invalid_argument, "-o " + options.output + ": would replace the source mesh " + replaced->string() +
                                                 ", and the next apply would deform it again; name another file, or give "
                                                 "--in-place if you mean it");
  }
  return options.output;
}

bool at_rest(const v1::Design& design) {
  return design.motions_size() == 0 &&
         std::all_of(design.variables().begin(), design.variables().end(), [](double value) { return value == 0; });
}

/// Refuses what only a server does.
void check_compiled_options(const ApplyOptions& options) {
  const auto refuse = [](const char* option, const std::string& what) {
    throw Error(ErrorCode::invalid_argument,
                std::string(option) + ": " + what + "; apply the setup file, which the server evaluates");
  };
  if (!options.design.motion_files.empty()) refuse("--motions", "a compiled deformation has design variables only");
  if (options.path == "direct") refuse("--path", "a compiled deformation has its basis only");
  if (options.cells.split != "off") refuse("--split", "a compiled deformation is evaluated in one step");
  if (options.cells.check == "quality") refuse("--check", "quality is measured by the server, and by deform quality");
  if (options.encoding.solver_tolerance != 0) refuse("--solver-tolerance", "a compiled deformation has none");
  if (options.encoding.encoding != "automatic" || options.encoding.tolerance != 0) {
    refuse("--encoding", "no points travel with a compiled deformation");
  }
}

/// Tells and decides the exit code.
ExitCode finish_apply(const Applied& applied, const CommonOptions& common) {
  if (common.style() == Style::json) {
    print(applied_json(applied));
  } else {
    print_applied(applied, std::cout);
  }
  return complain_about(applied);
}

double seconds_between(std::chrono::steady_clock::time_point from, std::chrono::steady_clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

/// The same without a server.
ExitCode run_compiled_apply(ApplyOptions options, const CommonOptions& common) {
  const auto start = std::chrono::steady_clock::now();
  check_compiled_options(options);
  const std::filesystem::path file = options.input.setup;
  const compiled::Deformation deformation = compiled::Deformation::load(file);
  const compiled::Content& content = deformation.content();
  const v1::Setup setup = compiled_setup(content, file);
  options.input.source = compiled_mesh_path(content, file, options.input.source).string();
  const std::filesystem::path output = checked_output(options);
  std::vector<double> values = parse_settings(options.design.settings, setup);
  values.resize(deformation.variables(), 0.0);
  const auto loaded = std::chrono::steady_clock::now();
  const auto source = io::read_mesh_file(options.input.source, own_process());
  const Mesh& mesh = *source->mesh();
  check_compiled_mesh(content, mesh, options.input.source);
  const auto read = std::chrono::steady_clock::now();
  Points points(mesh.point_count());
  deformation.evaluate(values, std::span(points[0].data(), 3 * points.size()));
  const auto evaluated = std::chrono::steady_clock::now();
  Applied applied;
  applied.file = output.string();
  applied.points = points.size();
  const CompiledCheck check = options.cells.check == "off"              ? CompiledCheck::none
                              : options.cells.looks_for_intersections() ? CompiledCheck::intersections
                                                                        : CompiledCheck::inversions;
  applied.result = compiled_result(deformation, setup, values, mesh, points, check);
  applied.encoding = "none";
  applied.method = setup.method();
  applied.notes = content.notes;
  if (std::all_of(values.begin(), values.end(), [](double value) { return value == 0; }))
    applied.notes.emplace_back(nothing_moves);
  applied.failures = bad_reasons(applied.result);
  applied.written = applied.failures.empty() || options.keep_bad;
  for (const auto& gate : options.gates.failed(applied.result)) applied.failures.push_back(to_text(gate));
  const auto checked = std::chrono::steady_clock::now();
  if (applied.written) io::write_mesh_file(*source, points, output);
  const auto end = std::chrono::steady_clock::now();
  applied.seconds = {{"load", seconds_between(start, loaded)},     {"read", seconds_between(loaded, read)},
                     {"deform", seconds_between(read, evaluated)}, {"check", seconds_between(evaluated, checked)},
                     {"write", seconds_between(checked, end)},     {"total", seconds_between(start, end)}};
  return finish_apply(applied, common);
}

}  // namespace

ExitCode complain_about(const Applied& applied) {
  for (const auto& warning : warnings_of(applied.result)) warn(warning);
  if (applied.failures.empty()) return exit_ok;
  complain(failure_text(applied));
  return exit_verdict;
}

Applied apply_by_server(const ApplyOptions& options, const CommonOptions& common) {
  const auto start = std::chrono::steady_clock::now();
  const std::filesystem::path output = checked_output(options);
  Connection connection(common);
  Progress progress;
  const PreparedSetup prepared = open_setup(connection, options.input, progress);
  const io::MeshFile& source = source_of(prepared);
  v1::DeformRequest request;
  request.set_system_id(prepared.system.id());
  const OutputOptions encoding = options.encoding.named(connection.client(), prepared.system);
  encoding.set(request);
  request.set_path(evaluation_path(options.path));
  options.cells.set(request);
  *request.add_designs() = options.design.design(prepared);
  progress.wait(options.cells.split == "off" ? "deform" : "deform in steps");
  const auto outcome = connection.client().deform(request, connection.call());
  progress.clear();
  const auto& design = outcome.designs.at(0);
  const auto before_write = std::chrono::steady_clock::now();
  Applied applied;
  applied.file = output.string();
  applied.points = design.points.size();
  applied.result = design.result;
  applied.summary = outcome.summary;
  applied.encoding = encoding.encoding;
  applied.method = prepared.system.setup().method();
  for (const auto& note : prepared.system.notes()) {
    if (note.ends_with('?')) applied.notes.push_back(note);  // it asks whether this is what was meant
  }
  if (at_rest(request.designs(0))) applied.notes.emplace_back(nothing_moves);
  applied.failures = bad_reasons(design.result);
  applied.written = applied.failures.empty() || options.keep_bad;
  for (const auto& gate : options.gates.failed(design.result)) applied.failures.push_back(to_text(gate));
  if (applied.written) io::write_mesh_file(source, design.points, output);
  const auto end = std::chrono::steady_clock::now();
  applied.seconds = {{"read", prepared.times.read},
                     {"register", prepared.times.register_geometry},
                     {"prepare", prepared.times.prepare},
                     {"queue", outcome.summary.queue_ms() * 1e-3},
                     {"solve", outcome.summary.solve_ms() * 1e-3},
                     {"encode", outcome.summary.encode_ms() * 1e-3},
                     {"decode", outcome.decode_ms * 1e-3},
                     {"deform", outcome.wall_ms * 1e-3},
                     {"write", seconds_between(before_write, end)},
                     {"total", seconds_between(start, end)}};
  return applied;
}

void add_apply_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<ApplyOptions>();
  auto* command = app.add_subcommand("apply", "Deform once and write the mesh file with its new coordinates");
  command
      ->add_option("SETUP", options->input.setup,
                   "Setup file, the id of a prepared system, or a compiled deformation, which needs no server")
      ->required();
  options->design.add_to(*command);
  auto* target = command->add_option_group("target", "Where the result goes");
  target->add_option(
      "-o,--output", options->output,
      "File to write, in the format of the original: only its coordinates change; .gz is added or left out at will");
  target->add_flag("--in-place", options->in_place, "Overwrite the source mesh, which -o refuses to do");
  target->require_option(1, 2);
  command->add_flag("--keep-bad", options->keep_bad, "Write bad designs, too; the exit code stays 4");
  command->add_option("--source,--mesh", options->input.source,
                      "Mesh file of a setup that names its geometry by id, or of a compiled deformation that is not beside it");
  add_turn_normals(*command, options->input);
  command->add_option("--path", options->path, "How designs are evaluated")
      ->transform(CLI::IsMember({"automatic", "basis", "direct"}, CLI::ignore_case))
      ->capture_default_str();
  options->encoding.add_to(*command);
  options->cells.check = "intersections";
  options->cells.add_to(*command);
  options->gates.add_to(*command);
  command->footer(std::string("Motion files: ") + motion_formats +
                  "\nExit code 4 when the design is bad (then nothing is written without --keep-bad) or --fail-on holds. Bad: "
                  "not finite, not\n"
                  "converged, off by more than 1e-3 of the motion, cells newly inverted, a split that did not arrive, exact "
                  "constraints missed, handles missed by more than half (control MESH), nothing moves.\nSeconds of solve, encode "
                  "and decode are core seconds, the others wall time.\n"
                  "Examples:\n"
                  "  deform apply setup.yaml --set roof_up=0.03 --set slant_turn=0.1 -o out.obj\n"
                  "  deform apply setup.yaml --motions matrices.csv -o out.obj --json\n"
                  "  deform apply car.deformation --set roof_up=0.03 -o out.obj");
  command->callback([options, &common, &chosen] {
    if (options->gates.need_intersections()) options->cells.look_for_intersections();
    chosen = [options, &common] {
      return is_compiled_file(options->input.setup) ? run_compiled_apply(*options, common)
                                                    : finish_apply(apply_by_server(*options, common), common);
    };
  });
}

}  // namespace deform::cli
