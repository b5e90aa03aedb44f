// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/refitting.h"

#include <BRepTools.hxx>
#include <BRep_Tool.hxx>
#include <Eigen/Geometry>
#include <GeomAdaptor_Curve.hxx>
#include <GeomAdaptor_Surface.hxx>
#include <Geom_BSplineCurve.hxx>
#include <Geom_BSplineSurface.hxx>
#include <Precision.hxx>
#include <TColStd_Array1OfInteger.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TColgp_Array1OfPnt.hxx>
#include <TColgp_Array2OfPnt.hxx>
#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform::cad {

namespace {

constexpr double rigid_share = 0.1;         ///< of the tolerance
constexpr double fit_share = 0.35;          ///< of the tolerance, for each of u and v
constexpr double box_margin = 1e-6;         ///< pcurves may leave the box of a face by their tolerance
constexpr double check_spacing = 1.0 / 24;  ///< of D

Vec3 vector_of(const gp_Pnt& p) { return {p.X(), p.Y(), p.Z()}; }
gp_Pnt point_of(const Eigen::Vector3d& p) { return {p[0], p[1], p[2]}; }

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

TColStd_Array1OfReal knot_array(const SplineAxis& axis) {
  const std::vector<double> knots = axis.knots();
  TColStd_Array1OfReal array(1, static_cast<int>(knots.size()));
  for (int k = 1; k <= array.Length(); ++k) array(k) = knots[k - 1];
  return array;
}

TColStd_Array1OfInteger multiplicity_array(const SplineAxis& axis) {
  const std::vector<int> multiplicities = axis.multiplicities();
  TColStd_Array1OfInteger array(1, static_cast<int>(multiplicities.size()));
  for (int k = 1; k <= array.Length(); ++k) array(k) = multiplicities[k - 1];
  return array;
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

Vec3 Refitting::Fit::at(const std::array<double, 2>& parameters) const {
  return vector_of(surface.IsNull() ? curve->Value(parameters[0]) : surface->Value(parameters[0], parameters[1]));
}

Refitting::Refitting(const Model& model, double tolerance, double rigid) : model_(model), tolerance_(tolerance), rigid_(rigid) {
  for (int f = 0; f < model.face_count(); ++f) faces_.push_back(face_fit(f));
  for (int e = 0; e < model.edge_count(); ++e) edges_.push_back(edge_fit(e));
}

Refitting::Fit Refitting::face_fit(int f) const {
  const Handle(Geom_Surface) surface = BRep_Tool::Surface(model_.face(f));
  std::array<double, 2> from{}, to{}, least{}, most{};
  BRepTools::UVBounds(model_.face(f), from[0], to[0], from[1], to[1]);
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
  Fit fit{SplineAxis(breaks_between(
              from[0], to[0], [&] { return adaptor.NbUIntervals(GeomAbs_C2); },
              [&](TColStd_Array1OfReal& ends) { adaptor.UIntervals(ends, GeomAbs_C2); })),
          SplineAxis(breaks_between(
              from[1], to[1], [&] { return adaptor.NbVIntervals(GeomAbs_C2); },
              [&](TColStd_Array1OfReal& ends) { adaptor.VIntervals(ends, GeomAbs_C2); })),
          surface, nullptr};
  const auto value = [&](double a, double b) {
    return surface->Value(from[0] + a * (to[0] - from[0]), from[1] + b * (to[1] - from[1]));
  };
  std::array<double, 2> size{};
  for (const double other : {0.0, 0.5, 1.0}) {
    size[0] = std::max(size[0], rough_length([&](double a) { return value(a, other); }));
    size[1] = std::max(size[1], rough_length([&](double a) { return value(other, a); }));
  }
  for (int k = 0; k < 2; ++k) {
    const double pieces = std::max(1.0, size[k] / (check_spacing * model_.diagonal));
    fit.spacing[k] = (to[k] - from[k]) / pieces;
  }
  return fit;
}

Refitting::Fit Refitting::edge_fit(int e) const {
  double from = 0, to = 1;
  const Handle(Geom_Curve) curve = BRep_Tool::Curve(model_.edge(e), from, to);
  if (curve.IsNull()) {
    Fit none{SplineAxis({0, 1}), SplineAxis({0, 1}), nullptr, nullptr};
    none.open = false;
    none.refit = Refit::kept;
    return none;
  }
  const GeomAdaptor_Curve adaptor(curve, from, to);
  Fit fit{SplineAxis(breaks_between(
              from, to, [&] { return adaptor.NbIntervals(GeomAbs_C2); },
              [&](TColStd_Array1OfReal& ends) { adaptor.Intervals(ends, GeomAbs_C2); })),
          SplineAxis({0, 1}), nullptr, curve};
  const double size = rough_length([&](double a) { return curve->Value(from + a * (to - from)); });
  fit.spacing[0] = (to - from) / std::max(1.0, size / (check_spacing * model_.diagonal));
  return fit;
}

/// What is not known yet of the nodes, and of the checks between them along each axis.
void Refitting::want(Fit& fit) {
  const auto ask = [&](double u, double v) {
    const std::array<double, 2> parameters{u, v};
    if (!fit.places.emplace(parameters, Vec3{}).second) return;
    asked_.push_back({&fit, parameters});
    wanted_.push_back(fit.at(parameters));
  };
  const std::vector<double>& u = fit.u.nodes();
  const std::vector<double> none{0.0}, &v = fit.axes() == 2 ? fit.v.nodes() : none;
  for (const double a : u) {
    for (const double b : v) ask(a, b);
  }
  for (const double a : fit.u.checks(fit.spacing[0])) {
    for (const double b : v) ask(a, b);
  }
  if (fit.axes() == 1) return;
  for (const double b : fit.v.checks(fit.spacing[1])) {
    for (const double a : u) ask(a, b);
  }
}

const Points& Refitting::wanted() {
  asked_.clear();
  wanted_.clear();
  for (std::vector<Fit>* fits : {&faces_, &edges_}) {
    for (Fit& fit : *fits) {
      if (fit.open) want(fit);
    }
  }
  if (!vertices_known_) {
    for (int v = 0; v < model_.vertex_count(); ++v) wanted_.push_back(vector_of(BRep_Tool::Pnt(model_.vertex(v))));
  }
  return wanted_;
}

void Refitting::give(const Points& places) {
  for (std::size_t i = 0; i < asked_.size(); ++i) {
    if (!is_finite(places[i])) {
      for (int f = 0; f < model_.face_count(); ++f) {
        if (asked_[i].fit == &faces_[f]) {
          throw Error(ErrorCode::invalid_argument, model_.face_name(f) + ": the deformation is not finite there");
        }
      }
      throw Error(ErrorCode::invalid_argument, "an edge: the deformation is not finite there");
    }
    asked_[i].fit->places[asked_[i].parameters] = places[i];
  }
  if (!vertices_known_) {
    vertices_.assign(places.begin() + static_cast<std::ptrdiff_t>(asked_.size()), places.end());
    vertices_known_ = true;
  }
  for (std::vector<Fit>* fits : {&faces_, &edges_}) {
    for (Fit& fit : *fits) {
      if (fit.open) judge(fit);
    }
  }
}

bool Refitting::moves_rigidly(Fit& fit) const {
  const auto count = static_cast<Eigen::Index>(fit.places.size());
  Eigen::Matrix3Xd before(3, count), after(3, count);
  Eigen::Index i = 0;
  for (const auto& [parameters, place] : fit.places) {
    const Vec3 rest = fit.at(parameters);
    for (int k = 0; k < 3; ++k) before(k, i) = rest[k], after(k, i) = place[k];
    ++i;
  }
  if ((after - before).colwise().norm().maxCoeff() <= rigid_) {
    fit.refit = Refit::kept;
    return true;
  }
  const Eigen::Matrix4d motion = Eigen::umeyama(before, after, false);
  const Eigen::Matrix3Xd moved = (motion.topLeftCorner<3, 3>() * before).colwise() + motion.topRightCorner<3, 1>();
  if ((after - moved).colwise().norm().maxCoeff() > rigid_) return false;
  gp_Trsf trsf;
  trsf.SetValues(motion(0, 0), motion(0, 1), motion(0, 2), motion(0, 3), motion(1, 0), motion(1, 1), motion(1, 2), motion(1, 3),
                 motion(2, 0), motion(2, 1), motion(2, 2), motion(2, 3));
  fit.motion = trsf;
  fit.refit = Refit::moved;
  return true;
}

/// The intervals of an axis in which checks are off.
std::set<int> Refitting::bad_intervals(const Fit& fit, int axis) const {
  const SplineAxis& along = axis == 0 ? fit.u : fit.v;
  const std::vector<double> none{0.0}, &across = fit.axes() == 1 ? none : axis == 0 ? fit.v.nodes() : fit.u.nodes();
  const auto place = [&](double a, double b) {
    return fit.places.at(axis == 0 ? std::array<double, 2>{a, b} : std::array<double, 2>{b, a});
  };
  const auto columns = static_cast<Eigen::Index>(3 * across.size());
  const auto rows_at = [&](const std::vector<double>& parameters) {
    Eigen::MatrixXd rows(static_cast<Eigen::Index>(parameters.size()), columns);
    for (std::size_t i = 0; i < parameters.size(); ++i) {
      for (std::size_t j = 0; j < across.size(); ++j) {
        const Vec3 p = place(parameters[i], across[j]);
        for (int k = 0; k < 3; ++k) rows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(3 * j) + k) = p[k];
      }
    }
    return rows;
  };
  const std::vector<double> checks = along.checks(fit.spacing[axis]);
  const Eigen::MatrixXd off = along.values(along.poles(rows_at(along.nodes())), checks) - rows_at(checks);
  std::set<int> bad;
  for (std::size_t i = 0; i < checks.size(); ++i) {
    for (std::size_t j = 0; j < across.size(); ++j) {
      const double error = off.block<1, 3>(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(3 * j)).norm();
      if (error > fit_share * tolerance_) bad.insert(along.interval_of(checks[i]));
    }
  }
  return bad;
}

void Refitting::judge(Fit& fit) const {
  fit.open = false;
  const bool first = !fit.judged;
  fit.judged = true;
  if (first && moves_rigidly(fit)) return;
  fit.refit = Refit::fitted;
  std::array<std::set<int>, 2> bad;
  for (int axis = 0; axis < fit.axes(); ++axis) bad[axis] = bad_intervals(fit, axis);
  for (int axis = 0; axis < fit.axes(); ++axis) {
    if (!bad[axis].empty() && (axis == 0 ? fit.u : fit.v).halve(bad[axis])) fit.open = true;
  }
}

bool Refitting::refine_face(int f, const std::vector<std::array<double, 2>>& places) {
  Fit& fit = faces_[f];
  if (fit.refit == Refit::fitted) {
    std::array<std::set<int>, 2> bad;
    for (const auto& [u, v] : places) bad[0].insert(fit.u.interval_of(u)), bad[1].insert(fit.v.interval_of(v));
    const bool finer_u = fit.u.halve(bad[0]), finer_v = fit.v.halve(bad[1]);
    if (!finer_u && !finer_v) return false;
  }
  fit.refit = Refit::fitted;  // what was taken for rigid is not: its nodes are judged anew
  fit.open = true;
  return true;
}

std::array<int, 2> Refitting::nodes(int f) const {
  return {static_cast<int>(faces_[f].u.nodes().size()), static_cast<int>(faces_[f].v.nodes().size())};
}

Handle(Geom_Surface) Refitting::surface(int f) const {
  const Fit& fit = faces_[f];
  if (fit.refit == Refit::kept) return Handle(Geom_Surface)::DownCast(fit.surface->Copy());
  if (fit.refit == Refit::moved) return Handle(Geom_Surface)::DownCast(fit.surface->Transformed(fit.motion));
  const std::vector<double>&u = fit.u.nodes(), &v = fit.v.nodes();
  const auto rows = static_cast<Eigen::Index>(u.size()), columns = static_cast<Eigen::Index>(v.size());
  std::array<Eigen::MatrixXd, 3> poles;
  for (int k = 0; k < 3; ++k) {
    Eigen::MatrixXd values(rows, columns);
    for (Eigen::Index i = 0; i < rows; ++i) {
      for (Eigen::Index j = 0; j < columns; ++j) values(i, j) = fit.places.at({u[i], v[j]})[k];
    }
    poles[k] = fit.v.poles(fit.u.poles(values).transpose()).transpose();
  }
  TColgp_Array2OfPnt array(1, static_cast<int>(rows), 1, static_cast<int>(columns));
  for (int i = 0; i < rows; ++i) {
    for (int j = 0; j < columns; ++j) array(i + 1, j + 1) = gp_Pnt(poles[0](i, j), poles[1](i, j), poles[2](i, j));
  }
  return new Geom_BSplineSurface(array, knot_array(fit.u), knot_array(fit.v), multiplicity_array(fit.u),
                                 multiplicity_array(fit.v), 3, 3);
}

Handle(Geom_Curve) Refitting::curve(int e) const {
  const Fit& fit = edges_[e];
  if (fit.curve.IsNull()) return nullptr;
  if (fit.refit == Refit::kept) return Handle(Geom_Curve)::DownCast(fit.curve->Copy());
  if (fit.refit == Refit::moved) return Handle(Geom_Curve)::DownCast(fit.curve->Transformed(fit.motion));
  const std::vector<double>& t = fit.u.nodes();
  Eigen::MatrixXd values(static_cast<Eigen::Index>(t.size()), 3);
  for (std::size_t i = 0; i < t.size(); ++i) {
    const Vec3& p = fit.places.at({t[i], 0});
    for (int k = 0; k < 3; ++k) values(static_cast<Eigen::Index>(i), k) = p[k];
  }
  const Eigen::MatrixXd poles = fit.u.poles(values);
  TColgp_Array1OfPnt array(1, static_cast<int>(t.size()));
  for (int i = 0; i < array.Length(); ++i) array(i + 1) = point_of(poles.row(i));
  return new Geom_BSplineCurve(array, knot_array(fit.u), multiplicity_array(fit.u), 3);
}

}  // namespace deform::cad
