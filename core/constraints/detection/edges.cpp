// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/edges.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "core/numerics/dense/decompositions.h"

namespace deform::detection {

namespace {

constexpr double smooth_joint = 0.05;         ///< radians; primitives that meet in less have no edge between them
constexpr double shortest = 0.02;             ///< of features, over the size
constexpr double least_arc = 0.35;            ///< radians
constexpr std::size_t fewest_points = 5;      ///< of a piece of a chain, of a line beside no primitive, and of circles and arcs
constexpr std::size_t fewest_on_line = 3;     ///< as a whole
constexpr std::size_t fewest_on_any_arc = 8;  ///< beside no primitive: noise folds long thin faces into arcs of five and six
// Any smooth curve is nearly straight, or an arc, for a while. Pieces are evidence where they are long for how far their points
// are off: measured on the creases of a car and a propeller, lines up to 330 and arcs up to 14 times, on edges of parts from 900
// and 40.
constexpr double least_straightness = 500;  ///< length over distance of points
constexpr double least_roundness = 25;      ///< sagitta over distance of points
constexpr std::uint32_t rim = 0xfffffffe;

/// A feature edge with the labels beside it, the smaller first.
struct Edge {
  PointId a, b;
  std::uint32_t left, right;
};

struct Chain {
  std::vector<PointId> points;
  bool closed = false;
  bool supported = true;  ///< a primitive on one side, another or nothing at all on the other
};

struct Fit {
  EdgeKind kind = EdgeKind::line;
  Vector3d point, axis;
  double radius = 0, rms = 0, max = 0;
};

std::vector<Edge> collected(const Surface& surface, const Limits& limits, std::span<const std::uint32_t> labels) {
  std::vector<Edge> edges;
  for (std::size_t f = 0; f < surface.face_count(); ++f) {
    const auto neighbours = surface.neighbours(f);
    for (const Neighbour& n : neighbours) {
      if (n.face < f || surface.area[f] == 0 || surface.area[n.face] == 0) continue;
      const double doubt = surface.allowance(f) + surface.allowance(n.face);
      const auto [left, right] = std::minmax(labels[f], labels[n.face]);
      if (left == right && left != unlabelled) continue;
      const bool between = right != unlabelled && n.angle > smooth_joint + doubt;
      if (between || n.angle > limits.maximum_angle + doubt) edges.push_back({n.from, n.to, left, right});
    }
    const auto corners = surface.corners(f);
    if (corners.size() < 3) continue;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const auto [a, b] = std::minmax(corners[i], corners[(i + 1) % corners.size()]);
      const bool shared = std::any_of(neighbours.begin(), neighbours.end(),
                                      [low = a, high = b](const Neighbour& n) { return n.from == low && n.to == high; });
      if (a != b && !shared) edges.push_back({a, b, std::min(labels[f], rim), std::max(labels[f], rim)});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& x, const Edge& y) {
    return std::tie(x.a, x.b, x.left, x.right) < std::tie(y.a, y.b, y.left, y.right);
  });
  edges.erase(std::unique(edges.begin(), edges.end(), [](const Edge& x, const Edge& y) { return x.a == y.a && x.b == y.b; }),
              edges.end());
  return edges;
}

/// Edges end to end.
class Chains {
 public:
  explicit Chains(std::span<const Edge> edges, std::size_t points)
      : edges_(edges), first_(points + 1, 0), used_(edges.size(), 0) {
    for (const Edge& e : edges) {
      ++first_[e.a + 1];
      ++first_[e.b + 1];
    }
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    at_.resize(2 * edges.size());
    std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
    for (std::size_t i = 0; i < edges.size(); ++i) {
      at_[next[edges[i].a]++] = i;
      at_[next[edges[i].b]++] = i;
    }
    // Start at the ends; the remaining chains are closed.
    for (std::size_t p = 0; p < points; ++p) {
      if (degree(p) == 0 || !is_end(p)) continue;
      for (std::size_t i = first_[p]; i < first_[p + 1]; ++i) walk(static_cast<PointId>(p), at_[i]);
    }
    for (std::size_t i = 0; i < edges.size(); ++i) walk(edges[i].a, i);
  }
  std::vector<Chain> chains;

