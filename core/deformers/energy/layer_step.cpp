// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/layer_step.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/constraints/fitting.h"
#include "core/numerics/dense/decompositions.h"

namespace deform {

namespace {

constexpr std::size_t faces_per_task = 64;
constexpr double least_slope = 0.3;      // of an edge: its height over its length, below which it has no height to keep
constexpr double no_rotation = 1e-12;    // second singular value of a face over the first: a line
constexpr double farthest = 3;           // of points around, over those of the columns
constexpr double farthest_more = 1e-12;  // of the model: rounding

/// e = a s / (s . m), or the mean of the turned edges where it leans too much.
struct Direction {
  Eigen::Vector3d s = Eigen::Vector3d::Zero(), m = Eigen::Vector3d::Zero();
  double count = 0, height = 0;

  bool upright() const { return s.dot(m) > least_slope * s.norm() * m.norm() && height > least_slope * s.norm(); }
  Eigen::Vector3d edge() const { return upright() ? Eigen::Vector3d(height / s.dot(m) * s) : Eigen::Vector3d(s / count); }
  Eigen::Vector3d change(const Eigen::Vector3d& ds, const Eigen::Vector3d& dm) const {
    if (!upright()) return ds / count;
    const double along = s.dot(m);
    return height / along * (ds - (ds.dot(m) + s.dot(dm)) / along * s);
  }
  /// Of change(), to s and m.
  std::pair<Eigen::Vector3d, Eigen::Vector3d> adjoint(const Eigen::Vector3d& g) const {
    if (!upright()) return {g / count, Eigen::Vector3d::Zero()};
    const double along = s.dot(m), by = height / along;
    return {by * (g - g.dot(s) / along * m), -by * g.dot(s) / along * s};
  }
};

}  // namespace

/// The corners of columns that follow.
std::vector<PointId> LayerStep::carried_points(const std::vector<ConstraintSet>& sets, const std::vector<char>& following) {
  std::vector<PointId> result;
  for (const ConstraintSet& set : sets) {
    if (!set.column) continue;
    for (std::size_t level = 0; level <= set.column->layers(); ++level) {
      for (std::size_t c = 0; c < set.column->sides(); ++c) {
        const PointId id = set.ids[set.column->corner(level, c)];
        if (following[id]) result.push_back(id);
      }
    }
  }
  std::sort(result.begin(), result.end());
  result.erase(std::unique(result.begin(), result.end()), result.end());
  return result;
}

LayerStep::LayerStep(const DeformationBefore& before, const std::vector<ConstraintSet>& sets, const std::vector<char>& keeps,
                     const RunContext& context)
    : before_(before) {
  const Mesh& mesh = before_.held.mesh;
  ids_ = carried_points(sets, std::vector<char>(mesh.point_count(), 1));
  std::vector<char> following(mesh.point_count());
  for (const PointId id : before_.following) following[id] = 1;
  for (std::uint32_t u = 0; u < ids_.size(); ++u) {
    follows_.push_back(following[ids_[u]]);
    if (following[ids_[u]]) moving_.push_back(u);
  }
  add_faces(sets, mesh, before_.box);
  std::erase_if(edges_, [&](const Edge& edge) { return !follows(edge.point) || keeps[ids_[edge.point]]; });
  const std::vector<PointId> moving = carried_points(sets, following);
  CarrierPlaces from = carrier_places(
      {mesh, before_.box, before_.held.region_of, moving, before_.held_ids, before_.following.size(), ExactSteps::joins});
  carrier_ = std::make_unique<const ResidualCorrection>(from.places, std::move(from.centres), ResidualCorrection::Kind::gentle,
                                                        from.bound, context);
  carried_from_ = from.places.size();
}

void LayerStep::add_faces(const std::vector<ConstraintSet>& sets, const Mesh& mesh, const UnitBox& box) {
  constexpr std::uint32_t unknown = ~std::uint32_t{0}, several = unknown - 1;
  std::vector<std::uint32_t> below(ids_.size(), unknown);
  std::vector<std::size_t> level_of(ids_.size());
  std::vector<std::vector<std::uint32_t>> faces(ids_.size());
  const auto rest = [&](std::uint32_t u) { return to_eigen(box.to_unit(mesh.points[ids_[u]])); };
  for (const ConstraintSet& set : sets) {
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
        below[u] = below[u] == unknown || below[u] == under ? under : several;
        level_of[u] = std::max(level_of[u], level);
        faces[u].push_back(static_cast<std::uint32_t>(faces_.size()));
      }
    }
    faces_.push_back(std::move(face));
  }
  for (std::uint32_t u = 0; u < ids_.size(); ++u) {
    if (below[u] == unknown || below[u] == several) continue;
    Edge edge{u, below[u], level_of[u], std::move(faces[u]), rest(u) - rest(below[u]), 0};
    for (const std::uint32_t f : edge.faces) edge.height += edge.rest.dot(faces_[f].normal);
    edges_.push_back(std::move(edge));
  }
  std::stable_sort(edges_.begin(), edges_.end(), [](const Edge& a, const Edge& b) { return a.level < b.level; });
}

std::size_t LayerStep::own_bytes(std::size_t set_points) {
  return set_points * (sizeof(Edge) + sizeof(Face) / 2 + 2 * sizeof(Eigen::Vector3d) + 10 * sizeof(std::uint32_t));
}

