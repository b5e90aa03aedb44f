// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cages/mirror_search.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/mesh/cages/principal_axes.h"

namespace deform {

namespace {

// Corners of the surface that are looked at.
constexpr std::size_t extreme_samples = 64;  // far from each other: edges and corners, if there are any
constexpr std::size_t few_samples = 400;     // of all alike, besides
constexpr std::size_t passes = 4;            // over them: the first is enough to move planes roughly
constexpr std::size_t ball_probes = 32;      // of the extreme ones, where directions are many
constexpr std::size_t samples_per_task = 512;

// Planes whose directions the moments leave open.
constexpr double same_moments = 0.05;      // of principal moments
constexpr int axes_between = 7;            // of mirror_candidates(), in steps of 22.5 degrees
constexpr int circle_directions = 180;     // in steps of a degree: wheels have up to 60 spokes
constexpr double circle_neighbours = 1.5;  // degrees
constexpr int ball_directions = 1000;      // 4.5 degrees from each other
constexpr double ball_neighbours = 7;      // degrees
constexpr std::size_t directions_per_task = 20;
constexpr double hopeless = 0.1;          // of D: root mean square deviation of directions that are none
constexpr std::size_t most_minima = 64;   // of the deviation over directions
constexpr std::size_t enough_planes = 8;  // that were found among them

// Planes that are moved to where they fit best.
constexpr double worth_moving = 0.02;      // of D: root mean square deviation before
constexpr double worth_moving_far = 0.03;  // the same of directions over a ball
constexpr double fits_well = 0.1;          // of the tolerance: such planes are not moved
constexpr int most_moves = 25;
constexpr double far_off = 2;                  // of the median: distances that count half in the end
constexpr double far_off_first = 3;            // of the root mean square: distances that count half in the beginning
constexpr double nearer = 10;                  // by which the former comes from the latter in a move, at most
constexpr double longest_move = 0.1;           // radians, and of D
constexpr double moved_enough = 1e-9;          // radians, and of D
constexpr double moved_enough_of_rest = 1e-3;  // of the median distance that remains
constexpr double settled = 0.2;                // of the root mean square: moves that change it little
constexpr double hopeless_after = 1.5;         // of the limit: root mean square deviation
constexpr double free_to_move = 1e-16;         // of the largest eigenvalue: how stiff a motion is that changes nothing

// Which planes are taken.
constexpr double fits_as_well = 1.5;                                 // ratio of deviations
constexpr double rounding = 1e-9;                                    // of D
constexpr double nearly_parallel = 0.999, nearly_orthogonal = 0.01;  // cosines
constexpr double same_place = 0.01;                                  // of D: distance of nearly parallel planes
constexpr double as_short = 1e-6;                                    // of D

double radians(double degrees) { return degrees * std::numbers::pi / 180; }

bool is_across_axis(const CagePlane& plane) {
  return std::any_of(plane.normal.begin(), plane.normal.end(), [](double x) { return std::abs(x) == 1; });
}

/// A plane and how far the image in it is from the surface.
struct Tried {
  CagePlane plane;
  double deviation = std::numeric_limits<double>::infinity();
  Vec3 at{};

