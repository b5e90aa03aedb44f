// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/handle_map.h"

#include <algorithm>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr std::size_t mapped_points_per_task = 4096;

}  // namespace

HandleMap::HandleMap(std::unique_ptr<const HandleEvaluation> evaluation)
    : evaluation_(std::move(evaluation)),
      partners_(evaluation_->system_->regions_.symmetry.sector(), *evaluation_->system_->mesh_) {
  const HandleSystem& system = *evaluation_->system_;
  const Mesh& mesh = *system.mesh_;
  const auto replaced = evaluation_->replaced();
  given_.reserve(replaced.size() + (system.hard_handles() ? system.points_.count : 0));
  for (const auto& [id, to] : replaced) given_.push_back({mesh.points[id], to});
  for (std::size_t i = 0; system.hard_handles() && i < mesh.point_count(); ++i) {
    const auto id = static_cast<PointId>(i);
    if (!system.is_prescribed(id)) continue;
    given_.push_back({mesh.points[i], evaluation_->held_.place(evaluation_->designs_[0], id, MotionKind::position)});
  }
  // Among points in one place the first counts.
  std::stable_sort(given_.begin(), given_.end(), [](const Given& a, const Given& b) { return a.from < b.from; });
  const auto last = std::unique(given_.begin(), given_.end(), [](const Given& a, const Given& b) { return a.from == b.from; });
  given_.erase(last, given_.end());
}

SpaceMap::Found HandleMap::evaluate(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                                    const RunContext& context) const {
  const Symmetry& symmetry = evaluation_->system_->regions_.symmetry;
  // The displacement of the second of two partners is that of the first, turned.
  std::vector<Vec3> at_first;
  std::vector<std::size_t> seconds;
  for (std::size_t i = 0; i < points.size() && symmetry.is_sector(); ++i) {
    const PartnerPlaces::Entry* const partner = partners_.at(points[i]);
    at_first.push_back(partner == nullptr ? points[i] : evaluation_->system_->mesh_->points[partner->first]);
    if (partner != nullptr && partner->is_second) seconds.push_back(i);
  }
  const Found found = evaluation_->displacements_at(symmetry.is_sector() ? at_first : points, first, out, context);
  for (const std::size_t i : seconds) out[i] = symmetry.sector().turned(out[i], 1);
  parallel_for(context, points.size(), mapped_points_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3& x = points[i];
      const auto found =
          std::lower_bound(given_.begin(), given_.end(), x, [](const Given& a, const Vec3& b) { return a.from < b; });
      if (found != given_.end() && found->from == x) {
        out[i] = found->to;
        continue;
      }
      Vec3 u = out[i];
      if (!symmetry.empty()) u = symmetry.from_frame(symmetry.admissible(u, x));
      out[i] = x + u;
    }
  });
  return found;
}

}  // namespace deform
