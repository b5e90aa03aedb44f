// SPDX-License-Identifier: Apache-2.0
#include "core/base/error.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace deform {

const char* to_string(ErrorCode code) {
  switch (code) {
    case ErrorCode::invalid_argument:
      return "invalid_argument";
    case ErrorCode::not_found:
      return "not_found";
    case ErrorCode::already_exists:
      return "already_exists";
    case ErrorCode::failed_precondition:
      return "failed_precondition";
    case ErrorCode::unauthenticated:
      return "unauthenticated";
    case ErrorCode::permission_denied:
      return "permission_denied";
    case ErrorCode::out_of_budget:
      return "out_of_budget";
    case ErrorCode::numerical_failure:
      return "numerical_failure";
    case ErrorCode::cancelled:
      return "cancelled";
    case ErrorCode::deadline_exceeded:
      return "deadline_exceeded";
    case ErrorCode::data_loss:
      return "data_loss";
    case ErrorCode::unavailable:
      return "unavailable";
    case ErrorCode::internal:
      return "internal";
  }
  return "internal";
}

const char* to_string(Refusal reason) {
  switch (reason) {
    case Refusal::none:
      return "none";
    case Refusal::queue:
      return "queue";
    case Refusal::memory:
      return "memory";
    case Refusal::held:
      return "held";
    case Refusal::quota:
      return "quota";
    case Refusal::rate:
      return "rate";
    case Refusal::disk:
      return "disk";
    case Refusal::draining:
      return "draining";
  }
  return "none";
}

namespace {

std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t substitution = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, substitution});
    }
  }
  return row[b.size()];
}

}  // namespace

std::string nearest_names(const std::string& name, const std::vector<std::string>& candidates) {
  constexpr std::size_t max_length = 256;  // longer names are not worth a quadratic comparison
  if (name.size() > max_length) return {};
  std::vector<std::pair<std::size_t, std::string>> ranked;
  for (const auto& candidate : candidates) {
    if (candidate.size() > max_length) continue;
    const std::size_t distance = edit_distance(name, candidate);
    const bool contains =
        !name.empty() && (candidate.find(name) != std::string::npos || name.find(candidate) != std::string::npos);
    if (contains || distance <= std::max<std::size_t>(2, name.size() / 2)) ranked.emplace_back(distance, candidate);
  }
  std::sort(ranked.begin(), ranked.end());
  std::string text;
  for (std::size_t i = 0; i < std::min<std::size_t>(3, ranked.size()); ++i) {
    text += (i ? ", \"" : "\"") + ranked[i].second + "\"";
  }
  return text;
}

}  // namespace deform
