// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "core/base/types.h"

namespace deform::io {

/// Points of a file by the numbers that it calls them by, which may be sparse and in any order.
class LabelIndex {
 public:
  /// The next point, from 0, is called `label`. False when a point is called so already.
  bool add(std::int64_t label);
  /// The point of that name. A table where labels are dense, a hash otherwise.
  std::optional<PointId> find(std::int64_t label) const;
  std::size_t size() const { return count_; }

 private:
  void leave_table();

  static constexpr PointId none = ~PointId{0};
  std::size_t count_ = 0;
  bool in_table_ = true;
  std::vector<PointId> table_;  // by label
  std::unordered_map<std::int64_t, PointId> map_;
};

}  // namespace deform::io
