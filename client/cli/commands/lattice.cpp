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
#include "core/base/error.h"
#include "core/base/text.h"
#include "core/base/vectors.h"

namespace deform::cli {

namespace {

struct LatticeCommand {
  std::string setup, source, output;
  std::vector<std::string> settings;
};

/// Labels of the control points; a control point in several regions has that of the first handle.
std::vector<std::uint32_t> labels_of(const v1::Setup& setup, const ControlLattice& lattice) {
  std::vector<std::uint32_t> labels(lattice.places.size(), 0);
  const auto mark = [&](const v1::Region& region, std::uint32_t label, const std::string& what) {
    for (const PointId p : control_points_of(region, lattice, what)) labels[p] = label;
  };
  for (int i = 0; i < setup.fixed_size(); ++i) mark(setup.fixed(i), 1, "fixed[" + std::to_string(i) + "]");
  for (int i = setup.handles_size() - 1; i >= 0; --i) {
    mark(setup.handles(i).region(), static_cast<std::uint32_t>(2 + i), "handle \"" + setup.handles(i).name() + "\"");
  }
  return labels;
}

LatticePicture picture_of(const LatticeCommand& options, const v1::Setup& setup, const ControlLattice& lattice) {
  LatticePicture picture{lattice, lattice.places, {}, {}};
  const std::vector<double> values = parse_settings(options.settings, setup);
  if (!selects_controls(setup)) {
    if (values.empty()) return picture;
    throw Error(ErrorCode::invalid_argument,
                "--set: only with control CONTROLS variables move control points; with ENERGY and MESH they follow from the "
                "handles when a design is solved for, and the lattice is shown before that");
  }
  if (!values.empty()) picture.moved = moved_controls(setup, lattice, values);
  picture.labels = labels_of(setup, lattice);
  for (const auto& handle : setup.handles()) picture.handles.push_back(handle.name());
  return picture;
}

ExitCode run_lattice(const LatticeCommand& options, const CommonOptions& common) {
  const SetupFile file = read_setup_file(options.setup, own_process());
  const std::filesystem::path path = mesh_path(options.setup, file, options.source);
  const auto mesh = io::read_mesh_file(path, own_process())->mesh();
  const ControlLattice lattice = control_lattice(file.setup, *mesh);
  const LatticePicture picture = picture_of(options, file.setup, lattice);
  write_lattice(picture, options.output);
  double largest = 0;
  for (std::size_t p = 0; p < picture.moved.size(); ++p)
    largest = std::max(largest, distance(picture.moved[p], lattice.places[p]));
  const std::array<std::size_t, 3> points = *lattice.controls().lattice;
  const auto in_handles =
      std::count_if(picture.labels.begin(), picture.labels.end(), [](std::uint32_t label) { return label >= 2; });
  if (common.style() == Style::json) {
    nlohmann::ordered_json json;
    json["file"] = options.output;
    json["points"] = points;
    json["in_handles"] = in_handles;
    json["max_displacement"] = largest;
    print(json);
    return exit_ok;
  }
  std::cout << "wrote " << printable(options.output) << ": " << points[0] << " x " << points[1] << " x " << points[2]
            << " control points";
  if (!picture.labels.empty()) std::cout << ", " << in_handles << " in handles, moved by up to " << number_text(largest);
  std::cout << std::endl;
  return exit_ok;
}

constexpr char footer[] =
    R"(Points of the file are the control points in the order of their numbers, i fastest, with the arrays index (i, j, k), displacement
and region (0 other, 1 fixed, 2 and more handles); its cells are the edges of the lattice. Nothing is asked of a server.
Setups take such a file for a lattice that was moved before anything is deformed: lattice: {control_points: {file: lattice.vtp}}.
Examples:
  deform lattice wing.yaml -o lattice.vtp
  deform lattice wing.yaml --set twist=0.1 -o twisted.vtp)";

}  // namespace

void add_lattice_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<LatticeCommand>();
  auto* command = app.add_subcommand("lattice", "Write the lattice of a setup with method.ffd, at rest or as a design moves it");
  command->add_option("SETUP", options->setup, "Setup file")->required();
  command->add_option("-o,--output", options->output, "File to write: .vtp")->required();
  command->add_option("--set", options->settings, "NAME=VALUE of a design variable; may be repeated; with control CONTROLS only")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--source", options->source, "Mesh file of a setup that names its geometry by id");
  command->footer(footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_lattice(*options, common); }; });
}

}  // namespace deform::cli
