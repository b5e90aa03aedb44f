// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cages/mirror_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr std::size_t few_samples = 400;
constexpr std::size_t samples_per_task = 512;
constexpr double same_moments = 0.05;  // of principal moments: below, the axes in between are any
constexpr int axes_between = 7;        // in steps of 22.5 degrees
constexpr double worth_moving = 0.02;  // of D: root mean square deviation of planes that are moved to where they fit best
constexpr double fits_well = 0.1;      // of the tolerance: such planes are not moved
constexpr int most_moves = 30;
constexpr double most_factor = 0.95;                                 // of steps of which the rest is foreseen
constexpr double far_off = 2;                                        // of the median: distances that count half
constexpr double moved_enough = 1e-9;                                // of the normal, and of D
constexpr double fits_as_well = 1.5;                                 // ratio of deviations
constexpr double rounding = 1e-9;                                    // of D
constexpr double nearly_parallel = 0.999, nearly_orthogonal = 0.01;  // cosines
constexpr double same_place = 0.01;                                  // of D: distance of nearly parallel planes

using Matrix = std::array<Vec3, 3>;  // symmetric

/// Eigenvalues and unit eigenvectors of a symmetric matrix by Jacobi's method, ascending.
struct Axes {
  Vec3 values{};
  std::array<Vec3, 3> vectors{};
};

Axes axes_of(Matrix a) {
  Matrix v{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  // columns are the vectors
  for (int sweep = 0; sweep < 30; ++sweep) {
    if (a[0][1] == 0 && a[0][2] == 0 && a[1][2] == 0) break;
    for (const auto& [p, q] : {std::pair<std::size_t, std::size_t>{0, 1}, {0, 2}, {1, 2}}) {
      if (a[p][q] == 0) continue;
      const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
      const double t = (theta < 0 ? -1 : 1) / (std::abs(theta) + std::hypot(theta, 1.0));
      const double c = 1 / std::hypot(t, 1.0), s = t * c;
      for (Matrix* m : {&a, &v}) {
        for (Vec3& row : *m) {
          const double x = row[p], y = row[q];
          row[p] = c * x - s * y;
          row[q] = s * x + c * y;
        }
      }
      for (std::size_t k = 0; k < 3; ++k) {
        const double x = a[p][k], y = a[q][k];
        a[p][k] = c * x - s * y;
        a[q][k] = s * x + c * y;
      }
      if (std::abs(a[p][q]) < 1e-300) a[p][q] = a[q][p] = 0;
    }
  }
  std::array<std::size_t, 3> order{0, 1, 2};
  std::sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return a[i][i] < a[j][j]; });
  Axes axes;
  for (std::size_t k = 0; k < 3; ++k) {
    axes.values[k] = a[order[k]][order[k]];
    for (std::size_t i = 0; i < 3; ++i) axes.vectors[k][i] = v[i][order[k]];
  }
  return axes;
}

void add_product(Matrix& m, double factor, const Vec3& a, const Vec3& b) {
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) m[i][j] += 0.5 * factor * (a[i] * b[j] + b[i] * a[j]);
  }
}

/// Centroid and second moments about it, of the area or, where there is none, of the corners.
struct Moments {
  Vec3 centre{};
  Matrix second{};
  Box box;
};

Moments moments_of(std::span<const TriangleCorners> triangles) {
  Moments moments;
  for (const TriangleCorners& t : triangles) {
    for (const Vec3& x : t) moments.box.add(x);
  }
  const Vec3 middle = 0.5 * (moments.box.min + moments.box.max);
  const double unit = moments.box.diagonal() > 0 ? moments.box.diagonal() : 1;
  const auto weight = [&](const TriangleCorners& t) { return 0.5 * norm(cross((t[1] - t[0]) / unit, (t[2] - t[0]) / unit)); };
  double area = 0;
  for (const TriangleCorners& t : triangles) area += weight(t);
  const bool flat = area > 0;
  double sum = 0;
  Vec3 first{};
  for (const TriangleCorners& t : triangles) {
    const double w = flat ? weight(t) : 1;
    sum += w;
    first = first + w / 3 * (t[0] + t[1] + t[2] - 3.0 * middle);
  }
  moments.centre = middle + first / sum;
  for (const TriangleCorners& t : triangles) {
    const double w = flat ? weight(t) : 1;
    Vec3 all{};
    for (const Vec3& corner : t) {
      const Vec3 x = (corner - moments.centre) / unit;
      add_product(moments.second, w / 12, x, x);
      all = all + x;
    }
    add_product(moments.second, w / 12, all, all);
  }
  return moments;
}

/// A plane and how far the image in it is from the surface.
struct Tried {
  CagePlane plane;
  double deviation = std::numeric_limits<double>::infinity();
  Vec3 at{};

