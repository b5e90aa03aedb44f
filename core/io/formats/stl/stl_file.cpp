// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/assembly/corner_welder.h"
#include "core/io/assembly/face_groups.h"
#include "core/io/binary/byte_order.h"
#include "core/io/formats/stl/new_stl.h"
#include "core/io/readers.h"
#include "core/io/text/text_scanner.h"

namespace deform::io {

namespace {

constexpr std::size_t header_bytes = 84;    // 80 free bytes, then the number of triangles
constexpr std::size_t triangle_bytes = 50;  // normal, three corners, two attribute bytes

/// The normals that a file gives for its facets: those that are finite and not zero.
struct FacetNormals {
  std::vector<Vec3> values;
  std::vector<FaceId> facets;  ///< whose they are, ascending
};

/// The normals stand in the file like points behind those of the mesh: `whole` has both as its points. A facet whose corners did
/// not move keeps its normal, byte for byte; of the others it is that of the new corners, on the side where it was.
class StlFile : public MeshFile {
 public:
  StlFile(std::shared_ptr<const Mesh> mesh, std::unique_ptr<MeshFile> whole, FacetNormals normals)
      : MeshFile(Format::stl, std::move(mesh)), whole_(std::move(whole)), normals_(std::move(normals)) {}

  std::string with_points(std::span<const Vec3> points) const override {
    check_points(points, original_points().size());
    Points all(points.begin(), points.end());
    all.insert(all.end(), normals_.values.begin(), normals_.values.end());
    for (std::size_t k = 0; k < normals_.facets.size(); ++k) {
      const auto corners = std::span(mesh()->face_points).subspan(std::size_t{3} * normals_.facets[k], 3);
      const bool rests = std::all_of(corners.begin(), corners.end(), [&](PointId p) {
        return same_points(points.subspan(p, 1), std::span(original_points()).subspan(p, 1));
      });
      if (!rests)
        all[points.size() + k] = turned(normals_.values[k], normal(original_points(), corners), normal(points, corners));
    }
    return whole_->with_points(all);
  }

 private:
  /// Zero without an area.
  static Vec3 normal(std::span<const Vec3> points, std::span<const PointId> corners) {
    const Vec3 area = cross(points[corners[1]] - points[corners[0]], points[corners[2]] - points[corners[0]]);
    const double size = norm(area);
    return size > 0 ? (1 / size) * area : Vec3{};
  }

  static Vec3 turned(const Vec3& written, const Vec3& before, const Vec3& after) {
    return dot(written, before) < 0 ? Vec3{} - after : after;
  }

  const std::unique_ptr<MeshFile> whole_;
  const FacetNormals normals_;
};

/// The points of a mesh and its normals behind them, and which of them the records of the file are.
struct RecordedMesh : Mesh {
  std::vector<PointId> record_points;
};

/// solid NAME / facet normal i j k / outer loop / 3 x vertex x y z / endloop / endfacet / endsolid, any number of solids,
/// any case.
class StlTextReader {
 public:
  StlTextReader(std::string_view bytes, const std::string& name) : scanner_(bytes, name, Syntax::plain) {}

  void read() {
    for (std::size_t solid = 1; scanner_.next_in_file(); ++solid) {
      expect("solid");
      read_solid(solid);
    }
    if (mesh_->face_sizes.empty()) scanner_.fail("expected at least one facet, found none in the file");
    mesh_->points = welder_.take_points();
    mesh_->groups = groups_.finish();
  }

  std::shared_ptr<const Mesh> mesh() { return mesh_; }
  FacetNormals take_normals() { return std::move(normals_); }
  std::vector<CoordinateTokens> take_tokens() { return std::move(tokens_); }
  /// The records of the file, as indices into RecordedMesh.
  std::vector<PointId> record_points() const {
    std::vector<PointId> points;
    points.reserve(mesh_->face_points.size() + normals_.facets.size());
    for (std::size_t f = 0, next = 0; f < mesh_->face_count(); ++f) {
      if (next < normals_.facets.size() && normals_.facets[next] == f) {
        points.push_back(static_cast<PointId>(mesh_->point_count() + next++));
      }
      points.insert(points.end(), mesh_->face_points.begin() + static_cast<std::ptrdiff_t>(3 * f),
                    mesh_->face_points.begin() + static_cast<std::ptrdiff_t>(3 * f + 3));
    }
    return points;
  }

