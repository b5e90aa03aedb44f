// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>

#include "core/base/types.h"

namespace deform::server {

/// How the designs of a call are cut: step s covers block s % blocks of the designs of group s / blocks. Blocks of the designs of
/// one step leave one after the other, so designs interleave and each one's blocks ascend. Where somebody looks at whole designs
/// and may change them, another step comes before the blocks of a group: it makes all points of its designs. Where somebody only
/// looks, the blocks of a group are made as usual, but kept until the last of them is there: whoever made that one looks.
struct StepPlan {
  static constexpr std::size_t group_designs = 16;  ///< share one pass over the basis
  static constexpr std::size_t whole_bytes = std::size_t{256} << 20;

  std::size_t points = 0, block_points = 0, designs = 0;
  enum class Looks { no, after_blocks, before_blocks } looks = Looks::no;
  std::size_t most_designs = group_designs;  ///< of a group

  bool whole() const { return looks == Looks::before_blocks; }
  bool gathers() const { return looks == Looks::after_blocks; }
  std::size_t group() const {
    const std::size_t fit = looks == Looks::no ? group_designs : std::max<std::size_t>(1, whole_bytes / (points * sizeof(Vec3)));
    return std::min({designs, most_designs, fit});
  }
  std::size_t blocks() const { return (points + block_points - 1) / block_points; }
  std::size_t groups() const { return designs == 0 ? 0 : (designs + group() - 1) / group(); }
  /// That may be under way at once where they are gathered, so that no worker waits for the end of a group.
  std::size_t open_groups(int workers) const {
    const std::size_t busy = 1 + (static_cast<std::size_t>(workers) + blocks() - 1) / blocks();
    return std::min(groups(), busy);
  }
  std::size_t group_bytes() const { return group() * points * sizeof(Vec3); }
  std::size_t group_steps() const { return blocks() + (whole() ? 1 : 0); }
  std::size_t steps() const { return group_steps() * groups(); }
  bool is_whole(std::size_t step) const { return whole() && step % group_steps() == 0; }
  std::size_t first_step(std::size_t step) const { return step / group_steps() * group_steps(); }  ///< of the group of a step
  std::size_t first_design(std::size_t step) const { return step / group_steps() * group(); }
  std::size_t design_count(std::size_t step) const { return std::min(group(), designs - first_design(step)); }
  std::size_t block(std::size_t step) const { return step % group_steps() - (whole() ? 1 : 0); }
  std::size_t first_point(std::size_t step) const { return block(step) * block_points; }
  std::size_t point_count(std::size_t step) const { return std::min(block_points, points - first_point(step)); }
  std::size_t step_bytes() const { return group() * std::min(block_points, points) * sizeof(Vec3); }

  /// Makes groups smaller where a mesh has so few blocks that workers would have nothing to do, or a reader to read, until all of
  /// a group is done: two steps per worker, or one per design.
  void spread(int workers);
  /// Bytes of replies and running steps at which no further step begins.
  std::size_t high_water(int workers) const;
  /// Upper bound of the bytes of points and replies that a call holds.
  std::size_t buffer_bytes(int workers) const;
};

}  // namespace deform::server
