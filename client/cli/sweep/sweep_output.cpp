// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/sweep/sweep_output.h"

#include <utility>

#include "client/cli/sweep/sweep_archive.h"
#include "client/cli/sweep/sweep_folder.h"
#include "core/base/error.h"

namespace deform::cli {

std::unique_ptr<SweepOutput> open_sweep_output(const std::filesystem::path& where, const std::string& extension,
                                               std::vector<ExpectedResult> expected) {
  const std::filesystem::path path = where.has_filename() ? where : where.parent_path();  // without a slash at its end
  if (path.extension() != ".tar") return std::make_unique<SweepFolder>(path, extension, std::move(expected));
  if (!path.parent_path().empty() && !std::filesystem::is_directory(path.parent_path())) {
    throw Error(ErrorCode::invalid_argument,
                "-o " + path.string() + ": the folder " + path.parent_path().string() + " does not exist");
  }
  return std::make_unique<SweepArchive>(path, extension, std::move(expected));
}

}  // namespace deform::cli
