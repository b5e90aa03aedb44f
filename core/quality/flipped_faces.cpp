#include "core/quality/flipped_faces.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/quality/face_pairs.h"
#include "core/quality/polygon.h"
#include "core/quality/two_sides.h"

namespace deform {

namespace {

using namespace quality;

constexpr std::size_t grain = 8192;
constexpr int most_rows = 8;  // of collapsed faces, across which neighbours are looked for
// cos^2 of 30 degrees: two faces that turned by less, with at most 15 degrees between them at rest, have |delta| <= 90.
constexpr double calm = 0.75;
constexpr float smooth = 0.965925826F;  // cos of 15 degrees
constexpr float unknown = 2;            // no cosine

/// What an edge says about its faces: 1 surely on one side, -1 surely on opposite ones.
double evidence(double cosine) { return cosine > -0.5 ? (cosine + 0.5) / 1.5 : 2 * cosine + 1; }

/// How much an edge has to say by its angle at rest.
double weight(const FacePair& pair) { return 0.05 + 0.95 * std::max(0.0, static_cast<double>(pair.cosine)); }

/// Numbers sets of faces that are known to be on one side.
class Clusters {
 public:
  explicit Clusters(std::size_t faces) : parent_(faces) { std::iota(parent_.begin(), parent_.end(), FaceId{0}); }
  FaceId find(FaceId face) {
    while (parent_[face] != face) face = parent_[face] = parent_[parent_[face]];
    return face;
  }
  void join(FaceId a, FaceId b) { parent_[find(a)] = find(b); }
  /// Per face a number from 0 on; returns how many there are. Nothing can be joined any more.
  std::size_t number() {
    for (FaceId f = 0; f < parent_.size(); ++f) parent_[f] = find(f);
    std::vector<FaceId> numbers(parent_.size());
    std::size_t count = 0;
    for (FaceId f = 0; f < parent_.size(); ++f) {
      if (parent_[f] == f) numbers[f] = static_cast<FaceId>(count++);
    }
    for (FaceId& root : parent_) root = numbers[root];
    return count;
  }
  FaceId operator[](std::size_t face) const { return parent_[face]; }

 private:
  std::vector<FaceId> parent_;
};

}  // namespace

class FlipCheck::Impl {
 public:
  Impl(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context)
      : points_(rest.size()), rest_(rest), corners_(mesh) {
    if (mesh.point_count() != rest.size()) wrong_count("at rest", rest.size(), mesh.point_count());
    double largest = 0;
    for (const Vec3& p : rest) largest = std::max({largest, std::abs(p[0]), std::abs(p[1]), std::abs(p[2])});
    rounding_ = 4 * std::numeric_limits<double>::epsilon() * largest;
    const std::vector<Vec3> normals = unit_normals(rest, context);
    pairs_ = face_pairs(mesh, corners_, rest, normals, context);
    pairs_.shrink_to_fit();
    sharp_ = static_cast<std::size_t>(
        std::stable_partition(pairs_.begin(), pairs_.end(), [](const FacePair& pair) { return pair.cosine < smooth; }) -
        pairs_.begin());
    normals_.reserve(normals.size());
    for (const Vec3& n : normals) {
      normals_.push_back({static_cast<float>(n[0]), static_cast<float>(n[1]), static_cast<float>(n[2])});
    }
  }

  std::vector<Extreme> flipped(std::span<const Vec3> points, const RunContext& context) const {
    if (points.size() != points_) wrong_count("deformed", points.size(), points_);
    std::vector<char> turned(size());
    const bool any = find_turned(points, turned, context);
    if (!is_suspect(points, turned, any ? pairs_.size() : sharp_, context)) return {};
    std::vector<Vec3> normals = unit_normals(points, context);
    std::vector<float> cosines = changes(points, normals, context);
    if (carry_normals(points, normals, cosines)) cosines = changes(points, normals, context);
    const std::vector<char> over = sides(turned, normals, cosines);
    return listed(points, cosines, over);
  }

  std::size_t size() const { return corners_.size(); }
  std::size_t bytes() const {
    return normals_.capacity() * sizeof(normals_[0]) + pairs_.capacity() * sizeof(FacePair) + corners_.bytes();
  }
  std::size_t call_bytes() const { return size() * (sizeof(Vec3) + 64) + pairs_.size() * (2 * sizeof(float) + sizeof(SidePair)); }

 private:
  [[noreturn]] static void wrong_count(const char* which, std::size_t count, std::size_t expected) {
    throw Error(ErrorCode::invalid_argument, std::string("points ") + which + ": expected " + std::to_string(expected) +
                                                 ", as many as the mesh has, got " + std::to_string(count));
  }

  bool takes_part(std::size_t face) const { return normals_[face] != std::array<float, 3>{}; }

