// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/output/result_json.h"
#include "client/cli/setup/setup_schema.h"

namespace deform::cli {

namespace {

constexpr char schema_footer[] =
    R"(Editors that know JSON schemas complete keys and names of setups from it and underline what is wrong. With the YAML language server:
  deform schema > setup.schema.json
and as the first line of a setup:
  # yaml-language-server: $schema=setup.schema.json)";

}  // namespace

void add_schema_command(CLI::App& app, const CommonOptions&, Action& chosen) {
  auto* command = app.add_subcommand("schema", "Print a JSON schema of setup files, for editors; needs no server");
  command->footer(schema_footer);
  command->callback([&chosen] {
    chosen = [] {
      print(setup_schema());
      return exit_ok;
    };
  });
}

}  // namespace deform::cli
