// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "deploy/manual/command_tree.h"

namespace deform::manual {

// What a shell needs to complete the command line of a program: commands, options and the values of options that have a few.

std::string bash_completion(const Command& program);
std::string zsh_completion(const Command& program);
std::string fish_completion(const Command& program);

}  // namespace deform::manual
