// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/error.h"

namespace deform {

/// One reason for rejecting an input.
struct Problem {
  std::string field;    ///< the entry that is wrong, with its index: "constraints[3].regions[0]"
  std::string message;  ///< message of the Error
};

/// Runs checks of an input, and either throws the first problem or collects all of them. Not thread-safe.
///
///   Problems problems(Problems::Mode::collect);
///   for (...) problems.check("handles[" + std::to_string(i) + "]", [&] { check_handle(i); });
class Problems {
 public:
  /// What happens to a problem.
  enum class Mode {
    throw_first,  ///< check() rethrows it
    collect,      ///< check() appends it to the list
  };
  explicit Problems(Mode mode) : mode_(mode) {}  ///< starts with an empty list

  /// Runs a check, which throws Error(invalid_argument) or Error(not_found) if it fails, and returns whether it passed. Other
  /// errors are never collected.
  template <typename Check>
  bool check(const std::string& field, const Check& check) {
    if (mode_ == Mode::throw_first) {
      check();
      return true;
    }
    try {
      check();
      return true;
    } catch (const Error& error) {
      if (error.code() != ErrorCode::invalid_argument && error.code() != ErrorCode::not_found) throw;
      list_.push_back({field, error.what()});
      return false;
    }
  }

  bool collects() const { return mode_ == Mode::collect; }    ///< whether checking goes on after a problem
  bool empty() const { return list_.empty(); }                ///< whether no problem was found
  const std::vector<Problem>& list() const { return list_; }  ///< in the order of the checks
  /// Whether a problem concerns the field as a whole.
  bool contain(std::string_view field) const {
    return std::any_of(list_.begin(), list_.end(), [&](const Problem& p) { return p.field == field; });
  }
  /// Whether a problem concerns the field or a part of it ("handles[0].region" is a part of "handles[0]").
  bool concern(std::string_view field) const {
    return std::any_of(list_.begin(), list_.end(), [&](const Problem& p) {
      return p.field.starts_with(field) &&
             (p.field.size() == field.size() || p.field[field.size()] == '.' || p.field[field.size()] == '[');
    });
  }

 private:
  Mode mode_;
  std::vector<Problem> list_;
};

}  // namespace deform
