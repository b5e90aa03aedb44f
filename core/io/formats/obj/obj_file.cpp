// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>

#include "core/io/assembly/coordinate_records.h"
#include "core/io/assembly/face_groups.h"
#include "core/io/formats/obj/new_obj.h"
#include "core/io/readers.h"
#include "core/io/text/text_scanner.h"

namespace deform::io {

namespace {

constexpr std::uint64_t max_ids = std::numeric_limits<std::uint32_t>::max();
constexpr std::size_t max_names_per_line = 64;  // limits the cost of one face

/// Wavefront OBJ: v, f, g, o, usemtl, and the points of p and l; everything else is stepped over and stays in the file.
class ObjReader {
 public:
  ObjReader(std::string_view bytes, const std::string& name) : scanner_(bytes, name, Syntax::obj) {}

  void read() {
    while (scanner_.next_in_file()) {
      read_statement();
      scanner_.skip_line();
    }
    if (mesh_->points.empty()) scanner_.fail("expected at least one vertex (v x y z), found none in the file");
    if (largest_index_ > mesh_->points.size()) {
      scanner_.fail_at(largest_index_at_, "vertex index " + std::to_string(largest_index_) + " is out of range, the file has " +
                                              std::to_string(mesh_->points.size()) + " vertices");
    }
    mesh_->groups = groups_.finish();
  }

  std::shared_ptr<const Mesh> mesh() { return mesh_; }
  TextRecords take_records() { return std::move(records_); }

 private:
  void read_statement() {
    const std::string_view keyword = scanner_.word();
    if (keyword == "v") {
      read_vertex();
    } else if (keyword == "f") {
      read_face();
    } else if (keyword == "g") {
      read_group_names();
    } else if (keyword == "o") {
      object_ = read_name(FaceGroups::Kind::object);
    } else if (keyword == "usemtl") {
      material_ = read_name(FaceGroups::Kind::material);
    } else if (keyword == "p" || keyword == "l") {
      read_points_of_groups();
    }
  }

  void read_vertex() {
    if (mesh_->points.size() == max_ids) scanner_.fail("more than " + std::to_string(max_ids) + " vertices");
    Vec3 point;
    std::size_t positions[3];
    for (int k = 0; k < 3; ++k) {
      if (!scanner_.next_in_line()) scanner_.fail("expected 3 vertex coordinates, found " + std::to_string(k));
      positions[k] = scanner_.position();
      point[k] = scanner_.number("vertex coordinate");
    }
    mesh_->points.push_back(point);
    records_.tokens.push_back(CoordinateTokens::at(positions, scanner_));
  }

  void read_face() {
    if (mesh_->face_sizes.size() == max_ids) scanner_.fail("more than " + std::to_string(max_ids) + " faces");
    const std::size_t first = mesh_->face_points.size();
    while (scanner_.next_in_line()) mesh_->face_points.push_back(read_corner());
    const std::size_t size = mesh_->face_points.size() - first;
    if (size == 0) scanner_.fail("expected the vertex indices of a face, found none");
    if (size > max_ids) scanner_.fail("a face with more than " + std::to_string(max_ids) + " corners");
    const auto face = static_cast<FaceId>(mesh_->face_sizes.size());
    mesh_->face_sizes.push_back(static_cast<std::uint32_t>(size));
    for (const std::size_t group : named_) groups_.add_face(group, face);
    if (object_ != none) groups_.add_face(object_, face);
    if (material_ != none) groups_.add_face(material_, face);
  }

  void read_points_of_groups() {
    while (scanner_.next_in_line()) {
      const PointId point = read_corner();
      for (const std::size_t group : named_) groups_.add_point(group, point);
      if (object_ != none) groups_.add_point(object_, point);
      if (material_ != none) groups_.add_point(material_, point);
    }
  }

  /// v, v/vt, v//vn or v/vt/vn; a part after a slash may be missing.
  PointId read_corner() {
    const std::size_t at = scanner_.position();
    const PointId point = resolve(scanner_.integer("vertex index"), at);
    for (int part = 0; part < 2 && scanner_.peek() == '/'; ++part) {
      scanner_.advance(1);
      const char c = scanner_.peek();
      if (c != '/' && !scanner_.at_end() && !is_delimiter(c)) scanner_.integer("texture or normal index");
    }
    if (!scanner_.at_end() && !is_delimiter(scanner_.peek())) {
      scanner_.move_to(at);
      scanner_.fail("expected a face corner like 1, 1/2, 1//3 or 1/2/3, found " + scanner_.quoted());
    }
    return point;
  }

  PointId resolve(std::int64_t index, std::size_t at) {
    const std::uint64_t count = mesh_->points.size();
    if (index < 0) {
      // -1 is the vertex read last; negated without overflow.
      const std::uint64_t back = std::uint64_t{0} - static_cast<std::uint64_t>(index);
      if (back > count) {
        scanner_.fail_at(at, "relative vertex index " + std::to_string(index) + " is out of range, only " +
                                 std::to_string(count) + " vertices stand before this line");
      }
      return static_cast<PointId>(count - back);
    }
    if (index == 0) scanner_.fail_at(at, "vertex index 0 is out of range, OBJ counts from 1");
    const auto absolute = static_cast<std::uint64_t>(index);
    if (absolute > max_ids) {
      scanner_.fail_at(at, "vertex index " + std::to_string(index) + " is out of range, the limit is " + std::to_string(max_ids));
    }
    if (absolute > largest_index_) {  // may refer to a vertex further down: judged at the end
      largest_index_ = absolute;
      largest_index_at_ = at;
    }
    return static_cast<PointId>(absolute - 1);
  }

  void read_group_names() {
    named_.clear();
    while (scanner_.next_in_line()) {
      const std::size_t start = scanner_.position();
      const std::size_t group = groups_.find_or_add(FaceGroups::Kind::group, scanner_.name());
      if (std::find(named_.begin(), named_.end(), group) != named_.end()) continue;
      if (named_.size() == max_names_per_line) {
        scanner_.fail_at(start, "more than " + std::to_string(max_names_per_line) + " group names on one line");
      }
      named_.push_back(group);
    }
  }

  std::size_t read_name(FaceGroups::Kind kind) {
    const std::string_view name = scanner_.rest_of_line();
    return name.empty() ? none : groups_.find_or_add(kind, name);
  }

  static constexpr std::size_t none = ~std::size_t{0};

  TextScanner scanner_;
  std::shared_ptr<Mesh> mesh_ = std::make_shared<Mesh>();
  TextRecords records_;
  FaceGroups groups_;
  std::vector<std::size_t> named_;  // groups of the latest g line
  std::size_t object_ = none, material_ = none;
  std::uint64_t largest_index_ = 0;
  std::size_t largest_index_at_ = 0;
};

std::unique_ptr<MeshFile> parse(std::string bytes, const std::string& name) {
  ObjReader reader(bytes, name);
  reader.read();
  return make_text_mesh_file(Format::obj, std::move(bytes), reader.mesh(), reader.take_records());
}

}  // namespace

Reader obj_reader() {
  return {.format = Format::obj, .name = "OBJ", .extensions = {".obj"}, .parse = parse, .new_file = new_obj};
}

}  // namespace deform::io
