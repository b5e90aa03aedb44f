#pragma once

#include <google/protobuf/repeated_field.h>

#include <string>

#include "core/base/types.h"

namespace deform::server {

/// Throws Error(invalid_argument) "path: problem".
[[noreturn]] void refuse_field(const std::string& path, const std::string& problem);

/// Exactly three finite numbers.
Vec3 vec3(const google::protobuf::RepeatedField<double>& numbers, const std::string& path);

double finite(double number, const std::string& path);

}  // namespace deform::server
