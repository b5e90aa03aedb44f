// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/handle_fields.h"

#include <algorithm>
#include <set>

#include "core/base/parallel.h"

namespace deform {

namespace {

constexpr std::size_t handle_field_points = 4096;  // per task; whole tiles

}  // namespace

HandleFields::HandleFields(const HandleSystem& system) : system_(system), entries_(entries(system)) {}

std::vector<HandleFields::Entry> HandleFields::entries(const HandleSystem& system) {
  std::vector<Entry> result;
  const std::size_t planes = system.regions_.symmetry.planes();
  for (std::size_t b = 0; b < system.basis_.size(); ++b) {
    const std::vector<std::size_t>& components = system.basis_[b].components;
    const bool apart = std::any_of(components.begin(), components.end(), [&](std::size_t k) { return k < planes; });
    for (std::uint32_t f = 0; f < system.fields(); ++f) {
      if (!apart) result.push_back({b, f, components});
      for (const std::size_t k : components) {
        if (apart) result.push_back({b, f, {k}});
      }
    }
  }
  return result;
}

/// Points on a symmetry plane do not move along its normal.
bool HandleFields::is_dropped(const Entry& entry, PointId id) const {
  const std::size_t k = entry.components.front();
  return k < system_.regions_.symmetry.planes() && (system_.regions_.symmetry.on(id) >> k & 1u) != 0;
}

void HandleFields::values(std::size_t first, std::size_t count, std::span<double> values, const RunContext& context) const {
  std::fill(values.begin(), values.end(), 0.0);
  for (std::size_t begin = 0; begin < count;) {  // of one basis
    std::size_t end = begin + 1;
    while (end < count && entries_[first + end].basis == entries_[first + begin].basis) ++end;
    following_values(first + begin, end - begin, count, values.data() + begin, context);
    begin = end;
  }
  const auto& handles = system_.regions_.handles;
  for (std::size_t h = 0; h < handles.size() && system_.hard_handles(); ++h) {
    for (const PointId id : handles[h]) {
      if (system_.points_.region_of[id] != h) continue;
      const auto own = system_.handle_fields(h, id);
      for (std::size_t k = 0; k < count; ++k) {
        const Entry& entry = entries_[first + k];
        if (entry.field / 4 == h && !is_dropped(entry, id) && !system_.basis_[entry.basis].turned)
          values[id * count + k] = own[entry.field % 4];
      }
    }
  }
}

/// Fields of one basis; `stride` is the distance of the values of two points.
void HandleFields::following_values(std::size_t first, std::size_t count, std::size_t stride, double* values,
                                    const RunContext& context) const {
  const HandleBasis& basis = system_.basis_[entries_[first].basis];
  const std::vector<PointId>& ids = system_.following();
  std::set<std::uint32_t> fields;
  std::vector<double> unit(system_.fields() * count, 0.0);
  for (std::size_t k = 0; k < count; ++k) {
    fields.insert(entries_[first + k].field);
    unit[entries_[first + k].field * count + k] = 1;
  }
  const std::vector<std::uint32_t> rows(fields.begin(), fields.end());
  parallel_for(context, ids.size(), handle_field_points, [&](std::size_t begin, std::size_t end) {
    std::vector<double> tile(count * tile_size);
    std::vector<Vec3> places;
    std::optional<CompressedSums> sums;
    if (basis.compressed) sums.emplace(*basis.compressed, rows, unit.data(), count, count);
    for (std::size_t at = begin; at < end; at += tile_size) {
      const std::size_t points = std::min(tile_size, end - at);
      std::fill(tile.begin(), tile.end(), 0.0);
      if (sums) {
        places = unit_places(*system_.mesh_, system_.box_, std::span(ids).subspan(at, points));
        sums->add_tile(at / tile_size, places, 0, count, tile.data());
      }
      for (std::size_t k = 0; k < count; ++k) {
        const Entry& entry = entries_[first + k];
        for (std::size_t i = 0; i < points; ++i) {
          const double value = sums ? tile[k * tile_size + i] : basis.tiles.at(at + i, entry.field);
          values[ids[at + i] * stride + k] = is_dropped(entry, ids[at + i]) ? 0 : value;
        }
      }
    }
  });
}

/// Twice: the decoded values differ from the fields by no more, and so do the sums from those of the fields.
double HandleFields::error(std::size_t field) const {
  const HandleBasis& basis = system_.basis_[entries_[field].basis];
  return basis.compressed ? 2 * basis.compressed->errors()[entries_[field].field] : 0;
}

}  // namespace deform
