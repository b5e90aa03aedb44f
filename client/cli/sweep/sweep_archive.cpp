// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/sweep/sweep_archive.h"

#include <algorithm>
#include <utility>

#include "core/base/error.h"

namespace deform::cli {

namespace {

namespace fs = std::filesystem;
using Place = ManifestEntry::Place;

[[noreturn]] void refuse_archive(const fs::path& path, const std::string& why) {
  throw Error(ErrorCode::invalid_argument,
              path.string() + ": " + why + "; it was left as it is: move it away, or choose another name");
}

fs::path checked(const fs::path& path) {
  const auto status = fs::symlink_status(path);
  if (fs::exists(status) && !fs::is_regular_file(status)) refuse_archive(path, "is there and no plain file");
  // Before a manifest is begun beside it.
  const fs::path manifest = path.string() + ".manifest";
  if (fs::exists(manifest)) return path;
  for (const fs::path& file : {path, fs::path(path.string() + ".part")}) {
    if (fs::exists(file)) refuse_archive(file, "is not of this sweep (there is no " + manifest.filename().string() + ")");
  }
  return path;
}

/// Entries in order that lie one behind the other from the beginning of an archive: how many of them, and where they end.
struct Fit {
  std::size_t count = 0;
  std::uint64_t end = 0;
};

Fit fit(const fs::path& path, const std::vector<ManifestEntry>& entries) {
  Fit fit;
  if (!fs::is_regular_file(path)) return fit;
  const DurableFile archive(path);
  for (const auto& entry : entries) {
    if (entry.offset != fit.end || !tar_has_entry(archive, entry.offset, entry.file, entry.bytes)) break;
    fit.end += tar_entry_bytes(entry.bytes);
    ++fit.count;
  }
  return fit;
}

/// The archive is complete and holds these entries and nothing else.
bool is_whole(const fs::path& path, const std::vector<ManifestEntry>& entries) {
  if (entries.empty()) return false;
  const Fit found = fit(path, entries);
  return found.count == entries.size() && fs::file_size(path) == found.end + tar_end_bytes;
}

std::vector<ManifestEntry> by_offset(const std::map<std::string, ManifestEntry>& results) {
  std::vector<ManifestEntry> entries;
  for (const auto& [file, entry] : results) entries.push_back(entry);
  std::sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) { return a.offset < b.offset; });
  return entries;
}

}  // namespace

SweepArchive::SweepArchive(const fs::path& path, std::string extension, std::vector<ExpectedResult> expected)
    : path_(checked(path)),
      part_(path.string() + ".part"),
      new_(part_.string() + ".new"),
      extension_(std::move(extension)),
      expected_(std::move(expected)),
      manifest_(path.string() + ".manifest") {
  recover();
}

std::set<std::string> SweepArchive::names() const {
  std::set<std::string> names = failed_;
  for (const auto& result : expected_) names.insert(result.name);
  return names;
}

/// What the archive holds. Version 0.1 had no part of its own: its entries were those of the part until that got its name.
SweepArchive::Results SweepArchive::recovered_results() {
  if (!fs::exists(path_)) return {};
  const auto& next = manifest_.next();
  if (is_whole(path_, next)) {
    Results results;
    for (auto entry : next) {
      entry.place = Place::result;
      results[entry.file] = entry;
    }
    return results;
  }
  if (manifest_.results().empty()) refuse_archive(path_, "is not of this sweep (its manifest names nothing in it)");
  if (!is_whole(path_, by_offset(manifest_.results()))) refuse_archive(path_, "is not what its manifest says");
  return manifest_.results();
}

std::vector<ManifestEntry> SweepArchive::recovered_part(const Results& results) const {
  if (!fs::exists(part_)) return {};
  std::vector<ManifestEntry> part = manifest_.part();
  if (part.empty() && results.empty()) part = by_offset(manifest_.results());
  part.resize(fit(part_, part).count);
  for (auto& entry : part) entry.place = Place::part;
  return part;
}

void SweepArchive::recover() {
  const Results results = recovered_results();
  const std::vector<ManifestEntry> part = recovered_part(results);
  const bool changed =
      !manifest_.next().empty() || results.size() != manifest_.results().size() || part.size() != manifest_.part().size();
  if (changed) manifest_.rewrite(results, part, names());
  std::error_code ignored;
  fs::remove(new_, ignored);
  for (const auto& [file, entry] : manifest_.results()) present_.insert_or_assign({entry.name, entry.hash}, entry);
  // These are newer: something else was to be known about the result.
  for (const auto& entry : manifest_.part()) present_.insert_or_assign({entry.name, entry.hash}, entry);
}

