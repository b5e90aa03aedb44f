// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "client/cli/output/gates.h"
#include "deform/v1/deformation.pb.h"

namespace deform::cli {

/// What became of one design.
struct Applied {
  std::string file;
  std::size_t points = 0;
  v1::DesignResult result;
  v1::DeformSummary summary;
  std::vector<std::pair<std::string, double>> seconds;  ///< by stage
  std::string encoding;                                 ///< "none": no points were received
  v1::Method method;                                    ///< of the system
  std::vector<std::string> notes;                       ///< our own; those of the server are in `summary`
  std::vector<std::string> failures;                    ///< gates and verdicts
  bool written = true;
};

/// What deserves a look although it is no failure: the server's warnings, or our own when it has none and a point moves 1.5 times
/// the largest prescribed displacement.
std::vector<std::string> warnings_of(const v1::DesignResult& result);

/// A line about DesignResult.reduction_error, or that of EvaluateResult, model units; nothing where all points are centres.
void print_reduction_error(double error, std::ostream& out);

nlohmann::ordered_json applied_json(const Applied& applied);
void print_applied(const Applied& applied, std::ostream& out);

/// One line that says why the command fails; `failures` is not empty.
std::string failure_text(const Applied& applied);

}  // namespace deform::cli
