// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/face_mending.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "core/base/vectors.h"

namespace deform::cad {

namespace {

using Eigen::Vector3d;

constexpr int most_rounds = 80, steps_of_round = 25, remembered = 12;
constexpr double area_weight = 0.5;  ///< of sizes beside shapes

Vector3d vector(const gp_Vec& v) { return {v.X(), v.Y(), v.Z()}; }
Vector3d vector(const Vec3& v) { return {v[0], v[1], v[2]}; }

struct Derivatives {
  Vector3d place, du, dv, normal;  ///< the normal has length 1, or 0 where there is none
};

Derivatives derivatives(const Handle(Geom_Surface) & surface, const Parameters& uv) {
  gp_Pnt p;
  gp_Vec du, dv;
  surface->D1(uv[0], uv[1], p, du, dv);
  Derivatives at{{p.X(), p.Y(), p.Z()}, vector(du), vector(dv), Vector3d::Zero()};
  const Vector3d n = at.du.cross(at.dv);
  const double size = n.norm();
  if (size > 1e-12 * at.du.norm() * at.dv.norm() && size > 0) at.normal = n / size;
  return at;
}

Vector3d normal_of(const Handle(Geom_Surface) & surface, const FacePatch::Node& node) {
  return node.pole ? Vector3d(Vector3d::Zero()) : derivatives(surface, node.uv).normal;
}

/// The inverse of a triangle at rest, in its plane, and its area.
struct Rest {
  Eigen::Matrix2d inverse;
  double area = 0;
};

Rest rest_of(const FacePatch::Triangle& triangle, double scale) {
  const Vector3d a = scale * (vector(triangle.shape[1]) - vector(triangle.shape[0]));
  const Vector3d b = scale * (vector(triangle.shape[2]) - vector(triangle.shape[0]));
  Rest rest;
  const double along = a.norm(), height = a.cross(b).norm() / std::max(along, 1e-300),
               across = a.dot(b) / std::max(along, 1e-300);
  rest.area = 0.5 * along * height;
  // The inverse of the columns (along, 0) and (across, height).
  rest.inverse << 1 / along, -across / (along * height), 0, 1 / height;
  return rest;
}

double area_of(const Vector3d& a, const Vector3d& b, const Vector3d& c) { return 0.5 * (b - a).cross(c - a).norm(); }

class Sliding {
 public:
  Sliding(const Handle(Geom_Surface) & surface, FacePatch& patch, const std::vector<char>& free)
      : surface_(surface), patch_(patch) {
    slot_.assign(patch.nodes.size(), -1);
    for (std::size_t i = 0; i < patch.nodes.size(); ++i) {
      if (free[i]) {
        slot_[i] = static_cast<int>(free_.size());
        free_.push_back(i);
      }
    }
    double before = 0, now = 0;
    for (const FacePatch::Triangle& triangle : patch.triangles) {
      const auto& [a, b, c] = triangle.nodes;
      if (slot_[a] < 0 && slot_[b] < 0 && slot_[c] < 0) continue;
      before += area_of(vector(triangle.shape[0]), vector(triangle.shape[1]), vector(triangle.shape[2]));
      now += area_of(vector(patch.nodes[a].place), vector(patch.nodes[b].place), vector(patch.nodes[c].place));
    }
    const double scale = before > 0 && now > 0 ? std::sqrt(now / before) : 1;
    for (std::size_t t = 0; t < patch.triangles.size(); ++t) {
      const auto& [a, b, c] = patch.triangles[t].nodes;
      if (slot_[a] < 0 && slot_[b] < 0 && slot_[c] < 0) continue;
      const Rest rest = rest_of(patch.triangles[t], scale);
      if (!(rest.area > 1e-12 * scale * scale * now) || !rest.inverse.allFinite()) continue;
      triangles_.push_back(t);
      rests_.push_back(rest);
      total_ += rest.area;
    }
    unit_ = std::sqrt(total_ / std::max<std::size_t>(triangles_.size(), 1));
  }

