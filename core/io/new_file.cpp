#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <unordered_set>

#include "core/base/error.h"
#include "core/io/binary/byte_order.h"
#include "core/io/file_format.h"
#include "core/io/mesh_file.h"

namespace deform::io {

namespace {

void append_number(std::string& out, double value) {
  char buffer[32];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value).ptr;
  out.append(buffer, end);
}

void append_number(std::string& out, std::uint64_t value) {
  char buffer[24];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value).ptr;
  out.append(buffer, end);
}

/// Names as the format can hold them, still different from one another: `reserved` characters become underscores.
std::vector<std::string> writable_names(const Mesh& mesh, std::string_view reserved) {
  std::vector<std::string> names;
  std::unordered_set<std::string> taken;
  for (const Group& group : mesh.groups) {
    std::string name = group.name;
    for (char& c : name) {
      if ((c >= 0 && c < ' ') || reserved.find(c) != std::string_view::npos) c = '_';
    }
    const std::string first = name;
    for (int copy = 2; !taken.insert(name).second; ++copy) name = first + "_" + std::to_string(copy);
    names.push_back(name);
  }
  return names;
}

/// For each face the groups that hold it, as one compressed list.
class FaceMembership {
 public:
  explicit FaceMembership(const Mesh& mesh) : offsets_(mesh.face_count() + 1, 0) {
    for (const Group& group : mesh.groups) {
      for (const FaceId face : group.faces) ++offsets_[face + 1];
    }
    for (std::size_t i = 1; i < offsets_.size(); ++i) offsets_[i] += offsets_[i - 1];
    groups_.resize(offsets_.back());
    std::vector<std::uint64_t> next(offsets_.begin(), offsets_.end() - 1);
    for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
      for (const FaceId face : mesh.groups[g].faces) groups_[next[face]++] = static_cast<std::uint32_t>(g);
    }
  }
  std::span<const std::uint32_t> of(std::size_t face) const {
    return {groups_.data() + offsets_[face], groups_.data() + offsets_[face + 1]};
  }

 private:
  std::vector<std::uint64_t> offsets_;
  std::vector<std::uint32_t> groups_;
};

void append_group_points(std::string& out, const Mesh& mesh, const std::vector<std::string>& names) {
  for (std::size_t g = 0; g < mesh.groups.size(); ++g) {
    const Group& group = mesh.groups[g];
    if (group.points.empty()) continue;
    out.append("g ").append(names[g]).append("\np");
    for (const PointId point : group.points) {
      out += ' ';
      append_number(out, std::uint64_t{point} + 1);
    }
    out += '\n';
  }
}

std::string obj_bytes(const Mesh& mesh) {
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
      append_number(out, std::uint64_t{mesh.face_points[corner++]} + 1);
    }
    out += '\n';
  }
  return out;
}

Vec3 unit_normal(const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 u{b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v{c[0] - a[0], c[1] - a[1], c[2] - a[2]};
  const Vec3 n{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
  const double length = std::hypot(n[0], n[1], n[2]);
  return length > 0 ? Vec3{n[0] / length, n[1] / length, n[2] / length} : Vec3{0, 0, 0};
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

void write_new_file(const Mesh& mesh, const std::filesystem::path& path) {
  const Format format = format_of(path.string());
  mesh.validate();
  if (format == Format::obj) {
    write_file(path, obj_bytes(mesh));
  } else if (format == Format::stl) {
    check_triangles(mesh, path.string());
    write_file(path, mesh.groups.empty() ? stl_binary(mesh) : stl_text(mesh));
  } else {
    throw Error(ErrorCode::invalid_argument,
                path.string() + ": new files are written as .obj or .stl, not as " + to_string(format));
  }
}

}  // namespace deform::io
