// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/support/scipy_interpolator.h"

#include <sys/types.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

namespace deform::test {

namespace {

void write(const std::filesystem::path& path, const Points& rows) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(rows.data()), static_cast<std::streamsize>(rows.size() * sizeof(Vec3)));
}

std::string output_of(const std::string& command) {
  std::FILE* pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) return {};
  std::string output;
  char part[512];
  while (std::fgets(part, sizeof part, pipe) != nullptr) output += part;
  ::pclose(pipe);
  return output;
}

}  // namespace

SciPyResult interpolate_with_scipy(const std::string& python, const std::string& script, const Points& centres,
                                   const Points& values, const Points& points) {
  const auto folder = std::filesystem::temp_directory_path() / ("deform_scipy_" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  write(folder / "centres.f64", centres);
  write(folder / "values.f64", values);
  write(folder / "points.f64", points);
  SciPyResult result;
  const std::string output = output_of("\"" + python + "\" \"" + script + "\" \"" + folder.string() + "\" 2>&1");
  const auto json = nlohmann::json::parse(output, nullptr, false);
  if (json.is_discarded()) {
    result.error = output.empty() ? "no output" : output;
  } else {
    result.solve_seconds = json.at("solve");
    result.evaluate_seconds = json.at("evaluate");
    result.values.resize(points.size());
    std::ifstream file(folder / "result.f64", std::ios::binary);
    file.read(reinterpret_cast<char*>(result.values.data()), static_cast<std::streamsize>(points.size() * sizeof(Vec3)));
    if (!file) result.error = "the result is incomplete";
  }
  std::filesystem::remove_all(folder);
  return result;
}

}  // namespace deform::test
