// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/cell_options.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <nlohmann/json.hpp>

#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "core/base/number_text.h"
#include "core/base/text.h"

namespace deform::cli {

void CellOptions::add_to(CLI::App& command) {
  command
      .add_option(
          "--check", check,
          "What to find out about the faces and the cells of a volume or 2D mesh: off, amplitude (which faces flipped, which "
          "cells are inverted, and how far along the motion none is), intersections (that, and which faces ran into others), "
          "quality (that, and all measures)")
      ->transform(CLI::IsMember({"off", "amplitude", "intersections", "quality"}, CLI::ignore_case))
      ->capture_default_str();
  command
      .add_option("--split", split,
                  "Make a design that would invert cells in several steps: uniform (the least number of equal ones that inverts "
                  "none) or adaptive (steps as long as the mesh bears)")
      ->transform(CLI::IsMember({"off", "uniform", "adaptive"}, CLI::ignore_case))
      ->capture_default_str();
  command.add_option("--most-steps", most_steps, "Steps that --split tries at most")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command
      .add_option(
          "--margin", margin,
          "For --split: least scaled Jacobian (of polyhedral cells least cosine of a pyramid) that cells shall keep, below 1")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
}

void CellOptions::set(v1::DeformRequest& request) const {
  request.set_check(check == "off" ? v1::CELL_CHECK_OFF : check == "quality" ? v1::CELL_QUALITY : v1::SAFE_AMPLITUDE);
  request.set_intersections(looks_for_intersections());
  if (split == "off") return;
  request.mutable_splitting()->set_mode(split == "adaptive" ? v1::SPLIT_ADAPTIVE : v1::SPLIT_UNIFORM);
  request.mutable_splitting()->set_most_steps(most_steps);
  request.mutable_splitting()->set_margin(margin);
}

// "way 2": designs that were split before went straight and stopped earlier.
std::string CellOptions::identity() const {
  if (split == "off") return "";
  return split + " " + std::to_string(most_steps) + " way 2" + (margin > 0 ? " margin " + number_digits(margin) : "");
}

void add_findings(const v1::DesignResult& result, nlohmann::ordered_json& json) {
  if (result.has_faces()) {
    json["faces"] = result.faces().faces();
    json["flipped_faces"] = result.faces().flipped();
    json["flipped"] = std::vector<std::uint32_t>(result.faces().flipped_ids().begin(), result.faces().flipped_ids().end());
    if (result.faces().has_intersecting()) {
      json["newly_intersecting_faces"] = result.faces().intersecting();
      json["newly_intersecting"] =
          std::vector<std::uint32_t>(result.faces().intersecting_ids().begin(), result.faces().intersecting_ids().end());
    }
  }
  if (result.points_across_symmetry() > 0) json["points_across_symmetry"] = result.points_across_symmetry();
  if (result.has_cells()) json["cells"] = to_json(result.cells());
  if (result.has_quality()) json["quality"] = to_json(result.quality());
  if (result.has_split()) json["split"] = to_json(result.split());
  if (result.has_constraints()) json["constraints"] = to_json(result.constraints());
}

bool has_inverted_cells(const v1::DesignResult& result) { return !result.has_split() && result.cells().inverted() > 0; }

std::optional<double> fraction_reached(const v1::DesignResult& result) {
  const auto& split = result.split();
  return result.has_split() && (!split.inversion_free() || split.reached() < 1) ? std::optional(split.reached()) : std::nullopt;
}

namespace {

constexpr double nearly_flat = 0.05;  // normalized determinant

/// " 17, 23, ..." of ids that come worst first.
template <typename Ids>
std::string first_ids(const Ids& ids, std::uint64_t all) {
  constexpr int most = 10;
  std::string text;
  for (int k = 0; k < std::min(most, ids.size()); ++k) text += (k == 0 ? " " : ", ") + std::to_string(ids.Get(k));
  return text + (all > most ? ", ..." : "");
}

void print_faces(const v1::FaceReport& faces, std::ostream& out) {
  const bool both = faces.has_intersecting() && faces.intersecting() == 0;
  if (faces.flipped() == 0) {
    out << "  none of " << faces.faces() << " faces flipped" << (both ? " or ran into another\n" : "\n");
  } else {
    out << "  " << faces.flipped() << " of " << faces.faces()
        << " faces flipped:" << first_ids(faces.flipped_ids(), faces.flipped()) << ", worst first\n";
  }
  if (faces.intersecting() > 0) {
    out << "  " << faces.intersecting() << " of " << faces.faces()
        << " faces ran into others:" << first_ids(faces.intersecting_ids(), faces.intersecting()) << '\n';
  }
}

/// `cells` are those of the whole motion in one step, also where the design was made in several.
void print_cells(const v1::CellReport& cells, const v1::DesignResult& result, std::ostream& out) {
  const bool in_steps = result.has_split() && result.split().steps() > 1;
  out << "  " << cells.cells() << " cells, " << (in_steps ? "in one step " : "");
  if (cells.inverted() == 0 && cells.safe_amplitude() == 1) {
    out << "none is inverted";
    // A cell of 0 is flat, one of 1 at its best.
    if (const double least = cells.least_determinant(); !in_steps && least > 0 && least < nearly_flat) {
      out << "; the least determinant is " << number_text(least) << ", of cell " << cells.least_determinant_cell();
    }
  } else {
    out << cells.inverted() << (in_steps ? " would be inverted" : " inverted") << " by the full step; none before "
        << number_text(cells.safe_amplitude()) << " of it";
    if (cells.has_first_cell()) out << ", then cell " << cells.first_cell();
  }
  if (cells.without_volume() > 0) out << " (" << cells.without_volume() << " without positive volume)";
  if (cells.wrong_pyramid() > 0) out << " (" << cells.wrong_pyramid() << " with a wrong pyramid)";
  if (cells.left_handed() > 0) out << " (" << cells.left_handed() << " are left-handed and judged by the change of sign)";
  if (cells.inverted_at_rest() > 0) out << " (besides " << cells.inverted_at_rest() << " that are inverted at rest)";
  out << '\n';
  if (cells.inverted_ids_size() > 0 && !in_steps)
    out << "  worst cells:" << first_ids(cells.inverted_ids(), cells.inverted()) << '\n';
}

void print_split(const v1::SplitReport& split, std::ostream& out) {
  if (split.inversion_free()) {
    out << "  made in " << split.steps() << (split.steps() == 1 ? " step" : " steps") << " without inverted cells\n";
    return;
  }
  out << "  the motion does NOT ARRIVE: no number of steps up to " << split.steps() << " is free of inverted cells; written is "
      << number_text(split.reached()) << " of it, the farthest safe place" << (split.straight() ? " on the straight way" : "")
      << ", least determinant " << number_text(split.least_determinant()) << '\n';
  if (!split.failure().empty()) out << "  " << split.failure() << '\n';
}

void print_constraints(const v1::ConstraintsReport& constraints, std::ostream& out) {
  for (const auto& residual : constraints.residuals()) {
    out << "  " << printable(residual.name()) << ": largest " << number_text(residual.largest()) << ", rms "
        << number_text(residual.rms()) << " (without constraints " << number_text(residual.free_largest()) << ", "
        << number_text(residual.free_rms()) << ')'
        << (residual.missed() ? ", NOT EXACT: it contradicts others, or points that are held\n" : "\n");
    if (residual.has_least_height()) {
      out << "    heights of its layers: " << number_text(residual.least_height()) << " to "
          << number_text(residual.largest_height()) << " of those at rest (without constraints "
          << number_text(residual.free_least_height()) << " to " << number_text(residual.free_largest_height()) << ")\n";
    }
  }
  for (const auto& residual : constraints.residuals()) {
    if (!residual.has_held_rms()) continue;
    std::uint64_t held = 0;
    for (const auto& by : residual.held()) held += by.points();
    out << "  " << printable(residual.name()) << ": " << held << " of its points are held and by themselves miss it by up to "
        << number_text(residual.held_largest()) << ", rms " << number_text(residual.held_rms()) << '\n';
  }
  if (constraints.exact_given_up()) out << "  exact placement GIVEN UP for some constraints, see the warnings\n";
  out << "  constraints "
      << (constraints.converged()     ? "converged"
          : constraints.at_rounding() ? "converged as far as rounding allows, not to their tolerance,"
                                      : "DID NOT CONVERGE")
      << " in " << constraints.iterations() << " iterations";
  if (constraints.newton_steps() > 0) out << ", " << constraints.newton_steps() << " of them Newton steps";
  if (constraints.convergence_error() > 0)
    out << ", " << number_text(constraints.convergence_error()) << " rms from the solution";
  out << '\n';
}

}  // namespace

void print_findings(const v1::DesignResult& result, std::ostream& out) {
  if (result.has_constraints()) print_constraints(result.constraints(), out);
  if (result.has_faces()) print_faces(result.faces(), out);
  if (result.has_cells()) print_cells(result.cells(), result, out);
  if (result.has_split()) print_split(result.split(), out);
  for (const auto& measure : result.quality().measures()) {
    out << "  " << printable(measure.label()) << ": " << number_text(measure.value());
    if (measure.has_id()) out << " (" << measure.id() << ")";
    out << '\n';
  }
}

}  // namespace deform::cli
