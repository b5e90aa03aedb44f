// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <TopoDS_Face.hxx>
#include <array>
#include <vector>

namespace deform::cad {

/// Which (u, v) lie inside of a trimmed face, from polygons along the curves of its edges: quick, and wrong only within about
/// 1e-3 of the size of a curve beside it. Immutable; any thread may call.
class FaceRegion {
 public:
  /// The face with its curves in (u, v); taken forwards.
  explicit FaceRegion(const TopoDS_Face& face);

  bool contains(double u, double v) const;
  /// The box of the face: least and largest u, least and largest v.
  const std::array<double, 4>& box() const { return box_; }

 private:
  struct Segment {
    double u0, v0, u1, v1;
  };
  std::size_t row_of(double v) const;
  void add_wire(std::vector<std::vector<std::array<double, 2>>> polygons);

  std::array<double, 4> box_{};
  std::vector<Segment> segments_;
  std::vector<std::vector<int>> rows_;  ///< segments that reach into each of the equal parts of the range of v
};

}  // namespace deform::cad
