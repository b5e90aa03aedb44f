// SPDX-License-Identifier: GPL-3.0-or-later
#include "deploy/manual/completion.h"

#include <functional>
#include <sstream>

namespace deform::manual {

namespace {

/// "/apply" for "deform apply", "" for "deform": where the words of a command line have led to.
std::string place(const Command& command) {
  std::string text;
  for (std::size_t i = 1; i < command.words.size(); ++i) text += "/" + command.words[i];
  return text;
}

/// As a word of the shell between single quotes.
std::string quoted(const std::string& text, const std::string& quote) {
  std::string out;
  for (const char c : text) out += c == '\'' ? quote : std::string(1, c);
  return "'" + out + "'";
}
std::string posix_quoted(const std::string& text) { return quoted(text, "'\\''"); }

std::vector<Argument> options_of(const Command& command) {
  std::vector<Argument> options;
  for (const auto* arguments : {&command.arguments, &command.inherited}) {
    for (const Argument& argument : *arguments) {
      if (!argument.positional) options.push_back(argument);
    }
  }
  return options;
}

std::vector<std::string> option_names(const Command& command) {
  std::vector<std::string> names;
  for (const Argument& option : options_of(command)) names.insert(names.end(), option.names.begin(), option.names.end());
  return names;
}

std::vector<std::string> command_names(const Command& command) {
  std::vector<std::string> names;
  for (const Command& part : command.commands) names.push_back(part.words.back());
  return names;
}

/// The branches of a case statement over "PLACE OPTION", for options that take a value.
void write_value_cases(std::ostream& out, const Command& program,
                       const std::function<std::string(const Argument& option)>& action) {
  for (const Command* command : all_commands(program)) {
    for (const Argument& option : options_of(*command)) {
      if (option.value.empty()) continue;
      std::vector<std::string> patterns;
      for (const std::string& name : option.names) patterns.push_back("\"" + place(*command) + " " + name + "\"");
      out << "    " << joined(patterns, " | ") << ") " << action(option) << " ;;\n";
    }
  }
}

/// The loop over the words before the cursor that finds the command, for both shells that have one syntax for it.
void write_search(std::ostream& out, const Command& program, const std::string& words) {
  std::vector<std::string> places;
  for (const Command* command : all_commands(program)) {
    if (command != &program) places.push_back(place(*command));
  }
  out << "  for word in " << words << "; do\n"
      << "    case \"$at/$word\" in\n"
      << "      " << joined(places, " | ") << ") at=\"$at/$word\" ;;\n"
      << "    esac\n"
      << "  done\n";
}

std::string function_name(const Command& program) { return "_" + program.words.front(); }

}  // namespace

std::string bash_completion(const Command& program) {
  std::ostringstream out;
  const std::string& name = program.words.front();
  out << "# bash completion of " << name << "; made from its command line\n"
      << function_name(program) << "() {\n"
      << "  local at= word cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD - 1]} words= options=\n"
      << "  COMPREPLY=()\n";
  write_search(out, program, "\"${COMP_WORDS[@]:1:COMP_CWORD-1}\"");
  out << "  case \"$at $prev\" in\n";
  write_value_cases(out, program, [](const Argument& option) -> std::string {
    if (!option.choices.empty()) return "words=" + posix_quoted(joined(option.choices, " "));
    return option.takes_path() ? "words=PATH" : "return";
  });
  out << "  esac\n"
      << "  if [[ -z $words ]]; then\n"
      << "    case \"$at\" in\n";
  for (const Command* command : all_commands(program)) {
    const std::string commands = joined(command_names(*command), " ");
    out << "      \"" << place(*command) << "\") options='" << joined(option_names(*command), " ")
        << "' words=" << (commands.empty() ? "PATH" : "'" + commands + "'") << " ;;\n";
  }
  out << "    esac\n"
      << "    [[ $cur == -* ]] && words=$options\n"
      << "  fi\n"
      << "  if [[ $words == PATH ]]; then\n"
      << "    compopt -o filenames 2>/dev/null\n"
      << "    mapfile -t COMPREPLY < <(compgen -f -- \"$cur\")\n"
      << "  else\n"
      << "    mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"$cur\")\n"
      << "  fi\n"
      << "}\n"
      << "complete -F " << function_name(program) << ' ' << name << '\n';
  return out.str();
}

std::string zsh_completion(const Command& program) {
  std::ostringstream out;
  const auto described = [](const std::string& word, const std::string& text) {
    return " " + posix_quoted(text.empty() ? word : word + ":" + text);
  };
  out << "#compdef " << program.words.front() << "\n# made from its command line\n"
      << function_name(program) << "() {\n"
      << "  local at= word\n"
      << "  local -a options commands\n";
  write_search(out, program, "\"${(@)words[2,CURRENT-1]}\"");
  out << "  case \"$at ${words[CURRENT-1]}\" in\n";
  write_value_cases(out, program, [](const Argument& option) -> std::string {
    if (!option.choices.empty()) return "compadd -- " + joined(option.choices, " ") + "; return";
    return option.takes_path() ? "_files; return" : "_message " + posix_quoted(option.value) + "; return";
  });
  out << "  esac\n"
      << "  case \"$at\" in\n";
  for (const Command* command : all_commands(program)) {
    out << "    \"" << place(*command) << "\")\n      options=(";
    for (const Argument& option : options_of(*command)) {
      for (const std::string& name : option.names) out << described(name, option.text);
    }
    out << " )\n      commands=(";
    for (const Command& part : command->commands) out << described(part.words.back(), part.text);
    out << " ) ;;\n";
  }
  out << "  esac\n"
      << "  if [[ ${words[CURRENT]} == -* ]]; then\n"
      << "    _describe -o option options\n"
      << "  elif (( $#commands )); then\n"
      << "    _describe command commands\n"
      << "  else\n"
      << "    _files\n"
      << "  fi\n"
      << "}\n"
      << function_name(program) << " \"$@\"\n";
  return out.str();
}

std::string fish_completion(const Command& program) {
  std::ostringstream out;
  const std::string& name = program.words.front();
  const auto text = [](const std::string& words) { return quoted(words, "\\'"); };
  out << "# fish completion of " << name << "; made from its command line\n";
  for (const Command* command : all_commands(program)) {
    // Every word that led here was seen, none of those that lead on.
    std::string condition;
    for (std::size_t i = 1; i < command->words.size(); ++i) {
      condition += (condition.empty() ? "" : "; and ") + ("__fish_seen_subcommand_from " + command->words[i]);
    }
    const std::string further = joined(command_names(*command), " ");
    if (!further.empty()) condition += (condition.empty() ? "" : "; and ") + ("not __fish_seen_subcommand_from " + further);
    const std::string start = "complete -c " + name + (condition.empty() ? "" : " -n " + text(condition));
    for (const Command& part : command->commands) {
      out << start << " -f -a " << part.words.back() << " -d " << text(part.text) << '\n';
    }
    for (const Argument& option : options_of(*command)) {
      out << start;
      for (const std::string& word : option.names) {
        out << (word.starts_with("--") ? " -l " + word.substr(2) : " -s " + word.substr(1));
      }
      if (!option.value.empty()) out << (option.takes_path() ? " -r -F" : " -x");
      if (!option.choices.empty()) out << " -a " << text(joined(option.choices, " "));
      out << " -d " << text(option.text) << '\n';
    }
  }
  return out.str();
}

}  // namespace deform::manual
