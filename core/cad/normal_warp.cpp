// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/normal_warp.h"

#include <BRepTools.hxx>
#include <BRep_Tool.hxx>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

namespace deform::cad {

namespace {

using Eigen::Vector3d;

constexpr int most_steps = 50;
constexpr double longest_step = 0.25;  ///< of the box
constexpr double close = 1e-12;        ///< of the size, where the normal meets the partner
constexpr double margin = 1e-9;        ///< of the box

Vector3d vector(const gp_XYZ& v) { return {v.X(), v.Y(), v.Z()}; }

struct Frame {
  Vector3d place, along_u, along_v;
};

Frame frame_of(const Geom_Surface& surface, const Parameters& uv) {
  gp_Pnt p;
  gp_Vec du, dv;
  surface.D1(uv[0], uv[1], p, du, dv);
  return {vector(p.XYZ()), vector(du.XYZ()), vector(dv.XYZ())};
}

}  // namespace

NormalWarp::NormalWarp(const Model& before, const Model& after, const Correspondence& partners, int face,
                       const std::vector<EdgeMap>& edges, const std::vector<int>& samples)
    : from_(BRep_Tool::Surface(before.face(face))),
      to_(BRep_Tool::Surface(after.face(partners.faces[face]))),
      scale_(parameter_lengths(before.face(face))) {
  BRepTools::UVBounds(after.face(partners.faces[face]), box_[0], box_[1], box_[2], box_[3]);
  const std::vector<BoundaryPair> pairs = boundary_pairs(before, after, partners, face, edges, samples, scale_);
  std::vector<Eigen::Vector2d> centres;
  Eigen::MatrixXd shifts(static_cast<Eigen::Index>(pairs.size()), 3);
  for (const auto& [from, to] : pairs) {
    const Vector3d here = vector(from_->Value(from[0], from[1]).XYZ()), there = vector(to_->Value(to[0], to[1]).XYZ());
    size_ = std::max(size_, (there - vector(to_->Value(pairs.front().to[0], pairs.front().to[1]).XYZ())).norm());
    shifts.row(static_cast<Eigen::Index>(centres.size())) = (there - here).transpose();
    centres.emplace_back(from[0] * scale_[0], from[1] * scale_[1]);
  }
  if (pairs.size() < 3 || shifts.cwiseAbs().maxCoeff() <= close * size_) return;
  shift_ = ThinPlate(std::move(centres), shifts);
}

std::optional<Parameters> NormalWarp::operator()(const Parameters& uv, const Parameters& near) const {
  Frame base = frame_of(*from_, uv);
  if (!shift_.is_zero()) {
    const Eigen::Vector2d x(uv[0] * scale_[0], uv[1] * scale_[1]);
    const Eigen::Matrix2Xd gradient = shift_.gradient(x);
    base.place += shift_(x).transpose();
    base.along_u += scale_[0] * gradient.row(0).transpose();
    base.along_v += scale_[1] * gradient.row(1).transpose();
  }
  const Vector3d normal = base.along_u.cross(base.along_v).normalized();
  if (!normal.allFinite()) return std::nullopt;
  Parameters at = near;
  double height = (frame_of(*to_, at).place - base.place).dot(normal);
  const bool periodic[] = {static_cast<bool>(to_->IsUPeriodic()), static_cast<bool>(to_->IsVPeriodic())};
  for (int k = 0; k < most_steps; ++k) {
    const Frame target = frame_of(*to_, at);
    const Vector3d off = target.place - base.place - height * normal;
    if (off.norm() <= close * size_) return at;
    Eigen::Matrix3d slopes;
    slopes << target.along_u, target.along_v, -normal;
    const Vector3d step = -slopes.partialPivLu().solve(off);
    if (!step.allFinite()) return std::nullopt;
    const double longest = std::max(std::abs(step[0]) / (box_[1] - box_[0]), std::abs(step[1]) / (box_[3] - box_[2]));
    const double share = longest > longest_step ? longest_step / longest : 1;
    for (int c = 0; c < 2; ++c) {
      const double low = box_[2 * c], high = box_[2 * c + 1], beyond = margin * (high - low);
      at[c] += share * step[c];
      if (!periodic[c]) at[c] = std::clamp(at[c], low - beyond, high + beyond);
    }
    height += share * step[2];
  }
  return std::nullopt;
}

}  // namespace deform::cad
