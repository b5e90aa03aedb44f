// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store_cli.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "core/base/text.h"
#include "server/rpc/log.h"
#include "server/store/store_commands.h"

namespace deform::server {

namespace {

constexpr const char* help =
    "check and rebuild need a stopped server; backup runs beside one. A backup is a store itself: hard links of the files where\n"
    "both are on one file system, else copies. restore is for a data directory that is new or empty.\n"
    "Exit code: 0 all is well, 1 faults were found or the command failed, 2 wrong usage.";

int print(const StoreReport& report, std::ostream& out) {
  for (const auto& line : report.lines) out << escaped(line, 2000) << '\n';
  out.flush();
  return report.outcome == StoreReport::Outcome::well ? 0 : 1;
}

/// The command line; parsing it runs the command.
struct StoreCommand {
  explicit StoreCommand(std::string default_data_dir);
  StoreCommand(const StoreCommand&) = delete;
  StoreCommand& operator=(const StoreCommand&) = delete;

  CLI::App app{"deformd store: look after a data directory", "deformd store"};
  std::string data_dir, folder;
  StoreReport report;
};

StoreCommand::StoreCommand(std::string default_data_dir) : data_dir(std::move(default_data_dir)) {
  app.require_subcommand(1);
  app.fallthrough();
  app.footer(help);
  app.add_option("--data-dir", data_dir, "the data directory [DEFORMD_DATA_DIR]")->type_name("PATH")->capture_default_str();
  app.add_subcommand("check", "Verify every file and the catalog; change nothing")->callback([this] {
    report = check_store(data_dir);
  });
  app.add_subcommand("rebuild", "Set the catalog aside and make a new one of the files")->callback([this] {
    report = rebuild_store(data_dir);
  });
  CLI::App* backup = app.add_subcommand("backup", "Make DIR, a new or empty folder, a copy of the data directory");
  backup->add_option("DIR", folder, "where to")->required();
  backup->callback([this] { report = backup_store(data_dir, folder); });
  CLI::App* restore = app.add_subcommand("restore", "Make the data directory a copy of the backup DIR");
  restore->add_option("DIR", folder, "where from")->required();
  restore->callback([this] { report = restore_store(folder, data_dir); });
}

}  // namespace

void describe_store_command(const std::function<void(const CLI::App&)>& describe) {
  const StoreCommand command("deformd-data");
  describe(command.app);
}

std::optional<int> run_store_command(const CommandLine& command_line, std::ostream& out) {
  if (command_line.arguments.empty() || command_line.arguments.front() != "store") return std::nullopt;
  start_logging({spdlog::level::warn, {}});  // which files are concerned, on standard error
  StoreCommand command(command_line.environment("DEFORMD_DATA_DIR").value_or("deformd-data"));
  CLI::App& app = command.app;
  std::vector<std::string> arguments(command_line.arguments.begin() + 1, command_line.arguments.end());
  std::reverse(arguments.begin(), arguments.end());  // as CLI11 wants them
  try {
    app.parse(std::move(arguments));
  } catch (const CLI::CallForHelp&) {
    const auto chosen = app.get_subcommands();
    out << (chosen.empty() ? app.help() : chosen.front()->help()) << std::flush;
    return 0;
  } catch (const CLI::ParseError& error) {
    throw Error(ErrorCode::invalid_argument, std::string(error.what()) + " (deformd store --help tells more)");
  }
  return print(command.report, out);
}

}  // namespace deform::server
