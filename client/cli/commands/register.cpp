// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/mesh_reading.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/result_json.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

struct RegisterOptions {
  std::string file;
  std::string name;
};

ExitCode run_register(const RegisterOptions& options, const CommonOptions& common) {
  Connection connection(common);
  Progress progress;
  const auto file = io::read_mesh_file(options.file, own_process(connection.interrupted()));
  const std::string label = options.name.empty() ? std::filesystem::path(options.file).filename().string() : options.name;
  const auto info = register_mesh(connection, file->mesh(), label, progress);
  progress.clear();
  if (common.style() == Style::json) {
    print(to_json(info));
    return exit_ok;
  }
  std::cout << info.id() << '\n';
  std::cout << "  " << (info.existed() ? "was registered before: " : "registered: ") << info.points() << " points, "
            << (info.faces() > 0 ? std::to_string(info.faces()) : "no") << " faces"
            << (info.cells() > 0 ? ", " + std::to_string(info.cells()) + " cells" : "") << '\n';
  for (const auto& group : info.groups())
    std::cout << "  group " << printable(group.name()) << ": " << group_size_text(group) << '\n';
  std::cout << std::flush;
  return exit_ok;
}

}  // namespace

void add_register_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<RegisterOptions>();
  auto* command = app.add_subcommand("register", "Give a mesh to the server and print its id");
  command->add_option("FILE", options->file, "Mesh: " + io::mesh_file_names())->required();
  command->add_option("--name", options->name, "Label that lists show; default: the file name");
  command->footer(
      "The id is a hash of the content: registering the same mesh again costs nothing. A setup file may name the mesh file\n"
      "itself, then prepare and apply register it on the way.\n"
      "Example: deform register car.stl.gz");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_register(*options, common); }; });
}

}  // namespace deform::cli