  /// The deviation by which planes are compared: those across coordinate axes are as good as others that fit somewhat better.
  double judged() const { return is_across_axis(plane) ? deviation / fits_as_well : deviation; }
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

/// The place that is farthest from a centre, then the one that is farthest from those before, and so on.
std::vector<Vec3> extremes_of(std::span<const Vec3> places, const Vec3& centre, std::size_t count) {
  std::vector<double> far(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) far[i] = squared_distance(places[i], centre);
  std::vector<Vec3> extremes;
  while (extremes.size() < std::min(count, places.size())) {
    const Vec3 next = places[static_cast<std::size_t>(std::max_element(far.begin(), far.end()) - far.begin())];
    for (std::size_t i = 0; i < places.size(); ++i) {
      const double near = squared_distance(places[i], next);
      far[i] = extremes.empty() ? near : std::min(far[i], near);
    }
    extremes.push_back(next);
  }
  return extremes;
}

/// Two unit vectors at right angles to a unit vector and to each other.
std::array<Vec3, 2> across(const Vec3& n) {
  Vec3 e{};
  e[static_cast<std::size_t>(std::min_element(n.begin(), n.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }) -
                             n.begin())] = 1;
  const Vec3 u = cross(n, e) / norm(cross(n, e));
  return {u, cross(n, u)};
}

/// Directions in a plane, over half a turn.
std::vector<Vec3> circle(const Vec3& u, const Vec3& v) {
  std::vector<Vec3> directions;
  for (int i = 0; i < circle_directions; ++i) {
    const double angle = std::numbers::pi * i / circle_directions;
    directions.push_back(std::cos(angle) * u + std::sin(angle) * v);
  }
  return directions;
}

/// Directions over half a ball, evenly on a spiral.
std::vector<Vec3> half_ball() {
  constexpr double golden = std::numbers::pi * (3 - 2.23606797749978969);
  std::vector<Vec3> directions;
  for (int i = 0; i < ball_directions; ++i) {
    const double z = (i + 0.5) / ball_directions, r = std::sqrt(1 - z * z);
    directions.push_back({r * std::cos(golden * i), r * std::sin(golden * i), z});
  }
  return directions;
}

/// Planes across the coordinate axes and the principal axes.
std::vector<CagePlane> planes_across_axes(const PrincipalAxes& axes) {
  std::vector<CagePlane> planes;
  const Vec3 middle = 0.5 * (axes.box.min + axes.box.max);
  const double near = rounding * axes.box.diagonal();
  for (std::size_t k = 0; k < 3; ++k) {
    std::vector<double> places;
    for (const double place : {0.0, middle[k], axes.centre[k]}) {
      const bool known = std::any_of(places.begin(), places.end(), [&](double p) { return std::abs(p - place) <= near; });
      if (known) continue;
      places.push_back(place);
      CagePlane& plane = planes.emplace_back();
      plane.point[k] = place;
      plane.normal[k] = 1;
    }
  }
  for (const Vec3& axis : axes.moments.vectors) planes.push_back({axes.centre, axis});
  return planes;
}

/// Whether nothing tells the principal axes k and k + 1 from those in between.
bool are_same(const PrincipalAxes& axes, std::size_t k) {
  const Vec3& values = axes.moments.values;
  return values[k + 1] - values[k] <= same_moments * values[k + 1];
}

class Search {
 public:
  Search(std::vector<TriangleCorners> triangles, double tolerance, const RunContext& context)
      : axes_(principal_axes(triangles)),
        samples_(corners_of(triangles)),
        diagonal_(axes_.box.diagonal()),
        closest_(std::move(triangles)),
        tolerance_(tolerance),
        context_(context),
        few_(extremes_of(samples_, axes_.centre, extreme_samples)) {
    const std::size_t step = samples_.size() / few_samples + 1;
    for (std::size_t pass = 0; pass < passes; ++pass) {
      for (std::size_t i = pass * step; i < samples_.size(); i += passes * step) few_.push_back(samples_[i]);
      if (pass == 0) fewer_ = few_.size();
    }
  }

  SurfaceMirrors run() {
    try_axes();
    SurfaceMirrors found = chosen();
    const bool first = are_same(axes_, 0), second = are_same(axes_, 1);
    const bool is_across_axes = found.planes.size() == 3 && std::all_of(found.planes.begin(), found.planes.end(), is_across_axis);
    if ((first || second) && !is_across_axes) {
      const auto& [u, v, w] = axes_.moments.vectors;
      if (first && second) {
        search(half_ball(), ball_neighbours, ball_probes, worth_moving_far);
      } else {
        search(first ? circle(u, v) : circle(v, w), circle_neighbours, extreme_samples);
      }
      found = chosen();
      if (first && second && !found.planes.empty() && found.planes.size() < 3) {
        const auto [a, b] = across(found.planes[0].normal);
        search(circle(a, b), circle_neighbours, extreme_samples);
        found = chosen();
      }
      if (!found.planes.empty() && found.planes.size() < 3) {
        complete(found.planes);
        found = chosen();
      }
    }
    if (found.planes.empty()) found.near = nearest();
    return found;
  }

