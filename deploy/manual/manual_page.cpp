// SPDX-License-Identifier: GPL-3.0-or-later
#include "deploy/manual/manual_page.h"

#include <algorithm>
#include <sstream>

#include "core/base/version.h"

namespace deform::manual {

namespace {

/// As roff prints it unchanged.
std::string roff(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if ((c == '.' || c == '\'') && (out.empty() || out.back() == '\n')) out += "\\&";
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else {
      out += c;
    }
  }
  return out;
}

std::string bold(const std::string& text) { return "\\fB" + roff(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + roff(text) + "\\fR"; }

std::string value_text(const Argument& argument) {
  return italic(argument.choices.empty() ? argument.value : joined(argument.choices, "|"));
}

void write_arguments(std::ostream& out, const std::vector<Argument>& arguments) {
  for (const Argument& argument : arguments) {
    std::vector<std::string> names;
    for (const std::string& name : argument.names) names.push_back(argument.positional ? italic(name) : bold(name));
    out << ".TP\n" << joined(names, ", ");
    if (!argument.positional && !argument.value.empty()) out << ' ' << value_text(argument);
    out << '\n' << roff(argument.text);
    if (argument.text.empty()) out << "\\&";
    if (!argument.fallback.empty()) out << " (default: " << roff(argument.fallback) << ')';
    if (argument.required && !argument.positional) out << " (required)";
    if (!argument.variable.empty()) out << " (environment variable: " << roff(argument.variable) << ')';
    out << '\n';
  }
}

std::string page_name(const Command& command) { return joined(command.words, "-"); }

/// The description without "NAME: " before it.
std::string summary(const Command& command) {
  const std::string name = joined(command.words, " ") + ": ";
  return command.text.starts_with(name) ? command.text.substr(name.size()) : command.text;
}

void write_synopsis(std::ostream& out, const Command& command) {
  out << ".SH SYNOPSIS\n" << bold(joined(command.words, " "));
  if (!command.arguments.empty()) out << " [" << italic("OPTION") << "]...";
  for (const Argument& argument : command.arguments) {
    if (!argument.positional) continue;
    const std::string name = italic(argument.names.front()) + (argument.repeated ? "..." : "");
    out << ' ' << (argument.required ? name : "[" + name + "]");
  }
  if (!command.commands.empty()) out << ' ' << italic("COMMAND") << " ...";
  out << '\n';
}

void write_section(std::ostream& out, const char* title, const std::vector<Argument>& arguments) {
  if (arguments.empty()) return;
  out << ".SH " << title << '\n';
  write_arguments(out, arguments);
}

}  // namespace

std::string manual_page(const Command& command, int section) {
  std::ostringstream out;
  std::string title = page_name(command);
  std::transform(title.begin(), title.end(), title.begin(), [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  out << ".TH " << roff(title) << ' ' << section << " \"\" \"" << command.words.front() << ' ' << version() << "\"\n"
      << ".SH NAME\n"
      << roff(page_name(command)) << " \\- " << roff(summary(command)) << '\n';
  write_synopsis(out, command);
  std::vector<Argument> positional, options;
  for (const Argument& argument : command.arguments) (argument.positional ? positional : options).push_back(argument);
  write_section(out, "ARGUMENTS", positional);
  write_section(out, "OPTIONS", options);
  write_section(out, "COMMON OPTIONS", command.inherited);
  if (!command.commands.empty()) {
    out << ".SH COMMANDS\n";
    for (const Command& part : command.commands) out << ".TP\n" << bold(part.words.back()) << '\n' << roff(summary(part)) << '\n';
  }
  if (!command.footer.empty()) out << ".SH NOTES\n.nf\n" << roff(command.footer) << "\n.fi\n";
  if (command.words.size() > 1) out << ".SH SEE ALSO\n.BR " << roff(command.words.front()) << " (" << section << ")\n";
  return out.str();
}

}  // namespace deform::manual
