// SPDX-License-Identifier: Apache-2.0
#include "core/quality/flipped_faces.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <string>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/quality/face_pairs.h"
#include "core/quality/polygon.h"
#include "core/quality/still_faces.h"
#include "core/quality/two_sides.h"

namespace deform {

namespace {

using namespace quality;

constexpr std::size_t faces_per_range = 8192;
constexpr int most_rows = 32;  // rows of crushed faces across which normals are extrapolated
// cos^2 of 30 degrees: two faces that turned by less, with at most 15 degrees between them at rest, have |delta| <= 90.
constexpr double square_of_calm = 0.75;
constexpr float smooth = 0.965925826F;  // cos of 15 degrees
constexpr float unknown = 2;            // no cosine
constexpr double no_motion = 1e-6;      // of the largest displacement: what solvers leave of none

/// How a face moved: still faces are proved not to have turned by more than 30 degrees, calm ones were checked.
enum Motion : char { still, moved, calm, turned };

/// The evidence of an edge about its faces: 1 certainly on the same side, -1 certainly on opposite ones.
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
  /// Numbers the sets of faces from 0 and returns their number. No sets can be joined afterwards.
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
    diagonal_ = bounding_box(rest).diagonal();
    const std::vector<Vec3> normals = unit_normals(rest, context);
    pairs_ = face_pairs(mesh, corners_, rest, normals, context);
    pairs_.shrink_to_fit();
    sharp_ = static_cast<std::size_t>(
        std::stable_partition(pairs_.begin(), pairs_.end(), [](const FacePair& pair) { return pair.cosine < smooth; }) -
        pairs_.begin());
    still_.emplace(corners_, rest, normals, std::span(pairs_).first(sharp_), context);
    normals_.reserve(normals.size());
    for (const Vec3& n : normals) {
      normals_.push_back({static_cast<float>(n[0]), static_cast<float>(n[1]), static_cast<float>(n[2])});
    }
  }

  std::vector<Extreme> flipped(std::span<const Vec3> points, const RunContext& context) const {
    if (points.size() != points_) wrong_count("deformed", points.size(), points_);
    std::vector<char> motion(size());
    const Turned found = find_turned(points, motion, context);
    std::vector<Vec3> normals;  // all at once where many are needed
    if (found.count > size() / 8) normals = unit_normals(points, context);
    if (!found.crushed && !is_suspect(points, motion, normals, found.count > 0 ? pairs_.size() : sharp_, context)) return {};
    if (normals.empty()) normals = unit_normals(points, context);
    const std::vector<char> crushed = drop_crushed(points, normals, context);
    carry_normals(points, normals);
    const std::vector<float> cosines = changes(points, normals, context);
    const std::vector<char> held = at_rest(points, normals, crushed, context);
    const std::vector<char> over = sides(motion, crushed, held, normals, cosines);
    return listed(points, normals, crushed, held, cosines, over);
  }

  std::size_t size() const { return corners_.size(); }
  std::size_t bytes() const {
    return size() * sizeof(float) + normals_.capacity() * sizeof(normals_[0]) + pairs_.capacity() * sizeof(FacePair) +
           corners_.bytes();
  }
  std::size_t call_bytes() const {
    return points_ * 4 * sizeof(float) + size() * (sizeof(Vec3) + 96) + pairs_.size() * (2 * sizeof(float) + sizeof(SidePair));
  }

 private:
  [[noreturn]] static void wrong_count(const char* which, std::size_t count, std::size_t expected) {
    throw Error(ErrorCode::invalid_argument, std::string("points ") + which + ": expected " + std::to_string(expected) +
                                                 ", as many as the mesh has, got " + std::to_string(count));
  }

  bool takes_part(std::size_t face) const { return normals_[face] != std::array<float, 3>{}; }
  Vec3 rest_normal(std::size_t face) const { return {normals_[face][0], normals_[face][1], normals_[face][2]}; }

