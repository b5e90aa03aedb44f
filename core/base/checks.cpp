// SPDX-License-Identifier: Apache-2.0
#include "core/base/checks.h"

#include <cmath>

#include "core/base/error.h"

namespace deform {

namespace {

[[noreturn]] void refuse(const std::string& field, const std::string& message) {
  throw Error(ErrorCode::invalid_argument, field + ": " + message);
}

std::string item(const std::string& field, std::size_t index) { return field + "[" + std::to_string(index) + "]"; }

std::string out_of_range(const char* noun, std::size_t id, std::size_t limit) {
  return std::string(noun) + " " + std::to_string(id) + " is out of range, there are " + std::to_string(limit) + " " + noun + "s";
}

}  // namespace

void check_ids(std::span<const std::uint32_t> ids, std::size_t limit, const std::string& field, const char* noun) {
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (ids[i] >= limit) refuse(item(field, i), out_of_range(noun, ids[i], limit));
  }
}

void check_ids(std::span<const std::uint32_t> ids, std::size_t limit, const FieldEntry& entry, const char* noun) {
  for (const std::uint32_t id : ids) {
    if (id >= limit) refuse(item(entry.field, entry.index), out_of_range(noun, id, limit));
  }
}

void check_finite(const Vec3& point, const std::string& field) {
  for (int k = 0; k < 3; ++k) {
    if (!std::isfinite(point[k])) refuse(field, std::string("coordinate ") + "xyz"[k] + " is not a finite number");
  }
}

void check_finite(std::span<const Vec3> points, const std::string& field) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!std::isfinite(points[i][0] + points[i][1] + points[i][2])) check_finite(points[i], item(field, i));
  }
}

void check_range(std::uint64_t value, std::uint64_t low, std::uint64_t high, const std::string& field) {
  if (value >= low && value <= high) return;
  refuse(field, std::to_string(value) + " is out of range, allowed are " + std::to_string(low) + " to " + std::to_string(high));
}

}  // namespace deform
