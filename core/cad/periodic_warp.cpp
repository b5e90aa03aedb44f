// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/periodic_warp.h"

#include <BRep_Tool.hxx>
#include <Geom2d_Curve.hxx>
#include <Geom_Surface.hxx>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/numerics/dense/decompositions.h"

namespace deform::cad {

namespace {

double thin_plate(double square) { return square > 0 ? 0.5 * square * std::log(square) : 0; }

/// The samples of one use of an edge, the new ones without jumps by a period.
struct Strand {
  std::vector<Parameters> old, now;
  bool winds = false, degenerate = false;
};

double unwrapped(double value, double near, double period) { return value - period * std::round((value - near) / period); }

}  // namespace

PeriodicWarp::PeriodicWarp(const Model& before, const Model& after, const Correspondence& partners, int face,
                           const std::vector<EdgeMap>& edges, const std::vector<int>& samples, const std::vector<char>& loose) {
  const TopoDS_Face from = before.face(face), to = after.face(partners.faces[face]);
  const auto old_surface = BRep_Tool::Surface(from), new_surface = BRep_Tool::Surface(to);
  for (const Coedge& use : before.coedges[face]) {
    if (!use.seam || !loose[use.edge]) continue;
    const auto one = curve_of(before, face, use);
    const auto other = curve_of(before, face, {use.edge, -use.sense, true});
    const gp_Pnt2d a = one->Value(edges[use.edge].at(0)), b = other->Value(edges[use.edge].at(0));
    around_ = std::abs(a.X() - b.X()) > std::abs(a.Y() - b.Y()) ? 0 : 1;
  }
  period_ = around_ == 0 ? old_surface->UPeriod() : old_surface->VPeriod();
  const double new_period = around_ == 0 ? new_surface->UPeriod() : new_surface->VPeriod();
  const std::array<double, 2> scale = parameter_lengths(from);
  radius_ = scale[around_] * period_ / (2 * std::numbers::pi);
  along_ = scale[1 - around_];
  std::vector<Strand> strands;
  for (const Coedge& use : before.coedges[face]) {
    if (use.seam) continue;
    const int sense = use.sense * partners.edge_senses[use.edge] * partners.face_senses[face];
    const auto old_curve = curve_of(before, face, use);
    const auto new_curve = curve_of(after, partners.faces[face], {partners.edges[use.edge], sense, false});
    if (old_curve.IsNull() || new_curve.IsNull()) continue;
    Strand& strand = strands.emplace_back();
    strand.degenerate = edges[use.edge].degenerate();
    for (int i = 0; i <= samples[use.edge]; ++i) {
      const double t = edges[use.edge].at(static_cast<double>(i) / samples[use.edge]);
      const gp_Pnt2d a = old_curve->Value(t), b = new_curve->Value(edges[use.edge](t));
      Parameters old{a.X(), a.Y()}, now{b.X(), b.Y()};
      if (i > 0) now[around_] = unwrapped(now[around_], strand.now.back()[around_], new_period);
      strand.old.push_back(old);
      strand.now.push_back(now);
    }
    const double round = strand.old.back()[around_] - strand.old.front()[around_];
    if (std::abs(std::abs(round) - period_) > 0.01 * period_ || strand.degenerate) continue;
    strand.winds = true;
    slope_ = (strand.now.back()[around_] - strand.now.front()[around_]) / round;
  }
  std::vector<Eigen::Vector2d> shifts;
  bool first = true;
  double usual = 0;  // shift around of the first ring
  const auto shift_around = [&](const Strand& strand, std::size_t i) {
    return strand.now[i][around_] - slope_ * strand.old[i][around_];
  };
  const auto add = [&](const Parameters& old, double around, double along) {
    const Eigen::Vector3d centre = place(old);
    if (std::any_of(centres_.begin(), centres_.end(), [&](const auto& c) { return (c - centre).squaredNorm() < 1e-18; })) return;
    centres_.push_back(centre);
    shifts.emplace_back(around, along);
  };
  for (const bool winding : {true, false}) {
    for (const Strand& strand : strands) {
      if (strand.winds != winding) continue;
      double mean = 0;
      for (std::size_t i = 0; i < strand.old.size(); ++i)
        mean += shift_around(strand, i) / static_cast<double>(strand.old.size());
      if (first) usual = mean;
      first = false;
      const double branch = unwrapped(mean, usual, new_period) - mean;
      for (std::size_t i = 0; i < strand.old.size(); ++i) {
        const double around = strand.degenerate ? usual : shift_around(strand, i) + branch;
        add(strand.old[i], around, strand.now[i][1 - around_] - strand.old[i][1 - around_]);
      }
    }
  }
  const auto n = static_cast<Eigen::Index>(centres_.size());
  Eigen::MatrixXd system = Eigen::MatrixXd::Zero(n + 4, n + 4), right = Eigen::MatrixXd::Zero(n + 4, 2);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < n; ++j) system(i, j) = thin_plate((centres_[i] - centres_[j]).squaredNorm());
    system.block<1, 4>(i, n) << centres_[i].transpose(), 1;
    system.block<4, 1>(n, i) = system.block<1, 4>(i, n).transpose();
    right.row(i) = shifts[i].transpose();
  }
  // One ring alone does not determine the polynomial.
  weights_ = least_solution(system, right, 1e-12);
}

Eigen::Vector3d PeriodicWarp::place(const Parameters& uv) const {
  const double angle = 2 * std::numbers::pi * uv[around_] / period_;
  return {radius_ * std::cos(angle), radius_ * std::sin(angle), along_ * uv[1 - around_]};
}

Parameters PeriodicWarp::operator()(const Parameters& uv) const {
  const auto n = static_cast<Eigen::Index>(centres_.size());
  const Eigen::Vector3d x = place(uv);
  Eigen::RowVector2d shift = x.transpose() * weights_.middleRows<3>(n) + weights_.row(n + 3);
  for (Eigen::Index i = 0; i < n; ++i) shift += thin_plate((x - centres_[i]).squaredNorm()) * weights_.row(i);
  Parameters now{};
  now[around_] = slope_ * uv[around_] + shift.x();
  now[1 - around_] = uv[1 - around_] + shift.y();
  return now;
}

}  // namespace deform::cad
