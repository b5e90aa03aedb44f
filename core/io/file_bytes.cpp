// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "core/base/error.h"
#include "core/io/gzip.h"
#include "core/io/mesh_file.h"

namespace deform::io {

namespace {

[[noreturn]] void fail(ErrorCode code, const std::string& what, int error) {
  throw Error(code, what + ": " + std::strerror(error));
}

/// Closes on the way out; close_checked() is for written files, whose last error may come only then.
class File {
 public:
  explicit File(int descriptor) : descriptor_(descriptor) {}
  ~File() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int descriptor() const { return descriptor_; }
  bool close_checked() {
    const int descriptor = descriptor_;
    descriptor_ = -1;
    return ::close(descriptor) == 0;
  }

 private:
  int descriptor_;
};

/// At most limit + 1 bytes, so that the caller sees when there are more than limit. The size the file system states is only a
/// hint (pipes and devices state none).
std::string read_bytes(const File& file, const std::string& name, std::size_t limit) {
  struct stat status {};
  if (::fstat(file.descriptor(), &status) != 0) fail(ErrorCode::not_found, "cannot read " + name, errno);
  if (S_ISDIR(status.st_mode)) fail(ErrorCode::not_found, "cannot read " + name, EISDIR);
  const std::size_t stop = limit == ~std::size_t{0} ? limit : limit + 1;
  constexpr std::size_t smallest = 1 << 16;
  std::string bytes;
  std::size_t used = 0;
  while (used < stop) {
    if (used == bytes.size()) {
      const std::size_t hint = used == 0 && status.st_size > 0 ? static_cast<std::size_t>(status.st_size) + 1 : smallest;
      bytes.resize(std::min(stop, std::max(hint, used * 2)));
    }
    const ssize_t got = ::read(file.descriptor(), bytes.data() + used, bytes.size() - used);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) fail(ErrorCode::not_found, "cannot read " + name, errno);
    if (got == 0) break;
    used += static_cast<std::size_t>(got);
  }
  bytes.resize(used);
  return bytes;
}

void write_bytes(const File& file, std::string_view bytes, const std::string& name) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(file.descriptor(), bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail(ErrorCode::failed_precondition, "cannot write " + name, errno);
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

/// A new file next to `path`; removed on the way out unless it was renamed.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& target) : target_(target), name_(), file_(create()) {}
  ~TemporaryFile() {
    if (!renamed_) ::unlink(name_.c_str());
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  void write(std::string_view bytes) { write_bytes(file_, bytes, target_); }

  void rename_to_target() {
    struct stat replaced {};
    constexpr mode_t permissions = 0777;
    if (::stat(target_.c_str(), &replaced) == 0 && ::fchmod(file_.descriptor(), replaced.st_mode & permissions) != 0) {
      fail(ErrorCode::failed_precondition, "cannot write " + target_, errno);
    }
    if (!file_.close_checked() || ::rename(name_.c_str(), target_.c_str()) != 0) {
      fail(ErrorCode::failed_precondition, "cannot write " + target_, errno);
    }
    renamed_ = true;
  }

 private:
  /// Not mkstemp, which ignores the umask. O_EXCL makes the number matter only for speed.
  int create() {
    constexpr int attempts = 1000;
    for (int i = 0; i < attempts; ++i) {
      name_ = target_ + "." + std::to_string(::getpid()) + "." + std::to_string(i) + ".part";
      const int descriptor = ::open(name_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
      if (descriptor >= 0) return descriptor;
      if (errno != EEXIST) break;
    }
    fail(ErrorCode::failed_precondition, "cannot write " + target_, errno);
  }

  const std::string target_;
  std::string name_;
  File file_;
  bool renamed_ = false;
};

/// Pipes and devices (/dev/stdout) cannot be replaced by renaming.
bool is_special_file(const std::string& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 && !S_ISREG(status.st_mode) && !S_ISDIR(status.st_mode);
}

}  // namespace

std::string read_file(const std::filesystem::path& path, bool* was_gzip, std::size_t max_bytes) {
  const std::string name = path.string();
  const File file(::open(name.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.descriptor() < 0) fail(ErrorCode::not_found, "cannot open " + name, errno);
  std::string bytes = read_bytes(file, name, max_bytes);
  const bool compressed = is_gzip(bytes);
  if (was_gzip) *was_gzip = compressed;
  if (bytes.size() > max_bytes) {
    throw Error(ErrorCode::out_of_budget, name + ": the file has more than " + std::to_string(max_bytes) + " bytes");
  }
  return compressed ? gunzip(bytes, name, max_bytes) : bytes;
}

void write_file(const std::filesystem::path& path, std::string_view bytes) {
  const std::string name = path.string();
  const std::string packed = has_gzip_extension(name) ? gzip(bytes) : std::string();
  if (!packed.empty()) bytes = packed;
  if (is_special_file(name)) {
    File file(::open(name.c_str(), O_WRONLY | O_CLOEXEC));
    if (file.descriptor() < 0) fail(ErrorCode::failed_precondition, "cannot write " + name, errno);
    write_bytes(file, bytes, name);
    return;
  }
  TemporaryFile file(name);
  file.write(bytes);
  file.rename_to_target();
}

}  // namespace deform::io
