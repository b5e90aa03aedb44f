// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/fast_sums/fast_sums.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

#include "core/base/parallel.h"
#include "core/numerics/kernels/tiles.h"

namespace deform {

namespace {

// Pairs of boxes translated together: enough columns for the product to run out of the cache, and enough groups for the threads.
constexpr std::size_t group_pairs = 16, least_pairs = 4, wanted_groups = 16;
// The number of columns at once, which limits the memory of the interpolation points of all boxes.
constexpr std::size_t most_columns = 12;

std::size_t automatic_leaf(int order) {
  const auto p = static_cast<std::size_t>(order);
  return std::clamp<std::size_t>(p * p * p / 2, 64, 400);
}

bool adjacent(const Octree::Box& a, const Octree::Box& b) {
  // On the lattice of the finer one.
  const int shift = std::abs(a.level - b.level);
  const Octree::Box& fine = a.level > b.level ? a : b;
  const Octree::Box& coarse = a.level > b.level ? b : a;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::int64_t low = std::int64_t{coarse.cell[k]} << shift;
    const std::int64_t high = low + (std::int64_t{1} << shift) - 1;
    if (fine.cell[k] < low - 1 || fine.cell[k] > high + 1) return false;
  }
  return true;
}

}  // namespace

struct FastSums::Workspace {
  std::span<const double> weights;  // sorted, m x columns
  std::size_t columns;
  std::vector<double> up, down;  // per box nodes x columns
  std::vector<double> result;    // sorted, n x columns
  const RunContext& context;
};

FastSums::FastSums(const RadialKernel& kernel, std::span<const Vec3> points, std::span<const Vec3> centres,
                   const Options& options)
    : kernel_(kernel),
      grid_(options.order),
      sources_(centres, enclosing_cube(points, centres),
               options.leaf_points ? options.leaf_points : automatic_leaf(options.order)),
      targets_(points, enclosing_cube(points, centres),
               options.leaf_points ? options.leaf_points : automatic_leaf(options.order)),
      // A translation costs nodes^2 multiplications, at about six times the rate of kernel values.
      direct_limit_(grid_.nodes() * grid_.nodes() / 6),
      near_(targets_.boxes().size()),
      incoming_(targets_.boxes().size()),
      expanded_(targets_.boxes().size()) {
  if (!points.empty() && !centres.empty()) pair(0, 0);
  finish_lists();
}

void FastSums::pair(std::uint32_t target, std::uint32_t source) {
  const Octree::Box& t = targets_.boxes()[target];
  const Octree::Box& s = sources_.boxes()[source];
  if (t.count() * s.count() <= direct_limit_) {
    near_[target].direct.push_back({s.begin, s.end});
    return;
  }
  if (!adjacent(t, s)) return far_pair(target, source);
  const bool split_target = !t.leaf() && (t.level <= s.level || s.leaf());
  const bool split_source = !s.leaf() && (s.level <= t.level || t.leaf());
  if (!split_target && !split_source) {
    near_[target].direct.push_back({s.begin, s.end});
    return;
  }
  for (std::uint32_t a = 0; a < (split_target ? t.children : 1u); ++a) {
    for (std::uint32_t b = 0; b < (split_source ? s.children : 1u); ++b) {
      pair(split_target ? t.child + a : target, split_source ? s.child + b : source);
    }
  }
}

void FastSums::far_pair(std::uint32_t target, std::uint32_t source) {
  const Octree::Box& t = targets_.boxes()[target];
  const Octree::Box& s = sources_.boxes()[source];
  if (t.level < s.level) {  // a leaf of the targets beside a small box of centres
    if (s.count() > grid_.nodes()) {
      near_[target].nodes.push_back(source);
    } else {
      near_[target].direct.push_back({s.begin, s.end});
    }
    return;
  }
  if (t.level > s.level) {
    if (t.count() > grid_.nodes()) {
      incoming_[target].push_back({s.begin, s.end});
    } else {
      near_[target].direct.push_back({s.begin, s.end});
    }
    return;
  }
  std::array<std::int32_t, 3> offset;
  for (std::size_t k = 0; k < 3; ++k) offset[k] = s.cell[k] - t.cell[k];
  std::size_t p = 0;
  while (true) {
    const auto& axes = ChebyshevGrid::axis_order(p);
    if (std::abs(offset[axes[0]]) >= std::abs(offset[axes[1]]) && std::abs(offset[axes[1]]) >= std::abs(offset[axes[2]])) break;
    ++p;
  }
  unsigned flips = 0;
  std::array<std::int32_t, 3> canonical;
  for (std::size_t k = 0; k < 3; ++k) {
    canonical[k] = offset[ChebyshevGrid::axis_order(p)[k]];
    if (canonical[k] < 0) flips |= 4u >> k;
    canonical[k] = std::abs(canonical[k]);
  }
  const Vec3 image{static_cast<double>(canonical[0]), static_cast<double>(canonical[1]), static_cast<double>(canonical[2])};
  auto at =
      std::find_if(classes_.begin(), classes_.end(), [&](const Class& c) { return c.level == t.level && c.offset == image; });
  if (at == classes_.end()) at = classes_.insert(at, Class{t.level, image, {}, {}});
  at->pairs.push_back({target, source, static_cast<std::uint8_t>(8 * p + flips)});
}

