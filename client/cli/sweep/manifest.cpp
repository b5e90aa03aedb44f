// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/sweep/manifest.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "core/base/error.h"

namespace deform::cli {

namespace {

using ManifestJson = nlohmann::json;
using Place = ManifestEntry::Place;

constexpr char first_line[] = "{\"sweep_manifest\":1}\n";

std::string to_line(const ManifestJson& json) { return json.dump(-1, ' ', false, ManifestJson::error_handler_t::replace) + "\n"; }

void add(const ResultVerdicts& verdicts, ManifestJson& json) {
  if (!verdicts.reasons.empty()) json["bad"] = verdicts.reasons;
  if (verdicts.safe_amplitude) json["safe_amplitude"] = *verdicts.safe_amplitude;
  if (verdicts.reached) {
    json["state"] = "final";  // not "done": it made only a part of its motion, and no further run makes more
    json["reached"] = *verdicts.reached;
  }
  if (verdicts.estimated_error) json["estimated_error"] = *verdicts.estimated_error;
  if (verdicts.relative_error) json["relative_error"] = *verdicts.relative_error;
  if (!verdicts.doubts.empty()) json["doubtful"] = verdicts.doubts;
  if (!verdicts.warnings.empty()) json["warnings"] = verdicts.warnings;
  for (const auto& [gate, failure] : verdicts.gates) json["gate"][gate] = failure.empty() ? "passed" : failure;
}

std::string to_line(const ManifestEntry& entry) {
  ManifestJson json{
      {"name", entry.name}, {"hash", entry.hash}, {"file", entry.file}, {"offset", entry.offset}, {"bytes", entry.bytes}};
  if (entry.place != Place::result) json["in"] = entry.place == Place::part ? "part" : "next";
  add(entry.verdicts, json);
  return to_line(json);
}

std::string failure_line(const std::string& name, const SweepFailure& failure) {
  ManifestJson json{{"name", name}, {"failed", failure.reason}};
  if (!failure.hash.empty()) json["hash"] = failure.hash;
  add(failure.verdicts, json);
  return to_line(json);
}

ResultVerdicts parse_verdicts(const ManifestJson& json) {
  ResultVerdicts verdicts;
  if (json.contains("bad")) verdicts.reasons = json["bad"].get<std::vector<std::string>>();
  if (json.contains("safe_amplitude")) verdicts.safe_amplitude = json["safe_amplitude"].get<double>();
  if (json.contains("estimated_error")) verdicts.estimated_error = json["estimated_error"].get<double>();
  if (json.contains("relative_error")) verdicts.relative_error = json["relative_error"].get<double>();
  if (json.contains("reached")) verdicts.reached = json["reached"].get<double>();
  if (json.contains("doubtful")) verdicts.doubts = json["doubtful"].get<std::vector<std::string>>();
  if (json.contains("warnings")) verdicts.warnings = json["warnings"].get<std::vector<std::string>>();
  if (!json.contains("gate")) return verdicts;
  for (const auto& [gate, failure] : json["gate"].get<std::map<std::string, std::string>>()) {
    verdicts.gates[gate] = failure == "passed" ? "" : failure;
  }
  return verdicts;
}

/// Throws when it is none.
ManifestEntry parse_entry(const ManifestJson& json) {
  ManifestEntry entry;
  entry.name = json.at("name").get<std::string>();
  entry.hash = json.at("hash").get<std::string>();
  entry.file = json.at("file").get<std::string>();
  entry.offset = json.at("offset").get<std::uint64_t>();
  entry.bytes = json.at("bytes").get<std::uint64_t>();
  const std::string place = json.value("in", "");
  entry.place = place == "part" ? Place::part : place == "next" ? Place::next : Place::result;
  entry.verdicts = parse_verdicts(json);
  return entry;
}

/// Version 0.1 began with an entry.
bool is_ours(const std::string& line) {
  const ManifestJson json = ManifestJson::parse(line, nullptr, false);
  return json.is_object() && (json.contains("sweep_manifest") || (json.contains("name") && json.contains("hash")));
}

}  // namespace

Manifest::Manifest(const std::filesystem::path& path) : file_(path) {
  const auto busy = [&] {
    throw Error(ErrorCode::failed_precondition, path.string() + ": another sweep is writing there; wait for its end");
  };
  if (!file_.lock() || !file_.is_current()) busy();
  if (!read()) {
    throw Error(ErrorCode::invalid_argument,
                path.string() + ": is not the manifest of a sweep; move it away, or choose another place for the results");
  }
  is_new_ = file_.size() == 0;
  if (!is_new_) return;
  file_.append(first_line);
  file_.sync();
  sync_folder(path.parent_path());
}

/// False when the file is not ours. What was torn is cut off.
bool Manifest::read() {
  const std::string content = file_.read(0, file_.size());
  const std::size_t end = content.rfind('\n') + 1;  // 0 when there is none
  if (end == 0 && !content.empty() && !std::string(first_line).starts_with(content)) return false;
  for (std::size_t begin = 0; begin < end;) {
    const std::size_t stop = content.find('\n', begin);
    const std::string line = content.substr(begin, stop - begin);
    if (begin == 0 && !is_ours(line)) return false;
    take(line);
    begin = stop + 1;
  }
  if (end < content.size()) file_.cut(end);
  return true;
}

/// A line that cannot be understood says nothing; those behind it are as true as without it.
void Manifest::take(const std::string& line) {
  const ManifestJson json = ManifestJson::parse(line, nullptr, false);
  if (!json.is_object()) return;
  try {
    if (json.contains("writing")) {
      const auto file = json["writing"].get<std::string>();
      results_.erase(file);
      writing_.insert(file);
    } else if (json.contains("failed")) {
      failed_[json.at("name").get<std::string>()] = {json["failed"].get<std::string>(), json.value("hash", ""),
                                                     parse_verdicts(json)};
    } else if (json.contains("hash")) {
      take(parse_entry(json));
    }
  } catch (const ManifestJson::exception&) {
    return;
  }
}

void Manifest::take(ManifestEntry&& entry) {
  if (entry.place == Place::next) {
    next_.push_back(std::move(entry));
    return;
  }
  failed_.erase(entry.name);
  if (entry.place == Place::part) {
    part_.push_back(std::move(entry));
    return;
  }
  writing_.erase(entry.file);
  const std::string file = entry.file;
  results_.insert_or_assign(file, std::move(entry));
}

void Manifest::add(const ManifestEntry& entry) { add(std::vector<ManifestEntry>{entry}); }

void Manifest::add(const std::vector<ManifestEntry>& entries) {
  std::string lines;
  for (const auto& entry : entries) lines += to_line(entry);
  file_.append(lines);
  for (auto entry : entries) take(std::move(entry));
}

void Manifest::fail(const std::string& name, const SweepFailure& failure) {
  file_.append(failure_line(name, failure));
  failed_[name] = failure;
}

std::optional<SweepFailure> Manifest::find_failure(const std::string& name, const std::string& hash) const {
  const auto found = failed_.find(name);
  return found != failed_.end() && found->second.hash == hash ? std::optional(found->second) : std::nullopt;
}

void Manifest::replace(const std::string& file) {
  file_.append(to_line(ManifestJson{{"writing", file}}));
  file_.sync();
  results_.erase(file);
  writing_.insert(file);
}

void Manifest::rewrite(const std::map<std::string, ManifestEntry>& results, const std::vector<ManifestEntry>& part,
                       const std::set<std::string>& names) {
  std::string lines = first_line;
  std::map<std::string, SweepFailure> failed;
  for (const auto& [file, entry] : results) lines += to_line(entry);
  for (const auto& entry : part) lines += to_line(entry);
  for (const auto& file : writing_) lines += to_line(ManifestJson{{"writing", file}});
  for (const auto& [name, failure] : failed_) {
    if (!names.contains(name)) continue;
    lines += failure_line(name, failure);
    failed[name] = failure;
  }
  const std::filesystem::path path = file_.path();
  DurableFile fresh(path.string() + ".new");
  fresh.cut(0);
  fresh.append(lines);
  fresh.sync();
  if (!fresh.lock()) throw Error(ErrorCode::failed_precondition, path.string() + ": another sweep is writing there");
  fresh.rename(path);
  file_ = std::move(fresh);
  auto kept_results = results;
  auto kept_part = part;
  results_ = std::move(kept_results);
  part_ = std::move(kept_part);
  next_.clear();
  failed_ = std::move(failed);
}

}  // namespace deform::cli
