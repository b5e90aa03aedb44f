// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/cad/program_with_cad.h"

#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>
#include <vector>

#include "core/base/error.h"
#include "core/cad/availability.h"

namespace deform::cli {

namespace {

/// As this process was started, with its name.
std::vector<std::string> own_arguments() {
  std::ifstream file("/proc/self/cmdline", std::ios::binary);
  std::vector<std::string> arguments;
  for (std::string argument; std::getline(file, argument, '\0');) arguments.push_back(argument);
  return arguments;
}

}  // namespace

void need_cad() {
  if (cad::available()) return;
  std::error_code none;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", none).replace_filename("deform-cad");
  std::vector<std::string> arguments = own_arguments();
  std::vector<char*> pointers;
  for (std::string& argument : arguments) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  execv(program.c_str(), pointers.data());
  const int reason = errno;
  if (reason != ENOENT) throw Error(ErrorCode::failed_precondition, "deform-cad: " + std::generic_category().message(reason));
#if DEFORM_WITH_CAD
  throw Error(
      ErrorCode::failed_precondition,
      "the program deform-cad does not lie beside deform: build its target, programs, or install the component tools again");
#else
  cad::require();
#endif
}

}  // namespace deform::cli
