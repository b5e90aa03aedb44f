// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/basis_files.h"

#include <fcntl.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <optional>
#include <random>
#include <string_view>
#include <tuple>

#include "core/base/error.h"

namespace deform::server {

namespace {

constexpr std::string_view basis_suffix = ".basis", part_mark = ".basis.part.";
constexpr std::size_t digest_size = 64;
constexpr std::size_t piece_bytes = std::size_t{1} << 20;
constexpr std::int64_t abandoned_ns = std::int64_t{24} * 3600 * 1'000'000'000;  // of a file that no process finishes any more

[[noreturn]] void refuse_basis(const std::string& key) {
  throw Error(ErrorCode::data_loss, "store: the stored basis of system " + key + " is damaged");
}

std::filesystem::path path_in(const StoreDirectory& directory, const OwnedId& system) {
  return directory.bases() / (key_of(system) + std::string(basis_suffix));
}

std::string random_name() {
  std::random_device device;
  char text[17];
  std::snprintf(text, sizeof text, "%08x%08x", device(), device());
  return text;
}

std::int64_t nanoseconds(const timespec& time) { return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec; }

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// Joins small pieces, hashes and writes them.
class BasisFileWriter {
 public:
  BasisFileWriter(const File& file, const std::string& key, const RunContext& context) : file_(file), context_(context) {
    hash_.add(key.data(), key.size());
  }
  void add(const void* data, std::size_t size) {
    written_ += size;
    const auto* from = static_cast<const char*>(data);
    while (size > 0) {
      const std::size_t now = std::min(size, piece_bytes - piece_.size());
      piece_.insert(piece_.end(), from, from + now);
      from += now;
      size -= now;
      if (piece_.size() == piece_bytes) flush();
    }
  }
  std::uint64_t written() const { return written_; }
  void finish() {
    flush();
    const std::string digest = hash_.hex();
    file_.write(digest.data(), digest.size());
    file_.sync();
  }

 private:
  void flush() {
    context_.check();
    hash_.add(piece_.data(), piece_.size());
    file_.write(piece_.data(), piece_.size());
    piece_.clear();
  }

