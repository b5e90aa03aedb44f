// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/apply_report.h"

#include <nlohmann/json.hpp>

#include "client/cli/output/cell_options.h"
#include "client/cli/output/error_json.h"
#include "client/cli/output/format.h"
#include "core/base/text.h"
#include "proto/convert/method_traits.h"

namespace deform::cli {

namespace {

std::vector<std::string> all_notes(const Applied& applied) {
  std::vector<std::string> notes = applied.notes;
  notes.insert(notes.end(), applied.result.notes().begin(), applied.result.notes().end());
  notes.insert(notes.end(), applied.summary.notes().begin(), applied.summary.notes().end());
  return notes;
}

void print_displacement(const v1::DesignResult& result, std::ostream& out) {
  out << "  largest displacement " << number_text(result.max_displacement());
  const auto ratio = design_measure("displacement_ratio", result);
  if (result.prescribed_displacement() > 0 && ratio) {
    out << " (prescribed " << number_text(result.prescribed_displacement()) << ", ratio " << number_text(*ratio) << ')';
  }
  out << '\n';
}

void print_verdict(const v1::DesignResult& result, std::ostream& out) {
  if (result.verdict() == v1::VERDICT_UNKNOWN) return;
  out << "  estimated error " << number_text(result.estimated_error()) << " (" << number_text(result.relative_error())
      << " of the largest displacement): " << verdict_name(result.verdict()) << '\n';
  print_reduction_error(result.reduction_error(), out);
  const bool bad = result.verdict() == v1::VERDICT_BAD;
  for (const auto& reason : bad_reasons(result)) out << "    " << printable(reason) << '\n';
  for (const auto& reason : doubts(result)) out << (bad ? "    doubtful besides: " : "    ") << printable(reason) << '\n';
}

void print_residual(const Applied& applied, std::ostream& out) {
  if (applied.result.control_displacement() > 0) {
    out << "  control points moved by up to " << number_text(applied.result.control_displacement()) << '\n';
  }
  const bool cage = applied.method.has_cage();
  const bool controls = cage ? applied.method.cage().control() != v1::MESH : applied.method.ffd().control() == v1::CONTROLS;
  if (controls) return;  // they go where they are sent
  out << (convert::method_features(applied.method).control_points ? "  misfit at handle and fixed points "
                                                                  : "  misfit at the centres ")
      << number_text(applied.result.interpolation_residual()) << '\n';
}

}  // namespace

void print_reduction_error(double error, std::ostream& out) {
  if (!(error > 0)) return;
  out << "  not all handle and fixed points are centres: with all, points might be up to about " << number_text(error)
      << " elsewhere\n";
}

std::vector<std::string> warnings_of(const v1::DesignResult& result) {
  std::vector<std::string> warnings(result.warnings().begin(), result.warnings().end());
  constexpr double striking = 1.5;
  const auto ratio = design_measure("displacement_ratio", result);
  if (warnings.empty() && ratio && *ratio >= striking) {
    warnings.push_back("a point moves " + number_text(result.max_displacement()) + ", " + number_text(*ratio) +
                       " times the largest prescribed displacement; look at the result before using it");
  }
  return warnings;
}

nlohmann::ordered_json applied_json(const Applied& applied) {
  nlohmann::ordered_json json;
  json["file"] = applied.file;
  json["written"] = applied.written;
  json["points"] = applied.points;
  json["encoding"] = applied.encoding;
  json["max_error"] = applied.result.max_error();
  json["seconds"] = nlohmann::ordered_json::object();
  for (const auto& [stage, seconds] : applied.seconds) json["seconds"][stage] = seconds;
  auto& report = json["report"];
  report["path"] = v1::EvaluationPath_Name(applied.result.path());
  report["interpolation_residual"] = applied.result.interpolation_residual();
  report["max_displacement"] = applied.result.max_displacement();
  report["prescribed_displacement"] = applied.result.prescribed_displacement();
  if (const auto ratio = design_measure("displacement_ratio", applied.result)) report["displacement_ratio"] = *ratio;
  if (applied.result.control_displacement() > 0) report["control_displacement"] = applied.result.control_displacement();
  report["blocks_fell_back"] = applied.result.blocks_fell_back();
  report["estimated_error"] = applied.result.estimated_error();
  report["reduction_error"] = applied.result.reduction_error();
  report["relative_error"] = applied.result.relative_error();
  report["verdict"] = verdict_name(applied.result.verdict());
  report["reasons"] = std::vector<std::string>(applied.result.reasons().begin(), applied.result.reasons().end());
  add_findings(applied.result, report);
  report["bytes"] = applied.summary.bytes();
  report["prepared_again"] = applied.summary.prepared_again();
  report["notes"] = all_notes(applied);
  json["warnings"] = warnings_of(applied.result);
  json["failures"] = applied.failures;
  if (!applied.failures.empty()) json["error"] = verdict_error_json(failure_text(applied));
  return json;
}

void print_applied(const Applied& applied, std::ostream& out) {
  out << (applied.written ? "wrote " : "did NOT write ") << printable(applied.file) << ": " << applied.points << " points";
  if (applied.encoding != "none") {
    out << ", " << bytes_text(applied.summary.bytes()) << " received as " << applied.encoding << ", encoding error "
        << number_text(applied.result.max_error());
  }
  out << '\n';
  print_displacement(applied.result, out);
  print_verdict(applied.result, out);
  print_residual(applied, out);
  out << ' ';
  for (const auto& [stage, seconds] : applied.seconds) out << ' ' << stage << ' ' << duration_text(seconds);
  out << '\n';
  print_findings(applied.result, out);
  for (const auto& note : all_notes(applied)) out << "  note: " << printable(note) << '\n';
  for (const auto& warning : warnings_of(applied.result)) out << "  WARNING: " << printable(warning) << '\n';
  for (const auto& failure : applied.failures) out << "  FAILED: " << printable(failure) << '\n';
  out << std::flush;
}

std::string failure_text(const Applied& applied) {
  std::string text = applied.file + (applied.written ? "" : " was not written");
  for (std::size_t i = 0; i < applied.failures.size(); ++i) text += (i == 0 ? ": " : "; ") + applied.failures[i];
  return text + (applied.written ? "" : "; --keep-bad writes it all the same");
}

}  // namespace deform::cli