 private:
  std::size_t degree(std::size_t p) const { return first_[p + 1] - first_[p]; }
  bool is_end(std::size_t p) const {
    if (degree(p) != 2) return true;
    const Edge &x = edges_[at_[first_[p]]], &y = edges_[at_[first_[p] + 1]];
    // What is not labelled here may be the same all the same.
    return (x.left != y.left || x.right != y.right) && x.right != unlabelled && y.right != unlabelled;
  }
  void walk(PointId start, std::size_t edge) {
    if (used_[edge]) return;
    Chain chain{{start}, false, true};
    for (PointId p = start;;) {
      used_[edge] = 1;
      chain.supported = chain.supported && edges_[edge].left < rim && edges_[edge].right <= rim;
      p = edges_[edge].a == p ? edges_[edge].b : edges_[edge].a;
      if (p == start) {
        chain.closed = true;
        break;
      }
      chain.points.push_back(p);
      if (is_end(p)) break;
      const std::size_t other = at_[first_[p]] == edge ? at_[first_[p] + 1] : at_[first_[p]];
      if (used_[other]) break;
      edge = other;
    }
    chains.push_back(std::move(chain));
  }

  std::span<const Edge> edges_;
  std::vector<std::size_t> first_, at_;
  std::vector<char> used_;
};

class Fitter {
 public:
  Fitter(const Surface& surface, const Limits& limits)
      : surface_(surface), limits_(limits), threshold_(std::max(3 * limits.floor, limits.tolerance / 4)) {}

  double length(std::span<const PointId> ids, bool closed) const {
    double sum = closed ? (at(ids.back()) - at(ids.front())).norm() : 0;
    for (std::size_t i = 1; i < ids.size(); ++i) sum += (at(ids[i]) - at(ids[i - 1])).norm();
    return sum;
  }

  std::optional<Fit> line(std::span<const PointId> ids) const {
    if (ids.size() < 2) return std::nullopt;
    const auto [mean, axes] = principal(ids);
    Fit fit;
    fit.axis = axes.col(2);
    if (fit.axis.dot(at(ids.back()) - at(ids.front())) < 0) fit.axis = -fit.axis;
    fit.point = mean + (at(ids.front()) - mean).dot(fit.axis) * fit.axis;
    double squares = 0;
    for (const PointId p : ids) {
      const double d = (at(p) - mean).cross(fit.axis).norm();
      squares += d * d;
      fit.max = std::max(fit.max, d);
    }
    fit.rms = std::sqrt(squares / static_cast<double>(ids.size()));
    return fit.max <= threshold_ ? std::optional(fit) : std::nullopt;
  }

  std::optional<Fit> circle(std::span<const PointId> ids, bool closed) const {
    if (ids.size() < fewest_points || !gentle(ids, closed)) return std::nullopt;
    const auto [mean, axes] = principal(ids);
    const Vector3d axis = axes.col(0), e1 = axes.col(1), e2 = axes.col(2);
    // Algebraic first, then geometric (Gauss-Newton).
    Eigen::MatrixXd rows(ids.size(), 3);
    Eigen::VectorXd right(ids.size());
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const auto r = static_cast<Eigen::Index>(i);
      const Vector3d q = at(ids[i]) - mean;
      rows.row(r) << 2 * q.dot(e1), 2 * q.dot(e2), 1;
      right[r] = q.squaredNorm() - q.dot(axis) * q.dot(axis);
    }
    const Vector3d algebraic = pivoted_solution(rows, right).x;
    double x = algebraic[0], y = algebraic[1], radius = std::sqrt(std::max(0.0, algebraic[2] + x * x + y * y));
    for (int round = 0; round < 5; ++round) {
      for (std::size_t i = 0; i < ids.size(); ++i) {
        const auto r = static_cast<Eigen::Index>(i);
        const Vector3d q = at(ids[i]) - mean;
        const double u = q.dot(e1) - x, v = q.dot(e2) - y, rho = std::max(std::hypot(u, v), 1e-300);
        rows.row(r) << u / rho, v / rho, 1;
        right[r] = rho - radius;
      }
      const Vector3d step = pivoted_solution(rows, right).x;
      x += step[0];
      y += step[1];
      radius += step[2];
    }
    Fit fit;
    fit.kind = closed ? EdgeKind::circle : EdgeKind::arc;
    fit.point = mean + x * e1 + y * e2;
    fit.axis = axis;
    fit.radius = radius;
    if (!(radius > 0 && radius < 20)) return std::nullopt;
    double squares = 0;
    for (const PointId p : ids) {
      const Vector3d q = at(p) - fit.point;
      const double h = q.dot(axis), d = std::hypot(h, (q - h * axis).norm() - radius);
      squares += d * d;
      fit.max = std::max(fit.max, d);
    }
    fit.rms = std::sqrt(squares / static_cast<double>(ids.size()));
    if (!(fit.max <= std::min(limits_.tolerance, 0.02 * radius) && (fit.max <= 3 * limits_.floor || restless(ids, fit)))) {
      return std::nullopt;
    }
    return closed || length(ids, false) >= least_arc * radius ? std::optional(fit) : std::nullopt;
  }

