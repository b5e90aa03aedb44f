// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "core/base/types.h"

namespace deform {

// Checks of input. Each throws Error(invalid_argument) with a message that begins with the name of the invalid field.

/// Names one entry of a field in an error message: "elements[7]".
struct FieldEntry {
  const char* field;  ///< path of the field
  std::size_t index;  ///< index of the entry
};

/// Checks that all ids are below `limit`. The message is "FIELD[I]: NOUN ID is out of range, there are LIMIT NOUNs".
void check_ids(std::span<const std::uint32_t> ids, std::size_t limit, const std::string& field, const char* noun);
/// Checks the ids of one entry of a field. The message is "FIELD[INDEX]: NOUN ID is out of range, there are LIMIT NOUNs".
void check_ids(std::span<const std::uint32_t> ids, std::size_t limit, const FieldEntry& entry, const char* noun);

/// Checks that all coordinates are finite. The message is "FIELD[I]: coordinate y is not a finite number".
void check_finite(std::span<const Vec3> points, const std::string& field);
/// Checks that the coordinates of one point are finite. The message is "FIELD: coordinate y is not a finite number".
void check_finite(const Vec3& point, const std::string& field);

/// Checks that low <= value <= high. The message is "FIELD: VALUE is out of range, allowed are LOW to HIGH".
void check_range(std::uint64_t value, std::uint64_t low, std::uint64_t high, const std::string& field);

}  // namespace deform
