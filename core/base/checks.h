// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "core/base/types.h"

namespace deform {

// Checks of input. Each throws Error(invalid_argument) with a message that begins with the field that is wrong.

/// The field and the entry of it that is looked at: "elements[7]".
struct FieldEntry {
  const char* field;  ///< path of the field
  std::size_t index;  ///< of the entry
};

/// "FIELD[I]: NOUN ID is out of range, there are LIMIT NOUNs" unless all ids are below the limit.
void check_ids(std::span<const std::uint32_t> ids, std::size_t limit, const std::string& field, const char* noun);
/// The same of the ids that one entry of a field holds: "FIELD[INDEX]: NOUN ID is out of range, there are LIMIT NOUNs".
void check_ids(std::span<const std::uint32_t> ids, std::size_t limit, const FieldEntry& entry, const char* noun);

/// "FIELD[I]: coordinate y is not a finite number".
void check_finite(std::span<const Vec3> points, const std::string& field);
/// "FIELD: coordinate y is not a finite number".
void check_finite(const Vec3& point, const std::string& field);

/// "FIELD: VALUE is out of range, allowed are LOW to HIGH" unless low <= value <= high.
void check_range(std::uint64_t value, std::uint64_t low, std::uint64_t high, const std::string& field);

}  // namespace deform