  const File& file_;
  const RunContext& context_;
  codec::Sha256 hash_;
  std::vector<char> piece_;
  std::uint64_t written_ = 0;
};

}  // namespace

// ---- reading ----

BasisFileReader::BasisFileReader(FileSystem& files, const std::filesystem::path& path, const std::string& key)
    : file_(files, path, O_RDONLY | O_NOFOLLOW) {
  const std::uint64_t all = file_size(files, path);
  if (all < digest_size) refuse_basis(key);
  size_ = left_ = all - digest_size;
  hash_.add(key.data(), key.size());
}

void BasisFileReader::read(void* data, std::size_t size) {
  if (size > left_ || file_.read(data, size) != size) {
    throw Error(ErrorCode::data_loss, "store: a stored basis ends too early");
  }
  left_ -= size;
  hash_.add(data, size);
}

void BasisFileReader::verify() {
  std::vector<char> piece(std::min<std::uint64_t>(left_, piece_bytes));
  while (left_ > 0) read(piece.data(), std::min<std::uint64_t>(left_, piece.size()));
  std::array<char, digest_size + 1> digest{};
  if (file_.read(digest.data(), digest.size()) != digest_size || hash_.hex() != std::string_view(digest.data(), digest_size)) {
    throw Error(ErrorCode::data_loss, "store: a stored basis does not have its checksum");
  }
}

// ---- the folder ----

BasisFiles::BasisFiles(const StoreDirectory& directory, const DiskSpace& disk, std::uint64_t most)
    : directory_(directory), disk_(disk), most_(most), files_(directory.files()), writer_(random_name()) {}

std::filesystem::path BasisFiles::path_of(const OwnedId& system) const { return path_in(directory_, system); }

std::filesystem::path BasisFiles::part_of(const OwnedId& system) {
  return directory_.bases() / (key_of(system) + std::string(part_mark) + writer_ + "." + std::to_string(++parts_));
}

bool BasisFiles::contains(const OwnedId& system) const { return is_seen(files_, path_of(system)); }

std::unique_ptr<BasisFileReader> BasisFiles::open(const OwnedId& system) const {
  if (!contains(system)) return nullptr;
  return std::make_unique<BasisFileReader>(files_, path_of(system), key_of(system));
}

std::vector<BasisFiles::Entry> BasisFiles::entries() const {
  std::vector<std::string> names;
  std::vector<Entry> result;
  if (files_.list(directory_.bases(), names) != 0) return result;
  for (const std::string& name : names) {
    if (!name.ends_with(basis_suffix)) continue;
    auto system = owned_id(name.substr(0, name.size() - basis_suffix.size()));
    struct stat status {};
    const std::filesystem::path path = directory_.bases() / name;
    if (!system || files_.status(path, FileSystem::Links::stay, status) != 0 || !S_ISREG(status.st_mode)) continue;
    result.push_back({*std::move(system), path, static_cast<std::uint64_t>(status.st_size), nanoseconds(status.st_mtim)});
  }
  std::sort(result.begin(), result.end(),
            [](const Entry& a, const Entry& b) { return std::tie(a.modified_ns, a.path) < std::tie(b.modified_ns, b.path); });
  return result;
}

void BasisFiles::sweep(Alone alone) {
  std::vector<std::string> names;
  if (files_.list(directory_.bases(), names) != 0) return;
  for (const std::string& name : names) {
    const std::size_t mark = name.rfind(part_mark);
    if (mark == std::string::npos || name.ends_with(basis_suffix) || !owned_id(name.substr(0, mark))) continue;
    const std::filesystem::path path = directory_.bases() / name;
    struct stat status {};
    if (files_.status(path, FileSystem::Links::stay, status) != 0) continue;
    if (alone == Alone::yes || now_ns() - nanoseconds(status.st_mtim) > abandoned_ns) try_remove(files_, path);
  }
}

void BasisFiles::put(const OwnedId& system, std::uint64_t bytes, const std::function<void(const Sink&)>& write,
                     const RunContext& context) {
  if (contains(system)) return;
  const std::uint64_t size = bytes + digest_size;
  if (size > most_) throw Error(ErrorCode::out_of_budget, "store: it is larger than all bases may be together");
  disk_.require(size);
  // A folder that is not there is not made: another one may be mounted later.
  if (!directory_.is_reachable()) throw Error(ErrorCode::unavailable, "store: the folder cannot be reached");
  make_directories(files_, directory_.bases());
  evict_down_to(most_ - size);
  const std::filesystem::path part = part_of(system);
  try {
    const File file(files_, part, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW);
    BasisFileWriter writer(file, key_of(system), context);
    write([&](const void* data, std::size_t count) { writer.add(data, count); });
    if (writer.written() != bytes) throw Error(ErrorCode::internal, "store: a basis has another size than was announced");
    writer.finish();
    move_file(files_, part, path_of(system));
    sync_directory(files_, directory_.bases());
  } catch (...) {
    try_remove(files_, part);
    throw;
  }
}

void BasisFiles::remove(const StoreDirectory& directory, const OwnedId& system) {
  try_remove(directory.files(), path_in(directory, system));
}

void BasisFiles::set_aside(const OwnedId& system) const {
  const std::lock_guard lock(aside_mutex_);
  try {
    if (!contains(system)) return;
    const auto kept = directory_.set_aside(path_of(system), directory_.damaged());
    spdlog::error("store: the basis of system {} is damaged and was set aside as {}", key_of(system), kept.string());
  } catch (const Error& error) {
    spdlog::error("store: the basis of system {} is damaged: {}", key_of(system), error.what());
  }
}

void BasisFiles::evict_down_to(std::uint64_t bytes) const {
  const std::vector<Entry> all = entries();
  std::uint64_t sum = 0;
  for (const Entry& entry : all) sum += entry.bytes;
  for (const Entry& entry : all) {
    if (sum <= bytes) return;
    if (try_remove(files_, entry.path)) spdlog::info("store: the basis of system {} gave way to others", key_of(entry.system));
    sum -= entry.bytes;
  }
}

void BasisFiles::make_room(std::uint64_t bytes) const {
  if (disk_.refusal(bytes).empty()) return;
  const std::vector<Entry> all = entries();
  std::uint64_t sum = disk_.free();
  for (const Entry& entry : all) sum += entry.bytes;
  if (sum < disk_.keep_free() || sum - disk_.keep_free() < bytes) return;  // all of them would not be enough
  for (const Entry& entry : all) {
    if (try_remove(files_, entry.path)) spdlog::info("store: the basis of system {} makes room", key_of(entry.system));
    if (disk_.refusal(bytes).empty()) return;
  }
}

std::uint64_t BasisFiles::bytes() const {
  std::uint64_t sum = 0;
  for (const Entry& entry : entries()) sum += entry.bytes;
  return sum;
}

std::uint64_t BasisFiles::bytes_of(const std::string& tenant) const {
  std::uint64_t sum = 0;
  for (const Entry& entry : entries()) sum += entry.system.tenant == tenant ? entry.bytes : 0;
  return sum;
}

std::size_t BasisFiles::check(const RunContext& context,
                              const std::function<void(const OwnedId& system, const std::string& why)>& damaged) const {
  const std::vector<Entry> all = entries();
  for (const Entry& entry : all) {
    context.check();
    try {
      if (const auto reader = open(entry.system)) reader->verify();
    } catch (const Error& error) {
      if (contains(entry.system)) damaged(entry.system, error.public_message());
    }
  }
  return all.size();
}

}  // namespace deform::server
