// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>

#include "client/cli/commands/workspace.h"

namespace deform::cli {

/// What an id stands for: exactly one of the two.
struct Found {
  std::optional<v1::GeometryInfo> geometry;
  std::optional<v1::SystemInfo> system;
};

/// Throws Error(not_found) when it is neither, Error(invalid_argument) when its form is wrong or it is the beginning of both a
/// geometry's and a system's id.
Found look_up(Connection& connection, const std::string& id);

}  // namespace deform::cli
