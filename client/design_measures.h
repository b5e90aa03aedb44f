// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "deform/v1/deformation.pb.h"

namespace deform::client {

/// A number of the report on a design, by the name that gates (--fail-on), studies and adapters use.
struct DesignMeasure {
  const char* name;  ///< machine-readable, "flipped_faces"
  bool counts;       ///< a number of something, so it has no derivative
  /// Nothing where it was not measured: there is nothing of that kind, or it was not asked for.
  std::optional<double> (*of)(const v1::DesignResult& result);
};

/// All of them. Thread-safe.
const std::vector<DesignMeasure>& design_measures();

/// The one with this name. Throws Error(invalid_argument) for names that are none, with suggestions.
const DesignMeasure& find_design_measure(const std::string& name);

}  // namespace deform::client
