// SPDX-License-Identifier: GPL-3.0-or-later
#include "deploy/manual/command_tree.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>

namespace deform::manual {

namespace {

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(separator, begin), text.size());
    parts.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return parts;
}

Argument argument(const CLI::Option& option) {
  Argument result;
  result.positional = !option.nonpositional();
  for (const std::string& name : split(option.get_name(result.positional, true), ',')) {
    result.names.push_back(name.substr(0, name.find('{')));  // "--no-keep-going{false}"
  }
  result.text = option.get_description();
  result.fallback = option.get_default_str();
  result.variable = option.get_envname();
  result.required = option.get_required();
  result.repeated = option.get_expected_max() > 1;
  if (option.get_expected_max() == 0) return result;  // a switch
  // "TEXT:{off,amplitude}": the kind of value, and what CLI11's validators say of it.
  const std::string type = option.get_type_name();
  result.value = type.substr(0, type.find_first_of(":{ "));
  const std::size_t open = type.find('{'), close = type.find('}');
  if (open != std::string::npos && close != std::string::npos)
    result.choices = split(type.substr(open + 1, close - open - 1), ',');
  if (result.value.empty()) result.value = "VALUE";
  return result;
}

void inherit(const Command& above, Command& command) {
  for (const Argument& argument : above.arguments) {
    const bool known = std::any_of(command.arguments.begin(), command.arguments.end(),
                                   [&](const Argument& own) { return own.names == argument.names; });
    if (!argument.positional && !known) command.inherited.push_back(argument);
  }
}

/// Option groups are commands without a name.
void add_contents(const CLI::App& app, Command& command) {
  for (const CLI::Option* option : app.get_options({})) {
    if (!option->get_group().empty()) command.arguments.push_back(argument(*option));
  }
  for (const CLI::App* part : app.get_subcommands([](const CLI::App*) { return true; })) {
    if (part->get_name().empty()) {
      add_contents(*part, command);
    } else if (!part->get_group().empty()) {
      std::vector<std::string> words = command.words;
      words.push_back(part->get_name());
      command.commands.push_back(command_tree(*part, std::move(words)));
      if (part->get_fallthrough()) inherit(command, command.commands.back());
    }
  }
}

void collect(const Command& command, std::vector<const Command*>& all) {
  all.push_back(&command);
  for (const Command& part : command.commands) collect(part, all);
}

}  // namespace

bool Argument::takes_path() const {
  static const char* const numbers[] = {"FLOAT", "INT", "UINT", "NUMBER", "N", "SIZE", "SECONDS", "LEVEL", "HOST"};
  return !value.empty() && choices.empty() &&
         std::none_of(std::begin(numbers), std::end(numbers), [this](const char* number) { return value == number; });
}

Command command_tree(const CLI::App& app, std::vector<std::string> words) {
  Command command;
  command.words = std::move(words);
  command.text = app.get_description();
  command.footer = app.get_footer();
  add_contents(app, command);
  return command;
}

std::vector<const Command*> all_commands(const Command& program) {
  std::vector<const Command*> all;
  collect(program, all);
  return all;
}

std::string joined(const std::vector<std::string>& words, const std::string& separator) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : separator) + word;
  return text;
}

}  // namespace deform::manual