  std::vector<Vec3> unit_normals(std::span<const Vec3> points, const RunContext& context) const {
    std::vector<Vec3> normals(size());
    parallel_for(context, size(), faces_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t f = begin; f < end; ++f) normals[f] = unit_normal(points, corners_[f], rounding_);
    });
    return normals;
  }

  struct Turned {
    std::size_t count;
    bool crushed;
  };
  /// Per face still, calm or turned, by more than 30 degrees or without a normal. Says how many did, and whether one is crushed.
  Turned find_turned(std::span<const Vec3> points, std::vector<char>& motion, const RunContext& context) const {
    still_->find_moved(corners_, rest_, points, motion, context);
    std::atomic<std::size_t> all{0};
    std::atomic<bool> any_crushed{false};
    parallel_for(context, size(), faces_per_range, [&](std::size_t begin, std::size_t end) {
      std::size_t count = 0;
      for (std::size_t f = begin; f < end; ++f) {
        if (motion[f] == still) continue;
        const Vec3 n = rest_normal(f), area = vector_area(points, corners_[f]);
        const double along = dot(n, area);
        motion[f] = along > 0 && along * along >= square_of_calm * dot(area, area) ? calm : turned;
        if (motion[f] == calm) continue;
        ++count;
        if (!any_crushed.load(std::memory_order_relaxed) && is_crushed(rest_, points, corners_[f], n)) {
          any_crushed.store(true, std::memory_order_relaxed);
        }
      }
      all.fetch_add(count, std::memory_order_relaxed);
    });
    return {all.load(), any_crushed.load()};
  }

  /// cos(delta), or unknown.
  float change(std::span<const Vec3> points, const FacePair& pair, const Vec3& first, const Vec3& second) const {
    const Turn turn = turn_between(first, second, points[pair.to] - points[pair.from]);
    if (!turn.known()) return unknown;
    return static_cast<float>(turn.cosine * static_cast<double>(pair.cosine) + turn.sine * static_cast<double>(pair.sine));
  }

  /// Whether there is an edge beyond 90 degrees, or one of which nothing can be said, among the first `count`. normals: or none.
  bool is_suspect(std::span<const Vec3> points, const std::vector<char>& motion, const std::vector<Vec3>& normals,
                  std::size_t count, const RunContext& context) const {
    const auto normal = [&](FaceId f) { return normals.empty() ? unit_normal(points, corners_[f], rounding_) : normals[f]; };
    std::atomic<bool> found{false};
    parallel_for(context, count, faces_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end && !found.load(std::memory_order_relaxed); ++i) {
        const FacePair& pair = pairs_[i];
        const char first = motion[pair.first], second = motion[pair.second];
        if (i < sharp_ ? corners_.triangles() && first == still && second == still : first != turned && second != turned)
          continue;
        const float cosine = change(points, pair, normal(pair.first), normal(pair.second));
        if (cosine < 0 || cosine == unknown) found.store(true, std::memory_order_relaxed);
      }
    });
    return found.load();
  }

  std::vector<float> changes(std::span<const Vec3> points, const std::vector<Vec3>& normals, const RunContext& context) const {
    std::vector<float> cosines(pairs_.size());
    parallel_for(context, pairs_.size(), faces_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        cosines[i] = change(points, pairs_[i], normals[pairs_[i].first], normals[pairs_[i].second]);
      }
    });
    return cosines;
  }

  /// Takes the normals of crushed faces away, and says which these are.
  std::vector<char> drop_crushed(std::span<const Vec3> points, std::vector<Vec3>& normals, const RunContext& context) const {
    std::vector<char> crushed(size());
    parallel_for(context, size(), faces_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t f = begin; f < end; ++f) {
        crushed[f] = takes_part(f) && (normals[f] == Vec3{} || is_crushed(rest_, points, corners_[f], rest_normal(f)));
        if (crushed[f]) normals[f] = {};
      }
    });
    return crushed;
  }

  /// Gives faces without normals those that go on from their neighbours, row by row, over their longest edges.
  void carry_normals(std::span<const Vec3> points, std::vector<Vec3>& normals) const {
    struct Offer {
      FaceId to;
      double length;
      Vec3 normal;
    };
    const auto bare = [&](FaceId face) { return normals[face] == Vec3{}; };
    std::vector<std::uint32_t> open;
    for (std::uint32_t i = 0; i < pairs_.size(); ++i) {
      if (bare(pairs_[i].first) || bare(pairs_[i].second)) open.push_back(i);
    }
    std::vector<Offer> offers;
    for (int row = 0; row < most_rows && !open.empty(); ++row) {
      offers.clear();
      for (const std::uint32_t i : open) {
        const FacePair& pair = pairs_[i];
        const Vec3 edge = points[pair.to] - points[pair.from];
        const double size = length(edge);
        if (bare(pair.first) == bare(pair.second) || !(size > 0) || !std::isfinite(size)) continue;
        const bool back = bare(pair.first);
        const Turn turn{pair.cosine, back ? -static_cast<double>(pair.sine) : static_cast<double>(pair.sine)};
        const FaceId to = back ? pair.first : pair.second, from = back ? pair.second : pair.first;
        offers.push_back({to, size, turned_normal(normals[from], turn, edge)});
      }
      if (offers.empty()) break;
      // The first of the longest: they are in the order of the pairs.
      std::stable_sort(offers.begin(), offers.end(),
                       [](const Offer& a, const Offer& b) { return a.to != b.to ? a.to < b.to : a.length > b.length; });
      for (std::size_t k = 0; k < offers.size(); ++k) {
        if (k == 0 || offers[k - 1].to != offers[k].to) normals[offers[k].to] = offers[k].normal;
      }
      std::erase_if(open, [&](std::uint32_t i) { return !bare(pairs_[i].first) && !bare(pairs_[i].second); });
    }
  }

  /// Per face whether it is where it was: no corner moved, up to rounding. Of faces so small that this says nothing of their
  /// normals, those count that did not turn either.
  std::vector<char> at_rest(std::span<const Vec3> points, const std::vector<Vec3>& normals, const std::vector<char>& crushed,
                            const RunContext& context) const {
    double largest = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double moved = length(points[i] - rest_[i]);
      if (std::isfinite(moved)) largest = std::max(largest, moved);
    }
    const double limit = std::max(rounding_, no_motion * std::min(largest, diagonal_));
    std::vector<char> held(size());
    parallel_for(context, size(), faces_per_range, [&](std::size_t begin, std::size_t end) {
      for (std::size_t f = begin; f < end; ++f) {
        if (!takes_part(f) || crushed[f] || !(dot(rest_normal(f), normals[f]) > 0.5)) continue;
        const auto corners = corners_[f];
        held[f] = std::all_of(corners.begin(), corners.end(), [&](PointId p) { return length(points[p] - rest_[p]) <= limit; });
      }
    });
    return held;
  }

  double prescribed_cosine(const FacePair& pair, float cosine) const {
    return length(rest_[pair.to] - rest_[pair.from]) * weight(pair) * evidence(static_cast<double>(cosine));
  }

  /// Per face whether it is on the side that is not upright.
  std::vector<char> sides(const std::vector<char>& motion, const std::vector<char>& crushed, const std::vector<char>& held,
                          const std::vector<Vec3>& normals, const std::vector<float>& cosines) const {
    std::vector<char> over(size(), 0);
    if (std::none_of(cosines.begin(), cosines.end(), [](float c) { return c < -0.5F; })) return over;
    Clusters clusters(size());
    const auto is_calm = [&](FaceId f) { return motion[f] != turned && !crushed[f]; };
    for (std::size_t i = sharp_; i < pairs_.size(); ++i) {
      if (is_calm(pairs_[i].first) && is_calm(pairs_[i].second)) clusters.join(pairs_[i].first, pairs_[i].second);
    }
    const auto first_held = std::find(held.begin(), held.end(), 1);
    for (auto one = first_held; one != held.end(); one = std::find(one + 1, held.end(), 1)) {
      clusters.join(static_cast<FaceId>(first_held - held.begin()), static_cast<FaceId>(one - held.begin()));
    }
    const std::size_t count = clusters.number();
    std::vector<SidePair> pairs;
    for (std::size_t i = 0; i < pairs_.size(); ++i) {
      const FaceId a = clusters[pairs_[i].first], b = clusters[pairs_[i].second];
      if (a == b || cosines[i] == unknown) continue;
      pairs.push_back({a, b, static_cast<std::uint32_t>(i), prescribed_cosine(pairs_[i], cosines[i])});
    }
    const TwoSides found = two_sides(count, std::move(pairs));
    struct Side {
      bool held = false;          // has faces that are where they were: one of the two at most
      double area = 0, kept = 0;  // kept: area times cosine of how its normals turned
    };
    std::vector<std::array<Side, 2>> of(count);
    for (std::size_t f = 0; f < size(); ++f) {
      if (!takes_part(f)) continue;
      const double area = length(vector_area(rest_, corners_[f]));
      Side& side = of[found.component[clusters[f]]][static_cast<std::size_t>(found.side[clusters[f]])];
      if (held[f]) side.held = true;
      side.area += area;
      side.kept += area * dot(rest_normal(f), normals[f]);
    }
    for (std::size_t f = 0; f < size(); ++f) {
      const auto& [a, b] = of[found.component[clusters[f]]];
      const bool equal = std::abs(a.area - b.area) <= 1e-9 * (a.area + b.area);
      const bool second_is_upright = a.held != b.held ? b.held : equal ? b.kept > a.kept : b.area > a.area;
      over[f] = (found.side[clusters[f]] != 0) != second_is_upright;
    }
    return over;
  }

  std::vector<Extreme> listed(std::span<const Vec3> points, const std::vector<Vec3>& normals, const std::vector<char>& crushed,
                              const std::vector<char>& held, const std::vector<float>& cosines,
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
      if (held[f]) continue;
      const auto& [sum, weights, neighbours] = scores[f];
      if (crushed[f]) {
        const Vec3 own = unit_normal(points, corners_[f], rounding_);
        const double cosine = dot(normals[f], own);
        if (own == Vec3{}) {
          flipped.push_back({0, f});
        } else if (over[f] ? cosine > 0 : cosine < 0) {
          flipped.push_back({-std::abs(cosine), f});
        }
      } else if (neighbours > 1 ? sum < 0 : neighbours == 1 && over[f]) {
        flipped.push_back({sum / weights, f});
      }
    }
    std::stable_sort(flipped.begin(), flipped.end(), [](const Extreme& a, const Extreme& b) { return a.value < b.value; });
    return flipped;
  }

  std::size_t points_;
  std::span<const Vec3> rest_;
  FaceCorners corners_;
  double rounding_ = 0, diagonal_ = 0;
  std::vector<std::array<float, 3>> normals_;  ///< f, zero: the face takes no part
  std::vector<FacePair> pairs_;                ///< the sharp edges first
  std::size_t sharp_ = 0;
  std::optional<StillFaces> still_;
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
  return mesh.face_count() * (sizeof(Vec3) + 4 * sizeof(float) + sizeof(std::uint64_t)) +
         face_pairs_bytes(mesh.point_count(), mesh.face_points.size());
}

std::vector<Extreme> flipped_faces(const Mesh& mesh, std::span<const Vec3> rest, const RunContext& context) {
  return FlipCheck(mesh, rest, context).flipped(mesh.points, context);
}

}  // namespace deform
