// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/output/result_json.h"
#include "core/io/mesh_file.h"
#include "core/mesh/ahmed.h"

namespace deform::cli {

namespace {

struct SampleOptions {
  std::string output;
  AhmedOptions ahmed;
};

ExitCode run_sample(const SampleOptions& options, const CommonOptions& common) {
  const Mesh mesh = ahmed_body(options.ahmed);
  io::write_new_file(mesh, options.output);
  if (common.style() == Style::json) {
    nlohmann::ordered_json json;
    json["file"] = options.output;
    json["points"] = mesh.point_count();
    json["faces"] = mesh.face_count();
    json["groups"] = nlohmann::ordered_json::array();
    for (const auto& group : mesh.groups) json["groups"].push_back({{"name", group.name}, {"faces", group.faces.size()}});
    print(json);
    return exit_ok;
  }
  std::cout << "wrote " << options.output << ": " << mesh.point_count() << " points, " << mesh.face_count() << " faces, groups";
  for (const auto& group : mesh.groups) std::cout << ' ' << group.name;
  std::cout << std::endl;
  return exit_ok;
}

}  // namespace

void add_sample_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<SampleOptions>();
  auto* command = app.add_subcommand("sample", "Write an Ahmed body, the reference car body of aerodynamics, with named groups");
  command->add_option("-o,--output", options->output, "File to write, .obj or .stl, also with .gz")->required();
  command->add_option("--slant", options->ahmed.slant_degrees, "Slant angle, degrees")
      ->check(CLI::Range(0.0, 40.0))
      ->capture_default_str();
  command->add_option("--points", options->ahmed.target_points, "About so many points")
      ->check(CLI::Range(2000, 2000000))
      ->capture_default_str();
  command->footer(
      "Groups: nose, roof, sides, slant, base, underbody, stilts. Metres; x downstream, z up.\n"
      "Example: deform sample -o ahmed.obj --slant 25 --points 50000");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_sample(*options, common); }; });
}

}  // namespace deform::cli
