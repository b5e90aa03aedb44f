// SPDX-License-Identifier: Apache-2.0
#include "core/base/small_file.h"

#include <cerrno>
#include <cstring>
#include <fstream>

#include "core/base/error.h"

namespace deform {

std::string read_small_file(const std::filesystem::path& path, const std::string& option) {
  constexpr std::size_t most = std::size_t{4} << 20;
  const auto error = [&](const std::string& why) {
    return Error(ErrorCode::invalid_argument, option + ": " + path.string() + ": " + why);
  };
  std::ifstream in(path, std::ios::binary);
  if (!in) throw error(std::strerror(errno));
  std::string text(most + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (in.bad()) throw error("cannot be read");
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > most) throw error("larger than " + std::to_string(most) + " bytes");
  return text;
}

std::string why_unreadable(const std::filesystem::path& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) return std::strerror(EISDIR);
  errno = 0;
  if (std::ifstream(path, std::ios::binary)) return {};
  return errno != 0 ? std::strerror(errno) : "it cannot be opened";
}

}  // namespace deform
