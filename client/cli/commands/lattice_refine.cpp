// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/output/lattice_file.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/motions.h"
#include "client/cli/setup/reading.h"
#include "client/cli/setup/refined_setup.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

struct RefineCommand {
  std::string setup, source, output, mesh, halve, elevate;
  std::vector<std::string> settings;
};

/// Which axes are refined, by the option that fits the basis.
std::array<bool, 3> refined_axes(const RefineCommand& options, const v1::Setup& setup) {
  const bool bernstein = setup.method().ffd().lattice().basis() == v1::BERNSTEIN;
  if (bernstein && !options.halve.empty()) {
    refuse(
        "--halve: BERNSTEIN has one span along each axis and no knot to insert; give --elevate, which raises the degree by one");
  }
  if (!bernstein && !options.elevate.empty()) {
    refuse("--elevate: only BERNSTEIN has a degree to raise; give --halve, which halves the spans of cubic splines");
  }
  const std::string& names = bernstein ? options.elevate : options.halve;
  if (names.empty()) refuse(bernstein ? "--elevate: give the axes, such as i,k" : "--halve: give the axes, such as i,k");
  std::array<bool, 3> axes{};
  for (const char name : names) {
    if (name != ',') axes[static_cast<std::size_t>(name - 'i')] = true;
  }
  return axes;
}

/// What is wrong with a list of axes, each of them once: "i,k".
std::string axes_problem(const std::string& text) {
  std::string seen;
  for (std::size_t c = 0; c < text.size(); ++c) {
    const bool known = text[c] >= 'i' && text[c] <= 'k' && seen.find(text[c]) == std::string::npos;
    if (c % 2 == 0 ? !known : text[c] != ',') return "\"" + text + "\" is no list of i, j and k, each of them once";
    if (c % 2 == 0) seen += text[c];
  }
  return seen.size() * 2 == text.size() + 1 ? "" : "\"" + text + "\" is no list of axes, such as i,k";
}

std::filesystem::path folder_of(const std::filesystem::path& file) {
  return std::filesystem::weakly_canonical(std::filesystem::absolute(file)).parent_path();
}

/// The setup names other files relative to itself.
void check_refined_output(const RefineCommand& options) {
  const std::filesystem::path setup = options.setup, output = options.output;
  if (folder_of(setup) != folder_of(output)) {
    refuse("--output: the refined setup names the same files as " + setup.string() + " does; write it into the same folder");
  }
  std::error_code none;
  if (std::filesystem::equivalent(setup, output, none)) refuse("--output: would replace the setup that is refined");
  if (options.settings.empty() != options.mesh.empty()) {
    refuse(options.mesh.empty()
               ? "--set: the refined setup starts from the shape of this design: give the file for its mesh, --mesh FILE"
               : "--mesh: give the design whose mesh it is, --set NAME=VALUE");
  }
}

ExitCode run_refine(const RefineCommand& options, const CommonOptions& common) {
  check_refined_output(options);
  const SetupFile file = read_setup_file(options.setup, own_process());
  const std::filesystem::path path = mesh_path(options.setup, file, options.source);
  const std::filesystem::path output = options.output;
  keep_inputs("--output", output, {path});
  check_folder("--output", output);
  if (!options.mesh.empty()) {
    io::check_output(path, options.mesh);
    if (io::replaced_source(path, options.mesh)) refuse("--mesh: would replace the mesh of the setup");
  }
  Refinement refinement;
  refinement.setup = options.setup;
  if (file.setup.method().has_ffd()) refinement.axes = refined_axes(options, file.setup);
  refinement.values = parse_settings(options.settings, file.setup);
  refinement.control_points = output.stem().string() + ".control_points.vtp";
  if (!options.mesh.empty()) {
    refinement.geometry =
        std::filesystem::relative(std::filesystem::weakly_canonical(std::filesystem::absolute(options.mesh)), folder_of(output))
            .string();
  }
  const auto source = io::read_mesh_file(path, own_process());
  const RefinedSetup refined = refined_setup(refinement, *source->mesh());
  if (refined.mesh) io::write_mesh_file(*source, *refined.mesh, options.mesh);
  // A setup without control points has them at rest.
  const bool moved = refined.mesh || !file.setup.method().ffd().lattice().control_points().empty();
  const std::filesystem::path points_file = output.parent_path() / refinement.control_points;
  if (moved) write_lattice({refined.lattice, refined.lattice.places, {}, {}}, points_file);
  io::write_file(output, refined.text);
  const std::array<std::size_t, 3> points = *refined.lattice.controls().lattice;
  if (common.style() == Style::json) {
    nlohmann::ordered_json json;
    json["file"] = options.output;
    json["points_before"] = refined.before;
    json["points"] = points;
    if (moved) json["control_points"] = points_file.string();
    if (refined.mesh) {
      json["mesh"] = options.mesh;
      json["outside"] = refined.outside;
    }
    print(json);
    return exit_ok;
  }
  const auto text = [](const std::array<std::size_t, 3>& n) {
    return std::to_string(n[0]) + " x " + std::to_string(n[1]) + " x " + std::to_string(n[2]);
  };
  std::cout << "wrote " << printable(options.output) << ": " << text(points) << " control points instead of "
            << text(refined.before) << '\n';
  if (moved) std::cout << "wrote " << printable(points_file.string()) << ": where they are before a design moves them\n";
  if (refined.mesh) {
    std::cout << "wrote " << printable(options.mesh) << ": the mesh of the design, on which the new setup starts\n"
              << "  note: variables count from this design, within the same bounds as before\n";
    if (refined.outside > 0)
      std::cout << "  note: " << refined.outside << " points outside of the lattice stayed where they were\n";
  }
  std::cout << std::flush;
  return exit_ok;
}

constexpr char refine_footer[] =
    R"(What is kept is the shape: the lattice at rest, or moved (control_points, --set), is the same function of the points of the mesh. What is not
kept is how handles move it: a handle holds the control points of the finer lattice at the places of those that it held and between them,
whose splines reach half as far. With --set the mesh of the design is written, too, and the refined setup starts from there.
Comments of the setup are not copied. Nothing is asked of a server.
Examples:
  deform lattice refine wing.yaml --halve i,k -o finer.yaml
  deform lattice refine wing.yaml --halve j --set twist=0.1 --mesh twisted.obj -o finer.yaml)";

}  // namespace

void add_lattice_refine_command(CLI::App& lattice, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<RefineCommand>();
  auto* command = lattice.add_subcommand("refine", "Write a setup whose lattice has more control points and the same shape");
  command->add_option("SETUP", options->setup, "Setup file with method.ffd")->required();
  command->add_option("-o,--output", options->output, "Setup file to write, in the same folder")->required();
  const auto axes = [&](const char* name, std::string& into, const char* about) {
    command->add_option(name, into, about)->check(axes_problem, "AXES");
  };
  axes("--halve", options->halve, "Axes whose spans are halved, such as i,k: from n control points to 2 n - 3");
  axes("--elevate", options->elevate, "Axes of BERNSTEIN whose degree is raised by one");
  command->add_option("--set", options->settings, "NAME=VALUE of a design variable; may be repeated; with control CONTROLS only")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--mesh", options->mesh, "With --set: file to write, the mesh of the design");
  command->add_option("--source", options->source, "Mesh file of a setup that names its geometry by id");
  command->footer(refine_footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_refine(*options, common); }; });
}

}  // namespace deform::cli
