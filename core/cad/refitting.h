// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Geom_Curve.hxx>
#include <Geom_Surface.hxx>
#include <array>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/cad/model.h"
#include "core/cad/spline_axis.h"

namespace deform::cad {

/// What became of a surface or curve.
enum class Refit { kept, moved, fitted };

/// The geometry of a model after a map of space, found in rounds: it says at which points it wants to know the map, is told, and
/// asks again until the splines meet the map within the tolerance. A surface is interpolated over the (u, v) box of its face, and
/// a curve over the range of its edge, in their own parameters; so curves in (u, v) stay what they are. Surfaces and curves that
/// move rigidly at all samples are transformed instead. Not thread-safe.
class Refitting {
 public:
  /// The model has no locations; every edge has a curve or is degenerate. tolerance: of splines, rigid: of
  /// rigid motions, model units. It keeps a reference.
  Refitting(const Model& model, double tolerance, double rigid);

  /// The points at which the map is wanted; none: done.
  const Points& wanted();
  /// Where the map takes the wanted points. Throws Error(invalid_argument) naming a face where it is not finite.
  void give(const Points& places);

  /// Goes on with finer nodes around places (u, v) of a face where the fit is off; returns false when they cannot become finer.
  bool refine_face(int f, const std::vector<std::array<double, 2>>& places);

  /// Of a finished round. Faces and edges by number from 0; the curve of a degenerate edge is null.
  Handle(Geom_Surface) surface(int f) const;
  Handle(Geom_Curve) curve(int e) const;
  const Vec3& vertex(int v) const { return vertices_[v]; }
  Refit refit(int f) const { return faces_[f].refit; }
  std::array<int, 2> nodes(int f) const;  ///< of a fitted face, along u and v

 private:
  struct Fit {
    SplineAxis u, v;  ///< v of an edge has no meaning
    Handle(Geom_Surface) surface;
    Handle(Geom_Curve) curve;
    std::array<double, 2> spacing{};  ///< of checks
    std::map<std::array<double, 2>, Vec3> places{};
    bool open = true, judged = false;
    Refit refit = Refit::fitted;
    gp_Trsf motion{};
    Vec3 at(const std::array<double, 2>& parameters) const;
    int axes() const { return surface.IsNull() ? 1 : 2; }
  };
  struct Wanted {
    Fit* fit;
    std::array<double, 2> parameters;
  };

  Fit face_fit(int f) const;
  Fit edge_fit(int e) const;
  void want(Fit& fit);
  void judge(Fit& fit) const;
  bool moves_rigidly(Fit& fit) const;
  std::set<int> bad_intervals(const Fit& fit, int axis) const;

  const Model& model_;
  const double tolerance_, rigid_;
  std::vector<Fit> faces_, edges_;
  Points vertices_;
  bool vertices_known_ = false;
  std::vector<Wanted> asked_;
  Points wanted_;
};

}  // namespace deform::cad
