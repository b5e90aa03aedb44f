// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

namespace deform::manual {

/// An option or a positional argument.
struct Argument {
  std::vector<std::string> names;  ///< with their dashes; of a positional argument only its name
  std::string value;               ///< what stands after it in a synopsis: "FLOAT"; empty for a switch
  std::vector<std::string> choices;
  std::string fallback, variable, text;  ///< its default, the environment variable that sets it, its description
  bool positional = false, required = false, repeated = false;

  /// Whether a path can be its value.
  bool takes_path() const;
};

/// A program or one of its commands.
struct Command {
  std::vector<std::string> words;  ///< program first
  std::string text, footer;
  std::vector<Argument> arguments;
  std::vector<Argument> inherited;  ///< options of the command above that may stand here, too
  std::vector<Command> commands;
};

/// What a command line is made of, without what its help hides.
Command command_tree(const CLI::App& app, std::vector<std::string> words);

/// All commands, the program first.
std::vector<const Command*> all_commands(const Command& program);

/// Words with a separator between them.
std::string joined(const std::vector<std::string>& words, const std::string& separator);

}  // namespace deform::manual
