// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <stop_token>
#include <string>
#include <vector>

#include "client/cli/setup/reading.h"
#include "core/io/mesh_file.h"

namespace deform::cli {

/// How the commands read mesh files: those that may crash a library in a process of this program of their own.
io::ReadOptions own_process();
/// The same; a stop ends it.
io::ReadOptions own_process(const std::stop_token& stop);

/// The mesh file of a setup file: the one that it names, or `source` where it names its geometry by id. Throws
/// Error(invalid_argument) when there are both or none. setup: the name of the setup file.
std::filesystem::path mesh_path(const std::string& setup, const SetupFile& file, const std::string& source);

/// Throws Error(invalid_argument) naming the option when `output` is, under whatever name, one of the files that the command
/// reads. Empty paths are ignored.
void keep_inputs(const std::string& option, const std::filesystem::path& output,
                 const std::vector<std::filesystem::path>& inputs);
/// Throws Error(not_found), which names the folder, where the one in which `output`, a single file, is to lie does not exist.
void check_folder(const std::string& option, const std::filesystem::path& output);

}  // namespace deform::cli
