// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/refitting.h"

#include <BRep_Tool.hxx>
#include <GeomAdaptor_Curve.hxx>
#include <Geom_BSplineCurve.hxx>
#include <Geom_BSplineSurface.hxx>
#include <Geom_Circle.hxx>
#include <Geom_ConicalSurface.hxx>
#include <Geom_Ellipse.hxx>
#include <Geom_SphericalSurface.hxx>
#include <Geom_ToroidalSurface.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TopExp.hxx>
#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/cad/analytic_fit.h"
#include "core/cad/coordinates.h"

namespace deform::cad {

namespace {

constexpr double fit_share = 0.35;          ///< of the tolerance, for each of u and v
constexpr double pole_share = 0.01;         ///< of the limit of reshaped faces, where u near an apex shall mean something
constexpr double box_margin = 1e-6;         ///< pcurves may leave the box of a face by their tolerance
constexpr double check_spacing = 1.0 / 24;  ///< of D

Vec3 projected(const Geom_ElementarySurface& surface, const Vec3& p) {
  const std::array<double, 2> uv = analytic_parameters(surface, p, 0);
  return coordinates(surface.Value(uv[0], uv[1]));
}

/// Ascending parameters from a to b, with those between at which the geometry is less than C2.
template <typename Count, typename Fill>
std::vector<double> breaks_between(double a, double b, const Count& count, const Fill& fill) {
  std::vector<double> breaks{a};
  const int intervals = count();
  if (intervals > 1) {
    TColStd_Array1OfReal ends(1, intervals + 1);
    fill(ends);
    const double least = 1e-9 * (b - a);
    for (int k = 2; k <= intervals; ++k) {
      if (ends(k) > breaks.back() + least && ends(k) < b - least) breaks.push_back(ends(k));
    }
  }
  breaks.push_back(b);
  return breaks;
}

/// Length of a polygon through the curve p(0), ..., p(1).
template <typename Curve>
double rough_length(const Curve& p) {
  constexpr int pieces = 16;
  double sum = 0;
  gp_Pnt last = p(0.0);
  for (int k = 1; k <= pieces; ++k) {
    const gp_Pnt next = p(static_cast<double>(k) / pieces);
    sum += last.Distance(next);
    last = next;
  }
  return sum;
}

}  // namespace

Refitting::Refitting(const Model& model, const Limits& limits, const HeldFaces* held)
    : model_(model), limits_(limits), held_(held) {
  for (int f = 0; f < model.face_count(); ++f) faces_.push_back(face_of(f));
  for (int e = 0; e < model.edge_count(); ++e) edges_.push_back(edge_of(e));
}

Vec3 Refitting::at_rest(int f, const std::array<double, 2>& uv) const {
  return coordinates(faces_[f].adaptor.Value(uv[0], uv[1]));
}

std::array<Vec3, 3> Refitting::frame_at_rest(int f, const std::array<double, 2>& uv) const {
  gp_Pnt p;
  gp_Vec along_u, along_v;
  faces_[f].adaptor.D1(uv[0], uv[1], p, along_u, along_v);
  return {coordinates(p), {along_u.X(), along_u.Y(), along_u.Z()}, {along_v.X(), along_v.Y(), along_v.Z()}};
}

Refitting::Face Refitting::face_of(int f) const {
  const Handle(Geom_Surface) surface = BRep_Tool::Surface(model_.face(f));
  FaceRegion region(model_.face(f));
  std::array<double, 2> from{region.box()[0], region.box()[2]}, to{region.box()[1], region.box()[3]}, least{}, most{};
  surface->Bounds(least[0], most[0], least[1], most[1]);
  const std::array<double, 2> period{surface->IsUPeriodic() ? surface->UPeriod() : 0,
                                     surface->IsVPeriodic() ? surface->VPeriod() : 0};
  for (int k = 0; k < 2; ++k) {
    const double margin = box_margin * (to[k] - from[k]);
    if (period[k] > 0) {
      if (to[k] - from[k] + 2 * margin > period[k]) continue;
      from[k] -= margin, to[k] += margin;
    } else {
      from[k] = std::max(from[k] - margin, least[k]), to[k] = std::min(to[k] + margin, most[k]);
    }
  }
  const GeomAdaptor_Surface adaptor(surface, from[0], to[0], from[1], to[1]);
  SplineAxis u(breaks_between(
      from[0], to[0], [&] { return adaptor.NbUIntervals(GeomAbs_C2); },
      [&](TColStd_Array1OfReal& ends) { adaptor.UIntervals(ends, GeomAbs_C2); }));
  SplineAxis v(breaks_between(
      from[1], to[1], [&] { return adaptor.NbVIntervals(GeomAbs_C2); },
      [&](TColStd_Array1OfReal& ends) { adaptor.VIntervals(ends, GeomAbs_C2); }));
  const auto value = [&](double a, double b) {
    return adaptor.Value(from[0] + a * (to[0] - from[0]), from[1] + b * (to[1] - from[1]));
  };
  std::array<double, 2> size{}, spacing{};
  for (const double other : {0.0, 0.5, 1.0}) {
    size[0] = std::max(size[0], rough_length([&](double a) { return value(a, other); }));
    size[1] = std::max(size[1], rough_length([&](double a) { return value(other, a); }));
  }
  for (int k = 0; k < 2; ++k) {
    const double pieces = std::max(1.0, size[k] / (check_spacing * model_.diagonal));
    spacing[k] = (to[k] - from[k]) / pieces;
  }
  return {surface, adaptor, std::move(region), SplineFit(std::move(u), std::move(v), spacing)};
}

Refitting::Edge Refitting::edge_of(int e) const {
  double from = 0, to = 1;
  const Handle(Geom_Curve) curve = BRep_Tool::Curve(model_.edge(e), from, to);
  if (curve.IsNull()) return {nullptr, SplineFit(SplineAxis({0, 1}), 1), Refit::kept, false};
  const GeomAdaptor_Curve adaptor(curve, from, to);
  SplineAxis t(breaks_between(
      from, to, [&] { return adaptor.NbIntervals(GeomAbs_C2); },
      [&](TColStd_Array1OfReal& ends) { adaptor.Intervals(ends, GeomAbs_C2); }));
  const double size = rough_length([&](double a) { return adaptor.Value(from + a * (to - from)); });
  return {curve, SplineFit(std::move(t), (to - from) / std::max(1.0, size / (check_spacing * model_.diagonal)))};
}

const Points& Refitting::wanted() {
  asked_.clear();
  wanted_.clear();
  for (int f = 0; f < model_.face_count(); ++f) {
    if (!faces_[f].open) continue;
    faces_[f].fit.want([&](const SplineFit::Parameters& at) {
      asked_.push_back({f, -1, at});
      wanted_.push_back(at_rest(f, at));
    });
  }
  for (int e = 0; e < model_.edge_count(); ++e) {
    if (!edges_[e].open) continue;
    edges_[e].fit.want([&](const SplineFit::Parameters& at) {
      asked_.push_back({-1, e, at});
      wanted_.push_back(coordinates(edges_[e].rest->Value(at[0])));
    });
  }
  if (!vertices_known_) {
    for (int v = 0; v < model_.vertex_count(); ++v) wanted_.push_back(coordinates(BRep_Tool::Pnt(model_.vertex(v))));
  }
  return wanted_;
}

void Refitting::give(const Points& places) {
  for (std::size_t i = 0; i < asked_.size(); ++i) {
    const Wanted& asked = asked_[i];
    if (!is_finite(places[i])) {
      throw Error(ErrorCode::invalid_argument,
                  (asked.face >= 0 ? model_.face_name(asked.face) : "edge " + std::to_string(asked.edge + 1)) +
                      ": the deformation is not finite there");
    }
    if (asked.face >= 0) {
      faces_[asked.face].fit.give(asked.at, places[i]);
    } else {
      Edge& edge = edges_[asked.edge];
      edge.fit.give(asked.at, edge.onto.IsNull() ? places[i] : projected(*edge.onto, places[i]));
    }
  }
  if (!vertices_known_) {
    vertices_.assign(places.begin() + static_cast<std::ptrdiff_t>(asked_.size()), places.end());
  }
  for (int f = 0; f < model_.face_count(); ++f) {
    if (faces_[f].open) judge(f);
  }
  if (!vertices_known_) hold_borders();
  vertices_known_ = true;
  for (Edge& edge : edges_) {
    if (edge.open) judge(edge);
  }
}

PlaceSamples Refitting::samples_of(const Edge& edge) {
  const auto count = static_cast<Eigen::Index>(edge.fit.places().size());
  PlaceSamples samples{Eigen::Matrix3Xd(3, count), Eigen::Matrix3Xd(3, count)};
  Eigen::Index i = 0;
  for (const auto& [at, place] : edge.fit.places()) {
    const Vec3 rest = coordinates(edge.rest->Value(at[0]));
    samples.before.col(i) << rest[0], rest[1], rest[2];
    samples.after.col(i++) << place[0], place[1], place[2];
  }
  return samples;
}

/// Those in the trimmed face, and those of its edges.
PlaceSamples Refitting::samples_of(int f) const {
  std::vector<PlaceSamples> parts;
  std::vector<bool> seen(edges_.size(), false);
  for (const Coedge& use : model_.coedges[f]) {
    if (!edges_[use.edge].rest.IsNull() && !seen[use.edge]) parts.push_back(samples_of(edges_[use.edge]));
    seen[use.edge] = true;
  }
  Points before, after;
  for (const auto& [at, place] : faces_[f].fit.places()) {
    if (!faces_[f].region.contains(at[0], at[1])) continue;
    before.push_back(at_rest(f, at));
    after.push_back(place);
  }
  auto count = static_cast<Eigen::Index>(before.size());
  for (const PlaceSamples& part : parts) count += part.before.cols();
  PlaceSamples all{Eigen::Matrix3Xd(3, count), Eigen::Matrix3Xd(3, count)};
  Eigen::Index i = 0;
  for (const PlaceSamples& part : parts) {
    all.before.middleCols(i, part.before.cols()) = part.before;
    all.after.middleCols(i, part.after.cols()) = part.after;
    i += part.before.cols();
  }
  for (std::size_t k = 0; k < before.size(); ++k, ++i) {
    all.before.col(i) << before[k][0], before[k][1], before[k][2];
    all.after.col(i) << after[k][0], after[k][1], after[k][2];
  }
  return all;
}

/// Rigidly, or with a uniform scale.
bool Refitting::moves(const PlaceSamples& samples, Motions motions, Refit& refit, gp_Trsf& motion) const {
  const auto& [before, after] = samples;
  if (before.cols() == 0) return false;
  if ((after - before).colwise().norm().maxCoeff() <= limits_.rigid) {
    refit = Refit::kept;
    return true;
  }
  const RigidMotion best = motions == Motions::rigid ? best_motion(before, after) : best_similarity(before, after);
  if (!(best.scale > 0)) return false;
  for (Eigen::Index i = 0; i < before.cols(); ++i) {
    if ((after.col(i) - best(before.col(i))).norm() > limits_.rigid) return false;
  }
  motion = transformation_of(best);
  refit = Refit::moved;
  return true;
}

void Refitting::judge(int f) {
  Face& face = faces_[f];
  face.open = false;
  const bool first = !face.judged;
  face.judged = true;
  if (first) {
    const PlaceSamples samples = samples_of(f);
    if (moves(samples, Motions::rigid, face.refit, face.motion)) return;
    // Others, such as planes, have lengths in (u, v).
    const bool scalable = face.rest->IsKind(STANDARD_TYPE(Geom_SphericalSurface)) ||
                          face.rest->IsKind(STANDARD_TYPE(Geom_ToroidalSurface)) ||
                          face.rest->IsKind(STANDARD_TYPE(Geom_BSplineSurface));
    if (scalable && moves(samples, Motions::similar, face.refit, face.motion)) return;
    if (held_ != nullptr && hold(f, samples)) return;
    if (is_analytic(face.rest)) {
      const AnalyticFit fit = analytic_fit(face.rest, samples.before, samples.after);
      if (fit.largest <= (has_degenerate_edge(f) ? pole_share * limits_.reshaped : limits_.reshaped) && may_be_reshaped(f)) {
        face.refit = Refit::reshaped;
        face.reshaped = fit.surface;
        align_seam(f);
        return;
      }
    }
  }
  face.refit = Refit::fitted;
  face.open = face.fit.refine(fit_share * limits_.spline);
}

/// As the nodes of the mesh on it go.
bool Refitting::hold(int f, const PlaceSamples& samples) {
  Face& face = faces_[f];
  const std::optional<HeldFace> held = held_->held(f, face.region, samples);
  if (!held || (!held->surface.IsNull() && !may_be_reshaped(f))) return false;
  face.held = true;
  face.refit = held->surface.IsNull() ? Refit::moved : Refit::reshaped;
  face.motion = held->motion;
  face.reshaped = held->surface;
  if (!face.reshaped.IsNull()) align_seam(f);
  return true;
}

/// Takes the edges and vertices of held faces with them; those that move rigidly go first.
void Refitting::hold_borders() {
  for (const Refit kind : {Refit::reshaped, Refit::moved}) {
    for (int f = 0; f < model_.face_count(); ++f) {
      const Face& face = faces_[f];
      if (!face.held || face.refit != kind) continue;
      TopTools_IndexedMapOfShape corners;
      TopExp::MapShapes(model_.face(f), TopAbs_VERTEX, corners);
      for (int k = 1; k <= corners.Extent(); ++k) {
        const int v = model_.vertices.FindIndex(corners(k)) - 1;
        vertices_[v] = kind == Refit::moved ? coordinates(BRep_Tool::Pnt(model_.vertex(v)).Transformed(face.motion))
                                            : projected(*face.reshaped, vertices_[v]);
      }
      for (const Coedge& use : model_.coedges[f]) {
        Edge& edge = edges_[use.edge];
        if (edge.rest.IsNull()) continue;
        edge.held = true;
        if (kind == Refit::moved) {
          edge.refit = Refit::moved;
          edge.motion = face.motion;
          edge.open = false;
        } else if (edge.onto.IsNull()) {
          edge.onto = face.reshaped;
          const auto known = edge.fit.places();
          for (const auto& [at, place] : known) edge.fit.give(at, projected(*edge.onto, place));
        }
      }
    }
  }
}

/// The poles of spheres need not stay poles, but the apex of a cone does.
bool Refitting::may_be_reshaped(int f) const {
  return faces_[f].rest->IsKind(STANDARD_TYPE(Geom_ConicalSurface)) || !has_degenerate_edge(f);
}

bool Refitting::has_degenerate_edge(int f) const {
  return std::any_of(model_.coedges[f].begin(), model_.coedges[f].end(),
                     [&](const Coedge& use) { return edges_[use.edge].rest.IsNull(); });
}

/// Turns a reshaped surface about its axis until the seam is on average at the u where it was.
void Refitting::align_seam(int f) {
  Face& face = faces_[f];
  double sum = 0, widest = 0;
  std::size_t count = 0;
  const auto radius_at = [&](const Vec3& place) {
    gp_Pnt ignored;
    gp_Vec along_u, along_v;
    const std::array<double, 2> uv = analytic_parameters(*face.reshaped, place, 0);
    face.reshaped->D1(uv[0], uv[1], ignored, along_u, along_v);
    return along_u.Magnitude();
  };
  for (const Coedge& use : model_.coedges[f]) {
    if (!use.seam) continue;
    for (const auto& [at, place] : edges_[use.edge].fit.places()) widest = std::max(widest, radius_at(place));
  }
  for (const Coedge& use : model_.coedges[f]) {
    if (!use.seam) continue;
    double from = 0, to = 0;
    const Handle(Geom2d_Curve) curve = BRep_Tool::CurveOnSurface(model_.edge(use.edge), model_.face(f), from, to);
    for (const auto& [at, place] : edges_[use.edge].fit.places()) {
      if (radius_at(place) < 1e-3 * widest) continue;  // at an apex
      const double u = curve->Value(at[0]).X();
      sum += analytic_parameters(*face.reshaped, place, u)[0] - u;
      ++count;
    }
  }
  if (count == 0) return;
  const gp_Ax3& frame = face.reshaped->Position();
  face.reshaped->Rotate(frame.Axis(), (frame.Direct() ? 1 : -1) * sum / static_cast<double>(count));
}

void Refitting::judge(Edge& edge) const {
  edge.open = false;
  const bool first = !edge.judged;
  edge.judged = true;
  if (first) {
    // Others, such as lines, have another parameter when they are scaled than their curves in (u, v).
    const bool scalable = edge.rest->IsKind(STANDARD_TYPE(Geom_Circle)) || edge.rest->IsKind(STANDARD_TYPE(Geom_Ellipse)) ||
                          edge.rest->IsKind(STANDARD_TYPE(Geom_BSplineCurve));
    const PlaceSamples samples = samples_of(edge);
    if (moves(samples, Motions::rigid, edge.refit, edge.motion)) return;
    if (scalable && moves(samples, Motions::similar, edge.refit, edge.motion)) return;
  }
  edge.refit = Refit::fitted;
  edge.open = edge.fit.refine(fit_share * limits_.spline);
}

bool Refitting::check_borders() {
  bool changed = false;
  for (int f = 0; f < model_.face_count(); ++f) {
    Face& face = faces_[f];
    if (face.refit == Refit::fitted || face.held || face.open) continue;
    const bool off = std::any_of(model_.coedges[f].begin(), model_.coedges[f].end(), [&](const Coedge& use) {
      const Edge& edge = edges_[use.edge];
      if (edge.rest.IsNull() || edge.refit != Refit::fitted) return false;
      for (const auto& [at, place] : edge.fit.places()) {
        const bool reshaped = face.refit == Refit::reshaped;
        const gp_Pnt rest = edge.rest->Value(at[0]);
        const double miss = reshaped
                                ? analytic_distance(*face.reshaped, place)
                                : distance(coordinates(face.refit == Refit::moved ? rest.Transformed(face.motion) : rest), place);
        if (miss > (reshaped ? limits_.reshaped : limits_.rigid)) return true;
      }
      return false;
    });
    if (!off) continue;
    face.reshaped.Nullify();
    judge(f);
    changed = true;
  }
  return changed;
}

bool Refitting::refine_face(int f, const std::vector<std::array<double, 2>>& places) {
  Face& face = faces_[f];
  if (face.held) return false;
  if (face.refit == Refit::fitted) {
    face.open = face.fit.refine_around(places);
    return face.open;
  }
  face.reshaped.Nullify();
  judge(f);  // what was taken for rigid is not
  return true;
}

bool Refitting::refine_edge(int e, const std::vector<double>& parameters) {
  Edge& edge = edges_[e];
  if (edge.refit != Refit::fitted) {
    judge(edge);  // what was taken for rigid is not
    return true;
  }
  std::vector<SplineFit::Parameters> places;
  for (const double t : parameters) places.push_back({t, 0});
  edge.open = edge.fit.refine_around(places);
  return edge.open;
}

bool Refitting::scaled(int f) const {
  return faces_[f].refit == Refit::moved && std::abs(faces_[f].motion.ScaleFactor() - 1) > 1e-9;
}

std::array<int, 2> Refitting::nodes(int f) const {
  return {static_cast<int>(faces_[f].fit.axis(0).nodes().size()), static_cast<int>(faces_[f].fit.axis(1).nodes().size())};
}

Handle(Geom_Surface) Refitting::surface(int f) const {
  const Face& face = faces_[f];
  switch (face.refit) {
    case Refit::kept:
      return Handle(Geom_Surface)::DownCast(face.rest->Copy());
    case Refit::moved:
      return Handle(Geom_Surface)::DownCast(face.rest->Transformed(face.motion));
    case Refit::reshaped:
      return Handle(Geom_Surface)::DownCast(face.reshaped->Copy());
    default:
      return face.fit.surface();
  }
}

Handle(Geom_Curve) Refitting::curve(int e) const {
  const Edge& edge = edges_[e];
  if (edge.rest.IsNull()) return nullptr;
  if (edge.refit == Refit::kept) return Handle(Geom_Curve)::DownCast(edge.rest->Copy());
  if (edge.refit == Refit::moved) return Handle(Geom_Curve)::DownCast(edge.rest->Transformed(edge.motion));
  return edge.fit.curve();
}

Vec3 Refitting::edge_at_rest(int e, double t) const { return coordinates(edges_[e].rest->Value(t)); }

double Refitting::edge_error(int e, double t, const Vec3& target) const {
  const Edge& edge = edges_[e];
  const gp_Pnt rest = edge.rest->Value(t);
  switch (edge.refit) {
    case Refit::kept:
      return distance(coordinates(rest), target);
    case Refit::moved:
      return distance(coordinates(rest.Transformed(edge.motion)), target);
    default:
      return distance(edge.fit.value({t, 0}), target);
  }
}

double Refitting::error(int f, const std::array<double, 2>& uv, const Vec3& target) const {
  const Face& face = faces_[f];
  switch (face.refit) {
    case Refit::kept:
      return distance(at_rest(f, uv), target);
    case Refit::moved: {
      const Vec3 rest = at_rest(f, uv);
      return distance(coordinates(gp_Pnt(rest[0], rest[1], rest[2]).Transformed(face.motion)), target);
    }
    case Refit::reshaped:
      return analytic_distance(*face.reshaped, target);
    default:
      return distance(face.fit.value(uv), target);
  }
}

}  // namespace deform::cad
