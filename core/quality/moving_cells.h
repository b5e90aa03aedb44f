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

/// The interface of InversionCheck to one kind of cells. Any thread may call const members. Ids and numbers of points have been
/// checked by the caller.
class MovingCells {
 public:
  using PointSpan = std::span<const Vec3>;

  struct State {
    double determinant = 0;  ///< smallest normalized determinant of the cell
    bool inverted = false;
    bool without_volume = false;  ///< polyhedra: inverted because the volume is not positive
    bool wrong_pyramid = false;   ///< polyhedra: inverted because a pyramid is not positive, although the volume is
  };

  /// The nodes of all cells; those of cell i are ids[offsets[i]] .. ids[offsets[i+1]-1].
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
  /// The first s in [0, 1] at which the cell is inverted on the straight path, accurate to a few units of rounding and never too
  /// late; infinity if there is none or it is beyond `bound`. Positive if the cell is not inverted at `from`.
  virtual double first_inversion(PointSpan from, PointSpan to, std::size_t cell, double bound) const = 0;

  /// A tolerance such that motions within it invert the cell neither for state() nor for first_inversion(). At `rest` the cell
  /// must not be inverted and has this normalized determinant.
  virtual CellTolerance motion_tolerance(PointSpan rest, std::size_t cell, double determinant) const = 0;
  /// The exponent p such that a linear map with condition number chi divides a normalized determinant by at most chi^p.
  virtual int distortion() const = 0;
  /// Prepares nodes() for cells that do not store them.
  virtual void list_nodes() {}
  /// The points that a cell depends on.
  virtual NodeLists nodes() const = 0;

  /// The orientation of the cell with its nodes as given, ignoring take_as_left_handed().
  virtual Orientation orientation(PointSpan points, std::size_t cell) const = 0;
  virtual std::vector<CellLink> links() const = 0;
  /// Marks cells as left-handed, with one entry for each cell or none at all. From now on they are measured as their
  /// mirror images.
  void take_as_left_handed(std::vector<char> cells) { left_handed_ = std::move(cells); }
  bool left_handed(std::size_t cell) const { return !left_handed_.empty() && left_handed_[cell] != 0; }

 private:
  std::vector<char> left_handed_;
};

/// The cells must outlive the result. Throw Error(invalid_argument) if a cell refers to a point or face that does not exist.
std::unique_ptr<MovingCells> moving_elements(const Elements& elements, std::size_t points);
std::unique_ptr<MovingCells> moving_polyhedra(const PolyhedralCells& cells, std::size_t points);
/// The faces of a 2D mesh: triangles and quads in a plane z = constant.
std::unique_ptr<MovingCells> moving_faces(const Mesh& mesh);

}  // namespace deform::quality
