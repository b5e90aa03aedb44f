// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/numerics/sampling/sampling.h"

namespace deform {

/// The faces of a mesh, fanned into triangles from their first corner. Faces without area get no point.
class FacePieces : public Pieces {
 public:
  /// The mesh must outlive this.
  FacePieces(const Mesh& mesh, std::span<const Vec3> points);
  std::size_t count() const override;
  double measure(std::size_t face) const override;
  Vec3 place(std::size_t face, const Vec3& random) const override;

 private:
  const Mesh& mesh_;
  std::span<const Vec3> points_;
  std::vector<std::uint64_t> offsets_;
};

/// The cells of a volume mesh, cut into tetrahedra between the mean of their corners and their fanned faces; by the size of these
/// without sign, so that cells that are not convex, or inverted, are sampled too.
class CellPieces : public Pieces {
 public:
  CellPieces(const Mesh& mesh, std::span<const Vec3> points);
  std::size_t count() const override;
  double measure(std::size_t cell) const override;
  Vec3 place(std::size_t cell, const Vec3& random) const override;

 private:
  /// Calls use(corner, corner, corner) for the triangles of a cell.
  template <typename Use>
  void triangles(std::size_t cell, const Use& use) const;
  Vec3 middle(std::size_t cell) const;

  const Mesh& mesh_;
  std::span<const Vec3> points_;
  std::vector<std::uint64_t> cell_starts_;  ///< of cells by faces: where their faces stand in cell_faces_
  std::vector<std::uint32_t> cell_faces_;
};

/// The volume of a mesh without cells.
enum class VolumeOf {
  box,              ///< its bounding box, a twentieth of the diagonal larger on all sides
  enclosed_or_box,  ///< what its faces enclose (EnclosedPieces); if they do not, the box
  enclosed,         ///< if they do not, there is none
};

/// What is sampled of a mesh (thesis 8.3, 8.4): `surface` points spread uniformly over the faces and `volume` ones in the cells.
/// Without faces of any area and without cells the surface is the points themselves, each an equal part of an area of 1.
struct DenseCounts {
  std::size_t surface = 0, volume = 0;
  VolumeOf volume_of = VolumeOf::box;
};
DensePoints dense_points(const Mesh& mesh, std::span<const Vec3> points, const DenseCounts& counts, std::uint64_t seed,
                         const RunContext& context = {});

}  // namespace deform