 private:
  double height(const CagePlane& plane, const Vec3& x) const { return dot(plane.normal, x - plane.point); }
  /// Whether two planes are nearly parallel and pass the centroid at nearly the same place.
  bool is_same(const CagePlane& a, const CagePlane& b, double cosine, double place) const {
    const double along = dot(a.normal, b.normal), other = height(b, axes_.centre);
    return std::abs(along) >= cosine && std::abs(height(a, axes_.centre) - (along < 0 ? -other : other)) <= place * diagonal_;
  }
  double off(const CagePlane& plane, const Vec3& x) const {
    const Vec3 image = reflected(plane, x);
    return distance(image, closest_(image));
  }
  /// The root mean square deviation of the first few samples, in D; infinity if it is over a limit.
  double mean_deviation(const CagePlane& plane, std::size_t count, double limit) const {
    count = std::min(count, few_.size());
    const double most = limit * limit * static_cast<double>(count);
    double sum = 0;
    for (std::size_t i = 0; i < count && sum <= most; ++i) {
      const double part = off(plane, few_[i]) / diagonal_;
      sum += part * part;
    }
    return sum <= most ? std::sqrt(sum / static_cast<double>(count)) : std::numeric_limits<double>::infinity();
  }

  /// Infinity if it is over a limit.
  Tried deviation(const CagePlane& plane, double limit) const {
    using Worst = std::pair<double, Vec3>;
    const Tried over{plane};
    Worst first{-1, {}};
    for (const Vec3& x : few_) {
      if (const double here = off(plane, x); here > first.first) first = {here, x};
      if (first.first > limit) return over;
    }
    std::vector<Worst> worst(samples_.size() / samples_per_task + 1, first);
    std::atomic<bool> is_over = false;
    parallel_for(context_, samples_.size(), samples_per_task, [&](std::size_t begin, std::size_t end) {
      Worst& most = worst[begin / samples_per_task];
      for (std::size_t i = begin; i < end && !is_over.load(std::memory_order_relaxed); ++i) {
        // Those that are as near as others need not be distinguished.
        const Vec3 image = reflected(plane, samples_[i]);
        const double here = distance(image, closest_.find(image, most.first).point);
        if (here > most.first) most = {here, samples_[i]};
        if (here > limit) is_over.store(true, std::memory_order_relaxed);
      }
    });
    if (is_over) return over;
    for (const Worst& part : worst) {
      if (part.first > first.first) first = part;
    }
    return {plane, first.first, first.second};
  }

  /// Larger deviations do not count.
  double limit() const {
    const bool any = std::any_of(tried_.begin(), tried_.end(), [&](const Tried& t) { return t.deviation <= tolerance_; });
    return any ? tolerance_ : SurfaceMirrors::nearly * tolerance_;
  }
  double try_plane(const CagePlane& plane) {
    context_.check();
    const Tried tried = deviation(plane, limit());
    if (std::isfinite(tried.deviation)) tried_.push_back(tried);
    return tried.deviation;
  }
  /// Tries a plane where it fits best, if it comes near enough.
  void try_moved(const CagePlane& plane, double worth = worth_moving) {
    if (!std::isfinite(mean_deviation(plane, few_.size(), worth))) return;
    const std::optional<CagePlane> moved_to = moved(plane);
    if (!moved_to) return;
    const CagePlane& best = *moved_to;
    const bool known =
        std::any_of(moved_.begin(), moved_.end(), [&](const CagePlane& other) { return is_same(other, best, 1 - 1e-12, 1e-6); });
    if (known) return;
    moved_.push_back(best);
    try_plane(best);
  }

