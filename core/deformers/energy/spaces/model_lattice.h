// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/handles/control_functions.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/handles/space_functions.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"
#include "core/numerics/lattice/lattice_options.h"
#include "core/numerics/lattice/lattice_sums.h"
#include "core/numerics/lattice/moved_lattice.h"

namespace deform {

/// Checks of `problems`, each under the name of its field: numbers of control points out of range, a frame without volume or not
/// finite, moved control points that are not finite, of the wrong number or more than most_moved_points.
void check_lattice(Problems& problems, const LatticeOptions& options, const Mesh& mesh);
/// The limit of moved control points. The search for local coordinates in a moved lattice stores 64 samples for each.
inline constexpr std::size_t most_moved_points = 10000;

/// Calls lattice_around() with the bounding box of a mesh.
inline Lattice lattice_of(const LatticeOptions& options, const Mesh& mesh) {
  return lattice_around(options, bounding_box(mesh.points));
}

/// The splines of the control points (columns) at points (rows), computed from the local coordinates of the points. All functions
/// are zero at points outside the lattice.
class LatticeRows : public ControlFunctions {
 public:
  LatticeRows(const Lattice& lattice, LatticeCoordinates at);

  std::int64_t rows() const override { return static_cast<std::int64_t>(u_.size()); }
  std::int64_t cols() const override { return static_cast<std::int64_t>(lattice().size()); }
  std::size_t count(std::int64_t row) const override { return is_outside(static_cast<std::size_t>(row)) ? 0 : lattice().cover(); }
  void for_each(std::int64_t row, const std::function<void(std::int64_t, double)>& use) const override {
    visit(static_cast<std::size_t>(row), [&](std::size_t p, double weight) { use(static_cast<std::int64_t>(p), weight); });
  }
  void sums(std::span<const PointId> rows, std::span<const Vec3* const> vectors, Vec3* out) const override {
    sums_(u_, rows, vectors, out);
  }
  void tile_sums(std::span<const PointId> rows, std::span<const Vec3* const> vectors, double* out) const override {
    static_assert(LatticeSums::block == tile_size);
    sums_.tile(u_, rows, vectors, out);
  }
  std::size_t bytes() const override { return u_.size() * sizeof(Vec3); }

  const Lattice& lattice() const { return sums_.lattice(); }
  bool is_outside(std::size_t point) const { return u_[point][0] < 0; }
  const Vec3& coordinates(std::size_t point) const { return u_[point]; }
  /// Calls use(control point, value) as for_each() does, without an indirection.
  template <typename Use>
  void visit(std::size_t point, const Use& use) const {
    if (!is_outside(point)) lattice().for_each(lattice().weights(u_[point]), use);
  }

 private:
  LatticeSums sums_;
  std::vector<Vec3> u_;  ///< local coordinates of each point; the first one is negative outside
};

/// The splines of the control points at any place. Lattices whose control points have been moved keep the samples from which
/// MovedLattice starts.
class LatticeFunctions : public SpaceFunctions {
 public:
  /// `control_points` as LatticeOptions has them. Throws the errors of MovedLattice.
  LatticeFunctions(const Lattice& lattice, const std::vector<Vec3>& control_points);

  /// Places outside of the lattice are Outside.
  Outside rows(std::span<const Vec3> places, std::uint64_t first, const Use& use) const override;
  Outside sums(std::span<const Vec3> places, std::uint64_t first, const Vec3* vectors, Vec3* out) const override;
  std::size_t bytes() const override;

  /// The local coordinates of points; in parallel.
  LatticeCoordinates coordinates(std::span<const Vec3> points, const RunContext& context) const;

 private:
  std::optional<Vec3> inside(const Vec3& place, std::uint64_t number) const;

  const LatticeSums sums_;
  const std::unique_ptr<const MovedLattice> moved_;  ///< null for a lattice at rest
};

/// A lattice around a mesh.
struct ModelLattice {
  Lattice lattice;                          ///< model units
  std::shared_ptr<const LatticeRows> rows;  ///< at all points
  std::shared_ptr<const LatticeFunctions> in_space;
  std::vector<std::string> notes;
  std::vector<std::uint32_t> outside;  ///< points, ascending
};

/// The lattice of a mesh. All functions are zero at points outside the lattice, so these must be fixed: throws
/// Error(invalid_argument) with their number and the first one otherwise. The displacement is discontinuous there unless the
/// region near the boundary is fixed, so a note counts the edges that cross the boundary. Local coordinates in a moved lattice
/// are those of MovedLattice, whose errors are thrown too.
ModelLattice model_lattice(const Mesh& mesh, const LatticeOptions& options, const std::vector<RegionIndex>& region_of,
                           const RunContext& context);

/// The same for handles that move control points: all points outside stay at rest and need not be fixed.
ModelLattice control_lattice(const Mesh& mesh, const LatticeOptions& options, const RunContext& context);

/// The local coordinates at which edges of faces and cells leave the lattice, for all edges from a point inside to one outside,
/// in ascending order. Coordinates are not defined outside a moved lattice; there it is the place on the boundary closest to the
/// coordinates of the point inside.
std::vector<Vec3> boundary_crossings(const Mesh& mesh, const LatticeOptions& options, const ModelLattice& made);

}  // namespace deform
