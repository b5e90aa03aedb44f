// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <array>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/output/format.h"
#include "client/cli/output/lattice_file.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/control_lattice.h"
#include "client/cli/setup/motions.h"
#include "client/cli/setup/setup_stages.h"
#include "core/base/error.h"
#include "core/base/text.h"
#include "core/base/vectors.h"

namespace deform::cli {

namespace {

struct LatticeCommand {
  std::string setup, source, output;
  std::optional<std::uint32_t> then;
  std::vector<std::string> settings;
};

std::vector<std::string> handle_names(const v1::Setup& setup) {
  std::vector<std::string> names;
  for (const auto& handle : setup.handles()) names.push_back(handle.name());
  return names;
}

/// Where the control points are in the design that is asked for.
std::vector<Vec3> moved_places(const LatticeCommand& options, const v1::Setup& setup, const ControlSet& controls,
                               const std::vector<Vec3>& places) {
  const std::vector<double> values = parse_settings(options.settings, setup);
  if (values.empty()) return places;
  if (selects_controls(setup)) return moved_controls(setup, controls, places, values);
  throw Error(ErrorCode::invalid_argument,
              "--set: only with control CONTROLS variables move control points; with ENERGY and MESH they follow from the "
              "handles when a design is solved for, and control points are shown before that");
}

/// What was written.
struct LatticeOutcome {
  std::vector<Vec3> places, moved;
  std::vector<std::uint32_t> labels;
  std::string what;              ///< "5 x 4 x 4 control points"
  nlohmann::ordered_json count;  ///< the same for machines
};

LatticeOutcome write_lattice_of(const LatticeCommand& options, const SetupFile& file) {
  const auto mesh = io::read_mesh_file(mesh_path(options.setup, file, options.source), own_process())->mesh();
  const ControlLattice lattice = control_lattice(file.setup, *mesh);
  LatticePicture picture{lattice, moved_places(options, file.setup, lattice.controls(), lattice.places), {}, {}};
  if (selects_controls(file.setup)) {
    move_images(client::mirror_planes(file.setup, *mesh), lattice.places, picture.moved);
    picture.labels = control_labels(file.setup, lattice.controls());
    picture.handles = handle_names(file.setup);
  }
  write_lattice(picture, options.output);
  const std::array<std::size_t, 3> n = *lattice.controls().lattice;
  LatticeOutcome outcome{lattice.places, picture.moved, picture.labels, {}, {}};
  outcome.what = std::to_string(n[0]) + " x " + std::to_string(n[1]) + " x " + std::to_string(n[2]) + " control points";
  outcome.count["points"] = n;
  return outcome;
}

LatticeOutcome write_cage_of(const LatticeCommand& options, const SetupFile& file) {
  const v1::Setup& setup = file.setup;
  const ControlSet controls = cage_controls(setup);
  CagePicture picture;
  picture.places = control_places(setup, Mesh());
  picture.moved = moved_places(options, setup, controls, picture.places);
  picture.corners.assign(setup.method().cage().triangles().begin(), setup.method().cage().triangles().end());
  if (selects_controls(setup)) {
    if (setup.symmetry_size() > 0) {
      const auto mesh = io::read_mesh_file(mesh_path(options.setup, file, options.source), own_process())->mesh();
      move_images(client::mirror_planes(setup, *mesh), picture.places, picture.moved);
    }
    picture.labels = control_labels(setup, controls);
    picture.handles = handle_names(setup);
  }
  write_cage(picture, options.output);
  LatticeOutcome outcome{picture.places, picture.moved, picture.labels, {}, {}};
  const std::size_t triangles = picture.corners.size() / 3;
  outcome.what = "a cage of " + std::to_string(controls.size) + " vertices and " + std::to_string(triangles) + " triangles";
  outcome.count["vertices"] = controls.size;
  outcome.count["triangles"] = triangles;
  return outcome;
}

ExitCode run_lattice(const LatticeCommand& options, const CommonOptions& common) {
  SetupFile file = read_setup_file(options.setup, own_process());
  file.setup = setup_of_method(file.setup, options.then);
  if (!file.setup.method().has_ffd() && !file.setup.method().has_cage()) {
    throw Error(ErrorCode::invalid_argument, "method: only method.ffd has a lattice and method.cage a cage");
  }
  const LatticeOutcome written = file.setup.method().has_cage() ? write_cage_of(options, file) : write_lattice_of(options, file);
  double largest = 0;
  for (std::size_t p = 0; p < written.moved.size(); ++p)
    largest = std::max(largest, distance(written.moved[p], written.places[p]));
  const auto in_handles =
      std::count_if(written.labels.begin(), written.labels.end(), [](std::uint32_t label) { return label >= 2; });
  if (common.style() == Style::json) {
    nlohmann::ordered_json json;
    json["file"] = options.output;
    json.update(written.count);
    json["in_handles"] = in_handles;
    json["max_displacement"] = largest;
    print(json);
    return exit_ok;
  }
  std::cout << "wrote " << printable(options.output) << ": " << written.what;
  if (!written.labels.empty()) std::cout << ", " << in_handles << " in handles, moved by up to " << number_text(largest);
  std::cout << std::endl;
  return exit_ok;
}

constexpr char footer[] =
    R"(Of a lattice the points of the file are the control points in the order of their numbers, i fastest, with the arrays index (i, j, k),
displacement and region (0 other, 1 fixed, 2 and more handles); its cells are the edges of the lattice. Of a cage they are its vertices, with
the arrays id, displacement and region, and its cells the triangles. Nothing is asked of a server.
Setups take such a file for a lattice that was moved before anything is deformed: lattice: {control_points: {file: lattice.vtp}}.
Examples:
  deform lattice wing.yaml -o lattice.vtp
  deform lattice wing.yaml --set twist=0.1 -o twisted.vtp)";

}  // namespace

void add_lattice_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<LatticeCommand>();
  auto* command = app.add_subcommand(
      "lattice", "Write the lattice or cage of a setup, at rest or as a design moves it; deform lattice refine: a finer one");
  // With a command of its own, CLI11 would ask for these there, too.
  command->add_option("SETUP", options->setup, "Setup file with method.ffd or method.cage; required");
  command->add_option("-o,--output", options->output, "File to write: .vtp; required");
  command->add_option("--set", options->settings, "NAME=VALUE of a design variable; may be repeated; with control CONTROLS only")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--source", options->source, "Mesh file of a setup that names its geometry by id");
  command->add_option("--then", options->then, "Number of a further method of the setup, from 0; without: the first method");
  command->footer(footer);
  command->callback([options, command, &common, &chosen] {
    if (!command->get_subcommands().empty()) return;
    if (options->setup.empty()) throw CLI::RequiredError("SETUP");
    if (options->output.empty()) throw CLI::RequiredError("--output");
    chosen = [options, &common] { return run_lattice(*options, common); };
  });
  add_lattice_refine_command(*command, common, chosen);
}

}  // namespace deform::cli
