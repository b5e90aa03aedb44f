// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/disk_space.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "server/store/file.h"

namespace deform::server {

namespace {

constexpr std::uint64_t least_reserve = std::uint64_t{64} << 10;
constexpr std::uint64_t largest_reserve = std::uint64_t{4} << 20;

}  // namespace

DiskSpace::DiskSpace(const std::filesystem::path& folder, const std::filesystem::path& reserve, DiskOptions options,
                     FileSystem& files)
    : files_(files),
      folder_(folder),
      reserve_(reserve),
      options_(std::move(options)),
      most_(std::min(largest_reserve, options_.keep_free)) {
  struct stat status {};
  if (files_.status(reserve_, FileSystem::Links::follow, status) == 0) held_ = static_cast<std::uint64_t>(status.st_size);
}

std::uint64_t DiskSpace::free() const {
  if (options_.free_bytes) return options_.free_bytes();
  return files_.free_bytes(folder_).value_or(0);
}

std::string DiskSpace::refusal(std::uint64_t bytes) const {
  const std::uint64_t free = this->free();
  if (free >= options_.keep_free && free - options_.keep_free >= bytes) return {};
  std::string text =
      "the disk of the data directory has " + mebibytes(free) + " free, " + mebibytes(options_.keep_free) + " must stay free";
  if (bytes > 0) text += " and this needs " + mebibytes(bytes);
  return text;
}

void DiskSpace::require(std::uint64_t bytes) const {
  const std::string why = refusal(bytes);
  if (!why.empty())
    throw Error(ErrorCode::out_of_budget, "store: " + why + "; delete geometries or make room").refused_for(Refusal::disk);
}

void DiskSpace::lend() {
  const std::lock_guard lock(mutex_);
  ++rooms_;
  if (held_ == 0 || free() >= most_) return;
  if (try_remove(files_, reserve_)) held_ = 0;
}

void DiskSpace::take_back() {
  const std::lock_guard lock(mutex_);
  --rooms_;
  fill();
}

void DiskSpace::hold() {
  const std::lock_guard lock(mutex_);
  fill();
}

void DiskSpace::fill() {
  if (rooms_ > 0 || held_ >= most_ || free() < (held_ > 0 ? options_.keep_free : least_reserve)) return;
  const int descriptor = files_.open(reserve_, O_WRONLY | O_CREAT | O_NOFOLLOW);
  if (descriptor < 0) return;
  for (std::uint64_t size = most_; size >= least_reserve; size /= 2) {
    if (size <= held_) break;
    if (files_.allocate(descriptor, size) == 0) {
      held_ = size;
      break;
    }
    if (files_.truncate(descriptor, held_) != 0) break;  // what the attempt took
  }
  files_.close(descriptor);
  if (held_ == 0) try_remove(files_, reserve_);
}

}  // namespace deform::server
