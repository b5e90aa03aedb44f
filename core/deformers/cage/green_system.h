// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/deformers/handles/field_tiles.h"
#include "core/deformers/handles/handle_system.h"
#include "core/numerics/cage/cage.h"
#include "core/numerics/cage/green.h"
#include "core/numerics/cage/stretched_normal.h"

namespace deform {

/// Handles move vertices of a cage, the other vertices stay, and the points of the mesh follow by Green coordinates: a point
/// moves by the sum of phi_i(x) times the displacements of the vertices and psi_j(x) times the changes of the stretched normals
/// of the triangles. Normals are no linear function of the vertices, so there is no handle basis; what is prepared are the
/// coordinates of the points in the vertices and triangles that handles can change. They are stored unless BasisMode says
/// otherwise.
class GreenSystem : public HandleSystem {
 public:
  /// Throws the errors of HandleSystem, and Error(invalid_argument) with the number of points outside the cage and the first ids.
  GreenSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const CageOptions& options, const RunContext& context);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;

 private:
  friend class GreenEvaluation;

  /// Vertices of moving handles, then triangles that have one of them: what coordinates are kept of.
  struct Columns {
    std::vector<std::uint32_t> vertices, triangles;
    std::size_t size() const { return vertices.size() + triangles.size(); }
  };
  struct Scratch;
  struct Rejected;

  GreenSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const CageOptions& options,
              const std::shared_ptr<const Mesh>& controls, const RunContext& context);
  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  Fields adjoint(std::span<const double> variables, Cotangents at_following, const RunContext& context) const override;
  /// For one cotangent, with the vertices moved.
  std::vector<double> adjoint(const std::vector<Vec3>& moved, const std::vector<Vec3>& at_following,
                              const RunContext& context) const;
  std::string only_on_mesh() const override { return {}; }
  std::string without_basis() const override;

  void find_columns();
  void prepare_coordinates(BasisMode mode, const RunContext& context);
  void fill_info();
  bool moves(std::size_t vertex) const { return points_.region_of[vertex] < fixed_region; }
  StretchedNormal::Corners corners(std::size_t triangle, std::span<const Vec3> of) const;
  /// The displacements of all vertices of the cage or, for derivatives, their rates.
  std::vector<Vec3> displacements(const BoundDesign& design, MotionKind kind) const;
  /// The vertices moved by these. Throws Error(invalid_argument) that begins with `what` if a triangle has no normal any more.
  std::vector<Vec3> moved(std::span<const Vec3> displacements, const std::string& what) const;
  /// The vertices moved by design variables.
  std::vector<Vec3> moved_by(std::span<const double> variables) const;
  /// Writes the coordinates of the points of a tile, columns x 16. Points that do not lie in the cage are noted in `rejected`.
  void compute_tile(std::size_t tile, Scratch& scratch, double* out, Rejected* rejected) const;
  /// The same for at most 16 places, which must lie in the cage. `first` is the number of the first one; throws
  /// Error(invalid_argument) naming points[i].
  void compute_places(std::span<const Vec3> places, std::uint64_t first, Scratch& scratch, double* out) const;
  /// Writes the coordinates of one point into a tile; returns the winding number of the cage about it.
  int compute_point(const Vec3& x, Scratch& scratch, double* at) const;
  /// The coordinates of a tile: as stored, or computed to scratch.
  const double* tile(std::size_t tile, Scratch& scratch) const;

  const Cage cage_;
  const Green coordinates_;
  std::vector<StretchedNormal> normals_;  ///< of the triangles of columns_
  Columns columns_;
  std::vector<std::array<double, 4>> fields_;  ///< fields of its handle at each vertex, unit coordinates
  std::optional<FieldTiles> stored_;           ///< n x columns
  double rounding_ = 0;                        ///< error of the coordinates
};

/// The memory of the coordinates of n points in the columns that handles with these vertices need.
std::size_t green_bytes(const Cage& cage, const SelectedRegions& regions, std::size_t points);
/// What a GreenSystem takes besides.
std::size_t green_overhead_bytes(const Cage& cage);

}  // namespace deform
