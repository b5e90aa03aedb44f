// SPDX-License-Identifier: Apache-2.0
#include <bit>
#include <cmath>
#include <limits>

#include "core/base/error.h"
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
constexpr std::uint64_t max_ids = std::numeric_limits<std::uint32_t>::max();

/// solid NAME / facet normal i j k / outer loop / 3 x vertex x y z / endloop / endfacet / endsolid, any number of solids, any
/// case.
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
    records_.record_points = mesh_->face_points;
  }

  std::shared_ptr<const Mesh> mesh() { return mesh_; }
  TextRecords take_records() { return std::move(records_); }

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
    if (mesh_->face_sizes.size() == max_ids) scanner_.fail("more than " + std::to_string(max_ids) + " facets");
    // The normal is not used and stays as it is: some programs write nan, some nothing.
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

  void read_corner() {
    Vec3 place;
    std::size_t positions[3];
    for (int k = 0; k < 3; ++k) {
      if (!scanner_.next_in_file()) scanner_.fail("expected a vertex coordinate, found the end of the file");
      positions[k] = scanner_.position();
      place[k] = scanner_.number("vertex coordinate");
    }
    if (welder_.point_count() == max_ids) scanner_.fail("more than " + std::to_string(max_ids) + " points");
    mesh_->face_points.push_back(welder_.weld(place));
    records_.tokens.push_back(CoordinateTokens::at(positions, scanner_));
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
  TextRecords records_;
  FaceGroups groups_;
};

std::unique_ptr<MeshFile> parse_text(std::string bytes, const std::string& name) {
  StlTextReader reader(bytes, name);
  reader.read();
  return make_text_mesh_file(Format::stl, std::move(bytes), reader.mesh(), reader.take_records());
}

std::unique_ptr<MeshFile> parse_binary(std::string bytes, const std::string& name, std::uint32_t triangles) {
  BinaryRecords records;
  records.count = 3 * std::uint64_t{triangles};
  records.base = header_bytes + 12;
  records.block_stride = triangle_bytes;
  records.record_stride = 12;
  records.per_block = 3;

  auto mesh = std::make_shared<Mesh>();
  mesh->face_sizes.assign(triangles, 3);
  mesh->face_points.resize(records.count);
  CornerWelder welder;
  for (std::uint64_t corner = 0; corner < records.count; ++corner) {
    Vec3 place;
    for (int k = 0; k < 3; ++k) {
      const std::size_t at = records.offset(corner, k);
      place[k] = std::bit_cast<float>(load_scalar<std::uint32_t>(bytes.data() + at, records.order));
      if (!std::isfinite(place[k])) {
        throw Error(ErrorCode::invalid_argument, name + ": byte " + std::to_string(at) + ": coordinate " + "xyz"[k] +
                                                     " of triangle " + std::to_string(corner / 3) + " is not a finite number");
      }
    }
    mesh->face_points[corner] = welder.weld(place);
    if (welder.point_count() > max_ids) throw Error(ErrorCode::invalid_argument, name + ": too many different points");
  }
  mesh->points = welder.take_points();
  records.record_points = mesh->face_points;
  return make_binary_mesh_file(Format::stl, std::move(bytes), std::move(mesh), std::move(records));
}

bool begins_with_solid(std::string_view bytes) {
  const std::string unnamed;
  TextScanner scanner(bytes, unnamed, Syntax::plain);
  return scanner.next_in_file() && scanner.accept("solid");
}

std::unique_ptr<MeshFile> parse(std::string bytes, const std::string& name) {
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
  return {.format = Format::stl, .name = "STL", .extensions = {".stl"}, .parse = parse, .new_file = new_stl};
}

}  // namespace deform::io
