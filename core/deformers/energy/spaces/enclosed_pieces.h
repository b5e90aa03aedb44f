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

/// What the faces of a mesh enclose: where their winding number is over a half, faces that all face inwards included. In pieces
/// of equal cubes: those that no face touches and whose middle is inside, and of those that faces touch the eighths in which a
/// random point is inside.
///
/// Faces enclose a volume when nine tenths of their area lie between a winding number of 1 (to a tenth) on the one side and 0 on
/// the other. So small holes and cracks do no harm, and bowls, tubes and faces that disagree about their sides enclose nothing.
class EnclosedPieces : public Pieces {
 public:
  /// `on_faces`: points evenly distributed over the area of the faces, by which it is decided whether they enclose anything. If
  /// not, there is no piece.
  EnclosedPieces(const Mesh& mesh, std::span<const Vec3> points, std::span<const Vec3> on_faces, std::uint64_t seed,
                 const RunContext& context = {});
  std::size_t count() const override { return pieces_.size(); }
  double measure(std::size_t piece) const override;
  /// Inside, in pieces that faces touch too.
  Vec3 place(std::size_t piece, const Vec3& random) const override;

  /// The part of the area that is between inside and outside.
  double enclosing_area() const { return enclosing_area_; }

 private:
  struct Piece {
    Vec3 inside{};  ///< a point of it
    Vec3 least{};   ///< its corner
    bool whole = true;
  };

  WindingNumber winding_;
  double enclosing_area_ = 0;
  double size_ = 0;  ///< of the edges of cubes
  std::vector<Piece> pieces_;
};

/// Upper bound of the bytes of EnclosedPieces while they are made.
std::size_t enclosed_pieces_bytes(const Mesh& mesh);

}  // namespace deform