  /// The coordinate axes and the principal axes.
  void try_axes() {
    const std::vector<CagePlane> planes = planes_across_axes(axes_);
    std::vector<char> fits;
    for (const CagePlane& plane : planes) fits.push_back(try_plane(plane) <= fits_well * tolerance_ ? 1 : 0);
    for (std::size_t i = 0; i < planes.size(); ++i) {
      if (fits[i] == 0 && std::count(fits.begin(), fits.end(), 1) < 3) try_moved(planes[i]);
    }
  }

  /// Tries the planes through the centroid across those directions where fewer samples are off than across their neighbours, so
  /// many degrees around.
  void search(const std::vector<Vec3>& directions, double neighbours, std::size_t probes, double worth = worth_moving) {
    std::vector<double> scores(directions.size());
    parallel_for(context_, directions.size(), directions_per_task, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) scores[i] = mean_deviation({axes_.centre, directions[i]}, probes, hopeless);
    });
    const double cosine = std::cos(radians(neighbours));
    const auto is_lower = [&](std::size_t i, std::size_t j) { return scores[i] != scores[j] ? scores[i] < scores[j] : i < j; };
    std::vector<std::size_t> minima;
    for (std::size_t i = 0; i < directions.size(); ++i) {
      bool is_least = std::isfinite(scores[i]);
      for (std::size_t j = 0; j < directions.size() && is_least; ++j) {
        is_least = !is_lower(j, i) || std::abs(dot(directions[i], directions[j])) < cosine;
      }
      if (is_least) minima.push_back(i);
    }
    std::sort(minima.begin(), minima.end(), is_lower);
    minima.resize(std::min(minima.size(), most_minima));
    const std::size_t before = tried_.size();
    for (const std::size_t i : minima) {
      try_moved({axes_.centre, directions[i]}, worth);
      const auto found = std::count_if(tried_.begin() + static_cast<std::ptrdiff_t>(before), tried_.end(),
                                       [&](const Tried& t) { return t.deviation <= tolerance_; });
      if (static_cast<std::size_t>(found) >= enough_planes) return;
    }
  }

  /// Tries the planes that go with those that were found: of a body that may be turned by any angle, any plane was found.
  void complete(const std::vector<CagePlane>& planes) {
    std::vector<Vec3> axes(axes_.moments.vectors.begin(), axes_.moments.vectors.end());
    for (const CagePlane& plane : planes) axes.push_back(plane.normal);
    for (const CagePlane& plane : planes) {
      for (const Vec3& axis : axes) {
        const Vec3 normal = cross(plane.normal, axis);
        const double size = norm(normal);
        if (size < 0.5) continue;
        const CagePlane other{axes_.centre, normal / size};
        if (try_plane(other) > fits_well * tolerance_) try_moved(other);
      }
    }
  }

  /// How the distance of the image of a sample from the surface changes with the plane.
  struct Pull {
    double off = 0;  ///< the distance, in D
    Vec3 slope{};    ///< by turns of the normal towards two directions across it, and by moving the plane along it, in D
  };
  Pull pull(const CagePlane& plane, const std::array<Vec3, 2>& directions, const Vec3& x) const {
    const Vec3 image = reflected(plane, x);
    const ClosestPoint::Found found = closest_.find(image);
    const Vec3 apart = (image - found.point) / diagonal_;
    Pull pull{norm(apart)};
    Vec3 away{};
    if (pull.off > rounding) {
      away = apart / pull.off;
    } else {
      // On the surface: away from it is across it.
      const auto& [a, b, c] = closest_.triangle(found.triangle);
      const Vec3 normal = cross((b - a) / diagonal_, (c - a) / diagonal_);
      const double size = norm(normal);
      if (size > 0) away = normal / size;
      pull.off = dot(away, apart);
    }
    const double along = dot(away, plane.normal), s = height(plane, x) / diagonal_;
    for (std::size_t k = 0; k < 2; ++k) {
      const double lever = dot(directions[k], x - plane.point) / diagonal_;
      pull.slope[k] = -2 * (lever * along + s * dot(away, directions[k]));
    }
    pull.slope[2] = 2 * along;
    return pull;
  }

