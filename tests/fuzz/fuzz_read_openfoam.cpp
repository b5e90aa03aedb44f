// SPDX-License-Identifier: GPL-3.0-or-later
// The files of a polyMesh, separated by the byte 0x1f: points, faces, owner, neighbour, boundary, point, face and cell zones.
#include "core/io/formats/openfoam/openfoam_folder.h"
#include "tests/fuzz/read_and_write_back.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using deform::io::FoamFiles;
  FoamFiles files;
  FoamFiles::Part* const parts[] = {&files.points,   &files.faces,       &files.owner,      &files.neighbour,
                                    &files.boundary, &files.point_zones, &files.face_zones, &files.cell_zones};
  std::string_view rest(reinterpret_cast<const char*>(data), size);
  for (FoamFiles::Part* part : parts) {
    const std::size_t end = std::min(rest.find('\x1f'), rest.size());
    *part = {std::string(rest.substr(0, end)), "part"};
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  deform::fuzz::check_reader(files.points.bytes, [&](const std::string& points) {
    FoamFiles with = files;
    with.points.bytes = points;
    return deform::io::parse_openfoam(std::move(with));
  });
  return 0;
}
