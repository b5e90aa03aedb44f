// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "client/cli/commands/command.h"
#include "deform/v1/deformation.pb.h"

namespace deform::cli {

/// --check, --split, --most-steps, --margin: what is done about cells that would be inverted.
struct CellOptions {
  std::string check = "amplitude";
  std::string split = "off";
  unsigned most_steps = 20;
  double margin = 0;

  void add_to(CLI::App& command);
  void set(v1::DeformRequest& request) const;
  bool looks_for_intersections() const { return check == "intersections" || check == "quality"; }
  /// Looks for what a gate is about, unless nothing is looked at.
  void look_for_intersections() {
    if (check == "amplitude") check = "intersections";
  }
  /// What of it determines the points of a result; empty without splitting.
  std::string identity() const;
};

/// What the server found out about the cells of a design: keys "cells", "quality", "split" and "constraints", those
/// that are there.
void add_findings(const v1::DesignResult& result, nlohmann::ordered_json& json);
/// For people, a line each; nothing without cells.
void print_findings(const v1::DesignResult& result, std::ostream& out);

/// Cells are inverted in the points that came: never after splitting, which ends where none is.
bool has_inverted_cells(const v1::DesignResult& result);
/// How much of the motion the points have made when a split did not arrive.
std::optional<double> fraction_reached(const v1::DesignResult& result);

}  // namespace deform::cli
