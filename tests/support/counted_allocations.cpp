// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/support/counted_allocations.h"

#include <malloc.h>

#include <atomic>
#include <cerrno>

namespace {

std::atomic<std::size_t> allocated{0}, most_allocated{0};

void* counted(void* block) {
  if (block == nullptr) return nullptr;
  const std::size_t now = allocated += malloc_usable_size(block);
  for (std::size_t most = most_allocated; now > most && !most_allocated.compare_exchange_weak(most, now);) {
  }
  return block;
}

void* forgotten(void* block) {
  if (block != nullptr) allocated -= malloc_usable_size(block);
  return block;
}

}  // namespace

extern "C" {
void* __libc_malloc(std::size_t size);                           // NOLINT: names of the C library
void* __libc_calloc(std::size_t count, std::size_t size);        // NOLINT
void* __libc_realloc(void* block, std::size_t size);             // NOLINT
void* __libc_memalign(std::size_t alignment, std::size_t size);  // NOLINT
void __libc_free(void* block);                                   // NOLINT

void* malloc(std::size_t size) { return counted(__libc_malloc(size)); }
void* calloc(std::size_t count, std::size_t size) { return counted(__libc_calloc(count, size)); }
void* realloc(void* block, std::size_t size) { return counted(__libc_realloc(forgotten(block), size)); }
void* memalign(std::size_t alignment, std::size_t size) { return counted(__libc_memalign(alignment, size)); }
void* aligned_alloc(std::size_t alignment, std::size_t size) { return counted(__libc_memalign(alignment, size)); }
int posix_memalign(void** block, std::size_t alignment, std::size_t size) {
  *block = counted(__libc_memalign(alignment, size));
  return *block == nullptr ? ENOMEM : 0;
}
void free(void* block) { __libc_free(forgotten(block)); }
}

namespace deform::test {

CountedAllocations::CountedAllocations() : begin_(allocated) { most_allocated = begin_; }
std::size_t CountedAllocations::kept() const { return allocated - begin_; }
std::size_t CountedAllocations::most() const { return most_allocated - begin_; }

}  // namespace deform::test
