// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/server/simulated_server.h"

#include <cerrno>

namespace deform::server {

bool SimulatedServer::reaches_point() {
  if (stopped_) return false;
  if (before_point) before_point();
  if (++points_ >= stops_at) stopped_ = true;
  return !stopped_;
}

bool ServerFiles::fails() {
  if (server_.reaches_point()) return false;
  errno = EIO;
  return true;
}

int ServerFiles::open(const Path& path, int flags) { return fails() ? -1 : disk_.open(path, flags); }
ssize_t ServerFiles::write(int descriptor, const void* data, std::size_t size) {
  return fails() ? -1 : disk_.write(descriptor, data, size);
}
ssize_t ServerFiles::read(int descriptor, void* data, std::size_t size) {
  return fails() ? -1 : disk_.read(descriptor, data, size);
}
int ServerFiles::sync(int descriptor) { return fails() ? -1 : disk_.sync(descriptor); }
int ServerFiles::sync_all(int descriptor) { return fails() ? -1 : disk_.sync_all(descriptor); }
int ServerFiles::allocate(int descriptor, std::uint64_t size) { return fails() ? -1 : disk_.allocate(descriptor, size); }
int ServerFiles::truncate(int descriptor, std::uint64_t size) { return fails() ? -1 : disk_.truncate(descriptor, size); }
int ServerFiles::lock(int descriptor) { return fails() ? -1 : disk_.lock(descriptor); }
int ServerFiles::lock_shared(int descriptor) { return fails() ? -1 : disk_.lock_shared(descriptor); }
int ServerFiles::rename(const Path& from, const Path& to) { return fails() ? -1 : disk_.rename(from, to); }
int ServerFiles::link(const Path& file, const Path& name) { return fails() ? -1 : disk_.link(file, name); }
int ServerFiles::remove(const Path& path) { return fails() ? -1 : disk_.remove(path); }
int ServerFiles::make_directory(const Path& path) { return fails() ? -1 : disk_.make_directory(path); }
int ServerFiles::close_to_others(const Path& path) { return fails() ? -1 : disk_.close_to_others(path); }
int ServerFiles::status(const Path& path, Links links, struct stat& status) {
  return fails() ? -1 : disk_.status(path, links, status);
}
int ServerFiles::list(const Path& directory, std::vector<std::string>& names) {
  return fails() ? -1 : disk_.list(directory, names);
}

}  // namespace deform::server