  std::optional<Fit> best(std::span<const PointId> ids, bool closed) const {
    if (!closed) {
      if (auto fit = line(ids)) return fit;
    }
    return circle(ids, closed);
  }

  /// Whether the fit is significant, unlike that of a smooth curve over a short piece. Deviations caused by noise are ignored.
  bool evident(const Fit& fit, std::span<const PointId> ids) const {
    const double off = std::max(0.0, fit.max - 3 * surface_.noise), along = length(ids, false);
    if (fit.kind == EdgeKind::line) return along >= least_straightness * off;
    const double turn = std::min(along / fit.radius, 2 * std::numbers::pi);
    return fit.radius * (1 - std::cos(turn / 2)) >= least_roundness * off;
  }

  /// The place along a closed chain to cut it at: where it turns most.
  std::size_t sharpest(std::span<const PointId> ids) const {
    std::size_t where = 0;
    double most = -1;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const double turn = turning(ids[(i + ids.size() - 1) % ids.size()], ids[i], ids[(i + 1) % ids.size()]);
      if (turn > most + 1e-9) {
        most = turn;
        where = i;
      }
    }
    return where;
  }

 private:
  const Vector3d& at(PointId p) const { return surface_.points[p]; }

  std::pair<Vector3d, Eigen::Matrix3d> principal(std::span<const PointId> ids) const {
    Vector3d mean = Vector3d::Zero();
    for (const PointId p : ids) mean += at(p) / static_cast<double>(ids.size());
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const PointId p : ids) spread += (at(p) - mean) * (at(p) - mean).transpose();
    return {mean, symmetric_eigen(spread).vectors};
  }

  double turning(PointId a, PointId b, PointId c) const {
    const Vector3d before = at(b) - at(a), after = at(c) - at(b);
    return std::atan2(before.cross(after).norm(), before.dot(after));
  }

  /// Whether distances from the circle jump to and fro as noise and facets do (von Neumann's ratio), rather than swing slowly as
  /// those of an ellipse.
  bool restless(std::span<const PointId> ids, const Fit& fit) const {
    double last = 0, jumps = 0, squares = 0;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const Vector3d q = at(ids[i]) - fit.point;
      const double d = (q - q.dot(fit.axis) * fit.axis).norm() - fit.radius;
      if (i > 0) jumps += (d - last) * (d - last);
      squares += d * d;
      last = d;
    }
    return jumps >= 0.5 * squares;
  }

  /// No corners: the corners of a square are on a circle too.
  bool gentle(std::span<const PointId> ids, bool closed) const {
    const std::size_t n = ids.size();
    for (std::size_t i = closed ? 0 : 1; i < (closed ? n : n - 1); ++i) {
      const PointId a = ids[(i + n - 1) % n], b = ids[i], c = ids[(i + 1) % n];
      const double edge = std::min((at(b) - at(a)).norm(), (at(c) - at(b)).norm());
      const double doubt = edge > 0 ? (8 * surface_.noise + 2 * limits_.floor) / edge : 4;
      if (turning(a, b, c) > limits_.maximum_angle + doubt) return false;
    }
    return true;
  }

  const Surface& surface_;
  const Limits& limits_;
  double threshold_;
};

