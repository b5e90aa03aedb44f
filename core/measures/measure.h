// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"

namespace deform::measures {

/// Whether evaluate() gives gradients.
enum class Gradients { left_out, wanted };

/// The least of the samples that a measure aggregates: the true minimum over them, and where it is taken.
struct Least {
  double value = 0;         ///< of the sample, model units
  Vec3 at{};                ///< the place of the sample
  std::size_t index = 0;    ///< of thickness the id of its face, of clearance the id of its point
  double tolerance = 0;     ///< the aggregated value lies between `value` - `tolerance` and `value`
  std::size_t samples = 0;  ///< number of samples that have a value
  double covering = 0;      ///< of clearance: no place of the faces is farther than this from a sample; 0 of thickness
};

/// What a measure gives for one design.
struct Measurement {
  std::vector<double> values;  ///< m, Measure::value_count()
  std::vector<Points>
      gradients;               ///< m fields of n x 3, the derivatives of each value at the points; empty where they were left out
  std::optional<Least> least;  ///< of measures that aggregate samples
};

/// A number, or several, of the shape of a mesh, prepared for its faces and evaluated for designs, which have the same faces and
/// other points. Gradients are the exact derivatives of the values; where a value has a kink (two samples that change places as
/// the nearest, a face whose area vanishes) they are those of one side. Immutable; any number of threads may evaluate at once.
/// Results have the same bits for any number of threads.
class Measure {
 public:
  virtual ~Measure() = default;
  Measure(const Measure&) = delete;
  Measure& operator=(const Measure&) = delete;

  /// n, the number of points that a design has.
  std::size_t point_count() const { return point_count_; }
  virtual std::size_t value_count() const { return 1; }  ///< m

  /// The values of a design, in units of model units, their squares or cubes. Throws Error(invalid_argument) naming `points` for
  /// another number of points than point_count() and coordinates that are not finite, Error(numerical_failure) where the shape
  /// has no such value, Error(cancelled) and Error(deadline_exceeded).
  Measurement evaluate(std::span<const Vec3> points, Gradients gradients, const RunContext& context = {}) const;

 protected:
  /// Takes n, the number of points of the mesh.
  explicit Measure(std::size_t point_count) : point_count_(point_count) {}

 private:
  /// evaluate() for points that were checked.
  virtual Measurement measured(std::span<const Vec3> points, Gradients gradients, const RunContext& context) const = 0;

  std::size_t point_count_;
};

}  // namespace deform::measures
