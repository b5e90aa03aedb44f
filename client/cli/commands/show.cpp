// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/lookup.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/result_json.h"

namespace deform::cli {

namespace {

struct ShowOptions {
  std::string id;
  bool setup = false;
};

ExitCode run_show(const ShowOptions& options, const CommonOptions& common) {
  Connection connection(common);
  const Found found = look_up(connection, options.id);
  if (options.setup) {
    if (!found.system)
      throw Error(ErrorCode::invalid_argument, "--setup: " + options.id + " is a geometry, only systems have one");
    std::cout << setup_text(connection.client().get_setup(found.system->id(), connection.call())) << std::endl;
    return exit_ok;
  }
  print(found.geometry ? to_json(*found.geometry) : to_json(*found.system));
  return exit_ok;
}

}  // namespace

void add_show_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<ShowOptions>();
  auto* command = app.add_subcommand("show", "Show all that the server knows about a geometry or a system, as JSON");
  command->add_option("ID", options->id, "Id, or its first digits (at least 8)")->required();
  command->add_flag("--setup", options->setup, "The setup of a system, with defaults filled in; usable as a setup file");
  command->footer("Example: deform show 3f9a01c2 --setup > setup.yaml");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_show(*options, common); }; });
}

}  // namespace deform::cli
