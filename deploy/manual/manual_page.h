// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "deploy/manual/command_tree.h"

namespace deform::manual {

/// The manual page of one command, for man. Section 1 is for commands of users, 8 for those of administrators.
std::string manual_page(const Command& command, int section);

}  // namespace deform::manual
