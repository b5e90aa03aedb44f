// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/sector.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <sstream>

#include "core/base/error.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

[[noreturn]] void refuse_sector(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

constexpr std::size_t most_probes = 2000, least_votes = 3;  // for another count

constexpr PointId nobody = std::numeric_limits<PointId>::max();

/// Points by the cells of a grid, for the points within a small radius of a place.
class CellGrid {
 public:
  CellGrid(std::span<const Vec3> places, const std::vector<char>& use, double cell) : places_(places), cell_(cell) {
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (use[i] != 0) entries_.push_back({key(place(places[i], {})), static_cast<PointId>(i)});
    }
    std::sort(entries_.begin(), entries_.end(),
              [](const Entry& a, const Entry& b) { return a.key != b.key ? a.key < b.key : a.id < b.id; });
  }

  /// Calls visit(id, distance) for the points within `radius` (less than half a cell) of x.
  template <typename Visit>
  void near(const Vec3& x, double radius, const Visit& visit) const {
    std::array<std::uint64_t, 8> keys{};
    for (unsigned corner = 0; corner < 8; ++corner) {
      Vec3 offset{};
      for (std::size_t k = 0; k < 3; ++k) offset[k] = (corner >> k & 1u) != 0 ? radius : -radius;
      keys[corner] = key(place(x, offset));
    }
    std::sort(keys.begin(), keys.end());
    const auto last = std::unique(keys.begin(), keys.end());
    for (auto at = keys.begin(); at != last; ++at) {
      auto entry = std::lower_bound(entries_.begin(), entries_.end(), *at,
                                    [](const Entry& a, std::uint64_t wanted) { return a.key < wanted; });
      for (; entry != entries_.end() && entry->key == *at; ++entry) {
        const double away = distance(places_[entry->id], x);
        if (away <= radius) visit(entry->id, away);
      }
    }
  }

 private:
  struct Entry {
    std::uint64_t key;
    PointId id;
  };
  std::array<std::int64_t, 3> place(const Vec3& x, const Vec3& offset) const {
    std::array<std::int64_t, 3> result{};
    for (std::size_t k = 0; k < 3; ++k) result[k] = static_cast<std::int64_t>(std::floor((x[k] + offset[k]) / cell_));
    return result;
  }
  /// Different cells may have one key: distances decide.
  static std::uint64_t key(const std::array<std::int64_t, 3>& at) {
    std::uint64_t hash = 0;
    for (const std::int64_t k : at) hash = (hash ^ static_cast<std::uint64_t>(k)) * 0x9e3779b97f4a7c15u + (hash >> 29);
    return hash;
  }

  std::span<const Vec3> places_;
  double cell_;
  std::vector<Entry> entries_;
};

/// The corners of faces, or all points without faces.
std::vector<char> at_faces(const Mesh& mesh) {
  std::vector<char> use(mesh.point_count(), mesh.face_points.empty() ? 1 : 0);
  for (const PointId id : mesh.face_points) use[id] = 1;
  return use;
}

}  // namespace

Sector::Sector(const SectorOptions& options, const Mesh& mesh, std::span<const Vec3> places, double diagonal,
               const std::string& field)
    : reach_(tolerance * diagonal) {
  const std::size_t count = options.count;
  if (count < least || count > most) {
    refuse_sector(field + ".count: " + std::to_string(count) + " is out of range, a wheel has " + std::to_string(least) + " to " +
                  std::to_string(most) + " sectors");
  }
  for (std::size_t k = 0; k <= count; ++k) {
    // The angles of a whole, a half and a quarter turn exactly.
    const double angle = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(count);
    const bool quarter = 4 * k % count == 0;
    cosines_.push_back(quarter ? std::round(std::cos(angle)) : std::cos(angle));
    sines_.push_back(quarter ? std::round(std::sin(angle)) : std::sin(angle));
  }
  cosines_.pop_back();
  sines_.pop_back();
  of_.resize(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    of_[i] = static_cast<PointId>(i);
    if (on_axis(places[i])) axis_points_.push_back(static_cast<PointId>(i));
  }
  find_pairs(mesh, places, field);
  if (pairs_.empty()) find_likely(mesh, places);
  check_patches(options, mesh, places, field);
  check_holes(mesh, places, field);
}

Vec3 Sector::turned(const Vec3& x, std::size_t sectors) const {
  const double c = cosines_[sectors % count()], s = sines_[sectors % count()];
  return {x[0], c * x[1] - s * x[2], s * x[1] + c * x[2]};
}

bool Sector::on_axis(const Vec3& place) const { return std::hypot(place[1], place[2]) <= reach_; }

