// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

#include "core/compiled/content.h"

namespace deform::compiled {

/// Where the bytes of a file come from, in order.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  /// The size of the whole file, bytes.
  virtual std::uint64_t size() const = 0;
  /// Fills all of `out`. Throws Error(data_loss) where there are not so many bytes any more.
  virtual void read(std::span<std::byte> out) = 0;
};

/// Reads and checks everything: checksums, counts, order and completeness of the records, finite numbers, handles and ids in
/// range. What is allocated has no more bytes than the file, or 128 times as many for bases in codes. Throws Error(data_loss)
/// naming record, entry and limit for bytes that are no compiled deformation or are damaged, Error(failed_precondition) for a
/// layout of another version.
Content read_content(ByteSource& source);
/// The same of bytes in memory.
Content read_content(std::span<const std::byte> bytes);
/// The same of a file. Throws Error(not_found) where it cannot be opened, too.
Content read_content(const std::filesystem::path& file);

}  // namespace deform::compiled
