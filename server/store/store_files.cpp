// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/store_files.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <system_error>

namespace deform::server {

namespace {

std::filesystem::path without_slash(const std::filesystem::path& folder) {
  const std::filesystem::path normal = folder.lexically_normal();
  return normal.has_filename() ? normal : normal.parent_path();
}

/// What of `path` is below `folder`; "." for the folder itself, nothing for what is elsewhere.
std::optional<std::string> below(const std::filesystem::path& folder, const std::filesystem::path& path) {
  const std::filesystem::path inside = without_slash(path).lexically_relative(folder);
  if (inside.empty() || *inside.begin() == "..") return std::nullopt;
  return inside.string();
}

/// By which a backup names it.
std::filesystem::path where_links_lead(const std::filesystem::path& folder) {
  std::error_code failed;
  const std::filesystem::path real = std::filesystem::weakly_canonical(folder, failed);
  return failed ? folder : without_slash(real);
}

}  // namespace

StoreFiles::StoreFiles(FileSystem& files, const Path& folder, Naming naming)
    : files_(files), folder_(without_slash(folder)), real_folder_(where_links_lead(folder_)), naming_(naming) {}

void SyncTimes::add(double time) {
  ++counts[static_cast<std::size_t>(std::lower_bound(bounds.begin(), bounds.end(), time) - bounds.begin())];
  seconds += time;
}

SyncTimes StoreFiles::sync_times() const {
  const std::lock_guard lock(times_mutex_);
  return times_;
}

int StoreFiles::timed(const std::function<int()>& sync) {
  const auto start = std::chrono::steady_clock::now();
  const int result = sync();
  const int error = errno;
  const double time = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  {
    const std::lock_guard lock(times_mutex_);
    times_.add(time);
  }
  errno = error;
  return result;
}

std::string StoreFiles::shown(const Path& path) const {
  if (naming_ == Naming::in_full) return files_.shown(path);
  auto inside = below(folder_, path);
  if (!inside) inside = below(real_folder_, path);
  if (!inside) return files_.shown(path);
  return *inside == "." ? "the data directory" : *inside;
}

}  // namespace deform::server
