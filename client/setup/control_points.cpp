// SPDX-License-Identifier: Apache-2.0
#include "client/setup/control_points.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "client/setup/csv.h"
#include "client/setup/refuse.h"
#include "core/base/types.h"
#include "core/io/mesh_file.h"

namespace deform::client {

namespace {

std::vector<Vec3> places_in_csv(const std::filesystem::path& path) {
  const Csv csv = read_csv(path);
  std::array<std::size_t, 3> columns{};
  for (std::size_t k = 0; k < 3; ++k) {
    const std::string name(1, "xyz"[k]);
    const auto found = std::find(csv.header.begin(), csv.header.end(), name);
    if (found == csv.header.end()) refuse(path.string() + ": the header has no column \"" + name + "\"");
    columns[k] = static_cast<std::size_t>(found - csv.header.begin());
  }
  std::vector<Vec3> places;
  for (const auto& row : csv.rows) {
    places.push_back({csv.number(row, columns[0]), csv.number(row, columns[1]), csv.number(row, columns[2])});
  }
  return places;
}

}  // namespace

std::string read_control_points(const std::filesystem::path& path) {
  const std::vector<Vec3> places = path.extension() == ".csv" ? places_in_csv(path) : io::read_mesh_file(path)->mesh()->points;
  if (places.empty()) refuse(path.string() + ": holds no control point");
  std::string bytes(places.size() * sizeof(Vec3), '\0');
  std::memcpy(bytes.data(), places.data(), bytes.size());
  return bytes;
}

}  // namespace deform::client
