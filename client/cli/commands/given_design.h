// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "client/cli/commands/workspace.h"
#include "deform/v1/deformation.pb.h"

namespace deform::cli {

/// A note about a design at rest.
inline constexpr char nothing_moves[] = "no variable differs from 0 and no motion is given: nothing was asked to move";

/// A design on the command line: --set, --motions, --match-tolerance.
struct GivenDesign {
  std::vector<std::string> settings;
  std::vector<std::string> motion_files;
  double match_tolerance = 0;

  void add_to(CLI::App& command);
  /// Throws Error(invalid_argument) as parse_settings() and read_motions() do; motions take the mesh file of the setup.
  v1::Design design(const PreparedSetup& prepared) const;
};

}  // namespace deform::cli
