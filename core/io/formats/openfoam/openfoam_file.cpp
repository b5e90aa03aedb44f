// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>

#include "core/base/error.h"
#include "core/io/assembly/face_groups.h"
#include "core/io/binary/byte_order.h"
#include "core/io/formats/openfoam/foam_mesh.h"
#include "core/io/formats/openfoam/foam_scanner.h"
#include "core/io/formats/openfoam/openfoam_folder.h"

namespace deform::io {

namespace {

using Kind = FaceGroups::Kind;

constexpr std::uint64_t any_label = std::numeric_limits<std::uint32_t>::max();

FoamPoints read_points(const FoamFiles::Part& part) {
  FoamScanner scanner(part.bytes, part.name);
  scanner.read_header();
  FoamPoints file;
  file.is_binary = scanner.binary();
  const std::size_t scalar = static_cast<std::size_t>(scanner.scalar_bytes());
  const std::size_t count = scanner.count("the number of points", file.is_binary ? 3 * scalar : 8);
  if (count == 0) scanner.fail("a mesh without points");
  file.points.resize(count);
  if (file.is_binary) {
    const std::string_view bytes = scanner.raw(count * 3 * scalar, "the points");
    file.binary.count = count;
    file.binary.base = static_cast<std::uint64_t>(bytes.data() - part.bytes.data());
    file.binary.record_stride = 3 * scalar;
    file.binary.per_block = std::numeric_limits<std::uint32_t>::max();
    file.binary.axis_offsets = {0, scalar, 2 * scalar};
    file.binary.scalar_bytes = static_cast<int>(scalar);
    file.binary.order = scanner.order();
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        const char* at = bytes.data() + (3 * i + k) * scalar;
        file.points[i][k] = scalar == 8
                                ? std::bit_cast<double>(load_scalar<std::uint64_t>(at, scanner.order()))
                                : static_cast<double>(std::bit_cast<float>(load_scalar<std::uint32_t>(at, scanner.order())));
      }
    }
    return file;
  }
  file.text.tokens.resize(count);
  scanner.expect('(', "the list of points");
  for (std::size_t i = 0; i < count; ++i) {
    scanner.expect('(', "a point");
    std::size_t positions[3];
    for (std::size_t k = 0; k < 3; ++k) {
      scanner.next();
      positions[k] = scanner.position();
      file.points[i][k] = scanner.number("a coordinate");
    }
    scanner.expect(')', "a point");
    file.text.tokens[i] = CoordinateTokens::at(positions, scanner);
  }
  scanner.expect(')', "the list of points");
  return file;
}

void read_faces(const FoamFiles::Part& part, std::size_t points, PolyhedralCells& cells) {
  FoamScanner scanner(part.bytes, part.name);
  scanner.read_header();
  if (scanner.binary()) {  // faceCompactList: offsets, then all corners
    const std::vector<std::uint32_t> offsets = scanner.labels("the offsets of the faces", any_label, any_label);
    cells.face_points = scanner.labels("a corner of a face", points, any_label);
    cells.face_offsets.assign(offsets.begin(), offsets.end());
    if (offsets.empty()) cells.face_offsets.push_back(0);
    if (cells.face_offsets.front() != 0 || cells.face_offsets.back() != cells.face_points.size() ||
        !std::is_sorted(cells.face_offsets.begin(), cells.face_offsets.end())) {
      scanner.fail("the offsets of the faces do not rise from 0 to the number of corners, " +
                   std::to_string(cells.face_points.size()));
    }
    return;
  }
  const std::size_t count = scanner.count("the number of faces", 4);
  cells.face_offsets.reserve(count + 1);
  cells.face_points.reserve(4 * count);
  scanner.expect('(', "the list of faces");
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t corners = scanner.count("the number of corners of a face", 2);
    scanner.expect('(', "a face");
    for (std::size_t c = 0; c < corners; ++c) cells.face_points.push_back(scanner.index("a corner of a face", points));
    scanner.expect(')', "a face");
    cells.face_offsets.push_back(cells.face_points.size());
  }
  scanner.expect(')', "the list of faces");
}

FoamPatch read_patch(FoamScanner& scanner, std::size_t faces) {
  FoamPatch patch;
  patch.name = scanner.word("the name of a patch");
  scanner.next();
  const std::size_t begin = scanner.position();
  scanner.expect('{', "a patch");
  while (!scanner.accept('}')) {
    const std::string_view key = scanner.word("a key of a patch");
    if (key == "nFaces") {
      patch.count = scanner.index("nFaces", any_label);
    } else if (key == "startFace") {
      patch.first = scanner.index("startFace", any_label);
    } else if (key == "type") {
      const std::string_view type = scanner.word("the type of a patch");
      patch.empty = type == "empty";
      patch.between_parts = type == "processor";
    } else if (key == "referPatch") {
      patch.cyclic = scanner.word("the name of a patch");
    } else if (key == "inGroups") {
      if (scanner.peek() != '(' && scanner.peek() != ';') scanner.integer("the number of groups");
      if (scanner.accept('(')) {
        while (!scanner.accept(')')) patch.groups.emplace_back(scanner.word("the name of a group"));
      }
    }
    scanner.skip_entry();
  }
  if (patch.first + patch.count > faces) {
    scanner.fail_at(begin, "patch \"" + patch.name + "\": faces " + std::to_string(patch.first) + " to " +
                               std::to_string(patch.first + patch.count) + " (exclusive), the mesh has " + std::to_string(faces));
  }
  return patch;
}

