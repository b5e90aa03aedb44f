// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/sweep/sweep_folder.h"

#include <cctype>
#include <utility>

#include "core/base/error.h"
#include "core/io/gzip.h"

namespace deform::cli {

namespace {

namespace fs = std::filesystem;

constexpr char torn[] = ".sweep.part";

fs::path manifest_in(const fs::path& path) {
  std::error_code error;
  if (fs::create_directories(path, error)) sync_folder(path.parent_path());
  if (!fs::is_directory(path)) {
    throw Error(ErrorCode::invalid_argument, "-o " + path.string() + ": is no folder and cannot be made one");
  }
  return path / "sweep.manifest";
}

/// FILE.PROCESS.NUMBER.part, as version 0.1 left them behind.
bool is_old_torn(const std::string& name, const std::string& file) {
  if (!name.starts_with(file + ".") || !name.ends_with(".part")) return false;
  const std::string middle = name.substr(file.size() + 1, name.size() - file.size() - 6);
  std::size_t dots = 0;
  for (const char c : middle) {
    if (c == '.') ++dots;
    if (c != '.' && std::isdigit(static_cast<unsigned char>(c)) == 0) return false;
  }
  return dots == 1;
}

}  // namespace

/// The other name of the same points of OpenFOAM, of which it reads only one; empty for other files.
std::string SweepFolder::other_form(const std::string& file) const {
  return extension_ == openfoam_result ? file + ".gz" : std::string();
}

SweepFolder::SweepFolder(const fs::path& path, std::string extension, std::vector<ExpectedResult> expected)
    : path_(path), extension_(std::move(extension)), expected_(std::move(expected)), manifest_(manifest_in(path)) {
  refuse_foreign_files();
  remove_torn_files();
  if (whole_results().size() < manifest_.results().size()) manifest_.rewrite(whole_results(), {}, names());
}

std::set<std::string> SweepFolder::names() const {
  std::set<std::string> names = failed_;
  for (const auto& result : expected_) names.insert(result.name);
  return names;
}

/// Entries whose files are there.
std::map<std::string, ManifestEntry> SweepFolder::whole_results() const {
  std::map<std::string, ManifestEntry> whole = manifest_.results();
  std::erase_if(whole, [&](const auto& item) {
    std::error_code missing;
    return fs::file_size(path_ / item.first, missing) != item.second.bytes || missing;
  });
  return whole;
}

void SweepFolder::refuse_foreign_files() const {
  std::string first;
  std::size_t count = 0;
  for (const auto& result : expected_) {
    const std::string written = result.name + extension_;
    for (const std::string& file : {written, other_form(written)}) {
      if (file.empty() || manifest_.results().contains(file) || manifest_.is_being_written(file)) continue;
      if (!fs::exists(fs::symlink_status(path_ / file))) continue;
      if (count++ == 0) first = (path_ / file).string();
    }
  }
  if (count == 0) return;
  std::error_code ignored;
  if (manifest_.is_new()) fs::remove(path_ / "sweep.manifest", ignored);
  throw Error(ErrorCode::invalid_argument, first + ": is there and not of this sweep (sweep.manifest does not name it)" +
                                               (count > 1 ? ", and " + std::to_string(count - 1) + " more such files" : "") +
                                               "; nothing was written: move it away, or choose another folder");
}

void SweepFolder::remove_torn_files() const {
  for (const auto& result : expected_) {
    const fs::path file = path_ / (result.name + extension_);
    std::error_code ignored;
    fs::remove(file.string() + torn, ignored);
  }
  // Results of an OpenFOAM mesh are deeper, and were so in 0.1; what it left there is only untidy.
  std::set<std::string> files;
  for (const auto& result : expected_) files.insert(result.name + extension_);
  for (const auto& entry : fs::directory_iterator(path_)) {
    const std::string name = entry.path().filename().string();
    if (!name.ends_with(".part")) continue;
    for (std::size_t dot = name.find('.'); dot != std::string::npos; dot = name.find('.', dot + 1)) {
      const std::string file = name.substr(0, dot);
      if (files.contains(file) && is_old_torn(name, file)) fs::remove(entry.path());
    }
  }
}

std::optional<ResultVerdicts> SweepFolder::find(const ExpectedResult& result) const {
  const std::lock_guard lock(mutex_);
  const auto found = manifest_.results().find(result.name + extension_);
  if (found == manifest_.results().end() || found->second.hash != result.hash) return std::nullopt;
  return found->second.verdicts;
}

/// Those of the file; they are on the disk.
void SweepFolder::make_folders(const std::string& file) const {
  const fs::path folder = (path_ / file).parent_path();
  std::error_code error;
  if (!fs::create_directories(folder, error) && error) {
    throw Error(ErrorCode::failed_precondition, "cannot make the folder " + folder.string() + ": " + error.message());
  }
  for (fs::path above = folder; above != path_ && !above.empty() && above != above.parent_path();) {
    above = above.parent_path();
    sync_folder(above);
  }
}

void SweepFolder::put(const ExpectedResult& result, const ResultVerdicts& verdicts, const std::string& bytes) {
  const std::string file = result.name + extension_;
  make_folders(file);
  const std::string packed = extension_.ends_with(".gz") ? io::gzip(bytes) : std::string();
  DurableFile written((path_ / file).string() + torn);
  try {
    written.cut(0);
    written.append(packed.empty() ? bytes : packed);
    written.sync();
  } catch (...) {
    std::error_code ignored;
    fs::remove(written.path(), ignored);
    throw;
  }
  const ManifestEntry entry{result.name, result.hash, file, 0, written.size(), ManifestEntry::Place::result, verdicts};
  const std::lock_guard lock(mutex_);
  manifest_.replace(file);
  written.rename(path_ / file);
  if (const std::string other = other_form(file); !other.empty()) {
    std::error_code absent;
    fs::remove(path_ / other, absent);
  }
  manifest_.add(entry);
}

std::optional<SweepFailure> SweepFolder::find_failure(const ExpectedResult& result) const {
  const std::lock_guard lock(mutex_);
  return manifest_.find_failure(result.name, result.hash);
}

void SweepFolder::fail(const std::string& name, const SweepFailure& failure) {
  const std::lock_guard lock(mutex_);
  manifest_.fail(name, failure);
  failed_.insert(name);
}

void SweepFolder::finish() {
  const std::lock_guard lock(mutex_);
  manifest_.sync();
  try {
    manifest_.rewrite(whole_results(), {}, names());
  } catch (const Error&) {
    // There is no room for a shorter one: the longer one says the same.
  }
}

}  // namespace deform::cli
