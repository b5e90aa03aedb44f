// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace deform {

/// A sparse vector that is being summed: the places where it has an entry, and their values. Clearing it takes time proportional
/// to the number of these. One thread.
class SparseSum {
 public:
  explicit SparseSum(std::int64_t size) : value_(static_cast<std::size_t>(size)), has_(static_cast<std::size_t>(size), false) {}

  void add(std::int64_t place, double value) {
    const auto i = static_cast<std::size_t>(place);
    if (!has_[i]) {
      has_[i] = true;
      places_.push_back(place);
      value_[i] = value;
    } else {
      value_[i] += value;
    }
  }

  std::size_t count() const { return places_.size(); }
  double value(std::int64_t place) const { return value_[static_cast<std::size_t>(place)]; }

  /// Ascending.
  const std::vector<std::int64_t>& places() {
    std::sort(places_.begin(), places_.end());
    return places_;
  }

  void clear() {
    for (const std::int64_t place : places_) has_[static_cast<std::size_t>(place)] = false;
    places_.clear();
  }

 private:
  std::vector<double> value_;
  std::vector<bool> has_;
  std::vector<std::int64_t> places_;
};

}  // namespace deform