bool Sector::on_axis(PointId id) const { return std::binary_search(axis_points_.begin(), axis_points_.end(), id); }

Vec3 Sector::from_first(PointId id, const Vec3& of_first) const {
  if (is_second(id)) return turned(of_first, 1);
  return on_axis(id) ? Vec3{of_first[0], 0, 0} : of_first;
}

Vec3 Sector::at_first(PointId id, const Vec3& vector) const {
  if (is_second(id)) return turned(vector, count() - 1);
  return on_axis(id) ? Vec3{vector[0], 0, 0} : vector;
}

void Sector::find_pairs(const Mesh& mesh, std::span<const Vec3> places, const std::string& field) {
  std::vector<char> use = at_faces(mesh);
  for (const PointId id : axis_points_) use[id] = 0;
  const CellGrid grid(places, use, 64 * std::max(reach_, std::numeric_limits<double>::min()));
  std::vector<PointId> image_of(places.size(), nobody);  // the first point of each second one
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (use[i] == 0 || (count() == 2 && image_of[i] != nobody)) continue;
    PointId partner = nobody;
    double least_away = 0;
    grid.near(turned(places[i], 1), reach_, [&](PointId id, double away) {
      if (image_of[id] != nobody || id == i || (partner != nobody && away >= least_away)) return;
      partner = id;
      least_away = away;
    });
    if (partner == nobody) continue;
    image_of[partner] = static_cast<PointId>(i);
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (image_of[i] == nobody) continue;
    of_[i] = image_of[i];
    pairs_.push_back({image_of[i], static_cast<PointId>(i)});
  }
  check_chains(mesh, field);
}

/// The two ends of a sector are as far apart as its points at one radius and axial place are at most, so that of all counts whose
/// turn takes points to others the least is the likely one.
void Sector::find_likely(const Mesh& mesh, std::span<const Vec3> places) {
  std::vector<char> use = at_faces(mesh);
  for (const PointId id : axis_points_) use[id] = 0;
  std::vector<PointId> used;
  std::vector<Vec3> meridional;
  for (std::size_t i = 0; i < places.size(); ++i) {
    meridional.push_back({places[i][0], std::hypot(places[i][1], places[i][2]), 0});
    if (use[i] != 0) used.push_back(static_cast<PointId>(i));
  }
  const double cell = 64 * std::max(reach_, std::numeric_limits<double>::min());
  const CellGrid beside(meridional, use, cell);
  std::map<std::size_t, std::size_t> votes;
  const std::size_t step = (used.size() + most_probes - 1) / most_probes;
  for (std::size_t i = 0; i < used.size(); i += step) {
    const Vec3& x = places[used[i]];
    std::set<std::size_t> counts;
    beside.near(meridional[used[i]], reach_, [&](PointId id, double) {
      const Vec3& y = places[id];
      const double angle = std::atan2(x[1] * y[2] - x[2] * y[1], x[1] * y[1] + x[2] * y[2]);
      const double turns = angle > 0 ? std::round(2 * std::numbers::pi / angle) : 0;
      if (turns < static_cast<double>(least) || turns > static_cast<double>(most)) return;
      const double off = std::abs(angle - 2 * std::numbers::pi / turns) * meridional[id][1];
      if (off <= reach_) counts.insert(static_cast<std::size_t>(turns));
    });
    for (const std::size_t one : counts) ++votes[one];
  }
  const auto chosen = std::find_if(votes.begin(), votes.end(), [](const auto& vote) { return vote.second >= least_votes; });
  if (chosen == votes.end()) return;
  likely_ = chosen->first;
  const CellGrid grid(places, use, cell);
  const double angle = 2 * std::numbers::pi / static_cast<double>(likely_), c = std::cos(angle), s = std::sin(angle);
  for (const PointId id : used) {
    const Vec3& x = places[id];
    bool met = false;
    grid.near({x[0], c * x[1] - s * x[2], s * x[1] + c * x[2]}, reach_, [&](PointId, double) { met = true; });
    likely_pairs_ += met ? 1 : 0;
  }
  if (likely_ == 2) likely_pairs_ /= 2;  // half a turn takes each of two to the other
}

/// A sector ends where the next begins: an image has no image of its own.
void Sector::check_chains(const Mesh& mesh, const std::string& field) const {
  const std::string more = field + ": the mesh covers more than one of " + std::to_string(count()) + " sectors: ";
  for (const Pair& pair : pairs_) {
    if (!is_second(pair.first)) continue;
    refuse_sector(more + "point " + std::to_string(pair.first) + " is the image of point " +
                  std::to_string(first_of(pair.first)) + ", and point " + std::to_string(pair.second) + " that of point " +
                  std::to_string(pair.first));
  }
  if (count() != 2 || pairs_.empty()) return;
  const std::vector<char> use = at_faces(mesh);
  const auto used = static_cast<std::size_t>(std::count(use.begin(), use.end(), 1));
  if (2 * pairs_.size() + axis_points_.size() < used) return;
  refuse_sector(more + "all its points are images of each other");
}

