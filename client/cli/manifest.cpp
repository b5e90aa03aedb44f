#include "client/cli/manifest.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "core/base/error.h"

namespace deform::cli {

namespace {

bool parse_entry(const std::string& line, ManifestEntry& entry) {
  const auto json = nlohmann::json::parse(line, nullptr, false);
  if (!json.is_object()) return false;
  for (const char* key : {"name", "hash", "file"}) {
    if (!json.contains(key) || !json[key].is_string()) return false;
  }
  for (const char* key : {"offset", "bytes"}) {
    if (!json.contains(key) || !json[key].is_number_unsigned()) return false;
  }
  entry = {json["name"], json["hash"], json["file"], json["offset"], json["bytes"]};
  return true;
}

}  // namespace

Manifest::Manifest(std::filesystem::path path) : path_(std::move(path)) {
  std::vector<ManifestEntry> found;
  {
    std::ifstream in(path_, std::ios::binary);
    std::string line;
    ManifestEntry entry;
    // A line without its end was torn.
    while (std::getline(in, line) && !in.eof() && parse_entry(line, entry)) found.push_back(entry);
  }
  reset(std::move(found));
}

void Manifest::reset(std::vector<ManifestEntry> entries) {
  entries_ = std::move(entries);
  if (file_.is_open()) file_.close();
  const std::filesystem::path temporary = path_.string() + ".new";
  file_.open(temporary, std::ios::binary | std::ios::trunc);
  for (const auto& entry : entries_) write(entry);
  std::filesystem::rename(temporary, path_);  // the open stream goes on under the new name
}

void Manifest::add(const ManifestEntry& entry) {
  write(entry);
  entries_.push_back(entry);
}

void Manifest::write(const ManifestEntry& entry) {
  const nlohmann::json json{
      {"name", entry.name}, {"hash", entry.hash}, {"file", entry.file}, {"offset", entry.offset}, {"bytes", entry.bytes}};
  file_ << json.dump() << std::endl;
  if (!file_) throw Error(ErrorCode::unavailable, "cannot write " + path_.string() + "; is the disk full?");
}

}  // namespace deform::cli