  /// Planes across coordinate axes are as good as others that fit somewhat better.
  double preference() const {
    const Vec3& n = plane.normal;
    return n[0] == 1 || n[1] == 1 || n[2] == 1 ? 1 / fits_as_well : 1;
  }
};

/// Each place once, in order.
std::vector<Vec3> corners_of(std::span<const TriangleCorners> triangles) {
  std::vector<Vec3> corners;
  for (const TriangleCorners& t : triangles) corners.insert(corners.end(), t.begin(), t.end());
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  corners.shrink_to_fit();
  return corners;
}

class Search {
 public:
  Search(std::vector<TriangleCorners> triangles, double tolerance, const RunContext& context)
      : candidates_(mirror_candidates(triangles)),
        samples_(corners_of(triangles)),
        diagonal_(bounding_box(samples_).diagonal()),
        closest_(std::move(triangles)),
        tolerance_(tolerance),
        context_(context) {
    const std::size_t step = samples_.size() / few_samples + 1;
    for (std::size_t i = 0; i < samples_.size(); i += step) few_.push_back(samples_[i]);
  }

  SurfaceMirrors run() {
    std::vector<char> fits;
    for (const CagePlane& plane : candidates_) fits.push_back(try_plane(plane) <= fits_well * tolerance_ ? 1 : 0);
    const std::size_t given = tried_.size();
    for (std::size_t i = 0; i < candidates_.size(); ++i) {
      if (fits[i] != 0 || std::count(fits.begin(), fits.end(), 1) >= 3) continue;
      const CagePlane& plane = candidates_[i];
      if (mean_deviation(plane) > worth_moving * diagonal_) continue;
      const CagePlane best = moved(plane);
      const bool known = std::any_of(tried_.begin() + static_cast<std::ptrdiff_t>(given), tried_.end(),
                                     [&](const Tried& t) { return is_same(t.plane, best, 1 - 1e-12, 1e-6); });
      if (!known) try_plane(best);
    }
    SurfaceMirrors found;
    for (const Tried& tried : tried_) accept(tried, found);
    if (!found.planes.empty()) return found;
    const auto best = std::min_element(tried_.begin(), tried_.end(), [](const Tried& a, const Tried& b) {
      return a.preference() * a.deviation < b.preference() * b.deviation;
    });
    if (best == tried_.end()) return found;
    const auto first = std::find_if(tried_.begin(), tried_.end(), [&](const Tried& t) {
      return is_same(t.plane, best->plane, nearly_parallel, same_place) && t.preference() * t.deviation <= best->deviation;
    });
    found.near = {first->plane, first->deviation, first->at};
    return found;
  }

 private:
  double height(const CagePlane& plane, const Vec3& x) const { return dot(plane.normal, x - plane.point); }
  bool is_same(const CagePlane& a, const CagePlane& b, double cosine, double place) const {
    const Vec3& x = samples_[samples_.size() / 2];
    return std::abs(dot(a.normal, b.normal)) >= cosine &&
           std::abs(std::abs(height(a, x)) - std::abs(height(b, x))) <= place * diagonal_;
  }
  double off(const CagePlane& plane, const Vec3& x) const {
    const Vec3 image = reflected(plane, x);
    return distance(image, closest_(image));
  }
  double mean_deviation(const CagePlane& plane) const {
    double sum = 0;
    for (const Vec3& x : few_) {
      const double part = off(plane, x) / diagonal_;
      sum += part * part;
    }
    return diagonal_ * std::sqrt(sum / static_cast<double>(few_.size()));
  }

  /// Infinity if it is over the tolerance by more than SurfaceMirrors::nearly.
  Tried deviation(const CagePlane& plane) const {
    const double limit = SurfaceMirrors::nearly * tolerance_;
    Tried tried{plane};
    for (const Vec3& x : few_) {
      if (off(plane, x) > limit) return tried;
    }
    std::vector<std::pair<double, Vec3>> worst(samples_.size() / samples_per_task + 1, {-1, {}});
    parallel_for(context_, samples_.size(), samples_per_task, [&](std::size_t begin, std::size_t end) {
      auto& [most, at] = worst[begin / samples_per_task];
      for (std::size_t i = begin; i < end; ++i) {
        const double here = off(plane, samples_[i]);
        if (here > most) most = here, at = samples_[i];
      }
    });
    std::pair<double, Vec3> all{-1, {}};
    for (const auto& part : worst) {
      if (part.first > all.first) all = part;
    }
    if (all.first <= limit) tried.deviation = all.first, tried.at = all.second;
    return tried;
  }

  double try_plane(const CagePlane& plane) {
    context_.check();
    const Tried tried = deviation(plane);
    if (std::isfinite(tried.deviation)) tried_.push_back(tried);
    return tried.deviation;
  }

