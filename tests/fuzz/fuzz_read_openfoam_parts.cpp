// SPDX-License-Identifier: GPL-3.0-or-later
// Two parts of a decomposed case, their files separated by the byte 0x1f: points, faces, owner, neighbour, boundary, point, face
// and cell zones, addresses of points, faces and cells; then those of the second part. What is accepted is a mesh of the points
// of both.
#include "core/base/error.h"
#include "core/io/formats/openfoam/whole_mesh.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using deform::io::FoamFiles;
  std::string_view rest(reinterpret_cast<const char*>(data), size);
  const auto next = [&]() -> FoamFiles::Part {
    const std::size_t end = std::min(rest.find('\x1f'), rest.size());
    FoamFiles::Part part{std::string(rest.substr(0, end)), "part"};
    rest.remove_prefix(std::min(end + 1, rest.size()));
    return part;
  };
  try {
    std::vector<deform::io::CasePart> parts;
    for (int i = 0; i < 2; ++i) {
      FoamFiles files;
      for (FoamFiles::Part* part : {&files.points, &files.faces, &files.owner, &files.neighbour, &files.boundary,
                                    &files.point_zones, &files.face_zones, &files.cell_zones}) {
        *part = next();
      }
      deform::io::CaseAddresses addresses;
      for (FoamFiles::Part* part : {&addresses.points, &addresses.faces, &addresses.cells}) *part = next();
      parts.push_back(deform::io::parse_case_part(std::move(files), addresses));
    }
    const auto mesh = deform::io::assemble_mesh(deform::io::whole_mesh(parts), "parts");
    for (const auto& part : parts) {
      for (const deform::PointId point : part.points) {
        if (point >= mesh->point_count()) __builtin_trap();
      }
    }
  } catch (const deform::Error&) {
  }
  return 0;
}
