// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "core/base/problems.h"
#include "deform/v1/setup.pb.h"

namespace deform::client {

/// A setup as a file describes it.
struct SetupFile {
  v1::Setup setup;                                     ///< `geometry` is an id, or empty when it is a file
  std::optional<std::filesystem::path> geometry_file;  ///< relative paths start at the setup file
};

/// Throws Error(invalid_argument) with file and line; Error(not_found) when a file does not exist.
SetupFile read_setup_file(const std::filesystem::path& path);

/// The same, with what is wrong going to `problems`: collecting, the setup lacks what could not be read. Where the file itself
/// cannot be read or is no YAML, an Error all the same.
SetupFile read_setup_file(const std::filesystem::path& path, Problems& problems);

/// What becomes of the geometry that a setup names.
enum class GeometryEntry {
  needed,    ///< a setup without one is refused
  left_out,  ///< the caller has another: it is neither looked at nor kept
};

/// The same from text: `name` stands in errors, the files that it names are looked for in `folder`.
SetupFile parse_setup(const std::string& text, const std::string& name, const std::filesystem::path& folder,
                      GeometryEntry geometry, Problems& problems);

/// 8 to 64 hexadecimal digits: an id or the beginning of one.
bool looks_like_id(const std::string& text);

}  // namespace deform::client