  void run(const RunContext& context) {
    if (free_.empty() || triangles_.empty()) return;
    Eigen::VectorXd x = start();
    double before = 0;
    for (int round = 0; round < most_rounds; ++round) {
      context.check();
      take_normals(x);
      Eigen::VectorXd gradient(x.size());
      energy(x, gradient);
      const double worst = std::min(0.0, least_);
      epsilon_ = std::sqrt(1e-12 + 0.04 * worst * worst);
      const double value = descend(x, gradient);
      if (least_ > 0 && before > 0 && value > 0.999 * before) break;
      before = least_ > 0 ? value : 0;
    }
    store(x);
  }

 private:
  /// (u, v) in lengths.
  Eigen::VectorXd start() {
    Eigen::VectorXd x(2 * static_cast<Eigen::Index>(free_.size()));
    for (std::size_t k = 0; k < free_.size(); ++k) {
      const Parameters& uv = patch_.nodes[free_[k]].uv;
      const Derivatives at = derivatives(surface_, uv);
      lengths_.push_back({std::max(at.du.norm(), 1e-9 * unit_), std::max(at.dv.norm(), 1e-9 * unit_)});
      for (int c = 0; c < 2; ++c) x[2 * static_cast<Eigen::Index>(k) + c] = uv[c] * lengths_[k][c];
    }
    return x;
  }

  Parameters uv_of(const Eigen::VectorXd& x, std::size_t k) const {
    Parameters uv{};
    const bool periodic[] = {static_cast<bool>(surface_->IsUPeriodic()), static_cast<bool>(surface_->IsVPeriodic())};
    for (int c = 0; c < 2; ++c) {
      uv[c] = x[2 * static_cast<Eigen::Index>(k) + c] / lengths_[k][c];
      const auto low = 2 * static_cast<std::size_t>(c);
      if (!periodic[c]) uv[c] = std::clamp(uv[c], patch_.box[low], patch_.box[low + 1]);
    }
    return uv;
  }

  void evaluate(const Eigen::VectorXd& x) {
    now_.resize(free_.size());
    for (std::size_t k = 0; k < free_.size(); ++k) now_[k] = derivatives(surface_, uv_of(x, k));
  }

  void take_normals(const Eigen::VectorXd& x) {
    evaluate(x);
    normals_.clear();
    for (const std::size_t t : triangles_) {
      Vector3d sum = Vector3d::Zero();
      for (const int i : patch_.triangles[t].nodes) {
        sum += slot_[i] >= 0 ? now_[slot_[i]].normal : normal_of(surface_, patch_.nodes[i]);
      }
      const double size = sum.norm();
      normals_.push_back(size > 0 ? Vector3d(sum / size) : Vector3d::Zero());
    }
  }

  Vector3d place(int i) const { return slot_[i] >= 0 ? now_[slot_[i]].place : vector(patch_.nodes[i].place); }

