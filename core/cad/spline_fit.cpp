// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/spline_fit.h"

#include <TColStd_Array1OfInteger.hxx>
#include <TColStd_Array1OfReal.hxx>
#include <TColgp_Array1OfPnt.hxx>
#include <TColgp_Array1OfPnt2d.hxx>
#include <TColgp_Array2OfPnt.hxx>

namespace deform::cad {

namespace {

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

}  // namespace

const std::vector<double>& SplineFit::nodes(int k) const {
  static const std::vector<double> none{0.0};
  return k < axes() ? axes_[k].nodes() : none;
}

void SplineFit::want(const std::function<void(const Parameters&)>& ask) {
  const auto once = [&](double u, double v) {
    const Parameters at{u, v};
    if (places_.emplace(at, Vec3{}).second) ask(at);
  };
  for (const double a : nodes(0)) {
    for (const double b : nodes(1)) once(a, b);
  }
  for (const double a : axes_[0].checks(spacing_[0])) {
    for (const double b : nodes(1)) once(a, b);
  }
  if (axes() == 1) return;
  for (const double b : axes_[1].checks(spacing_[1])) {
    for (const double a : nodes(0)) once(a, b);
  }
}

std::set<int> SplineFit::bad_intervals(int axis, double tolerance) const {
  const SplineAxis& along = axes_[axis];
  const std::vector<double>& across = nodes(1 - axis);
  const auto columns = static_cast<Eigen::Index>(3 * across.size());
  const auto rows_at = [&](const std::vector<double>& parameters) {
    Eigen::MatrixXd rows(static_cast<Eigen::Index>(parameters.size()), columns);
    for (std::size_t i = 0; i < parameters.size(); ++i) {
      for (std::size_t j = 0; j < across.size(); ++j) {
        const double a = parameters[i], b = across[j];
        const Vec3& p = places_.at(axis == 0 ? Parameters{a, b} : Parameters{b, a});
        for (int k = 0; k < 3; ++k) rows(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(3 * j) + k) = p[k];
      }
    }
    return rows;
  };
  const std::vector<double> checks = along.checks(spacing_[axis]);
  const Eigen::MatrixXd off = along.values(along.poles(rows_at(along.nodes())), checks) - rows_at(checks);
  std::set<int> bad;
  for (std::size_t i = 0; i < checks.size(); ++i) {
    for (std::size_t j = 0; j < across.size(); ++j) {
      const double error = off.block<1, 3>(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(3 * j)).norm();
      if (error > tolerance) bad.insert(along.interval_of(checks[i]));
    }
  }
  return bad;
}

bool SplineFit::refine(double tolerance) {
  std::array<std::set<int>, 2> bad;
  for (int k = 0; k < axes(); ++k) bad[k] = bad_intervals(k, tolerance);
  bool finer = false;
  for (int k = 0; k < axes(); ++k) {
    if (!bad[k].empty() && axes_[k].halve(bad[k])) finer = true;
  }
  if (finer) poles_.resize(0, 0);
  return finer;
}

bool SplineFit::refine_around(const std::vector<Parameters>& places) {
  bool finer = false;
  for (int k = 0; k < axes(); ++k) {
    std::set<int> bad;
    for (const Parameters& at : places) bad.insert(axes_[k].interval_of(at[k]));
    finer = axes_[k].halve(bad) || finer;
  }
  if (finer) poles_.resize(0, 0);
  return finer;
}

const Eigen::MatrixXd& SplineFit::poles() const {
  if (poles_.size() > 0) return poles_;
  const std::vector<double>&u = nodes(0), &v = nodes(1);
  const auto rows = static_cast<Eigen::Index>(u.size()), columns = static_cast<Eigen::Index>(v.size());
  Eigen::MatrixXd values(rows, 3 * columns);
  for (Eigen::Index i = 0; i < rows; ++i) {
    for (Eigen::Index j = 0; j < columns; ++j) {
      const Vec3& p = places_.at({u[i], v[j]});
      for (int k = 0; k < 3; ++k) values(i, 3 * j + k) = p[k];
    }
  }
  values = axes_[0].poles(values);
  if (axes() == 2) {
    Eigen::MatrixXd across(columns, 3 * rows);
    for (Eigen::Index i = 0; i < rows; ++i) {
      for (Eigen::Index j = 0; j < columns; ++j) across.block<1, 3>(j, 3 * i) = values.block<1, 3>(i, 3 * j);
    }
    across = axes_[1].poles(across);
    for (Eigen::Index i = 0; i < rows; ++i) {
      for (Eigen::Index j = 0; j < columns; ++j) values.block<1, 3>(i, 3 * j) = across.block<1, 3>(j, 3 * i);
    }
  }
  poles_ = std::move(values);
  return poles_;
}

Vec3 SplineFit::value(const Parameters& at) const {
  const Eigen::MatrixXd& p = poles();
  std::array<double, 4> along{}, across{1, 0, 0, 0};
  const int i = axes_[0].functions(at[0], along), j = axes() == 2 ? axes_[1].functions(at[1], across) : 0;
  Vec3 sum{};
  for (int b = 0; b < (axes() == 2 ? 4 : 1); ++b) {
    for (int k = 0; k < 3; ++k) {
      double part = 0;
      for (int a = 0; a < 4; ++a) part += along[a] * p(i + a, 3 * (j + b) + k);
      sum[k] += across[b] * part;
    }
  }
  return sum;
}

Handle(Geom_BSplineSurface) SplineFit::surface() const {
  const Eigen::MatrixXd& p = poles();
  TColgp_Array2OfPnt array(1, static_cast<int>(p.rows()), 1, static_cast<int>(p.cols() / 3));
  for (int i = 0; i < array.NbRows(); ++i) {
    for (int j = 0; j < array.NbColumns(); ++j) array(i + 1, j + 1) = gp_Pnt(p(i, 3 * j), p(i, 3 * j + 1), p(i, 3 * j + 2));
  }
  return new Geom_BSplineSurface(array, knot_array(axes_[0]), knot_array(axes_[1]), multiplicity_array(axes_[0]),
                                 multiplicity_array(axes_[1]), 3, 3);
}

Handle(Geom_BSplineCurve) SplineFit::curve() const {
  const Eigen::MatrixXd& p = poles();
  TColgp_Array1OfPnt array(1, static_cast<int>(p.rows()));
  for (int i = 0; i < array.Length(); ++i) array(i + 1) = gp_Pnt(p(i, 0), p(i, 1), p(i, 2));
  return new Geom_BSplineCurve(array, knot_array(axes_[0]), multiplicity_array(axes_[0]), 3);
}

Handle(Geom2d_BSplineCurve) SplineFit::plane_curve() const {
  const Eigen::MatrixXd& p = poles();
  TColgp_Array1OfPnt2d array(1, static_cast<int>(p.rows()));
  for (int i = 0; i < array.Length(); ++i) array(i + 1) = gp_Pnt2d(p(i, 0), p(i, 1));
  return new Geom2d_BSplineCurve(array, knot_array(axes_[0]), multiplicity_array(axes_[0]), 3);
}

}  // namespace deform::cad