std::optional<ResultVerdicts> SweepArchive::find(const ExpectedResult& result) const {
  const std::lock_guard lock(mutex_);
  const auto found = present_.find({result.name, result.hash});
  return found == present_.end() ? std::nullopt : std::optional(found->second.verdicts);
}

void SweepArchive::put(const ExpectedResult& result, const ResultVerdicts& verdicts, const std::string& bytes) {
  const std::lock_guard lock(mutex_);
  if (!tar_) {
    const auto& part = manifest_.part();
    tar_ = std::make_unique<TarWriter>(part_, part.empty() ? 0 : part.back().offset + tar_entry_bytes(part.back().bytes));
    sync_folder(path_.parent_path());
  }
  const ManifestEntry entry{result.name, result.hash, result.name + extension_, tar_->end(), bytes.size(), Place::part, verdicts};
  tar_->add(entry.file, bytes);
  manifest_.add(entry);
  present_.insert_or_assign({entry.name, entry.hash}, entry);
}

std::optional<SweepFailure> SweepArchive::find_failure(const ExpectedResult& result) const {
  const std::lock_guard lock(mutex_);
  return manifest_.find_failure(result.name, result.hash);
}

void SweepArchive::fail(const std::string& name, const SweepFailure& failure) {
  const std::lock_guard lock(mutex_);
  manifest_.fail(name, failure);
  failed_.insert(name);
}

/// What the archive shall hold, in the order of the designs.
std::vector<ManifestEntry> SweepArchive::wanted() const {
  std::vector<ManifestEntry> entries;
  for (const auto& result : expected_) {
    const auto found = present_.find({result.name, result.hash});
    if (found != present_.end()) entries.push_back(found->second);
  }
  return entries;
}

/// Copies them together; their places in the new archive.
std::vector<ManifestEntry> SweepArchive::assemble(const std::vector<ManifestEntry>& entries) const {
  TarWriter tar(new_, 0);
  std::vector<ManifestEntry> next;
  std::optional<DurableFile> results, part;
  for (const auto& entry : entries) {
    auto& source = entry.place == Place::part ? part : results;
    if (!source) source.emplace(entry.place == Place::part ? part_ : path_);
    next.push_back(entry);
    next.back().offset = tar.end();
    tar.add_copy(entry.file, *source, entry.offset, entry.bytes);
  }
  tar.close();
  return next;
}

void SweepArchive::replace(const fs::path& by, const std::vector<ManifestEntry>& next) {
  std::vector<ManifestEntry> announced = next;
  for (auto& entry : announced) entry.place = Place::next;
  manifest_.add(announced);
  manifest_.sync();
  DurableFile(by).rename(path_);
  Results results;
  for (auto entry : next) {
    entry.place = Place::result;
    results[entry.file] = entry;
  }
  manifest_.rewrite(results, {}, names());
}

void SweepArchive::finish() {
  const std::lock_guard lock(mutex_);
  manifest_.sync();
  const std::vector<ManifestEntry> entries = wanted();
  if (entries.empty()) return;
  const auto in_part = static_cast<std::size_t>(
      std::count_if(entries.begin(), entries.end(), [](const auto& entry) { return entry.place == Place::part; }));
  if (in_part == 0 && entries.size() == manifest_.results().size()) {
    if (!manifest_.part().empty()) manifest_.rewrite(manifest_.results(), {}, names());
  } else if (in_part == entries.size() && in_part == manifest_.part().size()) {
    // Every entry of the part is wanted: it is the archive, in the order in which results came.
    const auto& part = manifest_.part();
    if (!tar_) tar_ = std::make_unique<TarWriter>(part_, part.back().offset + tar_entry_bytes(part.back().bytes));
    tar_->close();
    const std::vector<ManifestEntry> next = part;
    replace(part_, next);
  } else {
    try {
      replace(new_, assemble(entries));
    } catch (...) {
      std::error_code ignored;
      fs::remove(new_, ignored);  // the disk may be full
      throw;
    }
  }
  tar_.reset();
  std::error_code ignored;
  fs::remove(part_, ignored);
}

}  // namespace deform::cli
