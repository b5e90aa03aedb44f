// SPDX-License-Identifier: GPL-3.0-or-later
// What a message takes in memory is never more than its bytes foretold.
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/stubs/logging.h>

#include <cstdint>
#include <cstdlib>
#include <limits>

#include "deform/v1/service.pb.h"
#include "proto/convert/base/parsed_size.h"

namespace {

template <typename Message>
void foretell(const std::uint8_t* data, int size) {
  google::protobuf::io::ArrayInputStream in(data, size, 7);
  const std::size_t foretold = deform::convert::parsed_size(in, *Message::descriptor(), std::numeric_limits<std::size_t>::max());
  Message message;
  if (message.ParseFromArray(data, size) && message.SpaceUsedLong() > foretold) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  google::protobuf::SetLogHandler(nullptr);  // it tells of each text that is no UTF-8
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const int rest = static_cast<int>(size - 1);
  switch (data[0] % 4) {
    case 0:
      foretell<deform::v1::PrepareRequest>(data + 1, rest);
      break;
    case 1:
      foretell<deform::v1::DeformStreamRequest>(data + 1, rest);
      break;
    case 2:
      foretell<deform::v1::RegisterGeometryRequest>(data + 1, rest);
      break;
    default:
      foretell<deform::v1::Region>(data + 1, rest);
  }
  return 0;
}