void FastSums::finish_lists() {
  for (Class& c : classes_) {
    std::stable_sort(c.pairs.begin(), c.pairs.end(), [](const Pair& a, const Pair& b) { return a.target < b.target; });
    c.groups = {0};
    const std::size_t together = std::clamp(c.pairs.size() / wanted_groups, least_pairs, group_pairs);
    for (std::size_t i = 1; i < c.pairs.size(); ++i) {
      if (i - c.groups.back() >= together && c.pairs[i].target != c.pairs[i - 1].target) c.groups.push_back(i);
    }
    c.groups.push_back(c.pairs.size());
    for (const Pair& pair : c.pairs) expanded_[pair.target] = true;
  }
  collects_ = !classes_.empty();
  const auto& boxes = targets_.boxes();
  for (std::uint32_t b = 0; b < boxes.size(); ++b) {
    // Centres that are summed at interpolation points fill them without any translation: where the targets are finer than the
    // centres, that may be all there is.
    if (!incoming_[b].empty()) expanded_[b] = true;
    expands_ = expands_ || expanded_[b];
    for (std::uint32_t c = boxes[b].child; expanded_[b] && c < boxes[b].child + boxes[b].children; ++c) expanded_[c] = true;
    if (boxes[b].leaf()) {
      collects_ = collects_ || !near_[b].nodes.empty();
      leaves_.push_back(b);
      // Neighbouring ranges in one: fewer and longer loops.
      auto& direct = near_[b].direct;
      std::sort(direct.begin(), direct.end(), [](const Range& x, const Range& y) { return x.begin < y.begin; });
      std::vector<Range> merged;
      for (const Range& range : direct) {
        if (!merged.empty() && merged.back().end == range.begin) {
          merged.back().end = range.end;
        } else {
          merged.push_back(range);
        }
      }
      direct = std::move(merged);
      continue;
    }
    for (std::uint32_t c = boxes[b].child; c < boxes[b].child + boxes[b].children; ++c) {
      near_[c].direct.insert(near_[c].direct.end(), near_[b].direct.begin(), near_[b].direct.end());
      near_[c].nodes.insert(near_[c].nodes.end(), near_[b].nodes.begin(), near_[b].nodes.end());
    }
    near_[b] = {};
  }
}

std::vector<double> FastSums::sums(std::span<const double> weights, std::size_t columns, const RunContext& context) const {
  const std::size_t n = points(), m = centres();
  std::vector<double> result(n * columns);
  for (std::size_t first = 0; first < columns; first += most_columns) {
    const std::size_t width = std::min(most_columns, columns - first);
    std::vector<double> sorted(m * width);
    for (std::size_t j = 0; j < m; ++j) {
      for (std::size_t c = 0; c < width; ++c) sorted[j * width + c] = weights[sources_.order()[j] * columns + first + c];
    }
    Workspace work{sorted, width, {}, {}, std::vector<double>(n * width), context};
    if (collects_) {
      work.up.resize(sources_.boxes().size() * grid_.nodes() * width);
      upward(work);
    }
    if (expands_) {
      work.down.resize(targets_.boxes().size() * grid_.nodes() * width);
      translate(work);
      downward(work);
    }
    evaluate(work);
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t c = 0; c < width; ++c) result[targets_.order()[i] * columns + first + c] = work.result[i * width + c];
    }
  }
  return result;
}

