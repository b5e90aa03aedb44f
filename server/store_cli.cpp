// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store_cli.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "core/base/text.h"
#include "server/rpc/log.h"
#include "server/store/postgres_catalog.h"
#include "server/store/shared_store_copies.h"
#include "server/store/store_commands.h"

namespace deform::server {

namespace {

constexpr const char* help =
    "check and rebuild need a stopped server; backup runs beside one. A backup is a store itself: hard links of the files where\n"
    "both are on one file system, else copies. restore is for a data directory that is new or empty. With --catalog the data\n"
    "directory is that of servers that share it: check, backup and import run beside them, a backup is the store of one server,\n"
    "and restore and import bring one to them. What was interrupted goes on when it is begun again.\n"
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
  std::string data_dir, catalog, folder;
  StoreReport report;

 private:
  bool shared() const { return !catalog.empty(); }
  std::unique_ptr<SharedStore> open_shared() const;
  void check();
  void rebuild();
  void backup();
  void restore();
  void bring();
};

std::unique_ptr<SharedStore> StoreCommand::open_shared() const {
  check_catalog_uri(catalog);
  PostgresOptions postgres;
  postgres.uri = catalog;
  return std::make_unique<SharedStore>(data_dir, open_postgres_catalog(postgres));
}

void StoreCommand::check() {
  report = shared() ? open_shared()->check({}, [](const GeometryRecord&) { return nullptr; }) : check_store(data_dir);
}

void StoreCommand::rebuild() {
  if (shared()) {
    throw Error(ErrorCode::invalid_argument, "rebuild: the catalog is in PostgreSQL, and nothing but a backup has what is in it");
  }
  report = rebuild_store(data_dir);
}

void StoreCommand::backup() { report = shared() ? open_shared()->backup(folder) : backup_store(data_dir, folder); }

void StoreCommand::restore() {
  report = shared() ? restore_shared_store(folder, *open_shared()) : restore_store(folder, data_dir);
}

void StoreCommand::bring() {
  if (!shared()) {
    throw Error(ErrorCode::invalid_argument, "import: name the catalog to import into, --catalog postgresql://HOST/NAME");
  }
  report = import_store(folder, *open_shared());
}

StoreCommand::StoreCommand(std::string default_data_dir) : data_dir(std::move(default_data_dir)) {
  app.require_subcommand(1);
  app.fallthrough();
  app.footer(help);
  app.add_option("--data-dir", data_dir, "the data directory [DEFORMD_DATA_DIR]")->type_name("PATH")->capture_default_str();
  app.add_option("--catalog", catalog, "of servers that share the data directory: postgresql://HOST/NAME [DEFORMD_CATALOG]")
      ->type_name("URI");
  app.add_subcommand("check", "Verify every file and the catalog; change nothing")->callback([this] { check(); });
  app.add_subcommand("rebuild", "Set the catalog aside and make a new one of the files")->callback([this] { rebuild(); });
  CLI::App* backup = app.add_subcommand("backup", "Make DIR, a new or empty folder, a copy of the data directory");
  backup->add_option("DIR", folder, "where to")->required();
  backup->callback([this] { this->backup(); });
  CLI::App* restore = app.add_subcommand("restore", "Make the data directory a copy of the backup DIR");
  restore->add_option("DIR", folder, "where from")->required();
  restore->callback([this] { this->restore(); });
  CLI::App* bringing = app.add_subcommand("import", "Add what DIR, the store of one server or a backup, has to a shared store");
  bringing->add_option("DIR", folder, "where from")->required();
  bringing->callback([this] { bring(); });
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
  command.catalog = command_line.environment("DEFORMD_CATALOG").value_or("");
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
