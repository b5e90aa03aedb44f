// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/layer_step.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/constraints/fitting.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

constexpr std::size_t faces_per_task = 64, points_per_task = 1024;
constexpr double stay = 1e-3;          // weight of the way of an edge from the mean of the turned ones, beside its heights
constexpr double no_rotation = 1e-12;  // second singular value of a face over the first: a line

}  // namespace

LayerStep::LayerStep(const Input& input, const RunContext& context)
    : following_(input.following), scale_(input.box.scale), origin_(input.box.origin) {
  if (input.flat.exists()) along_ -= to_eigen(input.flat.normal()) * to_eigen(input.flat.normal()).transpose();
  for (const ConstraintSet& set : input.sets) {
    if (!set.column) continue;
    set_points_ += set.ids.size();
    for (std::size_t level = 0; level <= set.column->layers(); ++level) {
      for (std::size_t c = 0; c < set.column->sides(); ++c) ids_.push_back(set.ids[set.column->corner(level, c)]);
    }
  }
  std::sort(ids_.begin(), ids_.end());
  ids_.erase(std::unique(ids_.begin(), ids_.end()), ids_.end());
  for (const PointId id : ids_) {
    const std::size_t at = slot(id);
    slots_.push_back(at < following_.size() ? static_cast<std::uint32_t>(at) : none);
  }
  add_columns(input);
  if (empty()) return;
  // The height of a line of edges, at all of its points.
  std::vector<double> height(ids_.size(), 0.0);
  for (const Edge& edge : edges_) height[edge.point] = height[edge.below] + edge.rest.norm();
  for (auto edge = edges_.rbegin(); edge != edges_.rend(); ++edge) {
    height[edge->below] = std::max(height[edge->below], height[edge->point]);
  }
  for (const double h : height) reach_.push_back(carried_heights * h);
  at_rest_ = std::make_unique<const PointTree>(unit_places(input.mesh, input.box, ids_));
  carries_.resize(following_.size());
  parallel_for(context, following_.size(), points_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t s = begin; s < end; ++s) carries_[s] = carry_at(input.box.to_unit(input.mesh.points[following_[s]]));
  });
  add_nodes(input);
  for (const std::uint32_t s : slots_) {
    if (s != none) carries_[s] = {};
  }
}

std::size_t LayerStep::slot(PointId id) const {
  const auto found = std::lower_bound(following_.begin(), following_.end(), id);
  return found != following_.end() && *found == id ? static_cast<std::size_t>(found - following_.begin()) : following_.size();
}

LayerStep::Carry LayerStep::carry_at(const Vec3& place) const {
  const PointTree::Near near = at_rest_->nearest(place);
  const double r = std::sqrt(near.square);
  if (!(r < reach_[near.point])) return {};
  const double t = r / reach_[near.point], left = (1 - t) * (1 - t);
  return {{near.point, near.point}, {left * left * (4 * t + 1), 0}};
}

/// Nodes of columns that are no corners.
void LayerStep::add_nodes(const Input& input) {
  for (const ConstraintSet& set : input.sets) {
    if (!set.column) continue;
    std::vector<std::pair<double, std::uint32_t>> corners;
    for (std::size_t i = 0; i < set.ids.size(); ++i) {
      const std::size_t at = slot(set.ids[i]);
      if (at == following_.size() || std::binary_search(ids_.begin(), ids_.end(), set.ids[i])) continue;
      corners.clear();
      for (std::size_t level = 0; level <= set.column->layers(); ++level) {
        for (std::size_t c = 0; c < set.column->sides(); ++c) {
          const std::uint32_t place = set.column->corner(level, c);
          const auto u = std::lower_bound(ids_.begin(), ids_.end(), set.ids[place]) - ids_.begin();
          corners.emplace_back(squared_distance(set.rest[place], set.rest[i]), static_cast<std::uint32_t>(u));
        }
      }
      std::partial_sort(corners.begin(), corners.begin() + 2, corners.end());
      carries_[at] = {{corners[0].second, corners[1].second}, {0.5, 0.5}};
    }
  }
}

Vec3 LayerStep::sum(const Carry& carry, const Step& step) const {
  if (step.moved.empty()) return {};
  return carry.share[0] * step.moved[carry.from[0]] + carry.share[1] * step.moved[carry.from[1]];
}

