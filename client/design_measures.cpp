// SPDX-License-Identifier: Apache-2.0
#include "client/design_measures.h"

#include <algorithm>

#include "core/base/error.h"

namespace deform::client {

namespace {

using Measured = std::optional<double>;

Measured missed(const v1::DesignResult& result) {
  const auto& constraints = result.constraints();
  const auto count = std::count_if(constraints.residuals().begin(), constraints.residuals().end(),
                                   [](const v1::ConstraintResidual& residual) { return residual.missed(); });
  return std::max(static_cast<double>(count), constraints.exact_given_up() ? 1.0 : 0.0);
}

/// A split ends where nothing is inverted, be it short of the whole motion; its cells are reported for one full step.
Measured inverted_cells(const v1::DesignResult& result) {
  if (result.has_split()) return 0;
  return result.has_cells() ? Measured(static_cast<double>(result.cells().inverted())) : std::nullopt;
}

Measured safe_amplitude(const v1::DesignResult& result) {
  if (result.has_split()) return result.split().inversion_free() ? 1 : result.split().reached();
  return result.has_cells() ? Measured(result.cells().safe_amplitude()) : std::nullopt;
}

Measured least_determinant(const v1::DesignResult& result) {
  if (result.has_split()) return result.split().least_determinant();
  return result.has_cells() ? Measured(result.cells().least_determinant()) : std::nullopt;
}

Measured displacement_ratio(const v1::DesignResult& result) {
  if (result.prescribed_displacement() > 0) return result.max_displacement() / result.prescribed_displacement();
  return result.max_displacement() > 0 ? std::nullopt : Measured(1);
}

constexpr DesignMeasure measures[] = {
    {"flipped_faces", true,
     [](const v1::DesignResult& result) {
       return result.has_faces() ? Measured(static_cast<double>(result.faces().flipped())) : std::nullopt;
     }},
    {"newly_intersecting_faces", true,
     [](const v1::DesignResult& result) {
       return result.faces().has_intersecting() ? Measured(static_cast<double>(result.faces().intersecting())) : std::nullopt;
     }},
    {"points_across_symmetry", true,
     [](const v1::DesignResult& result) {
       return result.has_points_across_symmetry() ? Measured(static_cast<double>(result.points_across_symmetry())) : std::nullopt;
     }},
    {"inverted_cells", true, inverted_cells},
    {"inverted_at_rest", true,
     [](const v1::DesignResult& result) {
       return result.has_cells() ? Measured(static_cast<double>(result.cells().inverted_at_rest())) : std::nullopt;
     }},
    {"safe_amplitude", false, safe_amplitude},
    {"least_determinant", false, least_determinant},
    {"max_displacement", false, [](const v1::DesignResult& result) { return Measured(result.max_displacement()); }},
    {"prescribed_displacement", false, [](const v1::DesignResult& result) { return Measured(result.prescribed_displacement()); }},
    {"displacement_ratio", false, displacement_ratio},
    {"interpolation_residual", false, [](const v1::DesignResult& result) { return Measured(result.interpolation_residual()); }},
    {"estimated_error", false, [](const v1::DesignResult& result) { return Measured(result.estimated_error()); }},
    {"relative_error", false, [](const v1::DesignResult& result) { return Measured(result.relative_error()); }},
    {"reduction_error", false, [](const v1::DesignResult& result) { return Measured(result.reduction_error()); }},
    {"max_error", false, [](const v1::DesignResult& result) { return Measured(result.max_error()); }},
    {"missed", true, missed},
};

}  // namespace

const std::vector<DesignMeasure>& design_measures() {
  static const std::vector<DesignMeasure> all(std::begin(measures), std::end(measures));
  return all;
}

const DesignMeasure& find_design_measure(const std::string& name) {
  std::vector<std::string> names;
  std::string all;
  for (const DesignMeasure& measure : measures) {
    if (name == measure.name) return measure;
    names.emplace_back(measure.name);
    all += std::string(all.empty() ? "" : ", ") + measure.name;
  }
  const std::string near = nearest_names(name, names);
  throw Error(ErrorCode::invalid_argument, "there is no measure \"" + name + "\" of designs; " +
                                               (near.empty() ? "" : "did you mean " + near + "? ") + "there are " + all);
}

}  // namespace deform::client
