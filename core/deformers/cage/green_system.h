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

#include "core/deformers/cage/whole_cage.h"
#include "core/deformers/handles/control_images.h"
#include "core/deformers/handles/field_tiles.h"
#include "core/deformers/handles/handle_system.h"
#include "core/numerics/cage/green.h"
#include "core/numerics/cage/stretched_normal.h"

namespace deform {

/// What coordinates are kept of: the vertices of the setup's cage that handles move, themselves or by their images, then its
/// triangles that have one of them. Images move as their originals do, so their coordinates are added up: a column for each of
/// the parts of a displacement that images take alike.
class GreenColumns {
 public:
  GreenColumns(const WholeCage& whole, const ControlSources& sources, const Symmetry& symmetry);

  const std::vector<std::uint32_t>& vertices() const { return vertices_; }  ///< of the setup's cage, ascending
  /// The triangles of the whole cage that are images 0, ascending.
  const std::vector<std::uint32_t>& triangles() const { return triangles_; }
  const std::vector<ComponentPart>& parts() const { return parts_; }
  std::size_t size() const { return parts_.size() * (vertices_.size() + triangles_.size()); }
  /// The first column of a vertex, or of a triangle, by its position in the lists; those of its parts follow.
  std::size_t of_vertex(std::size_t position) const { return parts_.size() * position; }
  std::size_t of_triangle(std::size_t position) const { return parts_.size() * (vertices_.size() + position); }
  std::size_t bytes() const;

  /// Adds up the coordinates of a place in the whole cage: out[column * stride].
  void add_up(std::span<const double> phi, std::span<const double> psi, std::size_t stride, double* out) const;

 private:
  /// A vertex or triangle of the whole cage that moves.
  struct Entry {
    std::uint32_t number, position, image;
  };
  void add(const std::vector<Entry>& entries, std::size_t first, std::span<const double> values, std::size_t stride,
           double* out) const;

  std::vector<ComponentPart> parts_;
  std::vector<std::uint32_t> vertices_, triangles_;
  std::vector<Entry> vertex_entries_, triangle_entries_;
  std::vector<double> factors_;  ///< images x parts
};

/// Handles move vertices of a cage, the other vertices stay, and the points of the mesh follow by Green coordinates: a point
/// moves by the sum of phi_i(x) times the displacements of the vertices and psi_j(x) times the changes of the stretched normals
/// of the triangles. Normals are no linear function of the vertices, so there is no handle basis; what is prepared are the
/// coordinates of the points in the vertices and triangles that handles can change. They are stored unless BasisMode says
/// otherwise.
///
/// With symmetry planes or a sector the coordinates are those of the whole cage, whose vertices move as images of those that
/// handles hold; displacements and changes of normals are in the frame of the symmetry.
class GreenSystem : public HandleSystem {
 public:
  /// `whole` is the cage of these options with its images. Throws the errors of HandleSystem and check_images(), and
  /// Error(invalid_argument) with the number of points outside the cage and the first ids.
  GreenSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const CageOptions& options, WholeCage whole,
              const RunContext& context);

  std::unique_ptr<const Evaluation> bind(std::span<const Design> designs, EvaluationPath path,
                                         const RunContext& context) const override;

 private:
  friend class GreenEvaluation;

  struct Scratch;
  struct Rejected;

  std::unique_ptr<const Evaluation> derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                               const RunContext& context) const override;
  Fields adjoint(std::span<const double> variables, Cotangents at_following, const RunContext& context) const override;
  /// For one cotangent, with the vertices moved.
  std::vector<double> adjoint(const std::vector<Vec3>& moved, const std::vector<Vec3>& at_following,
                              const RunContext& context) const;
  std::string only_on_mesh() const override { return {}; }
  std::string without_basis() const override;
  void check_motions(const BoundDesign& design, std::size_t index) const override;
  void check_motions(const std::vector<Affine>& derivative, const std::string& what) const override;

  void prepare_coordinates(BasisMode mode, const RunContext& context);
  void fill_info();
  const Symmetry& symmetry() const { return regions_.symmetry; }
  StretchedNormal::Corners corners(std::size_t triangle, std::span<const Vec3> of) const;
  /// The displacements of the vertices of the setup's cage in the frame of the symmetry or, for derivatives, their rates.
  std::vector<Vec3> displacements(const BoundDesign& design, MotionKind kind) const;
  /// Those of the vertices of the whole cage, in model coordinates.
  std::vector<Vec3> in_model(std::span<const Vec3> displacements) const;
  Vec3 in_frame(const Vec3& vector) const { return symmetry().empty() ? vector : symmetry().to_frame(vector); }
  /// The vertices moved by these. Throws Error(invalid_argument) that begins with `what` if a triangle has no normal any more.
  std::vector<Vec3> moved(std::span<const Vec3> displacements, const std::string& what) const;
  /// The vertices moved by design variables.
  std::vector<Vec3> moved_by(std::span<const double> variables) const;
  /// Writes the coordinates of the points of a tile, columns x 16, of the second of two partners those of the first. Points that
  /// do not lie in the cage are noted in `rejected`.
  void compute_tile(std::size_t tile, Scratch& scratch, double* out, Rejected* rejected) const;
  /// The same for at most 16 places, which must lie in the cage. `first` is the number of the first one; throws
  /// Error(invalid_argument) naming points[i].
  void compute_places(std::span<const Vec3> places, std::uint64_t first, Scratch& scratch, double* out) const;
  /// Writes the coordinates of one point into a tile; returns the winding number of the cage about it.
  int compute_point(const Vec3& x, Scratch& scratch, double* at) const;
  /// The coordinates of a tile: as stored, or computed to scratch.
  const double* tile(std::size_t tile, Scratch& scratch) const;

  const WholeCage whole_;
  const Cage& cage_;  ///< the whole one
  const Green coordinates_;
  const ControlSources sources_;  ///< of the vertices of the setup's cage
  const GreenColumns columns_;
  std::vector<StretchedNormal> normals_;       ///< of columns_.triangles()
  std::vector<std::array<double, 4>> fields_;  ///< of its handle at each vertex of the setup's cage, unit coordinates
  std::optional<FieldTiles> stored_;           ///< n x columns
  double rounding_ = 0;                        ///< error of the coordinates
};

/// The memory of a GreenSystem besides its coordinates and what is proportional to the points.
std::size_t green_overhead_bytes(const WholeCage& whole, const ControlSources& sources, const GreenColumns& columns);

}  // namespace deform
