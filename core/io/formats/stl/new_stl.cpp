// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/stl/new_stl.h"

#include <bit>
#include <cmath>
#include <cstring>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/assembly/written_groups.h"
#include "core/io/binary/byte_order.h"

namespace deform::io {

namespace {

Vec3 unit_normal(const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 n = cross(b - a, c - a);
  const double length = norm(n);
  return length > 0 ? n / length : Vec3{0, 0, 0};
}

void check_triangles(const Mesh& mesh, const std::string& name) {
  for (std::size_t face = 0; face < mesh.face_count(); ++face) {
    if (mesh.face_sizes[face] != 3) {
      throw Error(ErrorCode::invalid_argument, name + ": face " + std::to_string(face) + " has " +
                                                   std::to_string(mesh.face_sizes[face]) + " corners, STL holds triangles only");
    }
  }
}

void append_facet(std::string& out, const Vec3& normal, const Vec3* const (&corners)[3]) {
  const auto append = [&out](const char* keyword, const Vec3& v) {
    out += keyword;
    for (const double c : v) {
      out += ' ';
      append_number(out, c);
    }
    out += '\n';
  };
  append("facet normal", normal);
  out += " outer loop\n";
  for (const Vec3* corner : corners) append("  vertex", *corner);
  out += " endloop\nendfacet\n";
}

/// Text, one solid per group: binary STL has no names. A face of several groups goes to the first, faces of none to the end.
std::string stl_text(const Mesh& mesh) {
  const FaceMembership membership(mesh);
  const std::vector<std::string> names = writable_names(mesh, {});
  std::string out;
  const auto append_face = [&](FaceId face) {
    const Vec3* corners[3];
    for (int k = 0; k < 3; ++k) corners[k] = &mesh.points[mesh.face_points[3 * std::size_t{face} + k]];
    append_facet(out, unit_normal(*corners[0], *corners[1], *corners[2]), corners);
  };
  for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
    const Group& group = mesh.groups[g];
    if (group.faces.empty()) continue;
    out.append("solid ").append(names[g]).append("\n");
    for (const FaceId face : group.faces) {
      if (membership.of(face)[0] == g) append_face(face);
    }
    out.append("endsolid ").append(names[g]).append("\n");
  }
  std::vector<FaceId> unnamed;
  for (std::size_t face = 0; face < mesh.face_count(); ++face) {
    if (membership.of(face).empty()) unnamed.push_back(static_cast<FaceId>(face));
  }
  if (unnamed.empty()) return out;
  out += "solid\n";
  for (const FaceId face : unnamed) append_face(face);
  out += "endsolid\n";
  return out;
}

std::string stl_binary(const Mesh& mesh) {
  constexpr std::size_t header_bytes = 84, triangle_bytes = 50;
  std::string out(header_bytes + triangle_bytes * mesh.face_count(), '\0');
  std::memcpy(out.data(), "deformd", 7);
  store_scalar(out.data() + 80, static_cast<std::uint32_t>(mesh.face_count()), std::endian::little);
  for (std::size_t face = 0; face < mesh.face_count(); ++face) {
    const PointId* corners = &mesh.face_points[3 * face];
    const Vec3 rows[4] = {unit_normal(mesh.points[corners[0]], mesh.points[corners[1]], mesh.points[corners[2]]),
                          mesh.points[corners[0]], mesh.points[corners[1]], mesh.points[corners[2]]};
    char* at = out.data() + header_bytes + triangle_bytes * face;
    for (const Vec3& row : rows) {
      for (const double c : row) {
        store_scalar(at, std::bit_cast<std::uint32_t>(static_cast<float>(c)), std::endian::little);
        at += 4;
      }
    }
  }
  return out;
}

}  // namespace

std::string new_stl(const Mesh& mesh, const std::string& name) {
  check_triangles(mesh, name);
  return mesh.groups.empty() ? stl_binary(mesh) : stl_text(mesh);
}

}  // namespace deform::io