  /// The plane moved to where images are nearest to the surface, in the mean square without what is much farther than most: what
  /// is on one side only does not pull at it. Gauss-Newton steps of the distances, along which images in faces slide freely.
  /// Nothing if the mean square is over the limit with all.
  std::optional<CagePlane> moved(CagePlane plane) const {
    double scale = std::numeric_limits<double>::infinity(), size = 0;
    const double most = limit() / diagonal_;
    std::size_t count = fewer_;
    std::vector<Pull> pulls(few_.size());
    std::vector<double> sizes;
    for (int move = 0; move < most_moves; ++move) {
      context_.check();
      plane.point = axes_.centre - height(plane, axes_.centre) * plane.normal;
      const std::array<Vec3, 2> directions = across(plane.normal);
      sizes.resize(count);
      double squares = 0;
      for (std::size_t i = 0; i < count; ++i) {
        pulls[i] = pull(plane, directions, few_[i]);
        sizes[i] = std::abs(pulls[i].off);
        squares += sizes[i] * sizes[i];
      }
      const double mean = std::sqrt(squares / static_cast<double>(count));
      if (move > 1 && size < settled * mean && mean > hopeless_after * most) return std::nullopt;
      const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(count / 2);
      std::nth_element(sizes.begin(), middle, sizes.end());
      // Where most of the surface are faces in which images slide, the median tells nothing of the rest until that fits, too.
      const double least = far_off * *middle + 1e-3 * rounding;
      // Not before the last move was small as against what counts half.
      const double next = size < scale ? scale / nearer : scale;
      scale = std::max(least, std::min(next, far_off_first * mean));
      const Vec3 step = step_of({pulls.data(), count}, scale);
      size = norm(step);
      plane.point = plane.point + step[2] * diagonal_ * plane.normal;
      plane.normal = plane.normal + (step[0] * directions[0] + step[1] * directions[1]);
      plane.normal = plane.normal / norm(plane.normal);
      if (!(size < std::max(moved_enough, moved_enough_of_rest * *middle)) || (scale != least && mean >= rounding)) continue;
      if (count == few_.size()) break;
      count = few_.size();
    }
    return plane;
  }

  /// The turns and the move that make distances least, those over `scale` (of D) counting less.
  static Vec3 step_of(std::span<const Pull> pulls, double scale) {
    SymmetricMatrix stiffness{};
    Vec3 right{};
    for (const Pull& p : pulls) {
      const double weight = 1 / (1 + p.off / scale * (p.off / scale));
      add_product(stiffness, weight, p.slope, p.slope);
      right = right - weight * p.off * p.slope;
    }
    const Eigenvectors modes = eigenvectors(stiffness);
    Vec3 step{};
    for (std::size_t k = 0; k < 3; ++k) {
      if (!(modes.values[k] > free_to_move * modes.values[2])) continue;
      step = step + dot(modes.vectors[k], right) / modes.values[k] * modes.vectors[k];
    }
    const double size = norm(step);
    return size > longest_move ? longest_move / size * step : step;
  }

  /// How far the surface reaches from a plane.
  double extent(const CagePlane& plane) const {
    double most = 0;
    for (const Vec3& x : samples_) most = std::max(most, std::abs(height(plane, x)));
    return most;
  }

