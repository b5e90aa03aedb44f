// SPDX-License-Identifier: Apache-2.0
#include "proto/convert/base/fields.h"

#include <cmath>
#include <limits>

#include "core/base/error.h"

namespace deform::convert {

void refuse_field(const std::string& path, const std::string& problem) {
  throw Error(ErrorCode::invalid_argument, path + ": " + problem);
}

void refuse_unknown(const std::string& path, int value) { refuse_field(path, "unknown value " + std::to_string(value)); }

int fitting_int(std::uint64_t number, const std::string& path) {
  constexpr int most = std::numeric_limits<int>::max();
  if (number > static_cast<std::uint64_t>(most)) {
    refuse_field(path, std::to_string(number) + " is out of range, more than " + std::to_string(most));
  }
  return static_cast<int>(number);
}

Vec3 vec3(const google::protobuf::RepeatedField<double>& numbers, const std::string& path) {
  if (numbers.size() != 3) refuse_field(path, "expected 3 numbers, got " + std::to_string(numbers.size()));
  check_finite(numbers, path);
  return {numbers[0], numbers[1], numbers[2]};
}

double finite(double number, const std::string& path) {
  if (!std::isfinite(number)) refuse_field(path, "must be a finite number");
  return number;
}

void check_finite(const google::protobuf::RepeatedField<double>& numbers, const std::string& path, const char* field) {
  for (int k = 0; k < numbers.size(); ++k) {
    if (!std::isfinite(numbers[k])) refuse_field(path + field + "[" + std::to_string(k) + "]", "must be a finite number");
  }
}

}  // namespace deform::convert
