// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

namespace deform {

/// Memory for an array, its beginning at a line of the cache. Large ones come in huge pages where the system has such on request
/// (Linux: transparent_hugepage `madvise`): an array that is read from end to end otherwise waits for the address of every page
/// of 4 KiB. Throws std::bad_alloc. Any thread.
void* allocate_array(std::size_t bytes);
/// Gives back what allocate_array() gave for so many bytes. Any thread.
void free_array(void* memory, std::size_t bytes) noexcept;

/// The allocator of LargeArray.
template <typename T>
struct LargeArrayAllocator {
  using value_type = T;  ///< as the standard library asks
  LargeArrayAllocator() = default;
  /// All are alike.
  template <typename U>
  LargeArrayAllocator(const LargeArrayAllocator<U>& /*other*/) {}
  /// Throws std::bad_alloc.
  T* allocate(std::size_t count) {
    static_assert(alignof(T) <= alignof(std::max_align_t));
    return static_cast<T*>(allocate_array(count * sizeof(T)));
  }
  /// What allocate() gave for as many.
  void deallocate(T* memory, std::size_t count) noexcept { free_array(memory, count * sizeof(T)); }
  /// What one has allocated, any other frees.
  friend bool operator==(const LargeArrayAllocator& /*a*/, const LargeArrayAllocator& /*b*/) { return true; }
};

/// A vector for hundreds of MiB that are read from end to end.
template <typename T>
using LargeArray = std::vector<T, LargeArrayAllocator<T>>;

}  // namespace deform
