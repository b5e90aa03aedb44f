// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <google/protobuf/io/zero_copy_stream.h>

#include <cstddef>

namespace google::protobuf {
class Descriptor;
}

namespace deform::convert {

/// Bytes that a message of this type takes once it is parsed, counted from its bytes: two of them may become a hundred. Counts
/// what protobuf's C++ library allocates, and rather too much; stops beyond `enough`. Bytes that are no such message give any
/// number. Thread-safe.
std::size_t parsed_size(google::protobuf::io::ZeroCopyInputStream& bytes, const google::protobuf::Descriptor& type,
                        std::size_t enough);

}  // namespace deform::convert