  /// The one that fits best. Of those that fit as well the first one across a coordinate axis, or else the one from which the
  /// surface reaches least far: of a square plate the planes across its sides, not its diagonals.
  const Tried* best_of(const std::vector<const Tried*>& planes) const {
    double least = std::numeric_limits<double>::infinity();
    for (const Tried* t : planes) least = std::min(least, t->judged());
    const Tried* best = nullptr;
    double shortest = std::numeric_limits<double>::infinity();
    for (const Tried* t : planes) {
      if (t->judged() > fits_as_well * least + rounding * diagonal_) continue;
      const bool better = std::any_of(planes.begin(), planes.end(), [&](const Tried* other) {  // a little turned or moved
        return is_same(other->plane, t->plane, nearly_parallel, same_place) &&
               other->deviation + rounding * diagonal_ < t->judged();
      });
      if (better) continue;
      if (is_across_axis(t->plane)) return t;
      const double reach = extent(t->plane);
      if (reach < shortest - as_short * diagonal_) shortest = reach, best = t;
    }
    return best;
  }

  SurfaceMirrors chosen() const {
    SurfaceMirrors found;
    std::vector<const Tried*> left;
    for (const Tried& tried : tried_) {
      if (tried.deviation <= tolerance_) left.push_back(&tried);
    }
    while (!left.empty() && found.planes.size() < 3) {
      const Tried* const next = best_of(left);
      std::erase(left, next);
      Tried taken = *next;
      Vec3& normal = taken.plane.normal;
      for (const CagePlane& known : found.planes) normal = normal - dot(normal, known.normal) * known.normal;
      if (normal != next->plane.normal) {
        normal = normal / norm(normal);
        taken = deviation(taken.plane, tolerance_);
        if (!(taken.deviation <= tolerance_)) continue;
      }
      found.planes.push_back(taken.plane);
      found.deviation = std::max(found.deviation, taken.deviation);
      std::erase_if(left, [&](const Tried* t) { return std::abs(dot(t->plane.normal, normal)) > nearly_orthogonal; });
    }
    // Those across coordinate axes first, in their order.
    std::stable_sort(found.planes.begin(), found.planes.end(), [](const CagePlane& a, const CagePlane& b) {
      const auto axis = [](const Vec3& n) {
        return std::find_if(n.begin(), n.end(), [](double x) { return std::abs(x) == 1; }) - n.begin();
      };
      return axis(a.normal) < axis(b.normal);
    });
    return found;
  }

  std::optional<SurfaceMirrors::Near> nearest() const {
    const auto best =
        std::min_element(tried_.begin(), tried_.end(), [](const Tried& a, const Tried& b) { return a.judged() < b.judged(); });
    if (best == tried_.end()) return std::nullopt;
    const auto first = std::find_if(tried_.begin(), tried_.end(), [&](const Tried& t) {
      return is_same(t.plane, best->plane, nearly_parallel, same_place) && t.judged() <= best->deviation;
    });
    return SurfaceMirrors::Near{first->plane, first->deviation, first->at};
  }

  const PrincipalAxes axes_;
  const std::vector<Vec3> samples_;
  const double diagonal_;
  const ClosestPoint closest_;
  const double tolerance_;
  const RunContext& context_;
  std::vector<Vec3> few_;  // the extreme ones first
  std::size_t fewer_ = 0;  // of them
  std::vector<Tried> tried_;
  std::vector<CagePlane> moved_;
};

}  // namespace

std::vector<CagePlane> mirror_candidates(std::span<const TriangleCorners> triangles) {
  if (triangles.empty()) return {};
  const PrincipalAxes axes = principal_axes(triangles);
  std::vector<CagePlane> candidates = planes_across_axes(axes);
  for (std::size_t k = 0; k < 2; ++k) {
    if (!are_same(axes, k)) continue;
    for (int i = 1; i <= axes_between; ++i) {
      const double angle = std::numbers::pi * i / (axes_between + 1);
      candidates.push_back(
          {axes.centre, std::cos(angle) * axes.moments.vectors[k] + std::sin(angle) * axes.moments.vectors[k + 1]});
    }
  }
  return candidates;
}

SurfaceMirrors surface_mirrors(std::vector<TriangleCorners> triangles, double tolerance, const RunContext& context) {
  if (triangles.empty()) return {};
  return Search(std::move(triangles), tolerance, context).run();
}

}  // namespace deform
