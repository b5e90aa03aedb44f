// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"

namespace deform {

/// Scalar fields on the points of a mesh whose combinations are the displacements of many designs: design k moves point i by the
/// sum over the fields f of phi_f(i) c_f, with one vector c_f per field (FieldMotion), up to the stated errors. Immutable; any
/// thread may call.
class DisplacementFields {
 public:
  virtual ~DisplacementFields() = default;
  virtual std::size_t count() const = 0;  ///< number of fields
  /// Writes the values of the fields [first, first + count) at all points, in the order of the points: values[i * count + k] is
  /// that of field first + k at point i. Throws Error(cancelled), Error(deadline_exceeded).
  virtual void values(std::size_t first, std::size_t count, std::span<double> values, const RunContext& context) const = 0;
  /// The largest error of the values of a field at any point: designs are evaluated with values that differ from these by no
  /// more.
  virtual double error(std::size_t field) const = 0;
};

/// The motion of one design from rest as a combination of DisplacementFields. Lengths in model units.
struct FieldMotion {
  std::vector<Vec3> coefficients;  ///< one for each field
  /// For each field, a bound of the error of its coefficient that includes the rounding of the sum over the fields.
  std::vector<double> uncertainties;
  double rounding = 0;  ///< a bound of the remaining error of any delivered point
};

}  // namespace deform
