// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/deformers/handles/symmetry.h"

namespace deform {

/// How far the motions of partners may differ, and those of points on the axis lead off it, as a fraction of D: as those of
/// coincident points.
inline constexpr double sector_agreement = 1e-10;

/// Why motions of handle and fixed points do not fit a sector, the first reason; empty if they do. `motion_of(id)` is that of a
/// point, std::nullopt if it is free, `name_of(id)` names it; differences up to `limit` are rounding.
template <typename MotionOf, typename NameOf>
std::string sector_conflict(const Symmetry& symmetry, const MotionOf& motion_of, const NameOf& name_of, double limit) {
  const std::string same = "; every sector has the same motion: take such points out of the handle with `difference`";
  for (const Sector::Pair& pair : symmetry.sector().pairs()) {
    const std::optional<Vec3> first = motion_of(pair.first), second = motion_of(pair.second);
    if (!first || !second) continue;
    const double apart = distance(*second, symmetry.turned(*first, 1));
    if (apart <= limit) continue;
    return "points " + name_of(pair.first) + " and " + name_of(pair.second) +
           " are partners on the periodic boundaries, but the motion of the second differs by " + number_digits(apart) +
           " from that of the first, turned by one sector" + same;
  }
  for (const PointId id : symmetry.sector().axis_points()) {
    const std::optional<Vec3> u = motion_of(id);
    if (!u) continue;
    const double off = norm(*u - dot(*u, symmetry.normal(0)) * symmetry.normal(0));
    if (off <= limit) continue;
    return "point " + name_of(id) + " lies on the axis of the sector but is moved by " + number_digits(off) + " off it" + same;
  }
  return {};
}

/// The points of periodic boundaries by their places, equal to the last bit. Immutable; any thread.
class PartnerPlaces {
 public:
  PartnerPlaces(const Sector& sector, const Mesh& mesh) {
    entries_.reserve(2 * sector.pairs().size());
    for (const Sector::Pair& pair : sector.pairs()) {
      entries_.push_back({mesh.points[pair.first], pair.first, false});
      entries_.push_back({mesh.points[pair.second], pair.first, true});
    }
    // Among points in one place the first counts.
    std::stable_sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) { return a.place < b.place; });
  }

  struct Entry {
    Vec3 place;
    PointId first;   ///< of the two partners
    bool is_second;  ///< whether the place is that of the other one
  };
  static std::size_t bytes_for(const Sector& sector) { return 2 * sector.pairs().size() * sizeof(Entry); }
  /// Null if there is none.
  const Entry* at(const Vec3& place) const {
    const auto found =
        std::lower_bound(entries_.begin(), entries_.end(), place, [](const Entry& a, const Vec3& b) { return a.place < b; });
    return found != entries_.end() && found->place == place ? &*found : nullptr;
  }

 private:
  std::vector<Entry> entries_;
};

}  // namespace deform
