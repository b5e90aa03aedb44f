// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"
#include "core/quality/cell_tolerance.h"
#include "core/quality/handedness.h"

namespace deform::quality {

/// What SafeAmplitude wants to know of one kind of cells. Any thread may call what is const. Ids and the number of points have
/// been checked.
class MovingCells {
 public:
  using PointSpan = std::span<const Vec3>;

  struct State {
    double determinant = 0;  ///< normalized, least of the cell
    bool inverted = false;
    bool without_volume = false;  ///< of polyhedra: inverted because the volume is not positive
    bool wrong_pyramid = false;   ///< or, the volume being positive, because a pyramid is not
  };

  /// Of cell i: ids[offsets[i]] .. ids[offsets[i+1]-1].
  struct NodeLists {
    std::span<const std::uint64_t> offsets;
    std::span<const PointId> ids;
    std::size_t count(std::size_t cell) const { return static_cast<std::size_t>(offsets[cell + 1] - offsets[cell]); }
    std::span<const PointId> of(std::size_t cell) const {
      return ids.subspan(static_cast<std::size_t>(offsets[cell]), count(cell));
    }
  };

  virtual ~MovingCells() = default;
  virtual std::size_t size() const = 0;
  virtual State state(PointSpan points, std::size_t cell) const = 0;
  /// The first s in [0, 1] at which the cell is inverted on the straight way, to about the last digits and never late; infinity
  /// when there is none or it lies beyond `bound`. Positive where the cell is not inverted at `from`.
  virtual double first_inversion(PointSpan from, PointSpan to, std::size_t cell, double bound) const = 0;

  /// Every motion it allows leaves the cell sound for state() and first_inversion(). `rest`: where the cell is not inverted and
  /// has this normalized determinant.
  virtual CellTolerance motion_tolerance(PointSpan rest, std::size_t cell, double determinant) const = 0;
  /// A matrix of condition chi divides a normalized determinant by at most chi to this power.
  virtual int distortion() const = 0;
  /// Makes nodes() known where the cells do not have them.
  virtual void list_nodes() {}
  /// The points that a cell depends on.
  virtual NodeLists nodes() const = 0;

  /// Of the cell as the format has its nodes, whatever is said below.
  virtual Orientation orientation(PointSpan points, std::size_t cell) const = 0;
  virtual std::vector<CellLink> links() const = 0;
  /// These cells, one entry each, are good as mirror images: from now on they are measured like that. Empty: none.
  void take_as_left_handed(std::vector<char> cells) { left_handed_ = std::move(cells); }
  bool left_handed(std::size_t cell) const { return !left_handed_.empty() && left_handed_[cell] != 0; }

 private:
  std::vector<char> left_handed_;
};

/// Whatever they refer to must live as long. They throw Error(invalid_argument) where a cell names what does not exist.
std::unique_ptr<MovingCells> moving_elements(const Elements& elements, std::size_t points);
std::unique_ptr<MovingCells> moving_polyhedra(const PolyhedralCells& cells, std::size_t points);
/// Of triangles and quads in a plane z = constant.
std::unique_ptr<MovingCells> moving_faces(const Mesh& mesh);

}  // namespace deform::quality
