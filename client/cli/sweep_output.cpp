#include "client/cli/sweep_output.h"

#include <utility>

#include "client/cli/manifest.h"
#include "client/cli/tar.h"
#include "core/base/error.h"
#include "core/io/mesh_file.h"

namespace deform::cli {

namespace {

namespace fs = std::filesystem;

class Folder : public SweepOutput {
 public:
  Folder(const fs::path& path, std::string extension, const ExpectedResults& expected)
      : path_(path), extension_(std::move(extension)), manifest_(prepared(path)) {
    remove_torn(expected);
    for (const auto& entry : manifest_.entries()) {
      std::error_code missing;
      if (fs::file_size(path_ / entry.file, missing) == entry.bytes && !missing) present_[entry.name] = entry.hash;
    }
  }

  bool has(const std::string& name, const std::string& hash) const override {
    const std::lock_guard lock(mutex_);
    const auto found = present_.find(name);
    return found != present_.end() && found->second == hash;
  }

  void put(const std::string& name, const std::string& hash, const std::string& bytes) override {
    const std::string file = name + extension_;
    fs::create_directories((path_ / file).parent_path());
    io::write_file(path_ / file, bytes);  // by a temporary file and rename
    const std::lock_guard lock(mutex_);
    manifest_.add({name, hash, file, 0, fs::file_size(path_ / file)});
    present_[name] = hash;
  }

  void finish() override {}

 private:
  /// What a killed run was writing: RESULT.PROCESS.NUMBER.part of io::write_file.
  void remove_torn(const ExpectedResults& expected) const {
    for (const auto& entry : fs::recursive_directory_iterator(path_)) {
      const std::string file = entry.path().lexically_relative(path_).string();
      const std::size_t end = file.find(extension_ + ".");
      if (file.ends_with(".part") && end != std::string::npos && expected.contains(file.substr(0, end))) fs::remove(entry.path());
    }
  }

  static fs::path prepared(const fs::path& path) {
    std::error_code error;
    fs::create_directories(path, error);
    if (!fs::is_directory(path)) {
      throw Error(ErrorCode::invalid_argument, "-o " + path.string() + ": is no folder and cannot be made one");
    }
    return path / "sweep.manifest";
  }

  const fs::path path_;
  const std::string extension_;
  mutable std::mutex mutex_;
  // under mutex_
  Manifest manifest_;
  std::map<std::string, std::string> present_;
};

class Archive : public SweepOutput {
 public:
  Archive(const fs::path& path, std::string extension, const ExpectedResults& expected)
      : path_(path), part_(path.string() + ".part"), extension_(std::move(extension)), manifest_(path.string() + ".manifest") {
    if (fs::exists(path_)) fs::rename(path_, part_);
    const std::uint64_t end = usable_end(expected);
    if (end == 0) manifest_.reset({});
    for (const auto& entry : manifest_.entries()) present_[entry.name] = entry.hash;
    tar_ = std::make_unique<TarWriter>(part_, end);
  }

  bool has(const std::string& name, const std::string& hash) const override {
    const std::lock_guard lock(mutex_);
    const auto found = present_.find(name);
    return found != present_.end() && found->second == hash;
  }

  void put(const std::string& name, const std::string& hash, const std::string& bytes) override {
    const std::lock_guard lock(mutex_);
    const std::string file = name + extension_;
    const std::uint64_t offset = tar_->end();
    tar_->add(file, bytes);
    manifest_.add({name, hash, file, offset, bytes.size()});
    present_[name] = hash;
  }

  void finish() override {
    const std::lock_guard lock(mutex_);
    tar_->finish();
    fs::rename(part_, path_);
  }

 private:
  /// Where to go on: behind the last recorded entry when all of them belong to this sweep and are there, else at the beginning.
  std::uint64_t usable_end(const ExpectedResults& expected) const {
    std::uint64_t end = 0;
    for (const auto& entry : manifest_.entries()) {
      const auto found = expected.find(entry.name);
      if (found == expected.end() || found->second != entry.hash || entry.offset != end) return 0;
      end += tar_entry_bytes(entry.bytes);
    }
    std::error_code missing;
    const auto size = fs::file_size(part_, missing);
    return !missing && size >= end ? end : 0;
  }

  const fs::path path_, part_;
  const std::string extension_;
  mutable std::mutex mutex_;
  // under mutex_
  Manifest manifest_;
  std::map<std::string, std::string> present_;
  std::unique_ptr<TarWriter> tar_;
};

}  // namespace

std::unique_ptr<SweepOutput> open_sweep_output(const fs::path& path, const std::string& extension,
                                               const ExpectedResults& expected) {
  if (path.extension() != ".tar") return std::make_unique<Folder>(path, extension, expected);
  if (!path.parent_path().empty() && !fs::is_directory(path.parent_path())) {
    throw Error(ErrorCode::invalid_argument,
                "-o " + path.string() + ": the folder " + path.parent_path().string() + " does not exist");
  }
  return std::make_unique<Archive>(path, extension, expected);
}

}  // namespace deform::cli
