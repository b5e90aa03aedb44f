// SPDX-License-Identifier: Apache-2.0
#include "core/io/assembly/label_index.h"

#include <algorithm>

#include "core/base/error.h"

namespace deform::io {

namespace {

/// How many entries a table may have for each label in it, and how many it may have anyway.
constexpr std::size_t entries_per_label = 8, free_entries = 4096;

}  // namespace

bool LabelIndex::add(std::int64_t label) {
  if (count_ >= none) throw Error(ErrorCode::invalid_argument, "more than " + std::to_string(none) + " points");
  const auto point = static_cast<PointId>(count_);
  if (in_table_) {
    const auto size = static_cast<std::size_t>(label);  // of a negative one beyond any limit
    if (size >= free_entries && size / entries_per_label > count_) {
      leave_table();
    } else {
      if (size >= table_.size()) table_.resize(std::max(size + 1, std::min(2 * table_.size(), entries_per_label * count_)), none);
      if (table_[size] != none) return false;
      table_[size] = point;
    }
  }
  if (!in_table_ && !map_.emplace(label, point).second) return false;
  ++count_;
  return true;
}

std::optional<PointId> LabelIndex::find(std::int64_t label) const {
  if (in_table_) {
    const auto place = static_cast<std::size_t>(label);
    if (place >= table_.size() || table_[place] == none) return std::nullopt;
    return table_[place];
  }
  const auto found = map_.find(label);
  return found == map_.end() ? std::nullopt : std::optional(found->second);
}

void LabelIndex::leave_table() {
  for (std::size_t label = 0; label < table_.size(); ++label) {
    if (table_[label] != none) map_.emplace(static_cast<std::int64_t>(label), table_[label]);
  }
  table_ = {};
  in_table_ = false;
}

}  // namespace deform::io
