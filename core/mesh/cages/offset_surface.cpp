// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/cages/offset_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"

namespace deform {

namespace {

constexpr std::size_t block = 16;    // nodes along the sides of what is one task
constexpr double least_part = 0.05;  // of an edge, between its ends and the surface: no triangle collapses
const double cell_diagonal = std::sqrt(3.0);

using Index = std::array<std::size_t, 3>;

/// Nodes along each axis; two cells more than the surface needs on every side, so that all nodes of the boundary are outside, but
/// for those in symmetry planes.
std::array<double, 3> node_counts(const Box& box, const OffsetGrid& grid) {
  std::array<double, 3> counts{};
  for (std::size_t k = 0; k < 3; ++k) {
    counts[k] = k < grid.planes ? std::ceil((box.max[k] + grid.offset) / grid.cell) + 3
                                : std::ceil((box.side(static_cast<int>(k)) + 2 * grid.offset) / grid.cell) + 5;
  }
  return counts;
}

class Extraction {
 public:
  Extraction(const ClosestPoint& triangles, const Box& box, const OffsetGrid& grid)
      : triangles_(triangles), offset_(grid.offset), cell_(grid.cell) {
    const auto counts = node_counts(box, grid);
    for (std::size_t k = 0; k < 3; ++k) {
      count_[k] = static_cast<std::size_t>(counts[k]);
      if (k < grid.planes) continue;
      const double middle = 0.5 * (box.min[k] + box.max[k]);
      origin_[k] = middle - 0.5 * cell_ * (counts[k] - 1);
    }
    heights_.resize(count_[0] * count_[1] * count_[2]);
  }

  Mesh run(const RunContext& context) {
    measure(context);
    fill_cavities();
    for (std::size_t k = 0; k + 1 < count_[2]; ++k) {
      context.check();
      for (std::size_t j = 0; j + 1 < count_[1]; ++j) {
        for (std::size_t i = 0; i + 1 < count_[0]; ++i) march({i, j, k});
      }
    }
    return std::move(mesh_);
  }

 private:
  std::size_t number(const Index& at) const { return at[0] + count_[0] * (at[1] + count_[1] * at[2]); }
  Vec3 place(const std::array<double, 3>& at) const {
    return {origin_[0] + cell_ * at[0], origin_[1] + cell_ * at[1], origin_[2] + cell_ * at[2]};
  }

  /// Distance less offset of all nodes near the surface; elsewhere only the sign is right.
  void measure(const RunContext& context) {
    Index blocks{};
    for (std::size_t k = 0; k < 3; ++k) blocks[k] = (count_[k] + block - 1) / block;
    parallel_for(context, blocks[0] * blocks[1] * blocks[2], 1, [&](std::size_t begin, std::size_t end) {
      for (std::size_t b = begin; b < end; ++b) {
        const Index first{b % blocks[0] * block, b / blocks[0] % blocks[1] * block, b / blocks[0] / blocks[1] * block};
        Index last{};
        for (std::size_t k = 0; k < 3; ++k) last[k] = std::min(first[k] + block, count_[k]);
        measure(first, last);
      }
    });
  }
  void measure(const Index& first, const Index& last) {
    std::array<double, 3> middle{};
    double square = 0;
    std::size_t axis = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      middle[k] = 0.5 * static_cast<double>(first[k] + last[k] - 1);
      const double half = 0.5 * static_cast<double>(last[k] - 1 - first[k]);
      square += half * half;
      if (last[k] - first[k] > last[axis] - first[axis]) axis = k;
    }
    const Vec3 x = place(middle);
    const double height = distance(x, triangles_(x)) - offset_;
    if (square == 0) {
      heights_[number(first)] = height;
      return;
    }
    // No node here is next to one on the other side.
    if (std::abs(height) > (std::sqrt(square) + cell_diagonal) * cell_) {
      for (std::size_t k = first[2]; k < last[2]; ++k) {
        for (std::size_t j = first[1]; j < last[1]; ++j) {
          const auto start = heights_.begin() + static_cast<std::ptrdiff_t>(number({first[0], j, k}));
          std::fill_n(start, last[0] - first[0], height);
        }
      }
      return;
    }
    Index before = last, behind = first;
    before[axis] = behind[axis] = first[axis] + (last[axis] - first[axis]) / 2;
    measure(first, before);
    measure(behind, last);
  }

  /// What is outside but cannot be reached from the boundary along edges of the tetrahedra becomes inside.
  void fill_cavities() {
    std::vector<char> reached(heights_.size(), 0);
    std::vector<Index> open{{count_[0] - 1, count_[1] - 1, count_[2] - 1}};  // which is in no symmetry plane
    reached.back() = 1;
    while (!open.empty()) {
      const Index at = open.back();
      open.pop_back();
      for (int direction = 1; direction < 8; ++direction) {
        for (const bool forwards : {true, false}) {
          Index next = at;
          bool valid = true;
          for (std::size_t k = 0; k < 3; ++k) {
            if ((direction >> k & 1) == 0) continue;
            valid = valid && (forwards ? at[k] + 1 < count_[k] : at[k] > 0);
            if (valid) next[k] = forwards ? at[k] + 1 : at[k] - 1;
          }
          if (!valid || reached[number(next)] != 0 || !(heights_[number(next)] > 0)) continue;
          reached[number(next)] = 1;
          open.push_back(next);
        }
      }
    }
    for (std::size_t i = 0; i < heights_.size(); ++i) {
      if (reached[i] == 0 && heights_[i] > 0) heights_[i] = -heights_[i];
    }
  }