void FastSums::upward(Workspace& work) const {
  const std::size_t size = grid_.nodes() * work.columns;
  for (std::size_t level = sources_.levels(); level-- > 0;) {
    const std::size_t begin = sources_.level_begin(level);
    parallel_for(work.context, sources_.level_begin(level + 1) - begin, 4, [&](std::size_t low, std::size_t high) {
      std::vector<double> values(grid_.nodes() * tile_size), columns(work.columns * tile_size);
      for (std::size_t b = begin + low; b < begin + high; ++b) {
        const Octree::Box& box = sources_.boxes()[b];
        double* to = work.up.data() + b * size;
        for (std::uint32_t c = box.child; c < box.child + box.children; ++c) {
          const auto& cell = sources_.boxes()[c].cell;
          const unsigned octant = static_cast<unsigned>((cell[0] & 1) << 2 | (cell[1] & 1) << 1 | (cell[2] & 1));
          grid_.to_parent(octant, work.up.data() + c * size, work.columns, to);
        }
        if (!box.leaf()) continue;
        const TiledPoints tiled(std::span(sources_.points()).subspan(box.begin, box.count()));
        for (std::size_t t = 0; t < tiled.tiles(); ++t) {
          grid_.tile_values(tiled.tile(t), sources_.centre(box), sources_.half(level), values.data());
          std::fill(columns.begin(), columns.end(), 0.0);
          for (std::size_t i = t * tile_size; i < std::min(box.count(), (t + 1) * tile_size); ++i) {
            for (std::size_t k = 0; k < work.columns; ++k) {
              columns[k * tile_size + i % tile_size] = work.weights[(box.begin + i) * work.columns + k];
            }
          }
          tile_product_transposed(values.data(), grid_.nodes(), columns.data(), work.columns, to, work.columns);
        }
      }
    });
  }
}

void FastSums::translate(Workspace& work) const {
  const std::size_t nodes = grid_.nodes();
  const std::size_t tiles = tile_count(nodes);
  std::vector<double> matrix(tiles * nodes * tile_size);
  for (const Class& c : classes_) {
    // For one class at a time, and not kept: it costs no more than a few translations.
    const double half = targets_.half(c.level);
    const TiledPoints to(grid_.nodes({}, half));
    const std::vector<Vec3> from = grid_.nodes({2 * half * c.offset[0], 2 * half * c.offset[1], 2 * half * c.offset[2]}, half);
    parallel_for(work.context, tiles, 4, [&](std::size_t begin, std::size_t end) {
      for (std::size_t t = begin; t < end; ++t) tile_kernel(kernel_, to.tile(t), from, matrix.data() + t * nodes * tile_size);
    });
    parallel_for(work.context, c.groups.size() - 1, 1, [&](std::size_t begin, std::size_t end) {
      for (std::size_t g = begin; g < end; ++g) translate_group(c, c.groups[g], c.groups[g + 1], matrix.data(), work);
    });
  }
}

void FastSums::translate_group(const Class& group, std::size_t first, std::size_t last, const double* matrix,
                               Workspace& work) const {
  const std::size_t nodes = grid_.nodes();
  const std::size_t width = (last - first) * work.columns;
  std::vector<double> from(nodes * width), out(width * tile_size);
  for (std::size_t i = first; i < last; ++i) {
    const Pair& pair = group.pairs[i];
    const double* up = work.up.data() + pair.source * nodes * work.columns;
    const auto& image = grid_.symmetry(pair.symmetry);
    for (std::size_t a = 0; a < nodes; ++a) {
      double* to = from.data() + image[a] * width + (i - first) * work.columns;
      for (std::size_t k = 0; k < work.columns; ++k) to[k] = up[a * work.columns + k];
    }
  }
  // Tile by tile of the target's nodes in the orientation of the class.
  std::vector<double> turned(nodes * width);
  for (std::size_t t = 0; t < tile_count(nodes); ++t) {
    std::fill(out.begin(), out.end(), 0.0);
    tile_product(matrix + t * nodes * tile_size, nodes, from.data(), width, width, out.data());
    for (std::size_t a = t * tile_size; a < std::min(nodes, (t + 1) * tile_size); ++a) {
      for (std::size_t k = 0; k < width; ++k) turned[a * width + k] = out[k * tile_size + a % tile_size];
    }
  }
  for (std::size_t i = first; i < last; ++i) {
    const Pair& pair = group.pairs[i];
    double* down = work.down.data() + pair.target * nodes * work.columns;
    const auto& image = grid_.symmetry(pair.symmetry);
    for (std::size_t a = 0; a < nodes; ++a) {
      const double* value = turned.data() + image[a] * width + (i - first) * work.columns;
      for (std::size_t k = 0; k < work.columns; ++k) down[a * work.columns + k] += value[k];
    }
  }
}

