// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// A setup as a file describes it.
struct SetupFile {
  v1::Setup setup;                                     ///< `geometry` is an id, or empty when it is a file
  std::optional<std::filesystem::path> geometry_file;  ///< relative paths start at the setup file
};

/// Throws Error(invalid_argument) with file and line; Error(not_found) when a file does not exist.
SetupFile read_setup_file(const std::filesystem::path& path);

/// 8 to 64 hexadecimal digits: an id or the beginning of one.
bool looks_like_id(const std::string& text);

}  // namespace deform::cli