 private:
  void read_solid(std::size_t number) {
    const std::string_view name = scanner_.rest_of_line();
    const std::string group_name = name.empty() ? "solid_" + std::to_string(number) : std::string(name);
    const std::size_t group = groups_.find_or_add(FaceGroups::Kind::group, group_name);
    for (;;) {
      if (!scanner_.next_in_file()) scanner_.fail("expected \"facet\" or \"endsolid\", found the end of the file");
      if (scanner_.accept("endsolid")) {
        scanner_.skip_line();
        return;
      }
      expect("facet");
      read_facet(group);
    }
  }

  void read_facet(std::size_t group) {
    if (mesh_->face_sizes.size() == most_ids) scanner_.fail("more than " + std::to_string(most_ids) + " facets");
    read_normal();
    while (scanner_.next_in_file() && !scanner_.accept("outer")) {
      if (scanner_.accept("vertex") || scanner_.accept("endfacet"))
        scanner_.fail("expected \"outer loop\" before the vertices of a facet");
      step_over_word();
    }
    expect("loop");
    for (int corner = 0; corner < 3; ++corner) {
      expect("vertex");
      read_corner();
    }
    if (scanner_.next_in_file() && scanner_.accept("vertex")) scanner_.fail("a facet with more than 3 vertices");
    expect("endloop");
    expect("endfacet");
    groups_.add_face(group, static_cast<FaceId>(mesh_->face_sizes.size()));
    mesh_->face_sizes.push_back(3);
  }

  /// Some programs write nan, some nothing: such a normal stays as it is.
  void read_normal() {
    if (!scanner_.next_in_file() || !scanner_.accept("normal")) return;
    Vec3 value;
    std::size_t positions[3];
    for (int k = 0; k < 3; ++k) {
      if (!scanner_.next_in_file()) return;
      positions[k] = scanner_.position();
      const std::string_view word = scanner_.word();
      const char* begin = word.data() + (word.starts_with('+') ? 1 : 0);
      const auto [end, error] = std::from_chars(begin, word.data() + word.size(), value[k]);
      if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value[k]))
        return scanner_.move_to(positions[k]);
    }
    if (value == Vec3{}) return;
    normals_.values.push_back(value);
    normals_.facets.push_back(static_cast<FaceId>(mesh_->face_sizes.size()));
    tokens_.push_back(CoordinateTokens::at(positions, scanner_));
  }

  void read_corner() {
    Vec3 place;
    std::size_t positions[3];
    for (int k = 0; k < 3; ++k) {
      if (!scanner_.next_in_file()) scanner_.fail("expected a vertex coordinate, found the end of the file");
      positions[k] = scanner_.position();
      place[k] = scanner_.number("vertex coordinate");
    }
    if (welder_.point_count() == most_ids) scanner_.fail("more than " + std::to_string(most_ids) + " points");
    mesh_->face_points.push_back(welder_.weld(place));
    tokens_.push_back(CoordinateTokens::at(positions, scanner_));
  }

  void step_over_word() {
    if (scanner_.word().empty()) scanner_.advance(1);  // a lone delimiter character
  }

  void expect(const char* keyword) {
    if (scanner_.next_in_file() && scanner_.accept(keyword)) return;
    scanner_.fail(std::string("expected \"") + keyword + "\", found " + scanner_.quoted());
  }

  TextScanner scanner_;
  std::shared_ptr<Mesh> mesh_ = std::make_shared<Mesh>();
  CornerWelder welder_;
  std::vector<CoordinateTokens> tokens_;  // of normals and corners, in file order
  FacetNormals normals_;
  FaceGroups groups_;
};

std::unique_ptr<MeshFile> parse_text(std::string bytes, const std::string& name) {
  StlTextReader reader(bytes, name);
  reader.read();
  auto whole = std::make_shared<RecordedMesh>();
  whole->record_points = reader.record_points();
  FacetNormals normals = reader.take_normals();
  whole->points = reader.mesh()->points;
  whole->points.insert(whole->points.end(), normals.values.begin(), normals.values.end());
  TextRecords records;
  records.tokens = reader.take_tokens();
  records.record_points = whole->record_points;
  auto file = make_text_mesh_file(Format::stl, std::move(bytes), std::move(whole), std::move(records));
  return std::make_unique<StlFile>(reader.mesh(), std::move(file), std::move(normals));
}

