// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "client/cli/commands/command.h"
#include "client/cli/commands/given_design.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/apply_report.h"
#include "client/cli/output/cell_options.h"
#include "client/cli/output/gates.h"

namespace deform::cli {

/// Options of `deform apply`.
struct ApplyOptions {
  PrepareInput input;
  GivenDesign design;
  std::string output;
  std::string path = "automatic";
  OutputOptions encoding;
  CellOptions cells;
  DesignGates gates;
  bool in_place = false;
  bool keep_bad = false;
};

/// Deforms once by a setup, and writes the mesh unless the design is bad.
Applied apply_by_server(const ApplyOptions& options, const CommonOptions& common);

/// Prints warnings and failures of a design and decides the exit code.
ExitCode complain_about(const Applied& applied);

}  // namespace deform::cli
