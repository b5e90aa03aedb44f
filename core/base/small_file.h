// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace deform {

/// All bytes of a file of at most 4 MiB. Throws Error(invalid_argument) "OPTION: PATH: why". Any thread.
std::string read_small_file(const std::filesystem::path& path, const std::string& option);

/// Why a file cannot be opened for reading, in the words of the system, such as "No such file or directory"; a folder is none.
/// Empty if it can. Any thread.
std::string why_unreadable(const std::filesystem::path& path);

}  // namespace deform