std::string Sector::without_partner(PointId id, std::span<const Vec3> places) const {
  double away = std::numeric_limits<double>::infinity();
  PointId nearest = id;
  for (const std::size_t sectors : {std::size_t{1}, count() - 1}) {
    const Vec3 image = turned(places[id], sectors);
    for (std::size_t i = 0; i < places.size(); ++i) {
      const double d = distance(places[i], image);
      if (i == id || d >= away) continue;
      away = d;
      nearest = static_cast<PointId>(i);
    }
  }
  std::ostringstream text;
  text << "point " << id << " has no partner on the other periodic boundary: turned by " << 360.0 / static_cast<double>(count())
       << " degrees it is " << away << " away from the nearest point, " << nearest << ", the limit is " << reach_ << " ("
       << tolerance << " of the diagonal)";
  return text.str();
}

/// A point between points that all have partners is on a periodic boundary.
void Sector::check_holes(const Mesh& mesh, std::span<const Vec3> places, const std::string& field) const {
  std::vector<char> side(places.size(), 0);  // 1: first, 2: second, 3: both, for N = 2
  for (const Pair& pair : pairs_) {
    side[pair.first] = static_cast<char>(side[pair.first] | 1);
    side[pair.second] = static_cast<char>(side[pair.second] | 2);
  }
  std::vector<char> around(places.size(), 3);
  std::vector<char> seen(places.size(), 0);
  const PointId* corners = mesh.face_points.data();
  for (const std::uint32_t size : mesh.face_sizes) {
    for (std::size_t c = 0; c < size; ++c) {
      for (std::size_t d = 0; d < size; ++d) {
        if (corners[c] == corners[d]) continue;
        around[corners[c]] = static_cast<char>(around[corners[c]] & side[corners[d]]);
        seen[corners[c]] = 1;
      }
    }
    corners += size;
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    const auto id = static_cast<PointId>(i);
    if (seen[i] == 0 || around[i] == 0 || side[i] != 0 || on_axis(id)) continue;
    refuse_sector(field + ": " + without_partner(id, places) + "; all points around it have one");
  }
}

void Sector::check_patches(const SectorOptions& options, const Mesh& mesh, std::span<const Vec3> places,
                           const std::string& field) const {
  if (options.periodic.size() > 2) {
    refuse_sector(field + ".periodic: " + std::to_string(options.periodic.size()) + " regions, a sector has 2 periodic patches");
  }
  std::vector<char> paired(places.size(), 0);
  for (const Pair& pair : pairs_) paired[pair.first] = paired[pair.second] = 1;
  for (std::size_t r = 0; r < options.periodic.size(); ++r) {
    const std::string what = field + ".periodic[" + std::to_string(r) + "]";
    const std::vector<PointId> ids = select(options.periodic[r], mesh, what);
    if (ids.empty()) refuse_sector(what + ": " + no_point_text(mesh));
    std::size_t alone = 0;
    PointId first = nobody;
    for (const PointId id : ids) {
      if (paired[id] != 0 || on_axis(id)) continue;
      if (alone++ == 0) first = id;
    }
    if (alone == 0) continue;
    refuse_sector(what + ": " + without_partner(first, places) +
                  (alone > 1 ? "; so are " + std::to_string(alone - 1) + " others of its points" : ""));
  }
}

/// The command line shows notes that end in a question with every design.
std::string Sector::note() const {
  std::string text = "Sector: one of " + std::to_string(count()) + "; " + std::to_string(pairs_.size()) +
                     " pairs of points on the periodic boundaries, " + std::to_string(axis_points_.size()) +
                     " points on the axis.";
  if (!pairs_.empty()) return text;
  if (likely_ == 0) return text + " If the mesh ends in periodic boundaries, `axis` or `count` is wrong: has it none?";
  return text + " With `count` " + std::to_string(likely_) + " there were " + std::to_string(likely_pairs_) +
         ": is the mesh one of so many sectors?";
}

std::size_t Sector::bytes() const {
  return of_.size() * sizeof(PointId) + pairs_.size() * sizeof(Pair) + axis_points_.size() * sizeof(PointId) +
         2 * cosines_.size() * sizeof(double);
}

}  // namespace deform