  std::vector<Vec3> unit_normals(std::span<const Vec3> points, const RunContext& context) const {
    std::vector<Vec3> normals(size());
    parallel_for(context, size(), grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t f = begin; f < end; ++f) normals[f] = unit_normal(points, corners_[f], rounding_);
    });
    return normals;
  }

  /// Marks the faces whose normals turned by more than 30 degrees, or are gone.
  bool find_turned(std::span<const Vec3> points, std::vector<char>& turned, const RunContext& context) const {
    std::atomic<bool> any{false};
    parallel_for(context, size(), grain, [&](std::size_t begin, std::size_t end) {
      std::size_t count = 0;
      const auto look = [&](std::size_t f, const Vec3& area) {
        const auto& n = normals_[f];
        const double along = n[0] * area[0] + n[1] * area[1] + n[2] * area[2];
        const bool still = along > 0 && along * along >= calm * dot(area, area);
        turned[f] = !still && takes_part(f);
        count += static_cast<std::size_t>(turned[f]);
      };
      if (corners_.triangles()) {
        for (std::size_t f = begin; f < end; ++f) {
          const PointId* at = corners_[f].data();
          look(f, cross(points[at[1]] - points[at[0]], points[at[2]] - points[at[0]]));
        }
      } else {
        for (std::size_t f = begin; f < end; ++f) look(f, vector_area(points, corners_[f]));
      }
      if (count > 0) any.store(true, std::memory_order_relaxed);
    });
    return any.load();
  }

  /// cos(delta), or unknown.
  float change(std::span<const Vec3> points, const FacePair& pair, const Vec3& first, const Vec3& second) const {
    const Turn turn = turn_between(first, second, points[pair.to] - points[pair.from]);
    if (!turn.known()) return unknown;
    return static_cast<float>(turn.cosine * static_cast<double>(pair.cosine) + turn.sine * static_cast<double>(pair.sine));
  }

  /// Whether there is an edge beyond 90 degrees, or one of which nothing can be said, among the first `count`.
  bool is_suspect(std::span<const Vec3> points, const std::vector<char>& turned, std::size_t count,
                  const RunContext& context) const {
    std::atomic<bool> found{false};
    parallel_for(context, count, grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end && !found.load(std::memory_order_relaxed); ++i) {
        const FacePair& pair = pairs_[i];
        if (i >= sharp_ && !turned[pair.first] && !turned[pair.second]) continue;
        const float cosine = change(points, pair, unit_normal(points, corners_[pair.first], rounding_),
                                    unit_normal(points, corners_[pair.second], rounding_));
        if (cosine < 0 || cosine == unknown) found.store(true, std::memory_order_relaxed);
      }
    });
    return found.load();
  }

  std::vector<float> changes(std::span<const Vec3> points, const std::vector<Vec3>& normals, const RunContext& context) const {
    std::vector<float> cosines(pairs_.size());
    parallel_for(context, pairs_.size(), grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        cosines[i] = change(points, pairs_[i], normals[pairs_[i].first], normals[pairs_[i].second]);
      }
    });
    return cosines;
  }

  /// Gives collapsed faces the normals that go on from their neighbours, over the longest edge. Says whether there were any.
  bool carry_normals(std::span<const Vec3> points, std::vector<Vec3>& normals, const std::vector<float>& cosines) const {
    struct Source {
      double length = 0;
      Vec3 normal{};
    };
    bool any = false;
    for (int row = 0; row < most_rows; ++row) {
      std::vector<std::pair<FaceId, Source>> found;
      const auto offer = [&](FaceId to, FaceId from, const FacePair& pair, double sign) {
        if (normals[to] != Vec3{} || normals[from] == Vec3{}) return;
        const Vec3 edge = points[pair.to] - points[pair.from];
        const double size = length(edge);
        if (!(size > 0) || !std::isfinite(size)) return;
        found.emplace_back(
            to, Source{size, turned_normal(normals[from], {pair.cosine, sign * static_cast<double>(pair.sine)}, edge)});
      };
      for (std::size_t i = 0; i < pairs_.size(); ++i) {
        if (cosines[i] != unknown) continue;
        offer(pairs_[i].second, pairs_[i].first, pairs_[i], 1);
        offer(pairs_[i].first, pairs_[i].second, pairs_[i], -1);
      }
      if (found.empty()) break;
      any = true;
      // The first of the longest: the pairs are in their order.
      std::vector<std::size_t> order(found.size());
      std::iota(order.begin(), order.end(), std::size_t{0});
      std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return found[a].first != found[b].first ? found[a].first < found[b].first
                                                : found[a].second.length > found[b].second.length;
      });
      for (std::size_t k = 0; k < order.size(); ++k) {
        const auto& [face, source] = found[order[k]];
        if (k == 0 || found[order[k - 1]].first != face) normals[face] = source.normal;
      }
    }
    return any;
  }

  double told(const FacePair& pair, float cosine) const {
    return length(rest_[pair.to] - rest_[pair.from]) * weight(pair) * evidence(static_cast<double>(cosine));
  }

  /// Per face whether it is on the side that is not upright.
  std::vector<char> sides(const std::vector<char>& turned, const std::vector<Vec3>& normals,
                          const std::vector<float>& cosines) const {
    std::vector<char> over(size(), 0);
    if (std::none_of(cosines.begin(), cosines.end(), [](float c) { return c < -0.5F; })) return over;
    Clusters clusters(size());
    for (std::size_t i = sharp_; i < pairs_.size(); ++i) {
      if (!turned[pairs_[i].first] && !turned[pairs_[i].second]) clusters.join(pairs_[i].first, pairs_[i].second);
    }
    const std::size_t count = clusters.number();
    std::vector<SidePair> pairs;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const FaceId a = clusters[pairs_[i].first], b = clusters[pairs_[i].second];
      if (a == b || cosines[i] == unknown) continue;
      pairs.push_back({a, b, static_cast<std::uint32_t>(i), told(pairs_[i], cosines[i])});
    }
    const TwoSides found = two_sides(count, std::move(pairs));
    struct Side {
      double area = 0, kept = 0;  // kept: area times cosine of how its normals turned
    };
    std::vector<std::array<Side, 2>> of(count);
    for (std::size_t f = 0; f < size(); ++f) {
      if (!takes_part(f)) continue;
      const auto& n = normals_[f];
      const double area = length(vector_area(rest_, corners_[f]));
      Side& side = of[found.component[clusters[f]]][static_cast<std::size_t>(found.side[clusters[f]])];
      side.area += area;
      side.kept += area * (n[0] * normals[f][0] + n[1] * normals[f][1] + n[2] * normals[f][2]);
    }
    for (std::size_t f = 0; f < size(); ++f) {
      const auto& [a, b] = of[found.component[clusters[f]]];
      const bool equal = std::abs(a.area - b.area) <= 1e-9 * (a.area + b.area);
      const bool second_is_upright = equal ? b.kept > a.kept : b.area > a.area;
      over[f] = (found.side[clusters[f]] != 0) != second_is_upright;
    }
    return over;
  }

  std::vector<Extreme> listed(std::span<const Vec3> points, const std::vector<float>& cosines,
                              const std::vector<char>& over) const {
    struct Score {
      double sum = 0, weights = 0;
      std::uint32_t neighbours = 0;
    };
    std::vector<Score> scores(size());
    const auto add = [&](FaceId face, FaceId neighbour, const FacePair& pair, float cosine) {
      Score& score = scores[face];
      score.sum += weight(pair) * (over[neighbour] ? -static_cast<double>(cosine) : static_cast<double>(cosine));
      score.weights += weight(pair);
      ++score.neighbours;
    };
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      if (cosines[i] == unknown) continue;
      add(pairs_[i].first, pairs_[i].second, pairs_[i], cosines[i]);
      add(pairs_[i].second, pairs_[i].first, pairs_[i], cosines[i]);
    }
    std::vector<Extreme> flipped;
    for (std::size_t f = 0; f < size(); ++f) {
      const auto& [sum, weights, neighbours] = scores[f];
      const bool is_flipped = neighbours > 1 ? sum < 0 : neighbours == 1 && over[f];
      if (!is_flipped || unit_normal(points, corners_[f], rounding_) == Vec3{}) continue;
      flipped.push_back({sum / weights, f});
    }
    std::stable_sort(flipped.begin(), flipped.end(), [](const Extreme& a, const Extreme& b) { return a.value < b.value; });
    return flipped;
  }

  std::size_t points_;
  std::span<const Vec3> rest_;
  FaceCorners corners_;
  double rounding_ = 0;
  std::vector<std::array<float, 3>> normals_;  ///< f, zero: the face takes no part
  std::vector<FacePair> pairs_;                ///< the sharp edges first
  std::size_t sharp_ = 0;
};

FlipCheck::FlipCheck(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context)
    : impl_(std::make_unique<const Impl>(mesh, rest, context)) {}
FlipCheck::~FlipCheck() = default;

std::vector<Extreme> FlipCheck::flipped(std::span<const Vec3> points, const RunContext& context) const {
  return impl_->flipped(points, context);
}
std::size_t FlipCheck::face_count() const { return impl_->size(); }
std::size_t FlipCheck::bytes() const { return impl_->bytes(); }
std::size_t FlipCheck::call_bytes() const { return impl_->call_bytes(); }

std::size_t FlipCheck::bytes_for(const Mesh& mesh) {
  return mesh.face_count() * (sizeof(Vec3) + 3 * sizeof(float) + sizeof(std::uint64_t)) +
         face_pairs_bytes(mesh.point_count(), mesh.face_points.size());
}

std::vector<Extreme> flipped_faces(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context) {
  return FlipCheck(mesh, rest, context).flipped(mesh.points, context);
}

}  // namespace deform
