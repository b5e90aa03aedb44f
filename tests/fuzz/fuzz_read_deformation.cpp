// SPDX-License-Identifier: GPL-3.0-or-later
// Compiled deformations: the parser on any bytes, and with checksums that are right on what stands behind them. What it accepts
// is evaluated.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "core/base/error.h"
#include "core/compiled/checksum.h"
#include "core/compiled/deformation.h"
#include "core/compiled/layout.h"
#include "core/compiled/reader.h"

namespace {

using namespace deform::compiled;

/// The records as they stand, with a true length and true checksums, and the end that belongs to them.
std::vector<std::byte> repaired(std::span<const std::byte> bytes) {
  std::vector<std::byte> result(sizeof(Preamble)), headers;
  const auto append = [](std::vector<std::byte>& to, const void* from, std::size_t size) {
    const auto* first = static_cast<const std::byte*>(from);
    to.insert(to.end(), first, first + size);
  };
  const auto put = [&](RecordHeader header, std::span<const std::byte> payload) {
    header.bytes = payload.size();
    header.checksum = checksum(payload);
    append(result, &header, sizeof header);
    append(result, payload.data(), payload.size());
    result.resize(padded(result.size()));
    return header;
  };
  for (std::size_t at = sizeof(Preamble); at + sizeof(RecordHeader) <= bytes.size();) {
    RecordHeader header;
    std::memcpy(&header, bytes.data() + at, sizeof header);
    at += sizeof header;
    if (header.kind == Kind::end) break;
    const std::size_t size = std::min<std::uint64_t>(header.bytes, bytes.size() - at);
    header = put(header, bytes.subspan(at, size));
    append(headers, &header, sizeof header);
    at += std::min(padded(size), bytes.size() - at);
  }
  const std::uint64_t all = checksum(headers);
  put({}, std::as_bytes(std::span(&all, 1)));
  Preamble preamble;
  preamble.bytes = result.size();
  std::memcpy(result.data(), &preamble, sizeof preamble);
  return result;
}

void try_bytes(std::span<const std::byte> bytes) {
  try {
    const Deformation deformation(read_content(bytes));
    if (deformation.variables() == 0) return;
    const std::vector<double> values(deformation.variables(), 0.01);
    std::vector<double> points(3 * deformation.points()), gradient(values.size());
    deformation.evaluate(values, points);
    deformation.jacobian_vector(values, values, points);
    deformation.report(values);
    deformation.vector_jacobian(values, std::span<const double>(points), gradient);
  } catch (const deform::Error&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::span<const std::byte> bytes(reinterpret_cast<const std::byte*>(data), size);
  try_bytes(bytes);
  try_bytes(repaired(bytes));
  return 0;
}
