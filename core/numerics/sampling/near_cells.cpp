// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/sampling/near_cells.h"

#include <utility>

namespace deform {

namespace {

constexpr std::size_t neighbours = 27;

/// Comparing the arrays would call memcmp().
bool same(const std::array<std::int64_t, 3>& a, const std::array<std::int64_t, 3>& b) {
  return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/// A cell and those around it.
template <typename Use>
void for_each_neighbour(const std::array<std::int64_t, 3>& cell, const Use& use) {
  for (std::int64_t dx = -1; dx <= 1; ++dx) {
    for (std::int64_t dy = -1; dy <= 1; ++dy) {
      for (std::int64_t dz = -1; dz <= 1; ++dz) use({cell[0] + dx, cell[1] + dy, cell[2] + dz});
    }
  }
}

}  // namespace

NearCells::NearCells(std::span<const Vec3> points, double radius) : points_(points.begin(), points.end()), radius_(radius) {
  if (points_.empty()) return;
  const Box box = bounding_box(points_);
  for (std::size_t k = 0; k < 3; ++k) {
    low_[k] = box.min[k] - radius;
    high_[k] = box.max[k] + radius;
  }
  // The cells with points, each found once, and the places in the table of those around it.
  std::vector<std::uint32_t> own(points_.size());
  std::vector<std::size_t> sizes;
  std::vector<Key> keys;
  table_.resize(64);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const Key key = cell_of(points_[i]);
    Cell& cell = table_[place_of(key)];
    if (cell.count == 0) {
      cell = {key, keys.size(), 1};
      keys.push_back(key);
      sizes.push_back(0);
      own[i] = static_cast<std::uint32_t>(keys.size() - 1);
      if (2 * keys.size() > table_.size()) widen_table();
    } else {
      own[i] = static_cast<std::uint32_t>(cell.begin);
    }
    ++sizes[own[i]];
  }
  table_.assign(table_.size(), {});
  std::size_t cells = 0;
  for (std::size_t c = 0; c < keys.size(); ++c) {
    if (2 * (cells + neighbours) > table_.size()) widen_table();
    for_each_neighbour(keys[c], [&](const Key& key) {
      Cell& cell = table_[place_of(key)];
      if (cell.count == 0) {
        cell.key = key;
        ++cells;
      }
      cell.count += sizes[c];
    });
  }
  std::size_t entries = 0;
  for (Cell& cell : table_) {
    cell.begin = entries;
    entries += cell.count;
  }
  std::vector<std::uint32_t> around;
  around.reserve(neighbours * keys.size());
  for (const Key& cell : keys) {
    for_each_neighbour(cell, [&](const Key& key) { around.push_back(static_cast<std::uint32_t>(place_of(key))); });
  }
  near_.resize(entries);
  std::vector<std::uint32_t> filled(table_.size(), 0);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    for (std::size_t n = 0; n < neighbours; ++n) {
      const std::uint32_t place = around[neighbours * own[i] + n];
      near_[table_[place].begin + filled[place]++] = static_cast<std::uint32_t>(i);
    }
  }
}

void NearCells::widen_table() {
  const std::vector<Cell> before = std::exchange(table_, std::vector<Cell>(2 * table_.size()));
  for (const Cell& cell : before) {
    if (cell.count > 0) table_[place_of(cell.key)] = cell;
  }
}

NearCells::Key NearCells::cell_of(const Vec3& x) const {
  Key cell;
  for (std::size_t k = 0; k < 3; ++k) cell[k] = static_cast<std::int64_t>((x[k] - low_[k]) / radius_);
  return cell;
}

std::size_t NearCells::place_of(const Key& key) const {
  auto h = static_cast<std::uint64_t>(key[0]) * 0x9e3779b97f4a7c15u;
  h = (h ^ (h >> 29)) + static_cast<std::uint64_t>(key[1]) * 0xbf58476d1ce4e5b9u;
  h = (h ^ (h >> 31)) + static_cast<std::uint64_t>(key[2]) * 0x94d049bb133111ebu;
  std::size_t i = static_cast<std::size_t>(h ^ (h >> 32)) & (table_.size() - 1);
  while (table_[i].count > 0 && !same(table_[i].key, key)) i = (i + 1) & (table_.size() - 1);
  return i;
}

std::span<const std::uint32_t> NearCells::near(const Vec3& x) const {
  for (std::size_t k = 0; k < 3; ++k) {
    if (!(x[k] > low_[k] && x[k] < high_[k])) return {};  // also without points, and for NaN
  }
  const Cell& cell = table_[place_of(cell_of(x))];
  return std::span(near_).subspan(cell.begin, cell.count);
}

std::size_t NearCells::bytes() const {
  return points_.size() * sizeof(Vec3) + table_.size() * sizeof(Cell) + near_.size() * sizeof(std::uint32_t);
}

}  // namespace deform
