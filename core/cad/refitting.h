// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <GeomAdaptor_Surface.hxx>
#include <Geom_Curve.hxx>
#include <Geom_ElementarySurface.hxx>
#include <Geom_Surface.hxx>
#include <array>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/cad/face_region.h"
#include "core/cad/held_faces.h"
#include "core/cad/model.h"
#include "core/cad/spline_fit.h"

namespace deform::cad {

/// What became of a surface or curve. reshaped: a plane, cylinder, cone or sphere is one still, elsewhere or with other
/// dimensions, and points slide in it: (u, v) of its edges are new.
enum class Refit { kept, moved, reshaped, fitted };

/// The geometry of a model after a map of space, found in rounds: it names the points at which it needs the map, takes the
/// values, and asks again until the splines meet the map within the tolerance. A surface is interpolated over the (u, v) box of
/// its face, and a curve over the range of its edge, in their own parameters; so curves in (u, v) stay what they are. What moves
/// rigidly at all samples in the trimmed face is transformed instead, and what is nearest to a surface of its own analytic type
/// becomes that. Not thread-safe.
class Refitting {
 public:
  struct Limits {
    double spline = 0;    ///< tolerance of splines
    double rigid = 0;     ///< of rigid motions
    double reshaped = 0;  ///< distance from an analytic surface
  };
  /// The model has no locations; every edge has a curve or is degenerate. limits: model units. It keeps references; held may be
  /// null.
  Refitting(const Model& model, const Limits& limits, const HeldFaces* held = nullptr);

  /// The points at which the map is wanted; none: done.
  const Points& wanted();
  /// Where the map takes the wanted points. Throws Error(invalid_argument) naming a face where it is not finite.
  void give(const Points& places);

  /// Goes on with splines for faces that seemed to move rigidly or keep their type where nodes of their edges, which lie closer
  /// by now, are off. Returns whether there were any.
  bool check_borders();

  /// Goes on with finer nodes around places (u, v) of a face where the fit is off; returns false when they cannot become finer.
  bool refine_face(int f, const std::vector<std::array<double, 2>>& places);

  /// The same for the parameters of an edge.
  bool refine_edge(int e, const std::vector<double>& parameters);

  /// The geometry after a finished round. Faces and edges by number from 0; the curve of a degenerate edge is null.
  Handle(Geom_Surface) surface(int f) const;
  Handle(Geom_Curve) curve(int e) const;
  const Vec3& vertex(int v) const { return vertices_[v]; }
  Refit refit(int f) const { return faces_[f].refit; }
  /// Whether a moved face is as a uniform scale makes it.
  bool scaled(int f) const;
  std::array<int, 2> nodes(int f) const;  ///< of a fitted face, along u and v
  /// Distance of the new surface of a face from where the map takes its point (u, v); of a reshaped one the distance from it.
  double error(int f, const std::array<double, 2>& uv, const Vec3& target) const;
  /// Distance of the new curve of an edge from where the map takes its point.
  double edge_error(int e, double t, const Vec3& target) const;
  bool edge_held(int e) const { return edges_[e].held; }  ///< with a held face
  /// The new surface of a reshaped face, else null.
  const Handle(Geom_ElementarySurface) & reshaped(int f) const { return faces_[f].reshaped; }

  /// Whether the face goes as the nodes of the mesh on it do, not as the map between them.
  bool held(int f) const { return faces_[f].held; }

  const FaceRegion& region(int f) const { return faces_[f].region; }
  Vec3 at_rest(int f, const std::array<double, 2>& uv) const;
  /// A point of a face, and the derivatives along u and v.
  std::array<Vec3, 3> frame_at_rest(int f, const std::array<double, 2>& uv) const;
  Vec3 edge_at_rest(int e, double t) const;

 private:
  struct Edge {
    Handle(Geom_Curve) rest;  ///< null: degenerate
    SplineFit fit;
    Refit refit = Refit::fitted;
    bool open = true, judged = false;
    gp_Trsf motion{};
    bool held = false;
    Handle(Geom_ElementarySurface) onto{};  ///< of a held face: where its places are projected
  };
  struct Face {
    Handle(Geom_Surface) rest;
    GeomAdaptor_Surface adaptor;
    FaceRegion region;
    SplineFit fit;
    Refit refit = Refit::fitted;
    bool open = true, judged = false;
    gp_Trsf motion{};
    Handle(Geom_ElementarySurface) reshaped{};
    bool held = false;
  };
  struct Wanted {
    int face, edge;  ///< one of them is -1
    SplineFit::Parameters at;
  };
  Face face_of(int f) const;
  Edge edge_of(int e) const;
  void judge(int f);
  bool may_be_reshaped(int f) const;
  bool has_degenerate_edge(int f) const;
  void align_seam(int f);
  bool hold(int f, const PlaceSamples& samples);
  void hold_borders();
  void judge(Edge& edge) const;
  PlaceSamples samples_of(int f) const;
  static PlaceSamples samples_of(const Edge& edge);
  enum class Motions { rigid, similar };
  bool moves(const PlaceSamples& samples, Motions motions, Refit& refit, gp_Trsf& motion) const;

  const Model& model_;
  const Limits limits_;
  const HeldFaces* held_;
  std::vector<Face> faces_;
  std::vector<Edge> edges_;
  Points vertices_;
  bool vertices_known_ = false;
  std::vector<Wanted> asked_;
  Points wanted_;
};

}  // namespace deform::cad
