// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/types.h"

namespace deform::client {

/// Point ids that a setup file takes from files beside it: `ids: {file: part.points.json, set: bore}`. A file is JSON: one list
/// of ids, or an object with a list for every set. Each file is read once. Not thread-safe.
class IdFiles {
 public:
  /// Relative paths start at this folder.
  explicit IdFiles(std::filesystem::path folder) : folder_(std::move(folder)) {}

  /// The ids of a set; `set` is empty for a file that is one list. Throws Error(not_found) when there is no such file,
  /// Error(invalid_argument): no JSON (with the byte), another form, two sets of one name, unknown set (with the nearest
  /// names), no id (with its index).
  std::vector<PointId> ids(const std::string& file, const std::string& set);

 private:
  const nlohmann::json& content(const std::string& file);

  std::filesystem::path folder_;
  std::map<std::string, nlohmann::json> contents_;
};

}  // namespace deform::client
