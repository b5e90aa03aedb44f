// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/numerics/sampling/sampling.h"

namespace deform {

/// The faces of a mesh, as fans of triangles around their first corner. Faces without area get no point.
class FacePieces : public Pieces {
 public:
  /// The mesh must outlive this object.
  FacePieces(const Mesh& mesh, std::span<const Vec3> points);
  std::size_t count() const override;
  double measure(std::size_t face) const override;
  Vec3 place(std::size_t face, const Vec3& random) const override;

 private:
  const Mesh& mesh_;
  std::span<const Vec3> points_;
  std::vector<std::uint64_t> offsets_;
};

/// The cells of a volume mesh, cut into tetrahedra between the mean of their corners and their faces as fans. Volumes are
/// unsigned, so that nonconvex and inverted cells are sampled too.
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
  std::vector<std::uint64_t> cell_starts_;  ///< for cells by faces: offsets into cell_faces_
  std::vector<std::uint32_t> cell_faces_;
};

/// The volume of a mesh without cells.
enum class VolumeOf {
  box,              ///< its bounding box, enlarged by D / 20 on all sides
  enclosed_or_box,  ///< the volume enclosed by its faces (EnclosedPieces), or else the box
  enclosed,         ///< the enclosed volume, or else none
};

/// The numbers of points sampled uniformly on the faces and in the cells of a mesh (thesis 8.3, 8.4). If no face has an area and
/// there are no cells, the points of the mesh represent the surface, as equal parts of an area of 1.
struct DenseCounts {
  std::size_t surface = 0, volume = 0;
  VolumeOf volume_of = VolumeOf::box;
};
DensePoints dense_points(const Mesh& mesh, std::span<const Vec3> points, const DenseCounts& counts, std::uint64_t seed,
                         const RunContext& context = {});

}  // namespace deform