  /// Mean over the area at rest; least_ becomes the least determinant.
  double energy(const Eigen::VectorXd& x, Eigen::VectorXd& gradient) {
    evaluate(x);
    gradient.setZero();
    double sum = 0;
    least_ = 1e300;
    for (std::size_t k = 0; k < triangles_.size(); ++k) {
      const auto& nodes = patch_.triangles[triangles_[k]].nodes;
      const Rest& rest = rests_[k];
      Eigen::Matrix<double, 3, 2> sides;
      sides.col(0) = place(nodes[1]) - place(nodes[0]);
      sides.col(1) = place(nodes[2]) - place(nodes[0]);
      const Eigen::Matrix<double, 3, 2> jacobian = sides * rest.inverse;
      const Vector3d a = jacobian.col(0), b = jacobian.col(1), &n = normals_[k];
      const double d = n.dot(a.cross(b));
      least_ = std::min(least_, d);
      const double root = std::sqrt(epsilon_ * epsilon_ + d * d);
      const double chi = d >= 0 ? 0.5 * (d + root) : 0.5 * epsilon_ * epsilon_ / (root - d), slope = chi / root;
      const double shape = a.squaredNorm() + b.squaredNorm(), size = area_weight * (1 + d * d);
      const double weight = rest.area / total_;
      sum += weight * (shape + size) / chi;
      const double by_d = 2 * area_weight * d / chi - (shape + size) * slope / (chi * chi);
      Eigen::Matrix<double, 3, 2> force;
      force.col(0) = 2 / chi * a + by_d * b.cross(n);
      force.col(1) = 2 / chi * b + by_d * n.cross(a);
      const Eigen::Matrix<double, 3, 2> pull = weight * force * rest.inverse.transpose();
      add(nodes[1], pull.col(0), gradient);
      add(nodes[2], pull.col(1), gradient);
      add(nodes[0], -pull.col(0) - pull.col(1), gradient);
    }
    return sum;
  }

  void add(int i, const Vector3d& pull, Eigen::VectorXd& gradient) const {
    const Eigen::Index k = slot_[i];
    if (k < 0) return;
    gradient[2 * k] += pull.dot(now_[k].du) / lengths_[k][0];
    gradient[2 * k + 1] += pull.dot(now_[k].dv) / lengths_[k][1];
  }

  /// A few steps of L-BFGS (Nocedal and Wright, algorithm 7.4) with backtracking.
  double descend(Eigen::VectorXd& x, Eigen::VectorXd& gradient) {
    std::deque<Eigen::VectorXd> steps, changes;
    double value = energy(x, gradient);
    for (int step = 0; step < steps_of_round; ++step) {
      Eigen::VectorXd direction = -gradient;
      std::vector<double> shares(steps.size());
      for (std::size_t i = steps.size(); i-- > 0;) {
        shares[i] = steps[i].dot(direction) / steps[i].dot(changes[i]);
        direction -= shares[i] * changes[i];
      }
      if (!steps.empty()) {
        direction *= steps.back().dot(changes.back()) / changes.back().squaredNorm();
      } else {
        direction *= 0.1 * unit_ / std::max(gradient.cwiseAbs().maxCoeff(), 1e-300);
      }
      for (std::size_t i = 0; i < steps.size(); ++i) {
        direction += (shares[i] - changes[i].dot(direction) / steps[i].dot(changes[i])) * steps[i];
      }
      const double slope = gradient.dot(direction);
      if (!(slope < 0)) break;
      double length = std::min(1.0, unit_ / std::max(direction.cwiseAbs().maxCoeff(), 1e-300));
      Eigen::VectorXd next, next_gradient(x.size());
      double next_value = value;
      bool lower = false;
      for (int halving = 0; halving < 25 && !lower; ++halving, length *= 0.5) {
        next = x + length * direction;
        next_value = energy(next, next_gradient);
        lower = next_value <= value + 1e-4 * length * slope;
      }
      if (!lower) break;
      const Eigen::VectorXd s = next - x, y = next_gradient - gradient;
      if (s.dot(y) > 1e-12 * s.norm() * y.norm()) {
        steps.push_back(s);
        changes.push_back(y);
        if (steps.size() > remembered) steps.pop_front(), changes.pop_front();
      }
      const bool still = value - next_value < 1e-7 * value;
      x = next;
      gradient = next_gradient;
      value = next_value;
      if (still) break;
    }
    return energy(x, gradient);
  }

  void store(const Eigen::VectorXd& x) {
    for (std::size_t k = 0; k < free_.size(); ++k) {
      FacePatch::Node& node = patch_.nodes[free_[k]];
      node.uv = uv_of(x, k);
      const gp_Pnt p = surface_->Value(node.uv[0], node.uv[1]);
      node.place = {p.X(), p.Y(), p.Z()};
    }
  }

