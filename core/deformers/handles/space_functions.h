// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/base/types.h"
#include "core/base/vectors.h"

namespace deform {

/// The functions that span a space deformation, at any place: what ComputedRows or SparseRows hold for the points of a mesh.
/// At the coordinates of a point of the mesh the values are those of its row, bit for bit. Immutable; any thread.
class SpaceFunctions {
 public:
  using Use = std::function<void(std::size_t place, std::int64_t column, double value)>;
  /// The positions of places at which no deformation is defined, such as those outside of a lattice; they stay at rest.
  using Outside = std::vector<std::size_t>;

  virtual ~SpaceFunctions() = default;
  /// Calls use(position of the place, column, value) for all entries, columns ascending for each place. Places are in model
  /// units; `first` is the number of the first one, for messages. Throws Error(invalid_argument) naming points[i].
  virtual Outside rows(std::span<const Vec3> places, std::uint64_t first, const Use& use) const = 0;
  /// out[i] = sum over the entries of place i of value times vectors[column], added up as ControlFunctions::sums() does at the
  /// points of a mesh.
  virtual Outside sums(std::span<const Vec3> places, std::uint64_t first, const Vec3* vectors, Vec3* out) const {
    for (std::size_t i = 0; i < places.size(); ++i) out[i] = {};
    return rows(places, first,
                [&](std::size_t place, std::int64_t column, double value) { out[place] = out[place] + value * vectors[column]; });
  }
  /// The memory of this object in bytes.
  virtual std::size_t bytes() const = 0;
};

}  // namespace deform
