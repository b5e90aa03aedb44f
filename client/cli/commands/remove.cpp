// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/cli/commands/command.h"
#include "client/cli/commands/lookup.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"

namespace deform::cli {

namespace {

struct RemoveOptions {
  std::vector<std::string> ids;
  bool with_setups = false;
  bool memory_only = false;
};

nlohmann::ordered_json remove_geometry(Connection& connection, const v1::GeometryInfo& geometry, const RemoveOptions& options) {
  if (options.memory_only) {
    throw Error(ErrorCode::invalid_argument,
                "--memory-only: " + geometry.id().substr(0, 16) + " is a geometry; it is for systems");
  }
  v1::DeleteGeometryRequest request;
  request.set_id(geometry.id());
  request.set_with_setups(options.with_setups);
  const auto reply = connection.client().delete_geometry(request, connection.call());
  return {{"id", geometry.id()}, {"kind", "geometry"}, {"setups_deleted", reply.setups_deleted()}};
}

nlohmann::ordered_json remove_system(Connection& connection, const v1::SystemInfo& system, const RemoveOptions& options) {
  v1::ReleaseSystemRequest request;
  request.set_id(system.id());
  request.set_forget(!options.memory_only);
  const auto reply = connection.client().release_system(request, connection.call());
  return {
      {"id", system.id()}, {"kind", "system"}, {"bytes_released", reply.bytes_released()}, {"forgotten", !options.memory_only}};
}

ExitCode run_remove(const RemoveOptions& options, const CommonOptions& common) {
  Connection connection(common);
  auto removed = nlohmann::ordered_json::array();
  for (const auto& id : options.ids) {
    const Found found = look_up(connection, id);
    removed.push_back(found.geometry ? remove_geometry(connection, *found.geometry, options)
                                     : remove_system(connection, *found.system, options));
    if (common.style() == Style::json) continue;
    const auto& last = removed.back();
    std::cout << "removed " << last["kind"].get<std::string>() << ' ' << last["id"].get<std::string>() << std::endl;
  }
  if (common.style() == Style::json) print({{"removed", removed}});
  return exit_ok;
}

}  // namespace

void add_remove_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<RemoveOptions>();
  auto* command = app.add_subcommand("remove", "Remove geometries or systems from the server");
  command->add_option("ID", options->ids, "Ids, or their first digits (at least 8)")->required();
  command->add_flag("--with-setups", options->with_setups, "Geometries: remove their systems too instead of refusing");
  command->add_flag("--memory-only", options->memory_only,
                    "Systems: give back the memory but keep the setup; the id stays valid");
  command->callback([options, &common, &chosen] { chosen = [options, &common] { return run_remove(*options, common); }; });
}

}  // namespace deform::cli
