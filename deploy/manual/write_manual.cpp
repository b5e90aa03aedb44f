// SPDX-License-Identifier: GPL-3.0-or-later
// Writes the manual pages of both programs and what shells need to complete their command lines:
//   write_manual FOLDER        FOLDER/man1/deform.1 ..., FOLDER/man8/deformd.8 ..., FOLDER/bash/deform, zsh/_deform,
//   fish/deform.fish ...
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "client/cli/commands/command.h"
#include "deploy/manual/completion.h"
#include "deploy/manual/manual_page.h"
#include "server/options.h"
#include "server/store_cli.h"

namespace {

using namespace deform::manual;

Command client_commands() {
  deform::cli::CommonOptions common;
  deform::cli::Action chosen;
  CLI::App app;
  deform::cli::define_command_line(app, common, chosen);
  return command_tree(app, {"deform"});
}

Command server_commands() {
  Command program;
  deform::server::describe_command_line([&](const CLI::App& app) { program = command_tree(app, {"deformd"}); });
  deform::server::describe_store_command([&](const CLI::App& app) {
    program.commands.push_back(command_tree(app, {"deformd", "store"}));
  });
  return program;
}

void write(const std::filesystem::path& path, const std::string& text) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream file(path, std::ios::binary);
  file << text;
  if (!file.flush()) throw std::runtime_error("cannot write " + path.string());
}

void write_all(const std::filesystem::path& folder, const Command& program, int section) {
  const std::string number = std::to_string(section), &name = program.words.front();
  for (const Command* command : all_commands(program)) {
    write(folder / ("man" + number) / (joined(command->words, "-") + "." + number), manual_page(*command, section));
  }
  write(folder / "bash" / name, bash_completion(program));
  write(folder / "zsh" / ("_" + name), zsh_completion(program));
  write(folder / "fish" / (name + ".fish"), fish_completion(program));
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) {
    std::cerr << "usage: write_manual FOLDER\n";
    return 2;
  }
  write_all(argv[1], client_commands(), 1);
  write_all(argv[1], server_commands(), 8);
  return 0;
} catch (const std::exception& error) {
  std::cerr << "write_manual: " << error.what() << '\n';
  return 1;
}