/// The faces and edges.
void LayerStep::add_columns(const Input& input) {
  constexpr std::uint32_t several = none - 1;
  std::vector<std::uint32_t> below(ids_.size(), none);
  std::vector<std::size_t> level_of(ids_.size());
  std::vector<std::vector<std::uint32_t>> faces(ids_.size());
  const auto rest = [&](std::uint32_t u) { return to_eigen(input.box.to_unit(input.mesh.points[ids_[u]])); };
  for (const ConstraintSet& set : input.sets) {
    if (!set.column) continue;
    const StretchedColumn& column = *set.column;
    const auto place = [&](std::size_t level, std::size_t c) {
      const PointId id = set.ids[column.corner(level, c)];
      return static_cast<std::uint32_t>(std::lower_bound(ids_.begin(), ids_.end(), id) - ids_.begin());
    };
    Face face;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero(), area = Eigen::Vector3d::Zero(), up = Eigen::Vector3d::Zero();
    for (std::size_t c = 0; c < column.sides(); ++c) {
      const std::uint32_t u = place(0, c);
      face.corners.push_back(u);
      face.rest.push_back(rest(u));
      mean += face.rest.back() / static_cast<double>(column.sides());
      up += rest(place(1, c)) - rest(u);
      below[u] = several;  // a point of the wall
    }
    for (Eigen::Vector3d& x : face.rest) x -= mean;
    for (std::size_t c = 0; c < column.sides(); ++c) area += face.rest[c].cross(face.rest[(c + 1) % column.sides()]);
    face.normal = (area.dot(up) < 0 ? -area : area).stableNormalized();
    for (std::size_t level = 1; level <= column.layers(); ++level) {
      for (std::size_t c = 0; c < column.sides(); ++c) {
        const std::uint32_t u = place(level, c), under = place(level - 1, c);
        below[u] = below[u] == none || below[u] == under ? under : several;
        level_of[u] = std::max(level_of[u], level);
        faces[u].push_back(static_cast<std::uint32_t>(faces_.size()));
      }
    }
    faces_.push_back(std::move(face));
  }
  for (std::uint32_t u = 0; u < ids_.size(); ++u) {
    if (below[u] == none || below[u] == several || !follows(u) || input.keeps[ids_[u]]) continue;
    edges_.push_back({u, below[u], level_of[u], std::move(faces[u]), rest(u) - rest(below[u])});
  }
  std::stable_sort(edges_.begin(), edges_.end(), [](const Edge& a, const Edge& b) { return a.level < b.level; });
}

std::size_t LayerStep::bytes_for(std::size_t set_points, std::size_t following) {
  const std::size_t own = sizeof(Edge) + sizeof(Face) / 2 + 3 * sizeof(Eigen::Vector3d) + 10 * sizeof(std::uint32_t);
  return set_points * own + following * sizeof(Carry);
}

std::vector<LayerStep::Turn> LayerStep::turns(const std::vector<Vec3>& at, const RunContext& context) const {
  std::vector<Turn> result(faces_.size());
  parallel_for(context, faces_.size(), faces_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      const Face& face = faces_[f];
      Eigen::Matrix3d M = Eigen::Matrix3d::Zero();
      // The mean drops out, as the corners at rest are about theirs; the first corner is near.
      const Eigen::Vector3d first = to_eigen(at[face.corners[0]]);
      for (std::size_t c = 0; c < face.corners.size(); ++c) {
        M.noalias() += (to_eigen(at[face.corners[c]]) - first) * face.rest[c].transpose();
      }
      const auto [values, U, V] = svd(M);
      const Eigen::Vector3d sign(1, 1, (U * V.transpose()).determinant() < 0 ? -1 : 1);
      result[f].R = U * sign.asDiagonal() * V.transpose();
      // In the axes V, S is diagonal.
      const Eigen::Vector3d s = values.cwiseProduct(sign);
      const Eigen::Vector3d sums(s[1] + s[2], s[0] + s[2], s[0] + s[1]);
      const bool turned = values[0] > 0 && values[1] > no_rotation * values[0];
      result[f].response = turned ? Eigen::Matrix3d(V * sums.cwiseInverse().asDiagonal() * V.transpose())
                                  : Eigen::Matrix3d(Eigen::Matrix3d::Zero());
    }
  });
  return result;
}

namespace {

/// An edge at faces that have turned, with N = sum n n^T + stay I of their normals.
template <typename Edge, typename Faces, typename Turns>
class TurnedEdge {
 public:
  TurnedEdge(const Edge& edge, const Faces& faces, const Turns& turns) : edge_(edge), faces_(faces), turns_(turns) {
    const auto count = static_cast<double>(edge.faces.size());
    Eigen::Matrix3d N = Eigen::Matrix3d(stay * count * Eigen::Matrix3d::Identity());
    Eigen::Vector3d mean = Eigen::Vector3d::Zero(), b = Eigen::Vector3d::Zero();
    for (const std::uint32_t f : edge.faces) mean += turns[f].R * edge.rest / count;
    for (const std::uint32_t f : edge.faces) {
      const Eigen::Vector3d n = normal(f);
      N += n * n.transpose();
      b += n * (height(f) - n.dot(mean));
    }
    inverse_ = N.inverse();
    edge_now_ = mean + inverse_ * b;
  }

  const Eigen::Vector3d& value() const { return edge_now_; }

  /// For faces that turn by w[f], in their axes at rest.
  Eigen::Vector3d change(const std::vector<Eigen::Vector3d>& w) const {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero(), b = Eigen::Vector3d::Zero();
    for (const std::uint32_t f : edge_.faces) {
      mean += turns_[f].R * w[f].cross(edge_.rest) / static_cast<double>(edge_.faces.size());
    }
    for (const std::uint32_t f : edge_.faces) {
      const Eigen::Vector3d n = normal(f), dn = turns_[f].R * w[f].cross(faces_[f].normal);
      b += dn * (height(f) - n.dot(edge_now_)) - n * (dn.dot(edge_now_) + n.dot(mean));
    }
    return mean + inverse_ * b;
  }

