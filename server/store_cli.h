// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <iosfwd>
#include <optional>

#include "server/options.h"

namespace deform::server {

/// "deformd store check|rebuild|backup DIR|restore DIR". Runs it, prints what it found and did, and returns the exit code of the
/// process: 0 all is well, 1 faults were found. Nothing when the command line is not of that form. Throws Error(invalid_argument)
/// for mistakes in it, and what the commands throw (store_commands.h).
std::optional<int> run_store_command(const CommandLine& command_line, std::ostream& out);

/// Hands over its command line, for its description in another form than --help.
void describe_store_command(const std::function<void(const CLI::App&)>& describe);

}  // namespace deform::server
