// SPDX-License-Identifier: Apache-2.0
#include "core/base/large_array.h"

#ifdef __linux__
#include <sys/mman.h>
#endif

#include <cstdint>
#include <new>

namespace deform {

namespace {

constexpr std::size_t line = 64, huge_page = std::size_t{2} << 20;
constexpr std::size_t least_large = 4 * huge_page;

std::align_val_t alignment(std::size_t bytes) { return std::align_val_t{bytes >= least_large ? huge_page : line}; }

}  // namespace

void* allocate_array(std::size_t bytes) {
  void* const memory = ::operator new(bytes, alignment(bytes));
#ifdef MADV_HUGEPAGE
  // Whole pages only, so that no more memory is taken than asked for. A system without huge pages refuses, which does no harm.
  if (bytes >= least_large) (void)madvise(memory, bytes / huge_page * huge_page, MADV_HUGEPAGE);
#endif
  return memory;
}

void free_array(void* memory, std::size_t bytes) noexcept { ::operator delete(memory, alignment(bytes)); }

}  // namespace deform