class Features {
 public:
  Features(const Mesh& mesh, const Surface& surface, const Limits& limits)
      : mesh_(mesh), surface_(surface), fitter_(surface, limits) {}
  std::vector<EdgeFeature> found;

  void add(const Chain& chain) {
    if (fitter_.length(chain.points, chain.closed) < shortest) return;
    if (const auto fit = fitter_.best(chain.points, chain.closed)) {
      const bool known = chain.supported || chain.closed;
      const bool enough = chain.points.size() >= (known ? fewest_on_line : fewest_alone(fit->kind));
      if (enough && (known || fitter_.evident(*fit, chain.points))) keep(*fit, chain.points, chain.closed);
      return;
    }
    std::vector<PointId> ids = chain.points;
    if (chain.closed) {
      std::rotate(ids.begin(), ids.begin() + static_cast<std::ptrdiff_t>(fitter_.sharpest(ids)), ids.end());
      ids.push_back(ids.front());
    }
    cut(ids, chain.supported);
  }

 private:
  /// The least number of points of a chain without an adjacent primitive.
  static std::size_t fewest_alone(EdgeKind kind) { return kind == EdgeKind::line ? fewest_points : fewest_on_any_arc; }

  /// The longest piece from the front that fits, and so on.
  void cut(std::span<const PointId> ids, bool supported) {
    while (ids.size() >= fewest_points) {
      std::size_t good = 0, step = fewest_points, bad = ids.size() + 1;
      for (std::size_t n = fewest_points; n <= ids.size(); n += step, step *= 2) {
        if (!fitter_.best(ids.first(n), false)) {
          bad = n;
          break;
        }
        good = n;
      }
      if (good == 0) {
        ids = ids.subspan(1);
        continue;
      }
      while (good + 1 < bad) {
        const std::size_t middle = (good + bad) / 2;
        (fitter_.best(ids.first(middle), false) ? good : bad) = middle;
      }
      const auto piece = ids.first(good);
      const auto fit = fitter_.best(piece, false);
      const bool enough = supported || piece.size() >= fewest_alone(fit->kind);
      if (enough && fitter_.length(piece, false) >= shortest && fitter_.evident(*fit, piece)) keep(*fit, piece, false);
      ids = ids.subspan(good - 1);
    }
  }

  void keep(const Fit& fit, std::span<const PointId> ids, bool closed) {
    EdgeFeature feature;
    feature.kind = fit.kind;
    feature.points.assign(ids.begin(), ids.end());
    if (!closed && ids.size() > 1 && ids.front() == ids.back()) feature.points.pop_back();
    const Vector3d point = surface_.middle + surface_.size * fit.point;
    feature.point = {point[0], point[1], point[2]};
    feature.axis = {fit.axis[0], fit.axis[1], fit.axis[2]};
    feature.radius = surface_.size * fit.radius;
    feature.length = surface_.size * fitter_.length(ids, closed);
    feature.rms = surface_.size * fit.rms;
    feature.max = surface_.size * fit.max;
    found.push_back(std::move(feature));
  }

  const Mesh& mesh_;
  const Surface& surface_;
  Fitter fitter_;
};

}  // namespace

std::vector<EdgeFeature> feature_edges(const Mesh& mesh, const Surface& surface, const Limits& limits,
                                       std::span<const std::uint32_t> labels) {
  const std::vector<Edge> edges = collected(surface, limits, labels);
  Features features(mesh, surface, limits);
  for (const Chain& chain : Chains(edges, mesh.point_count()).chains) features.add(chain);
  auto& found = features.found;
  std::stable_sort(found.begin(), found.end(), [](const EdgeFeature& a, const EdgeFeature& b) {
    return a.kind != b.kind ? a.kind < b.kind : a.length != b.length ? a.length > b.length : a.points < b.points;
  });
  for (auto begin = found.begin(), end = begin; begin != found.end(); begin = end) {
    while (end != found.end() && end->kind == begin->kind && end->length >= begin->length * (1 - 1e-6)) ++end;
    std::sort(begin, end, [](const EdgeFeature& a, const EdgeFeature& b) { return a.points < b.points; });
  }
  return std::move(found);
}

}  // namespace deform::detection