std::vector<FoamPatch> read_boundary(const FoamFiles::Part& part, std::size_t faces) {
  FoamScanner scanner(part.bytes, part.name);
  scanner.read_header();
  const std::size_t count = scanner.count("the number of patches", 4);
  scanner.expect('(', "the list of patches");
  std::vector<FoamPatch> patches;
  for (std::size_t i = 0; i < count; ++i) patches.push_back(read_patch(scanner, faces));
  scanner.expect(')', "the list of patches");
  return patches;
}

/// Every zone of the file; `key` holds the members, each in 0..limit-1.
std::vector<FoamZone> read_zones(const FoamFiles::Part& part, std::string_view key, std::uint64_t limit) {
  std::vector<FoamZone> zones;
  if (part.bytes.empty()) return zones;
  FoamScanner scanner(part.bytes, part.name);
  scanner.read_header();
  if (!scanner.next()) return zones;
  const std::size_t count = scanner.count("the number of zones", 4);
  if (scanner.peek() != '(') return zones;
  scanner.expect('(', "the list of zones");
  for (std::size_t i = 0; i < count; ++i) {
    const std::string name(scanner.word("the name of a zone"));
    scanner.expect('{', "a zone");
    std::vector<std::uint32_t> members;
    while (!scanner.accept('}')) {
      const std::string_view word = scanner.word("a key of a zone");
      if (word == key) {
        if (scanner.peek() == 'L') scanner.word("List<label>");
        members = scanner.labels("a member of the zone", limit, limit);
      } else if (word == "flipMap" && scanner.binary()) {
        if (scanner.peek() == 'L') scanner.word("List<bool>");
        const std::size_t flips = scanner.count("the number of flips", 1);
        if (flips > 0 || scanner.peek() == '(') scanner.raw(flips, "the flips");
      }
      scanner.skip_entry();
    }
    zones.push_back({name, std::move(members)});
  }
  return zones;
}

/// Old files have an entry for every face, with -1 for the boundary faces, which come last.
void drop_old_entries(const std::string& name, std::vector<std::uint32_t>& neighbour) {
  const auto boundary = std::find(neighbour.begin(), neighbour.end(), FoamScanner::minus_one);
  const auto internal =
      std::find_if(boundary, neighbour.end(), [](std::uint32_t cell) { return cell != FoamScanner::minus_one; });
  if (internal != neighbour.end()) {
    throw Error(ErrorCode::invalid_argument, name + ": face " + std::to_string(boundary - neighbour.begin()) +
                                                 " has no neighbour (-1) and stands before the internal face " +
                                                 std::to_string(internal - neighbour.begin()));
  }
  neighbour.erase(boundary, neighbour.end());
}

/// Every face has one or two cells, which limits allocations caused by numbers in the files.
void read_cells(const FoamFiles& files, PolyhedralCells& cells) {
  const std::size_t faces = cells.face_count();
  const auto read = [faces](const FoamFiles::Part& part, FoamScanner::MinusOne minus_one) {
    FoamScanner scanner(part.bytes, part.name);
    scanner.read_header();
    return scanner.labels("the cell of a face", 2 * faces, faces, minus_one);
  };
  cells.owner = read(files.owner, FoamScanner::MinusOne::refused);
  cells.neighbour = read(files.neighbour, FoamScanner::MinusOne::allowed);
  drop_old_entries(files.neighbour.name, cells.neighbour);
  if (cells.owner.size() != faces) {
    throw Error(ErrorCode::invalid_argument,
                files.owner.name + ": " + std::to_string(cells.owner.size()) + " owners for " + std::to_string(faces) + " faces");
  }
  for (const auto* sides : {&cells.owner, &cells.neighbour}) {
    for (const std::uint32_t cell : *sides) cells.cell_count = std::max<std::size_t>(cells.cell_count, std::size_t{cell} + 1);
  }
}

void check_patches(const FoamFiles::Part& part, const FoamMesh& mesh) {
  for (const FoamPatch& patch : mesh.patches) {
    if (patch.first >= mesh.cells.internal_faces()) continue;
    throw Error(ErrorCode::invalid_argument, part.name + ": patch \"" + patch.name + "\" begins at face " +
                                                 std::to_string(patch.first) + ", which is one of the " +
                                                 std::to_string(mesh.cells.internal_faces()) + " internal faces");
  }
}

/// Faces and groups of the boundary, and the points of zones inside.
class Assembly {
 public:
  explicit Assembly(FoamMesh mesh) : foam_(std::move(mesh)) {}