  const Handle(Geom_Surface) surface_;
  FacePatch& patch_;
  std::vector<int> slot_;          ///< of nodes among the free ones; -1: fixed
  std::vector<std::size_t> free_;  ///< nodes
  std::vector<std::size_t> triangles_;
  std::vector<Rest> rests_;                     ///< of triangles_
  std::vector<Vector3d> normals_;               ///< of triangles_
  std::vector<std::array<double, 2>> lengths_;  ///< of a step of u and v at free_
  std::vector<Derivatives> now_;                ///< of free_
  double total_ = 0, unit_ = 1;                 ///< area at rest, mean size of a triangle
  double epsilon_ = 1, least_ = 0;
};

}  // namespace

std::vector<std::size_t> flipped_triangles(const Handle(Geom_Surface) & surface, const FacePatch& patch) {
  std::vector<Vector3d> normals;
  for (const FacePatch::Node& node : patch.nodes) normals.push_back(normal_of(surface, node));
  std::vector<std::size_t> flipped;
  for (std::size_t t = 0; t < patch.triangles.size(); ++t) {
    const auto& [a, b, c] = patch.triangles[t].nodes;
    const Vector3d o = vector(patch.nodes[a].place);
    const Vector3d area = (vector(patch.nodes[b].place) - o).cross(vector(patch.nodes[c].place) - o);
    if (area.dot(normals[a] + normals[b] + normals[c]) < 0) flipped.push_back(t);
  }
  return flipped;
}

double distortion(const FacePatch& patch) {
  struct Grown {
    double before = 0, now = 0, stretch = 0;
  };
  std::vector<Grown> grown;
  double before = 0, now = 0;
  for (const FacePatch::Triangle& triangle : patch.triangles) {
    const Rest rest = rest_of(triangle, 1);
    const auto& [a, b, c] = triangle.nodes;
    const Vector3d o = vector(patch.nodes[a].place);
    Eigen::Matrix<double, 3, 2> sides;
    sides << vector(patch.nodes[b].place) - o, vector(patch.nodes[c].place) - o;
    const double area = 0.5 * sides.col(0).cross(sides.col(1)).norm();
    if (!(area > 0) || !rest.inverse.allFinite()) return std::numeric_limits<double>::infinity();
    // |J|^2 / (2 det J) is (s + 1/s) / 2.
    grown.push_back({rest.area, area, 0.5 * (sides * rest.inverse).squaredNorm() * rest.area / area});
    before += rest.area;
    now += area;
  }
  double sum = 0;
  for (const Grown& of : grown) {
    const double growth = of.now / of.before * (before / now);
    sum += of.before * (of.stretch - 1 + 0.5 * (growth + 1 / growth) - 1);
  }
  return before > 0 ? sum / before : 0;
}

void slide_inner_nodes(const Handle(Geom_Surface) & surface, FacePatch& patch, const std::vector<std::size_t>& triangles,
                       const std::vector<std::size_t>& nodes, std::size_t rings, const RunContext& context) {
  std::vector<char> free(patch.nodes.size(), 0);
  for (const std::size_t t : triangles) {
    for (const int i : patch.triangles[t].nodes) free[i] = 1;
  }
  for (const std::size_t i : nodes) free[i] = 1;
  for (std::size_t ring = 0; ring < rings; ++ring) {
    std::vector<char> wider = free;
    bool grown = false;
    for (const FacePatch::Triangle& triangle : patch.triangles) {
      const auto& [a, b, c] = triangle.nodes;
      if (!free[a] && !free[b] && !free[c]) continue;
      for (const int i : triangle.nodes) {
        grown = grown || !wider[i];
        wider[i] = 1;
      }
    }
    free = std::move(wider);
    if (!grown) break;
  }
  for (std::size_t i = 0; i < free.size(); ++i) free[i] = free[i] && patch.nodes[i].inner;
  Sliding(surface, patch, free).run(context);
}

}  // namespace deform::cad
