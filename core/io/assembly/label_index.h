// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "core/base/types.h"

namespace deform::io {

/// Maps the labels of the points of a file, which may be sparse and in any order, to point ids.
class LabelIndex {
 public:
  /// Gives the next point, counted from 0, this label. Returns false if the label is already in use.
  bool add(std::int64_t label);
  /// The point with this label. Uses a table if labels are dense and a hash map otherwise.
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
