// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/obj/new_obj.h"

#include <algorithm>

#include "core/io/assembly/coordinate_records.h"
#include "core/io/assembly/written_groups.h"

namespace deform::io {

namespace {

void append_group_points(std::string& out, const Mesh& mesh, const std::vector<std::string>& names) {
  for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
    const Group& group = mesh.groups[g];
    if (group.points.empty()) continue;
    out.append("g ").append(names[g]).append("\np");
    for (const PointId point : group.points) {
      out += ' ';
      out += std::to_string(std::uint64_t{point} + 1);
    }
    out += '\n';
  }
}

}  // namespace

std::string new_obj(const Mesh& mesh, const std::string&) {
  std::string out;
  for (const Vec3& point : mesh.points) {
    out += 'v';
    for (const double c : point) {
      out += ' ';
      append_number(out, c);
    }
    out += '\n';
  }
  const std::vector<std::string> names = writable_names(mesh, " #\\");  // white space separates names, # starts a comment
  append_group_points(out, mesh, names);
  const FaceMembership membership(mesh);
  std::span<const std::uint32_t> current;
  std::size_t corner = 0;
  for (std::size_t face = 0; face < mesh.face_count(); ++face) {
    const auto groups = membership.of(face);
    if (face == 0 ? !groups.empty() || !mesh.groups.empty()
                  : !std::equal(groups.begin(), groups.end(), current.begin(), current.end())) {
      out += 'g';
      for (const std::uint32_t g : groups) out.append(" ").append(names[g]);
      out += '\n';
    }
    current = groups;
    out += 'f';
    for (std::uint32_t i = 0; i < mesh.face_sizes[face]; ++i) {
      out += ' ';
      out += std::to_string(std::uint64_t{mesh.face_points[corner++]} + 1);
    }
    out += '\n';
  }
  return out;
}

}  // namespace deform::io
