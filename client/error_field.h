// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace deform::client {

/// The field of a request or setup that a message names before its first ": " ("designs[3].variables[0]"), also behind the line
/// of a file ("car.yaml:3: handles[0].name: ..."), else empty.
std::string field_of(const std::string& message);

}  // namespace deform::client
