// SPDX-License-Identifier: Apache-2.0
#include "client/setup/id_files.h"

#include <limits>
#include <set>

#include "core/base/error.h"
#include "core/io/mesh_file.h"

namespace deform::client {

namespace {

constexpr std::size_t max_id_file_bytes = std::size_t{1} << 28;

[[noreturn]] void refuse_ids(const std::string& what, const std::string& why) {
  throw Error(ErrorCode::invalid_argument, what + ": " + why);
}

std::vector<PointId> ids_of(const nlohmann::json& list, const std::string& what) {
  std::vector<PointId> ids;
  ids.reserve(list.size());
  for (const nlohmann::json& item : list) {
    const bool fits = item.is_number_unsigned() && item.get<std::uint64_t>() <= std::numeric_limits<PointId>::max();
    if (!fits) refuse_ids(what, "entry " + std::to_string(ids.size()) + " is no point id (an integer from 0 to 4294967295)");
    ids.push_back(item.get<PointId>());
  }
  return ids;
}

/// Parses JSON. The parser keeps the last of members that have the same name, so sets of one name are refused.
nlohmann::json parsed(const std::string& text, const std::string& path) {
  std::set<std::string> names;
  return nlohmann::json::parse(text, [&](int depth, nlohmann::json::parse_event_t event, const nlohmann::json& value) {
    if (depth == 1 && event == nlohmann::json::parse_event_t::key && !names.insert(value.get<std::string>()).second) {
      refuse_ids(path, "has two sets \"" + value.get<std::string>() + "\"; give each its own name");
    }
    return true;
  });
}

}  // namespace

const nlohmann::json& IdFiles::content(const std::string& file) {
  if (const auto known = contents_.find(file); known != contents_.end()) return known->second;
  const std::filesystem::path path = folder_ / file;
  nlohmann::json json;
  try {
    json = parsed(io::read_file(path, nullptr, max_id_file_bytes), path.string());
  } catch (const nlohmann::json::parse_error& error) {
    refuse_ids(path.string(), "is no JSON, see byte " + std::to_string(error.byte));
  }
  return contents_.emplace(file, std::move(json)).first->second;
}

std::vector<PointId> IdFiles::ids(const std::string& file, const std::string& set) {
  const nlohmann::json& json = content(file);
  const std::string path = (folder_ / file).string();
  if (json.is_array()) {
    if (!set.empty()) refuse_ids(path, "is one list of ids without sets; leave out \"set: " + set + "\"");
    return ids_of(json, path);
  }
  if (!json.is_object()) refuse_ids(path, "expected a list of point ids, or an object with a list for every set");
  if (set.empty()) refuse_ids(path, "has sets; say which one, as in {file: " + file + ", set: NAME}");
  const auto found = json.find(set);
  if (found == json.end()) {
    std::vector<std::string> names;
    for (const auto& [name, list] : json.items()) names.push_back(name);
    const std::string near = nearest_names(set, names);
    refuse_ids(path, "has no set \"" + set + "\"" + (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  if (!found->is_array()) refuse_ids(path, "set \"" + set + "\" is no list of point ids");
  return ids_of(*found, path + ": set \"" + set + "\"");
}

}  // namespace deform::client
