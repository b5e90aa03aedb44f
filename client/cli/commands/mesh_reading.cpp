// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/commands/mesh_reading.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "client/cli/commands/command.h"
#include "core/base/error.h"

namespace deform::cli {

namespace {

constexpr char command_name[] = "read-isolated";

}  // namespace

io::ReadOptions own_process() {
  io::ReadOptions options;
  options.isolated_reader = {"/proc/self/exe", command_name};
  return options;
}

io::ReadOptions own_process(const std::stop_token& stop) {
  io::ReadOptions options = own_process();
  options.stop = stop;
  return options;
}

std::filesystem::path mesh_path(const std::string& setup, const SetupFile& file, const std::string& source) {
  if (file.geometry_file && !source.empty()) {
    throw Error(ErrorCode::invalid_argument, "--source: the setup names its mesh file itself; remove one of the two");
  }
  if (file.geometry_file) return *file.geometry_file;
  if (!source.empty()) return source;
  throw Error(ErrorCode::invalid_argument, setup + ": it names its geometry by id: give the mesh file, --source FILE");
}

void keep_inputs(const std::string& option, const std::filesystem::path& output,
                 const std::vector<std::filesystem::path>& inputs) {
  if (output.empty()) return;
  for (const std::filesystem::path& input : inputs) {
    std::error_code absent;
    if (input.empty() || !std::filesystem::equivalent(input, output, absent)) continue;
    throw Error(ErrorCode::invalid_argument,
                option + " " + output.string() + ": would replace " + input.string() + ", which is read here; name another file");
  }
}

void check_folder(const std::string& option, const std::filesystem::path& output) {
  const std::filesystem::path folder = output.parent_path();
  std::error_code unknown;
  if (folder.empty() || std::filesystem::is_directory(folder, unknown)) return;
  throw Error(ErrorCode::not_found, option + " " + output.string() + ": there is no folder " + folder.string());
}

void add_read_isolated_command(CLI::App& app, const CommonOptions&, Action& chosen) {
  auto* command = app.add_subcommand(command_name, "Reads a mesh file for another process of this program; not for people");
  command->group("");  // in no list of commands
  command->callback([&chosen] { chosen = [] { return static_cast<ExitCode>(io::serve_isolated_reader()); }; });
}

}  // namespace deform::cli
