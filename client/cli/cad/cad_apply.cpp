// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <chrono>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/cad/program_with_cad.h"
#include "client/cli/cad/space_deformation.h"
#include "client/cli/commands/command.h"
#include "client/cli/commands/given_design.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/motions.h"
#include "core/base/text.h"
#include "core/cad/cad_apply.h"

namespace deform::cli {

namespace {

struct CadApplyCommand {
  PrepareInput input;
  std::vector<std::string> settings;
  bool crossings = false;
  cad::ApplyRequest request;
};

/// The model, and how it agrees with the mesh.
struct AppliedCad {
  cad::DeformedModel model;
  double mesh_difference = 0, tolerance = 0, seconds = 0;  ///< lengths in the unit of the mesh
  std::vector<std::string> failures;
};

using Became = cad::DeformedFace::Became;

const char* became_text(Became became) {
  switch (became) {
    case Became::kept:
      return "kept";
    case Became::moved:
      return "moved";
    case Became::reshaped:
      return "reshaped";
    default:
      return "fitted";
  }
}

std::string in_diagonals(double length, double diagonal) { return number_text(length / diagonal) + " D"; }

std::string held_text(const cad::DeformedModel& model) {
  std::size_t held = 0;
  for (const cad::DeformedFace& face : model.faces) held += face.held ? 1 : 0;
  if (held == 0) return "no face is held by the nodes on it";
  return std::to_string(held) + (held == 1 ? " face goes" : " faces go") + " as the nodes on " + (held == 1 ? "it" : "them") +
         " do; between these the deformation differs by up to " + in_diagonals(model.overlooked, model.diagonal);
}

void print_applied_cad(const AppliedCad& applied, const CadApplyCommand& options) {
  const cad::DeformedModel& model = applied.model;
  for (const std::string& note : model.notes) std::cout << printable(note) << '\n';
  std::cout << "wrote " << printable(options.request.output.string()) << ": " << model.faces.size() << " faces, "
            << model.count(Became::kept) << " kept, " << model.count(Became::moved) << " moved rigidly, "
            << model.count(Became::reshaped) << " reshaped with their type, " << model.count(Became::fitted) << " fitted\n"
            << "  error " << in_diagonals(model.error, model.diagonal) << " largest, " << in_diagonals(model.rms, model.diagonal)
            << " rms at " << model.checks << " random points; edges up to " << in_diagonals(model.gap, model.diagonal)
            << " from their faces\n"
            << "  " << held_text(model) << '\n'
            << "  mesh and CAD model follow the same deformation up to "
            << in_diagonals(applied.mesh_difference, model.diagonal * options.request.scale) << '\n'
            << "  " << model.samples + model.checks * 2 << " points in " << model.rounds << " rounds, "
            << duration_text(applied.seconds) << '\n';
  for (const std::string& failure : applied.failures) std::cout << "  " << printable(failure) << '\n';
  std::cout.flush();
}

nlohmann::ordered_json applied_cad_json(const AppliedCad& applied, const CadApplyCommand& options) {
  const cad::DeformedModel& model = applied.model;
  nlohmann::ordered_json json;
  json["file"] = options.request.output.string();
  json["diagonal"] = model.diagonal;
  json["error"] = model.error;
  json["rms"] = model.rms;
  json["gap"] = model.gap;
  json["overlooked"] = model.overlooked;
  json["mesh_difference"] = applied.mesh_difference;
  json["checks"] = model.checks;
  json["samples"] = model.samples;
  json["rounds"] = model.rounds;
  json["seconds"] = applied.seconds;
  for (const auto& [stage, seconds] : model.stages) json["stages"][stage] = seconds;
  json["crossings"] = model.crossings;
  json["notes"] = model.notes;
  json["failures"] = applied.failures;
  json["faces"] = nlohmann::ordered_json::array();
  for (const cad::DeformedFace& face : model.faces) {
    nlohmann::ordered_json entry{
        {"face", face.number}, {"type", face.type}, {"became", became_text(face.became)}, {"error", face.error}};
    if (face.became == Became::fitted) entry["poles"] = face.poles;
    if (face.held) entry["overlooked"] = face.overlooked;
    json["faces"].push_back(std::move(entry));
  }
  return json;
}

std::vector<std::string> failures_of(const AppliedCad& applied) {
  std::vector<std::string> failures;
  const cad::DeformedModel& model = applied.model;
  for (const int number : model.coarse) {
    const cad::DeformedFace& face = model.faces.at(static_cast<std::size_t>(number) - 1);
    failures.push_back("face " + std::to_string(number) + " (" + face.type + ") is off by " +
                       in_diagonals(face.error, model.diagonal) +
                       ", above what --tolerance and --rigid allow: the deformation is not smooth there");
  }
  for (const auto& [first, second] : model.crossings) {
    failures.push_back("faces " + std::to_string(first) + " and " + std::to_string(second) + " go through each other");
  }
  if (applied.mesh_difference > applied.tolerance) {
    failures.push_back("points of the mesh and the same points of space differ by " + number_text(applied.mesh_difference) +
                       ", more than the tolerance " + number_text(applied.tolerance) +
                       ": the setup needs a smaller tolerance of its solver");
  }
  return failures;
}

ExitCode run_cad_apply(const CadApplyCommand& options, const CommonOptions& common) {
  need_cad(common);
  cad::check_request(options.request);
  const auto start = std::chrono::steady_clock::now();
  cad::ApplyRequest request = options.request;
  keep_inputs("-o", request.output.string(), {options.input.setup, options.input.source, request.model});
  check_folder("-o", request.output);
  Connection connection(common);
  Progress progress;
  LoadedSetup loaded = load_setup(connection, options.input, progress);
  check_space_method(loaded.setup);
  const PreparedSetup prepared = prepare_loaded(connection, std::move(loaded), progress);
  keep_inputs("-o", request.output.string(), {prepared.source_path});
  const std::vector<double> values = parse_settings(options.settings, prepared.system.setup());
  SpaceDeformation deformation(connection, prepared, values);
  const cad::MeshMotion mesh = deformation.mesh_motion(prepared);
  request.mesh = &mesh;
  if (options.crossings) request.crossings = cad::ApplyRequest::Crossings::looked_for;
  RunContext context;
  context.stop = connection.interrupted();
  AppliedCad applied;
  applied.model = cad::apply_to_model(
      request,
      [&](std::span<const Vec3> points) {
        progress.fraction("deform " + std::to_string(points.size()) + " points", 0);
        return deformation(points);
      },
      context);
  progress.clear();
  applied.mesh_difference = deformation.mesh_difference();
  if (deformation.still() > 0) {
    applied.model.notes.push_back(std::to_string(deformation.still()) +
                                  " points lie outside of the lattice and stay where they are.");
  }
  if (std::all_of(values.begin(), values.end(), [](double value) { return value == 0; })) {
    applied.model.notes.emplace_back(nothing_moves);
  }
  applied.tolerance = request.tolerance * applied.model.diagonal * request.scale;
  applied.failures = failures_of(applied);
  applied.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (common.style() == Style::json) {
    print(applied_cad_json(applied, options));
  } else {
    print_applied_cad(applied, options);
  }
  return applied.failures.empty() ? exit_ok : exit_verdict;
}

constexpr char cad_apply_footer[] =
    R"(The exact geometry follows the design as the mesh does: each surface and curve is fitted again in place, topology, names and
colours are kept. Faces that move rigidly stay planes, cylinders, ...; faces that do not move stay as they are; planes, cylinders, cones and
spheres that are such still, with other dimensions, keep their type. All methods but the shell deform space.
What is written is valid, also after it was read again; else nothing is written. The error is measured at random points, as a fraction of
D, the diagonal of the bounding box of the CAD model.
Exit code 4: a face is off by more than twice the tolerance, faces go through each other, or the mesh and the CAD model differ; the file
is written all the same.
CAD files: .step .stp .brep, to read also .iges .igs. The command needs deform-cad beside deform, which is built with OpenCASCADE (-DDEFORM_WITH_CAD=ON).
Examples:
  deform cad-apply wing.yaml wing.step --set twist=2 -o twisted.step
  deform cad-apply wing.yaml wing.step --set twist=2 -o twisted.step --tolerance 1e-5 --scale 0.001)";

}  // namespace

