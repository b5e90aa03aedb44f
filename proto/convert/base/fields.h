// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <google/protobuf/generated_enum_reflection.h>
#include <google/protobuf/repeated_field.h>

#include <cstdint>
#include <string>

#include "core/base/types.h"

namespace deform::convert {

/// Throws Error(invalid_argument) "path: problem".
[[noreturn]] void refuse_field(const std::string& path, const std::string& problem);
/// Throws "path: unknown value 17".
[[noreturn]] void refuse_unknown(const std::string& path, int value);

/// Returns the value; throws if it is not an enumerator.
template <typename Enum>
Enum known(Enum value, const std::string& path) {
  if (google::protobuf::GetEnumDescriptor<Enum>()->FindValueByNumber(value) == nullptr) refuse_unknown(path, value);
  return value;
}

int fitting_int(std::uint64_t number, const std::string& path);

/// Exactly three finite numbers.
Vec3 vec3(const google::protobuf::RepeatedField<double>& numbers, const std::string& path);

double finite(double number, const std::string& path);
/// Checks that all numbers are finite; an error names path + field + "[index]".
void check_finite(const google::protobuf::RepeatedField<double>& numbers, const std::string& path, const char* field = "");

}  // namespace deform::convert