std::size_t LayerStep::bytes() const {
  std::size_t bytes = ids_.size() * (sizeof(PointId) + 1) + moving_.size() * sizeof(std::uint32_t) + carrier_->bytes();
  for (const Face& face : faces_) bytes += sizeof(Face) + face.corners.size() * (sizeof(std::uint32_t) + sizeof(Eigen::Vector3d));
  for (const Edge& edge : edges_) bytes += sizeof(Edge) + edge.faces.size() * sizeof(std::uint32_t);
  return bytes;
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

/// s and m of an edge.
template <typename Edge, typename Faces, typename Turns>
Direction direction(const Edge& edge, const Faces& faces, const Turns& turns) {
  Direction result;
  for (const std::uint32_t f : edge.faces) {
    result.s += turns[f].R * edge.rest;
    result.m += turns[f].R * faces[f].normal;
  }
  result.count = static_cast<double>(edge.faces.size());
  result.height = edge.height;
  return result;
}

}  // namespace

RowMajorMatrix LayerStep::carried(const std::vector<Vec3>& from, const std::vector<Vec3>& to, const RunContext& context) const {
  Eigen::MatrixXd step = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(carried_from_), 3);
  for (std::size_t i = 0; i < moving_.size(); ++i) {
    const std::uint32_t u = moving_[i];
    for (std::size_t k = 0; k < 3; ++k) {
      step(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = before_.box.scale * (to[u][k] - from[u][k]);
    }
  }
  return carrier_->coefficients(step, context);
}

void LayerStep::add_values(const double* tile, const Step& step, double* out) const {
  if (step.carried.size() > 0) carrier_->add_values(tile, step.carried.data(), 3, out);
}

LayerStep::Step LayerStep::place(std::vector<Vec3> from, const RunContext& context) const {
  Step step;
  const std::vector<Turn> turned = turns(from, context);
  std::vector<Vec3> to = from;
  double largest = 0;
  for (const Edge& edge : edges_) {
    to[edge.point] = to[edge.below] + to_vec3(direction(edge, faces_, turned).edge());
    largest = std::max(largest, distance(to[edge.point], from[edge.point]));
  }
  step.carried = carried(from, to, context);
  if (carries_far(step, (farthest * largest + farthest_more) * before_.box.scale, context)) return {};
  for (const Vec3& y : to) step.values.push_back(before_.box.to_model(y));
  step.from = std::move(from);
  return step;
}

/// Whether some point moves farther than `most`: interpolants can overshoot.
bool LayerStep::carries_far(const Step& step, double most, const RunContext& context) const {
  std::atomic<bool> far = false;
  parallel_for(context, before_.following_places.tiles(), 64, [&](std::size_t begin, std::size_t end) {
    std::vector<double> values(3 * tile_size);
    for (std::size_t t = begin; t < end && !far; ++t) {
      std::fill(values.begin(), values.end(), 0.0);
      add_values(before_.following_places.tile(t), step, values.data());
      for (std::size_t i = 0; i < tile_size; ++i) {
        // The negation makes NaN count as far.
        if (!(std::hypot(values[i], values[tile_size + i], values[2 * tile_size + i]) <= most)) far = true;
      }
    }
  });
  return far;
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
    Eigen::Vector3d ds = Eigen::Vector3d::Zero(), dm = Eigen::Vector3d::Zero();
    for (const std::uint32_t f : edge.faces) {
      ds += turned[f].R * w[f].cross(edge.rest);
      dm += turned[f].R * w[f].cross(faces_[f].normal);
    }
    step.values[edge.point] = step.values[edge.below] + to_vec3(direction(edge, faces_, turned).change(ds, dm));
  }
  step.carried = carried(change, step.values, context);
  for (Vec3& value : step.values) value = before_.box.scale * value;
  return step;
}

std::vector<Vec3> LayerStep::adjoint(const std::vector<Vec3>& at, std::vector<Vec3>& cotangents,
                                     const RunContext& context) const {
  const std::vector<PointId>& following = before_.following;
  const std::vector<Vec3> places = unit_places(before_.held.mesh, before_.box, following);
  std::vector<Vec3> others = cotangents, y(ids_.size(), Vec3{});
  std::vector<std::size_t> slots;
  for (const std::uint32_t u : moving_) {
    slots.push_back(static_cast<std::size_t>(std::lower_bound(following.begin(), following.end(), ids_[u]) - following.begin()));
    y[u] = cotangents[slots.back()];
    others[slots.back()] = {};
  }
  const Eigen::MatrixXd steps = carrier_->adjoint(places, others, context);
  const auto step = [&](std::size_t i) {
    const auto row = static_cast<Eigen::Index>(i);
    return Vec3{steps(row, 0), steps(row, 1), steps(row, 2)};
  };
  for (std::size_t i = 0; i < moving_.size(); ++i) y[moving_[i]] = y[moving_[i]] + step(i);

  const std::vector<Turn> turned = turns(at, context);
  std::vector<Eigen::Vector3d> w(faces_.size(), Eigen::Vector3d::Zero());
  for (auto edge = edges_.rbegin(); edge != edges_.rend(); ++edge) {
    const auto [s, m] = direction(*edge, faces_, turned).adjoint(to_eigen(y[edge->point]));
    for (const std::uint32_t f : edge->faces) {
      w[f] += edge->rest.cross(turned[f].R.transpose() * s) + faces_[f].normal.cross(turned[f].R.transpose() * m);
    }
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
  for (std::size_t i = 0; i < moving_.size(); ++i) {
    cotangents[slots[i]] = y[moving_[i]] - step(i);
    y[moving_[i]] = {};
  }
  return y;
}

}  // namespace deform