std::unique_ptr<MeshFile> parse_binary(std::string bytes, const std::string& name, std::uint32_t triangles) {
  BinaryRecords corners;
  corners.count = 3 * std::uint64_t{triangles};
  corners.base = header_bytes + 12;
  corners.block_stride = triangle_bytes;
  corners.record_stride = 12;
  corners.per_block = 3;

  auto mesh = std::make_shared<Mesh>();
  mesh->face_sizes.assign(triangles, 3);
  mesh->face_points.resize(corners.count);
  CornerWelder welder;
  const auto number = [&](std::size_t at) {
    return static_cast<double>(std::bit_cast<float>(load_scalar<std::uint32_t>(bytes.data() + at, corners.order)));
  };
  for (std::uint64_t corner = 0; corner < corners.count; ++corner) {
    Vec3 place;
    for (int k = 0; k < 3; ++k) {
      const std::size_t at = corners.offset(corner, k);
      place[k] = number(at);
      if (!std::isfinite(place[k])) {
        throw Error(ErrorCode::invalid_argument, name + ": byte " + std::to_string(at) + ": coordinate " + "xyz"[k] +
                                                     " of triangle " + std::to_string(corner / 3) + " is not a finite number");
      }
    }
    mesh->face_points[corner] = welder.weld(place);
    if (welder.point_count() > most_ids) throw Error(ErrorCode::invalid_argument, name + ": too many different points");
  }
  mesh->points = welder.take_points();

  auto whole = std::make_shared<RecordedMesh>();
  whole->points = mesh->points;
  FacetNormals normals;
  BinaryRecords records = corners;
  records.base = header_bytes;
  records.per_block = 4;
  records.count = 4 * std::uint64_t{triangles};
  whole->record_points.reserve(records.count);
  for (std::uint32_t f = 0; f < triangles; ++f) {
    const std::size_t at = header_bytes + triangle_bytes * std::size_t{f};
    const Vec3 value{number(at), number(at + 4), number(at + 8)};
    const bool used = value != Vec3{} && std::isfinite(value[0]) && std::isfinite(value[1]) && std::isfinite(value[2]);
    if (used) {
      normals.values.push_back(value);
      normals.facets.push_back(f);
      whole->points.push_back(value);
    }
    whole->record_points.push_back(used ? static_cast<PointId>(whole->points.size() - 1) : fixed_record);
    for (std::size_t c = 0; c < 3; ++c) whole->record_points.push_back(mesh->face_points[3 * std::size_t{f} + c]);
  }
  records.record_points = whole->record_points;
  auto file = make_binary_mesh_file(Format::stl, std::move(bytes), std::move(whole), std::move(records));
  return std::make_unique<StlFile>(std::move(mesh), std::move(file), std::move(normals));
}

bool begins_with_solid(std::string_view bytes) {
  const std::string unnamed;
  TextScanner scanner(bytes, unnamed, Syntax::plain);
  return scanner.next_in_file() && scanner.accept("solid");
}

std::unique_ptr<MeshFile> parse_stl(std::string bytes, const std::string& name) {
  if (bytes.empty()) throw Error(ErrorCode::invalid_argument, name + ": line 1: expected an STL file, the file is empty");
  // The size decides, not the first word: many binary headers begin with "solid", and the four count bytes of a text file, read
  // as a number, never fit its size.
  const bool has_count = bytes.size() >= header_bytes;
  const std::uint32_t triangles = has_count ? load_scalar<std::uint32_t>(bytes.data() + 80, std::endian::little) : 0;
  const std::uint64_t expected = header_bytes + triangle_bytes * std::uint64_t{triangles};
  if (has_count && expected == bytes.size()) {
    if (triangles == 0)
      throw Error(ErrorCode::invalid_argument, name + ": byte 80: the file has 0 triangles, at least 1 is needed");
    return parse_binary(std::move(bytes), name, triangles);
  }
  const bool has_nul = bytes.find('\0') != std::string::npos;
  if (!has_nul && begins_with_solid(bytes)) return parse_text(std::move(bytes), name);
  if (!has_count) {
    throw Error(ErrorCode::invalid_argument,
                name + ": byte 0: expected \"solid\" or a binary STL file of at least 84 bytes, found " +
                    std::to_string(bytes.size()) + " bytes");
  }
  throw Error(ErrorCode::invalid_argument, name + ": byte 80: expected \"solid\" at the start or a binary STL file; " +
                                               std::to_string(triangles) + " triangles need " + std::to_string(expected) +
                                               " bytes, found " + std::to_string(bytes.size()));
}

}  // namespace

Reader stl_reader() {
  return {.format = Format::stl, .name = "STL", .extensions = {".stl"}, .parse = parse_stl, .new_file = new_stl};
}

}  // namespace deform::io
