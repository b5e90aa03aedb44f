#include "proto/convert/fields.h"

#include <cmath>

#include "core/base/error.h"

namespace deform::server {

void refuse_field(const std::string& path, const std::string& problem) {
  throw Error(ErrorCode::invalid_argument, path + ": " + problem);
}

Vec3 vec3(const google::protobuf::RepeatedField<double>& numbers, const std::string& path) {
  if (numbers.size() != 3) refuse_field(path, "expected 3 numbers, got " + std::to_string(numbers.size()));
  Vec3 result;
  for (int k = 0; k < 3; ++k) result[k] = finite(numbers[k], path + "[" + std::to_string(k) + "]");
  return result;
}

double finite(double number, const std::string& path) {
  if (!std::isfinite(number)) refuse_field(path, "must be a finite number");
  return number;
}

}  // namespace deform::server