  std::shared_ptr<const Mesh> assemble() {
    for (std::size_t f = cells_.internal_faces(); f < cells_.face_count(); ++f) {
      const auto corners = cells_.face(f);
      mesh_->face_sizes.push_back(static_cast<std::uint32_t>(corners.size()));
      mesh_->face_points.insert(mesh_->face_points.end(), corners.begin(), corners.end());
    }
    mesh_->points = std::move(foam_.points.points);
    add_patches();
    add_zones();
    mesh_->groups = groups_.finish();
    mesh_->cells = std::make_shared<PolyhedralCells>(std::move(cells_));
    mesh_->validate();
    return mesh_;
  }

 private:
  void add_patches() {
    for (const FoamPatch& patch : foam_.patches) {
      add_patch(groups_.find_or_add(Kind::group, patch.name), patch);
      if (!patch.empty) continue;
      cells_.empty_faces.resize(cells_.face_count());
      std::fill_n(cells_.empty_faces.begin() + static_cast<std::ptrdiff_t>(patch.first), patch.count, 1);
    }
    for (const FoamPatch& patch : foam_.patches) {
      for (const std::string& group : patch.groups) add_patch(groups_.find_or_add(Kind::patch_group, group), patch);
    }
  }

  void add_patch(std::size_t group, const FoamPatch& patch) {
    for (std::uint64_t f = patch.first; f < patch.first + patch.count; ++f) {
      groups_.add_face(group, static_cast<FaceId>(f - cells_.internal_faces()));
    }
  }

  void add_zones() {
    for (const FoamZone& zone : foam_.point_zones) {
      const std::size_t group = groups_.find_or_add(Kind::point_zone, zone.name);
      for (const PointId point : zone.members) groups_.add_point(group, point);
    }
    for (const FoamZone& zone : foam_.face_zones) {
      const std::size_t group = groups_.find_or_add(Kind::face_zone, zone.name);
      for (const std::uint32_t face : zone.members) {
        if (face >= cells_.internal_faces()) {
          groups_.add_face(group, static_cast<FaceId>(face - cells_.internal_faces()));
        } else {
          for (const PointId point : cells_.face(face)) groups_.add_point(group, point);
        }
      }
    }
    for (const FoamZone& zone : foam_.cell_zones) {
      if (!zone.members.empty()) add_cells(groups_.find_or_add(Kind::cell_zone, zone.name), zone.members);
    }
  }

  /// All points of these cells.
  void add_cells(std::size_t group, const std::vector<std::uint32_t>& members) {
    std::vector<char> wanted(cells_.cell_count);
    for (const std::uint32_t cell : members) wanted[cell] = 1;
    for (std::size_t f = 0; f < cells_.face_count(); ++f) {
      if (!wanted[cells_.owner[f]] && !(f < cells_.internal_faces() && wanted[cells_.neighbour[f]])) continue;
      for (const PointId point : cells_.face(f)) groups_.add_point(group, point);
    }
  }

  FoamMesh foam_;
  PolyhedralCells& cells_ = foam_.cells;
  FaceGroups groups_;
  std::shared_ptr<Mesh> mesh_ = std::make_shared<Mesh>();
};

}  // namespace

FoamMesh read_foam_mesh(const FoamFiles& files) {
  FoamMesh mesh;
  mesh.points = read_points(files.points);
  const std::size_t points = mesh.points.points.size();
  read_faces(files.faces, points, mesh.cells);
  read_cells(files, mesh.cells);
  const std::size_t faces = mesh.cells.face_count();
  mesh.patches = read_boundary(files.boundary, faces);
  check_patches(files.boundary, mesh);
  mesh.point_zones = read_zones(files.point_zones, "pointLabels", points);
  mesh.face_zones = read_zones(files.face_zones, "faceLabels", faces);
  mesh.cell_zones = read_zones(files.cell_zones, "cellLabels", mesh.cells.cell_count);
  return mesh;
}

std::shared_ptr<const Mesh> assemble_mesh(FoamMesh mesh, const std::string& name) {
  try {
    return Assembly(std::move(mesh)).assemble();
  } catch (const Error& error) {
    throw Error(error.code(), name + ": " + error.what());
  }
}

std::unique_ptr<MeshFile> make_points_file(FoamPoints points, std::string bytes, std::shared_ptr<const Mesh> mesh,
                                           std::span<const PointId> record_points) {
  points.text.record_points = points.binary.record_points = record_points;
  return points.is_binary ? make_binary_mesh_file(Format::openfoam, std::move(bytes), std::move(mesh), std::move(points.binary))
                          : make_text_mesh_file(Format::openfoam, std::move(bytes), std::move(mesh), std::move(points.text));
}

std::unique_ptr<MeshFile> parse_openfoam(FoamFiles files) {
  FoamMesh foam = read_foam_mesh(files);
  FoamPoints records;
  records.text = std::move(foam.points.text);
  records.binary = std::move(foam.points.binary);
  records.is_binary = foam.points.is_binary;
  auto mesh = assemble_mesh(std::move(foam), files.points.name);
  return make_points_file(std::move(records), std::move(files.points.bytes), std::move(mesh), {});
}

std::size_t openfoam_point_count(const FoamFiles::Part& points) { return read_points(points).points.size(); }

}  // namespace deform::io
