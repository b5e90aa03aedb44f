// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <iomanip>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/region_files.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/setup_stages.h"

namespace deform::cli {

namespace {

struct RegionsCommand {
  std::string setup, source, output;
  std::optional<std::uint32_t> then;
  bool no_centres = false;
};

/// The picture, and what is to be said about it.
struct Outcome {
  RegionPicture picture;
  std::vector<std::string> notes;
};

std::vector<PointId> ids_of(const v1::EstimateReply& estimate, std::size_t points) {
  std::vector<PointId> ids;
  std::uint64_t id = 0;
  for (const std::uint32_t step : estimate.centre_steps()) {
    id += step;
    if (id >= points) throw Error(ErrorCode::data_loss, "the server names a centre that is no point of the mesh");
    ids.push_back(static_cast<PointId>(id));
  }
  return ids;
}

/// Asks the server, which has to know the mesh for that. What it finds wrong with the setup is one more problem.
void ask_for_centres(const v1::Setup& setup, const std::shared_ptr<const Mesh>& mesh, const std::string& label,
                     const CommonOptions& common, Outcome& outcome) {
  v1::EstimateRequest request;
  *request.mutable_setup() = setup;
  request.set_list_centres(true);
  Connection connection(common);
  Progress progress;
  try {
    const v1::GeometryInfo info = register_mesh(connection, mesh, label, progress);
    progress.clear();
    if (!info.id().starts_with(setup.geometry())) {
      throw Error(ErrorCode::invalid_argument,
                  "--source: holds geometry " + info.id() + ", the setup is for " + setup.geometry());
    }
    request.mutable_setup()->set_geometry(info.id());
    const v1::EstimateReply estimate = connection.client().estimate(request, connection.call());
    if (estimate.centre_steps_size() > 0) outcome.picture.centres = ids_of(estimate, mesh->point_count());
    outcome.notes.assign(estimate.notes().begin(), estimate.notes().end());
  } catch (const Error& error) {
    progress.clear();
    if (error.code() == ErrorCode::cancelled || error.code() == ErrorCode::data_loss) throw;
    if (error.code() == ErrorCode::invalid_argument) {
      outcome.picture.regions.problems.push_back(error.what());
    } else {
      outcome.notes.push_back(std::string("The centres are not shown, the server did not tell them: ") + error.what());
    }
  }
}

std::string title(const LegendEntry& entry) { return entry.name.empty() ? entry.kind : entry.kind + " " + entry.name; }

void print_legend(const Outcome& outcome, const std::string& output) {
  std::cout << "value  colour      points   centres  region\n";
  bool constraints = false;
  for (const LegendEntry& entry : legend(outcome.picture)) {
    if (entry.kind == "constraint" && !constraints) std::cout << "constraints\n";
    constraints = entry.kind == "constraint";
    const bool counted = outcome.picture.centres && !constraints && entry.value != ResolvedRegions::free;
    std::cout << std::setw(5) << entry.value << "  " << colour_text(entry.colour) << std::setw(11) << entry.points
              << std::setw(10) << (counted ? std::to_string(entry.centres) : "-") << "  " << title(entry) << '\n';
  }
  for (const std::string& note : outcome.notes) std::cout << "  note: " << note << '\n';
  std::cout << "wrote " << output << '\n' << std::flush;
}

nlohmann::ordered_json entry_json(const LegendEntry& entry, const RegionPicture& picture) {
  nlohmann::ordered_json json;
  json["value"] = entry.value;
  json["kind"] = entry.kind;
  json["name"] = entry.name;
  json["colour"] = colour_text(entry.colour);
  json["points"] = entry.points;
  if (picture.centres && entry.kind != "constraint") json["centres"] = entry.centres;
  return json;
}

void print_json(const Outcome& outcome, const std::string& output) {
  const RegionPicture& picture = outcome.picture;
  nlohmann::ordered_json json;
  json["file"] = output;
  json["points"] = picture.regions.labels.size();
  json["regions"] = nlohmann::ordered_json::array();
  json["constraints"] = nlohmann::ordered_json::array();
  for (const LegendEntry& entry : legend(picture)) {
    json[entry.kind == "constraint" ? "constraints" : "regions"].push_back(entry_json(entry, picture));
  }
  json["centres"] = picture.centres ? nlohmann::ordered_json(picture.centres->size()) : nlohmann::ordered_json();
  json["problems"] = picture.regions.problems;
  json["notes"] = outcome.notes;
  print(json);
}

ExitCode run_regions(const RegionsCommand& options, const CommonOptions& common) {
  const SetupFile file = read_setup_file(options.setup, own_process());
  const std::filesystem::path path = mesh_path(options.setup, file, options.source);
  const auto mesh = io::read_mesh_file(path, own_process())->mesh();
  const v1::Setup setup = setup_of_method(file.setup, options.then);
  Outcome outcome{{resolve_regions(setup, *mesh), std::nullopt}, {}};
  auto& problems = outcome.picture.regions.problems;
  if (!options.no_centres && problems.empty()) {
    ask_for_centres(setup, mesh, path.filename().string(), common, outcome);
  }
  // Also when something is wrong: that is when people have to look at it.
  write_regions(*mesh, outcome.picture, options.output);
  if (common.style() == Style::json) {
    print_json(outcome, options.output);
  } else {
    print_legend(outcome, options.output);
  }
  if (problems.empty()) return exit_ok;
  const std::string more = problems.size() > 1 ? " (and " + std::to_string(problems.size() - 1) + " more)" : "";
  if (common.style() == Style::text) {
    for (std::size_t i = 1; i < problems.size(); ++i) std::cout << "  problem: " << problems[i] << '\n';
    std::cout << std::flush;
  }
  throw Error(ErrorCode::invalid_argument, problems.front() + more);
}

constexpr char regions_footer[] =
    R"(Points are coloured by handle (orange, sky blue, green, vermilion, blue, purple, yellow, then darker and lighter
ones), dark grey where they are fixed, light grey where they are free, indigo where they are free and constrained. Points of
handles and fixed ones that are no centres of the deformation are pale.
.ply: colours of vertices. .vtp: faces, of a volume mesh those of its boundary; .vtu: the cells of a volume mesh. Arrays of
.vtp and .vtu: region (0 free, 1 fixed, then the handles in order), colour, constraint (0 none, else its number), one for each
constraint, centre, contested (points that two regions want); their names are field data.
Nothing is prepared. The server is asked which points become centres; without one everything else is written.
A setup that `deform prepare` would refuse is drawn too, then the command fails with the words of prepare.
Examples:
  deform regions ahmed.yaml -o regions.vtp
  deform regions wing.yaml -o regions.ply --no-centres)";

}  // namespace

void add_regions_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<RegionsCommand>();
  auto* command =
      app.add_subcommand("regions", "Write the mesh of a setup coloured by handle, fixed, free, constraint and centre");
  command->add_option("SETUP", options->setup, "Setup file")->required();
  command->add_option("-o,--output", options->output, "File to write: .vtp, .ply or, of a volume mesh, .vtu")->required();
  command->add_option("--source", options->source, "Mesh file of a setup that names its geometry by id");
  command->add_option("--then", options->then, "Number of a further method of the setup, from 0; without: the first method");
  command->add_flag("--no-centres", options->no_centres, "Do not ask the server which points become centres");
  command->footer(regions_footer);
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_regions(*options, common); }; });
}

}  // namespace deform::cli
