// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/cad/program_with_cad.h"

#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "core/base/error.h"
#include "core/cad/availability.h"

namespace deform::cli {

void need_cad(const CommonOptions& common) {
  if (cad::available()) return;
  std::error_code error;
  const std::filesystem::path own = std::filesystem::read_symlink("/proc/self/exe", error);
  if (!error) {  // else a name alone would be looked for in the working folder
    std::vector<std::string> arguments = common.arguments;
    std::vector<char*> pointers;
    for (std::string& argument : arguments) pointers.push_back(argument.data());
    pointers.push_back(nullptr);
    execv((own.parent_path() / "deform-cad").c_str(), pointers.data());
    error.assign(errno, std::generic_category());
  }
  if (error != std::errc::no_such_file_or_directory) {
    throw Error(ErrorCode::failed_precondition, "deform-cad: " + error.message());
  }
#if DEFORM_WITH_CAD
  throw Error(ErrorCode::failed_precondition,
              "deform-cad does not lie beside deform: build both (cmake --build --preset programs), or install them together");
#else
  cad::require();
#endif
}

}  // namespace deform::cli