void add_cad_apply_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<CadApplyCommand>();
  auto* command = app.add_subcommand("cad-apply", "Deform the CAD model of a mesh as the mesh, and write it as CAD");
  command->add_option("SETUP", options->input.setup, "Setup file, or the id of a prepared system")->required();
  command->add_option("MODEL", options->request.model, "CAD model on which the mesh lies")->required();
  command->add_option("--set", options->settings, "NAME=VALUE of a design variable; may be repeated")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("-o,--output", options->request.output, "CAD file to write: .step, .stp or .brep")->required();
  command->add_option("--source,--mesh", options->input.source, "Mesh file of a setup that names its geometry by id");
  command
      ->add_option("--tolerance", options->request.tolerance,
                   "Largest distance of the written geometry from the deformed one, as a fraction of D")
      ->check(CLI::Range(1e-9, 1e-2))
      ->capture_default_str();
  command
      ->add_option("--rigid", options->request.rigid,
                   "Faces that move rigidly up to this distance, a fraction of D, keep their type; 0: a tenth of --tolerance")
      ->check(CLI::Range(0.0, 1e-2))
      ->capture_default_str();
  command
      ->add_option(
          "--hold", options->request.hold,
          "Faces go as the nodes on them do, rigidly or to a surface of their type, where the deformation between the nodes "
          "differs by up to this distance, a fraction of D; 0: none")
      ->check(CLI::Range(0.0, 1e-2))
      ->capture_default_str();
  command->add_flag("--crossings", options->crossings, "Look for faces that go through each other far from their edges");
  command->add_option("--scale", options->request.scale, "Factor from the unit of the CAD model to that of the mesh")
      ->check(positive())
      ->capture_default_str();
  command
      ->add_option("--checks", options->request.checks, "Random points at which the error is measured; each face has at least 20")
      ->check(CLI::Range(0, 10'000'000))
      ->capture_default_str();
  command->footer(cad_apply_footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_cad_apply(*options, common); }; });
}

}  // namespace deform::cli
