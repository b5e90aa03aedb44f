// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

struct ListOptions {
  std::string what = "all";
};

ExitCode run_list(const ListOptions& options, const CommonOptions& common) {
  Connection connection(common);
  std::vector<v1::GeometryInfo> geometries;
  std::vector<v1::SystemInfo> systems;
  if (options.what != "systems") geometries = connection.client().list_geometries(connection.call());
  if (options.what != "geometries") systems = connection.client().list_systems(connection.call(), client::SetupInInfo::omit);
  if (common.style() == Style::json) {
    nlohmann::ordered_json json;
    json["geometries"] = nlohmann::ordered_json::array();
    for (const auto& geometry : geometries) json["geometries"].push_back(to_json(geometry));
    json["systems"] = nlohmann::ordered_json::array();
    for (const auto& system : systems) json["systems"].push_back(to_json(system));
    print(json);
    return exit_ok;
  }
  constexpr std::size_t shown_digits = 16;
  for (const auto& geometry : geometries) {
    std::cout << "geometry " << geometry.id().substr(0, shown_digits) << "  " << date_text(geometry.registered_unix_ms()) << "  "
              << geometry.points() << " points, " << geometry.faces() << " faces, " << geometry.setups() << " setups  "
              << printable(geometry.name()) << (geometry.damage().empty() ? "" : "  DAMAGED: " + printable(geometry.damage()))
              << '\n';
  }
  for (const auto& system : systems) {
    std::cout << "system   " << system.id().substr(0, shown_digits) << "  " << date_text(system.created_unix_ms())
              << "  of geometry " << system.geometry_id().substr(0, shown_digits) << "  "
              << (system.resident() ? bytes_text(system.bytes()) + " in memory" : std::string("not in memory")) << '\n';
  }
  std::cout << std::flush;
  return exit_ok;
}

}  // namespace

void add_list_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<ListOptions>();
  auto* command = app.add_subcommand("list", "List what is registered and prepared");
  command->add_option("WHAT", options->what, "geometries, systems or all")
      ->check(CLI::IsMember({"geometries", "systems", "all"}))
      ->capture_default_str();
  command->footer(
      "Dates are when a geometry was registered and a setup was prepared first, local time.\nIds are cut to 16 digits, which "
      "every command accepts; --json has them in full.");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_list(*options, common); }; });
}

}  // namespace deform::cli