  /// The plane moved such that images are nearest to the surface, in the mean square without what is much farther than most: what
  /// is on one side only does not pull at it.
  CagePlane moved(CagePlane plane) const {
    Vec3 last{};
    for (int move = 0; move < most_moves; ++move) {
      context_.check();
      std::vector<Vec3> there;
      std::vector<double> weights;
      for (const Vec3& x : few_) {
        const Vec3 image = reflected(plane, x);
        there.push_back(closest_(image));
        weights.push_back(distance(image, there.back()) / diagonal_);
      }
      std::vector<double> sorted = weights;
      const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
      std::nth_element(sorted.begin(), middle, sorted.end());
      const double most = far_off * *middle + 1e-3 * rounding;
      double sum = 0;
      Vec3 from{}, to{};
      for (std::size_t i = 0; i < few_.size(); ++i) {
        double& w = weights[i];
        w = 1 / (1 + w / most * (w / most));
        sum += w;
        from = from + w * few_[i];
        to = to + w * there[i];
      }
      from = from / sum;
      to = to / sum;
      Matrix products{};
      for (std::size_t i = 0; i < few_.size(); ++i) {
        add_product(products, weights[i], (few_[i] - from) / diagonal_, (there[i] - to) / diagonal_);
      }
      CagePlane next{0.5 * (from + to), axes_of(products).vectors[0]};
      if (dot(next.normal, plane.normal) < 0) next.normal = -1.0 * next.normal;
      const Vec3 step = next.normal - plane.normal;
      const bool enough = norm(step) < moved_enough && std::abs(height(next, plane.point)) < moved_enough * diagonal_;
      plane = next;
      if (enough) break;
      // Steps become shorter by the same factor (Aitken).
      const double factor = dot(last, last) > 0 ? dot(step, last) / dot(last, last) : 0;
      last = step;
      if (move % 3 != 2 || !(factor > 0) || factor > most_factor) continue;
      plane.normal = plane.normal + factor / (1 - factor) * step;
      plane.normal = plane.normal / norm(plane.normal);
      last = {};
    }
    return plane;
  }

  void accept(const Tried& tried, SurfaceMirrors& found) const {
    if (tried.deviation > tolerance_ || found.planes.size() == 3) return;
    // One that fits better comes later.
    for (const Tried& other : tried_) {
      if (is_same(other.plane, tried.plane, nearly_parallel, same_place) &&
          other.deviation + rounding * diagonal_ < tried.preference() * tried.deviation) {
        return;
      }
    }
    CagePlane plane = tried.plane;
    double most = tried.deviation;
    for (const CagePlane& known : found.planes) {
      const double cosine = dot(plane.normal, known.normal);
      if (std::abs(cosine) > nearly_orthogonal) return;
      plane.normal = plane.normal - cosine * known.normal;
    }
    if (!found.planes.empty()) {
      plane.normal = plane.normal / norm(plane.normal);
      const Tried again = deviation(plane);
      if (!(again.deviation <= tolerance_)) return;
      most = again.deviation;
    }
    found.planes.push_back(plane);
    found.deviation = std::max(found.deviation, most);
  }

  const std::vector<CagePlane> candidates_;
  const std::vector<Vec3> samples_;
  const double diagonal_;
  const ClosestPoint closest_;
  const double tolerance_;
  const RunContext& context_;
  std::vector<Vec3> few_;
  std::vector<Tried> tried_;
};

}  // namespace

std::vector<CagePlane> mirror_candidates(std::span<const TriangleCorners> triangles) {
  std::vector<CagePlane> candidates;
  if (triangles.empty()) return candidates;
  const Moments moments = moments_of(triangles);
  const Vec3 middle = 0.5 * (moments.box.min + moments.box.max);
  const double near = rounding * moments.box.diagonal();
  for (std::size_t k = 0; k < 3; ++k) {
    std::vector<double> places;
    for (const double place : {0.0, middle[k], moments.centre[k]}) {
      const bool known = std::any_of(places.begin(), places.end(), [&](double p) { return std::abs(p - place) <= near; });
      if (known) continue;
      places.push_back(place);
      CagePlane& plane = candidates.emplace_back();
      plane.point[k] = place;
      plane.normal[k] = 1;
    }
  }
  const Axes axes = axes_of(moments.second);
  for (const Vec3& axis : axes.vectors) candidates.push_back({moments.centre, axis});
  for (std::size_t k = 0; k < 2; ++k) {
    if (axes.values[k + 1] - axes.values[k] > same_moments * axes.values[k + 1]) continue;
    for (int i = 1; i <= axes_between; ++i) {
      const double angle = std::numbers::pi * i / (axes_between + 1);
      candidates.push_back({moments.centre, std::cos(angle) * axes.vectors[k] + std::sin(angle) * axes.vectors[k + 1]});
    }
  }
  return candidates;
}

SurfaceMirrors surface_mirrors(std::vector<TriangleCorners> triangles, double tolerance, const RunContext& context) {
  if (triangles.empty()) return {};
  return Search(std::move(triangles), tolerance, context).run();
}

}  // namespace deform