void FastSums::downward(Workspace& work) const {
  const std::size_t size = grid_.nodes() * work.columns;
  for (std::size_t level = 0; level < targets_.levels(); ++level) {
    const std::size_t begin = targets_.level_begin(level);
    parallel_for(work.context, targets_.level_begin(level + 1) - begin, 4, [&](std::size_t low, std::size_t high) {
      std::vector<double> out(work.columns * tile_size);
      for (std::size_t b = begin + low; b < begin + high; ++b) {
        if (!expanded_[b]) continue;
        const Octree::Box& box = targets_.boxes()[b];
        double* down = work.down.data() + b * size;
        if (!incoming_[b].empty()) {
          const TiledPoints nodes(grid_.nodes(targets_.centre(box), targets_.half(level)));
          for (std::size_t t = 0; t < nodes.tiles(); ++t) {
            std::fill(out.begin(), out.end(), 0.0);
            for (const Range& range : incoming_[b]) {
              tile_kernel_sums(kernel_, nodes.tile(t), std::span(sources_.points()).subspan(range.begin, range.end - range.begin),
                               work.weights.data() + range.begin * work.columns, work.columns, work.columns, out.data());
            }
            for (std::size_t a = t * tile_size; a < std::min(grid_.nodes(), (t + 1) * tile_size); ++a) {
              for (std::size_t k = 0; k < work.columns; ++k) down[a * work.columns + k] += out[k * tile_size + a % tile_size];
            }
          }
        }
        for (std::uint32_t c = box.child; c < box.child + box.children; ++c) {
          const auto& cell = targets_.boxes()[c].cell;
          const unsigned octant = static_cast<unsigned>((cell[0] & 1) << 2 | (cell[1] & 1) << 1 | (cell[2] & 1));
          grid_.to_child(octant, down, work.columns, work.down.data() + c * size);
        }
      }
    });
  }
}

void FastSums::evaluate(Workspace& work) const {
  parallel_for(work.context, leaves_.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) evaluate_leaf(leaves_[i], work);
  });
}

void FastSums::evaluate_leaf(std::uint32_t b, Workspace& work) const {
  const Octree::Box& box = targets_.boxes()[b];
  const std::size_t nodes = grid_.nodes(), columns = work.columns;
  const TiledPoints tiled(std::span(targets_.points()).subspan(box.begin, box.count()));
  std::vector<double> values(expanded_[b] ? nodes * tile_size : 0), out(columns * tile_size);
  for (std::size_t t = 0; t < tiled.tiles(); ++t) {
    std::fill(out.begin(), out.end(), 0.0);
    for (const Range& range : near_[b].direct) {
      tile_kernel_sums(kernel_, tiled.tile(t), std::span(sources_.points()).subspan(range.begin, range.end - range.begin),
                       work.weights.data() + range.begin * columns, columns, columns, out.data());
    }
    for (const std::uint32_t source : near_[b].nodes) {
      const Octree::Box& from = sources_.boxes()[source];
      const std::vector<Vec3> places = grid_.nodes(sources_.centre(from), sources_.half(from.level));
      tile_kernel_sums(kernel_, tiled.tile(t), places, work.up.data() + source * nodes * columns, columns, columns, out.data());
    }
    if (expanded_[b]) {
      grid_.tile_values(tiled.tile(t), targets_.centre(box), targets_.half(box.level), values.data());
      tile_product(values.data(), nodes, work.down.data() + b * nodes * columns, columns, columns, out.data());
    }
    for (std::size_t i = t * tile_size; i < std::min(box.count(), (t + 1) * tile_size); ++i) {
      for (std::size_t k = 0; k < columns; ++k) work.result[(box.begin + i) * columns + k] = out[k * tile_size + i % tile_size];
    }
  }
}

std::size_t FastSums::bytes() const {
  std::size_t bytes = sources_.bytes() + targets_.bytes() + 48 * grid_.nodes() * sizeof(std::uint16_t);
  for (const Class& c : classes_) bytes += c.pairs.size() * sizeof(Pair) + c.groups.size() * sizeof(std::size_t);
  for (const Near& near : near_) bytes += sizeof(Near) + near.direct.size() * sizeof(Range) + near.nodes.size() * 4;
  for (const auto& incoming : incoming_) bytes += sizeof(incoming) + incoming.size() * sizeof(Range);
  bytes += expanded_.size() / 8;
  return bytes;
}

std::size_t FastSums::bytes_for(std::size_t n, std::size_t m, int order) {
  const std::size_t leaf = automatic_leaf(order);
  // Leaves of a surface are on average a third full, and all the boxes above them are a third of their number.
  const std::size_t boxes = 4 * ((n + m) / leaf + 2);
  const auto p = static_cast<std::size_t>(order);
  return (n + m) * (sizeof(Vec3) + 4) + boxes * (sizeof(Octree::Box) + 64 * sizeof(Pair) + 64 * sizeof(Range)) +
         boxes * p * p * p * most_columns * sizeof(double);
}

}  // namespace deform