  /// Corner c of a cell is one step farther along axis k where bit k of c is set.
  static Index corner(const Index& at, unsigned c) { return {at[0] + (c & 1), at[1] + (c >> 1 & 1), at[2] + (c >> 2 & 1)}; }

  void march(const Index& at) {
    unsigned outside = 0;
    for (unsigned c = 0; c < 8; ++c) outside |= heights_[number(corner(at, c))] > 0 ? 1U << c : 0;
    if (outside == 0 || outside == 255) return;
    for (std::size_t p = 0; p < 3; ++p) {
      // From corner 0 to 7 along the edges of the cell: an axis, a second one, the third. Even permutations, and odd ones.
      const unsigned first = 1U << p, second = 1U << (p + 1) % 3, third = 1U << (p + 2) % 3;
      march(at, {0, first, first | second, 7}, outside);
      march(at, {0, third, third | second, 7}, outside);
    }
  }

  void march(const Index& at, const std::array<unsigned, 4>& tetrahedron, unsigned outside) {
    std::array<unsigned, 4> order{};  // those inside first
    std::size_t inside = 0, back = 4;
    for (const unsigned c : tetrahedron) {
      if ((outside >> c & 1) == 0) order[inside++] = c;
    }
    for (const unsigned c : tetrahedron) {
      if ((outside >> c & 1) != 0) order[--back] = c;
    }
    if (inside == 0 || inside == 4) return;
    if (!is_right_handed(order)) std::swap(order[inside == 3 ? 0 : 2], order[inside == 3 ? 1 : 3]);
    const auto on = [&](std::size_t a, std::size_t b) { return vertex(at, order[a], order[b]); };
    if (inside == 1) {
      add(on(0, 1), on(0, 2), on(0, 3));
    } else if (inside == 3) {
      add(on(0, 3), on(1, 3), on(2, 3));
    } else {
      const PointId a = on(0, 2), b = on(0, 3), c = on(1, 3), d = on(1, 2);
      add(a, b, c);
      add(a, c, d);
    }
  }
  static bool is_right_handed(const std::array<unsigned, 4>& corners) {
    std::array<Vec3, 4> x{};
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t k = 0; k < 3; ++k) x[i][k] = corners[i] >> k & 1;
    }
    return dot(cross(x[1] - x[0], x[2] - x[0]), x[3] - x[0]) > 0;
  }

  /// On the edge between two corners, one of which has all the bits of the other.
  PointId vertex(const Index& at, unsigned a, unsigned b) {
    const unsigned low = std::min(a, b), high = std::max(a, b);
    const std::size_t from = number(corner(at, low)), to = number(corner(at, high));
    const auto [found, added] =
        vertices_.try_emplace(std::uint64_t{8} * from + (low ^ high), static_cast<PointId>(mesh_.points.size()));
    if (added) {
      const double part = std::clamp(heights_[from] / (heights_[from] - heights_[to]), least_part, 1 - least_part);
      const Index i = corner(at, low), j = corner(at, high);
      const auto between = [&](std::size_t k) { return static_cast<double>(i[k]) + part * static_cast<double>(j[k] - i[k]); };
      mesh_.points.push_back(place({between(0), between(1), between(2)}));
    }
    return found->second;
  }
  void add(PointId a, PointId b, PointId c) {
    mesh_.face_sizes.push_back(3);
    mesh_.face_points.insert(mesh_.face_points.end(), {a, b, c});
  }

  const ClosestPoint& triangles_;
  const double offset_, cell_;
  Index count_{};
  Vec3 origin_{};
  std::vector<double> heights_;
  std::unordered_map<std::uint64_t, PointId> vertices_;  // by the edge: its lower node and direction
  Mesh mesh_;
};

}  // namespace

std::size_t offset_nodes(const Box& box, const OffsetGrid& grid) {
  const auto counts = node_counts(box, grid);
  const double nodes = counts[0] * counts[1] * counts[2];
  return nodes < 1e18 ? static_cast<std::size_t>(nodes) : std::size_t{1000000000000000000};
}

Mesh offset_surface(const ClosestPoint& triangles, const Box& box, const OffsetGrid& grid, const RunContext& context) {
  if (triangles.empty()) throw Error(ErrorCode::invalid_argument, "there is no triangle to keep a distance from");
  if (!(grid.offset > 0) || !std::isfinite(grid.offset))
    throw Error(ErrorCode::invalid_argument, "offset: " + number_digits(grid.offset) + " must be over 0 and finite");
  if (!(grid.cell > 0) || !(grid.cell <= grid.offset))
    throw Error(ErrorCode::invalid_argument,
                "cell: " + number_digits(grid.cell) + " must be over 0 and at most the offset, " + number_digits(grid.offset));
  if (grid.planes > 3) throw Error(ErrorCode::invalid_argument, "planes: " + std::to_string(grid.planes) + ", at most 3");
  const std::size_t nodes = offset_nodes(box, grid);
  if (nodes > OffsetGrid::most_nodes)
    throw Error(ErrorCode::invalid_argument,
                "cell: it would take " + std::to_string(nodes) + " nodes, allowed are " + std::to_string(OffsetGrid::most_nodes));
  return Extraction(triangles, box, grid).run(context);
}

}  // namespace deform
