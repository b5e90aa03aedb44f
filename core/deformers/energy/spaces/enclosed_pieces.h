// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/mesh/winding_number.h"
#include "core/numerics/sampling/sampling.h"

namespace deform {

/// The volume enclosed by the faces of a mesh, that is where the absolute value of their winding number exceeds 1/2. The pieces
/// are equal cubes that no face touches and whose centre is inside, and those octants of the cubes touched by faces in which a
/// random point is inside.
///
/// The faces count as enclosing a volume if on 90 % of their area the winding number is 1 on one side and 0 on the other, up to
/// 0.1. So small holes and cracks are harmless, but bowls, tubes and inconsistently oriented faces enclose nothing.
class EnclosedPieces : public Pieces {
 public:
  /// `on_faces` are points distributed uniformly over the faces, which decide whether these enclose a volume. If they do not,
  /// there are no pieces.
  EnclosedPieces(const Mesh& mesh, std::span<const Vec3> points, std::span<const Vec3> on_faces, std::uint64_t seed,
                 const RunContext& context = {});
  std::size_t count() const override { return pieces_.size(); }
  double measure(std::size_t piece) const override;
  /// A point inside the volume, even in pieces touched by faces.
  Vec3 place(std::size_t piece, const Vec3& random) const override;

  /// The fraction of the area that separates inside from outside.
  double enclosing_area() const { return enclosing_area_; }

 private:
  struct Piece {
    Vec3 inside{};  ///< a point of the piece inside the volume
    Vec3 least{};   ///< its corner with the smallest coordinates
    bool whole = true;
  };

  WindingNumber winding_;
  double enclosing_area_ = 0;
  double size_ = 0;  ///< edge length of the cubes
  std::vector<Piece> pieces_;
};

/// An upper bound of the peak memory of the construction of EnclosedPieces, in bytes.
std::size_t enclosed_pieces_bytes(const Mesh& mesh);

}  // namespace deform