  /// Adds the transpose of change() for g.
  void add_adjoint(const Eigen::Vector3d& g, std::vector<Eigen::Vector3d>& w) const {
    const Eigen::Vector3d p = inverse_ * g;
    Eigen::Vector3d mean = g;
    for (const std::uint32_t f : edge_.faces) mean -= normal(f) * normal(f).dot(p);
    mean /= static_cast<double>(edge_.faces.size());
    for (const std::uint32_t f : edge_.faces) {
      const Eigen::Vector3d n = normal(f), dn = p * (height(f) - n.dot(edge_now_)) - edge_now_ * n.dot(p);
      const Eigen::Matrix3d back = turns_[f].R.transpose();
      w[f] += edge_.rest.cross(back * mean) + faces_[f].normal.cross(back * dn);
    }
  }

 private:
  Eigen::Vector3d normal(std::uint32_t f) const { return turns_[f].R * faces_[f].normal; }
  double height(std::uint32_t f) const { return edge_.rest.dot(faces_[f].normal); }

  const Edge& edge_;
  const Faces& faces_;
  const Turns& turns_;
  Eigen::Matrix3d inverse_;
  Eigen::Vector3d edge_now_;
};

}  // namespace

/// With values in unit coordinates.
LayerStep::Step LayerStep::moved(Step step, const std::vector<Vec3>& from) const {
  step.moved.resize(ids_.size());
  for (std::size_t u = 0; u < ids_.size(); ++u) {
    step.moved[u] = scale_ * (step.values[u] - from[u]);
    step.values[u] = scale_ * step.values[u];
  }
  return step;
}

LayerStep::Step LayerStep::place(std::vector<Vec3> from, const RunContext& context) const {
  Step step;
  const std::vector<Turn> turned = turns(from, context);
  step.values = from;
  for (const Edge& edge : edges_) {
    step.values[edge.point] =
        step.values[edge.below] + to_vec3(along_ * (TurnedEdge(edge, faces_, turned).value() - edge.rest) + edge.rest);
  }
  step = moved(std::move(step), from);
  for (Vec3& value : step.values) value = value + origin_;
  step.from = std::move(from);
  return step;
}

/// With M = sum x x_0^T = R S the rotation changes by dR = R [w]x, (tr S - S) w = sum x_0 x R^T dx.
LayerStep::Step LayerStep::derivative(const std::vector<Vec3>& at, const std::vector<Vec3>& change,
                                      const RunContext& context) const {
  const std::vector<Turn> turned = turns(at, context);
  std::vector<Eigen::Vector3d> w(faces_.size(), Eigen::Vector3d::Zero());
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const Face& face = faces_[f];
    for (std::size_t c = 0; c < face.corners.size(); ++c) {
      w[f] += face.rest[c].cross(turned[f].R.transpose() * to_eigen(change[face.corners[c]]));
    }
    w[f] = turned[f].response * w[f];
  }
  Step step;
  step.values = change;
  for (const Edge& edge : edges_) {
    step.values[edge.point] = step.values[edge.below] + to_vec3(along_ * TurnedEdge(edge, faces_, turned).change(w));
  }
  return moved(std::move(step), change);
}

std::vector<Vec3> LayerStep::adjoint(const std::vector<Vec3>& at, std::vector<Vec3>& cotangents,
                                     const RunContext& context) const {
  // Derivatives of how far the points are moved, and of their positions after the step.
  std::vector<Vec3> steps(ids_.size(), Vec3{}), y(ids_.size(), Vec3{});
  for (std::size_t s = 0; s < carries_.size(); ++s) {
    for (std::size_t k = 0; k < 2; ++k) {
      const std::uint32_t u = carries_[s].from[k];
      if (carries_[s].share[k] != 0) steps[u] = steps[u] + carries_[s].share[k] * cotangents[s];
    }
  }
  for (std::size_t u = 0; u < ids_.size(); ++u) y[u] = follows(u) ? steps[u] + cotangents[slots_[u]] : steps[u];

  const std::vector<Turn> turned = turns(at, context);
  std::vector<Eigen::Vector3d> w(faces_.size(), Eigen::Vector3d::Zero());
  for (auto edge = edges_.rbegin(); edge != edges_.rend(); ++edge) {
    TurnedEdge(*edge, faces_, turned).add_adjoint(along_ * to_eigen(y[edge->point]), w);
    y[edge->below] = y[edge->below] + y[edge->point];
    y[edge->point] = {};
  }
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const Eigen::Vector3d q = turned[f].response * w[f];
    for (std::size_t c = 0; c < faces_[f].corners.size(); ++c) {
      Vec3& x = y[faces_[f].corners[c]];
      x = x + to_vec3(turned[f].R * q.cross(faces_[f].rest[c]));
    }
  }
  for (std::size_t u = 0; u < ids_.size(); ++u) {
    y[u] = y[u] - steps[u];
    if (!follows(u)) continue;
    cotangents[slots_[u]] = y[u];
    y[u] = {};
  }
  return y;
}

}  // namespace deform
