// SPDX-License-Identifier: GPL-3.0-or-later
// Loaded before a program (LD_PRELOAD), makes its disk fail now and then: writing, syncing, renaming and linking. When and how is
// written by a test into a small file that both map: HISTORY_FAULTS names it.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <ctime>

namespace {

enum Mode : std::uint32_t { off = 0, errors = 1, full = 2, slow = 3 };

/// What the test writes, and how often something failed.
struct Faults {
  std::atomic<std::uint32_t> mode, per_mille, milliseconds, count;
};

Faults* faults() {
  static Faults* const mapped = []() -> Faults* {
    const char* name = std::getenv("HISTORY_FAULTS");
    if (name == nullptr) return nullptr;
    const int file = ::open(name, O_RDWR | O_CLOEXEC);
    if (file < 0) return nullptr;
    void* memory = ::mmap(nullptr, sizeof(Faults), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    ::close(file);
    return memory == MAP_FAILED ? nullptr : static_cast<Faults*>(memory);
  }();
  return mapped;
}

template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

bool chance(std::uint32_t per_mille) {
  static thread_local std::uint64_t state =
      static_cast<std::uint64_t>(::time(nullptr)) ^ reinterpret_cast<std::uintptr_t>(&state);
  state = state * 6364136223846793005u + 1442695040888963407u;
  return (state >> 33) % 1000 < per_mille;
}

enum class Kind { grows, syncs, names };

/// Whether a call is to fail, with errno set.
bool fails(Kind kind) {
  Faults* const told = faults();
  if (told == nullptr) return false;
  const std::uint32_t mode = told->mode;
  if (mode == off || !chance(told->per_mille)) return false;
  if (mode == full && kind == Kind::syncs) return false;
  ++told->count;
  if (mode == slow) {
    if (kind == Kind::syncs) ::usleep(1000 * told->milliseconds);
    return false;
  }
  errno = mode == full ? ENOSPC : EIO;
  return true;
}

bool is_on_disk(int descriptor) {
  struct stat status {};
  return descriptor > STDERR_FILENO && ::fstat(descriptor, &status) == 0 && (S_ISREG(status.st_mode) || S_ISDIR(status.st_mode));
}

/// What is removed makes room.
bool removing_fails() {
  Faults* const told = faults();
  if (told == nullptr) return false;
  if (told->mode == full) told->mode = off;
  return told->mode == errors && fails(Kind::names);
}

}  // namespace

extern "C" {

ssize_t write(int descriptor, const void* data, std::size_t size) {
  static auto* const real = next<ssize_t(int, const void*, std::size_t)>("write");
  return is_on_disk(descriptor) && fails(Kind::grows) ? -1 : real(descriptor, data, size);
}

ssize_t pwrite(int descriptor, const void* data, std::size_t size, off_t offset) {
  static auto* const real = next<ssize_t(int, const void*, std::size_t, off_t)>("pwrite");
  return is_on_disk(descriptor) && fails(Kind::grows) ? -1 : real(descriptor, data, size, offset);
}

ssize_t pwrite64(int descriptor, const void* data, std::size_t size, off64_t offset) {
  static auto* const real = next<ssize_t(int, const void*, std::size_t, off64_t)>("pwrite64");
  return is_on_disk(descriptor) && fails(Kind::grows) ? -1 : real(descriptor, data, size, offset);
}

int fsync(int descriptor) {
  static auto* const real = next<int(int)>("fsync");
  return is_on_disk(descriptor) && fails(Kind::syncs) ? -1 : real(descriptor);
}

int fdatasync(int descriptor) {
  static auto* const real = next<int(int)>("fdatasync");
  return is_on_disk(descriptor) && fails(Kind::syncs) ? -1 : real(descriptor);
}

int rename(const char* from, const char* to) {
  static auto* const real = next<int(const char*, const char*)>("rename");
  return fails(Kind::names) ? -1 : real(from, to);
}

int link(const char* from, const char* to) {
  static auto* const real = next<int(const char*, const char*)>("link");
  return fails(Kind::names) ? -1 : real(from, to);
}

int unlink(const char* path) {
  static auto* const real = next<int(const char*)>("unlink");
  return removing_fails() ? -1 : real(path);
}

int remove(const char* path) {
  static auto* const real = next<int(const char*)>("remove");
  return removing_fails() ? -1 : real(path);
}

}  // extern "C"
