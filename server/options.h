// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "server/rpc/log.h"
#include "server/rpc/option_text.h"
#include "server/rpc/server.h"

namespace CLI {
class App;
}

namespace deform::server {

/// Everything that can be set from outside about a deformd process.
struct Configuration {
  ServerOptions server;
  LogOptions log;
  std::chrono::milliseconds grace{30'000};  ///< for what is under way at SIGTERM
  std::filesystem::path port_file;          ///< the port that is listened on is written here

  /// Where a value came from, for the log.
  struct Effective {
    std::string name;
    std::string value;
    std::string source;  ///< "default", "flag", "environment" or the file with its line
  };
  std::vector<Effective> effective;
  std::vector<std::string> doubts;  ///< what may be meant otherwise, one line each, for the log
};

/// What options are read from.
struct CommandLine {
  std::vector<std::string> arguments;  ///< without the name of the program
  std::function<std::optional<std::string>(const std::string& name)> environment;
  std::vector<std::string> variables{};  ///< names of all of the environment
};

/// Text to print instead of running (--help, --version).
struct Answer {
  std::string text;
};

/// Flags win over environment variables (DEFORMD_...), those over the YAML file (--config), that over the defaults. Throws
/// Error(invalid_argument) in one line that names the option and where it was set.
std::variant<Configuration, Answer> read_configuration(const CommandLine& command_line);

/// Hands over the command line that read_configuration() reads, for its description in another form than --help.
void describe_command_line(const std::function<void(const CLI::App&)>& describe);

}  // namespace deform::server
