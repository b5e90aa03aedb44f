// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"

namespace deform::quality {

/// What SafeAmplitude wants to know of one kind of cells. Immutable; any thread may call. Ids and the number of points have been
/// checked.
class MovingCells {
 public:
  using PointSpan = std::span<const Vec3>;

  struct State {
    double determinant = 0;  ///< normalized, least of the cell
    bool inverted = false;
  };

  virtual ~MovingCells() = default;
  virtual std::size_t size() const = 0;
  virtual State state(PointSpan points, std::size_t cell) const = 0;
  /// The first s in [0, 1] at which the cell is inverted on the straight way, to about the last digits and never late; infinity
  /// when there is none or it lies beyond `bound`. Positive where the cell is not inverted at `from`.
  virtual double first_inversion(PointSpan from, PointSpan to, std::size_t cell, double bound) const = 0;
};

/// Whatever they refer to must live as long. They throw Error(invalid_argument) where a cell names what does not exist.
std::unique_ptr<const MovingCells> moving_elements(const Elements& elements, std::size_t points);
std::unique_ptr<const MovingCells> moving_polyhedra(const PolyhedralCells& cells, std::size_t points);
/// Of triangles and quads in a plane z = constant; their orientation is that of most of the area of `rest`.
std::unique_ptr<const MovingCells> moving_faces(const Mesh& mesh, std::span<const Vec3> rest);

}  // namespace deform::quality
