// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>

namespace deform::test {

/// Counts what all threads of the process allocate from its beginning, in bytes. One at a time. Programs with it replace the
/// allocator of the C library, so they are not built with sanitizers.
class CountedAllocations {
 public:
  CountedAllocations();
  std::size_t kept() const;  ///< what is allocated now, less what was at the beginning
  std::size_t most() const;  ///< the same at the moment when it was most

 private:
  const std::size_t begin_;
};

}  // namespace deform::test
