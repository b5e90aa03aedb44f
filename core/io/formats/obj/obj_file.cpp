// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <cmath>

#include "core/base/vectors.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/assembly/face_groups.h"
#include "core/io/formats/obj/new_obj.h"
#include "core/io/readers.h"
#include "core/io/text/text_scanner.h"

namespace deform::io {

namespace {

constexpr std::size_t max_names_per_line = 64;  // limits the cost of one face

/// The vertex normals of a file, and which corners of faces have them.
struct VertexNormals {
  std::vector<Vec3> values;              ///< of those that are finite and not zero: the others stay as they are
  std::vector<std::uint32_t> of_corner;  ///< per corner of all faces: 1 + its normal, 0: none
  std::vector<PointId> record_points;    ///< per v and vn in file order: which one, normals behind all points
};

/// An OBJ file whose normals stand in it like points behind those of the mesh: `whole` has both.
class TurningObjFile : public MeshFile {
 public:
  TurningObjFile(std::shared_ptr<const Mesh> mesh, std::unique_ptr<MeshFile> whole, VertexNormals normals)
      : MeshFile(Format::obj, std::move(mesh)), whole_(std::move(whole)), normals_(std::move(normals)) {}

  std::string with_points(std::span<const Vec3> points) const override {
    check_points(points, original_points().size());
    const std::size_t count = normals_.values.size();
    std::vector<Vec3> before(count), after(count);
    std::vector<char> moves(count, 0);
    std::size_t first = 0;
    for (const std::uint32_t size : mesh()->face_sizes) {
      const auto corners = std::span(mesh()->face_points).subspan(first, size);
      const auto named = std::span(normals_.of_corner).subspan(first, size);
      first += size;
      if (std::all_of(named.begin(), named.end(), [](std::uint32_t k) { return k == 0; })) continue;
      const bool rests = std::all_of(corners.begin(), corners.end(), [&](PointId p) {
        return same_points(points.subspan(p, 1), std::span(original_points()).subspan(p, 1));
      });
      const Vec3 area_before = area_vector(original_points(), corners), area_after = area_vector(points, corners);
      for (const std::uint32_t k : named) {
        if (k == 0) continue;
        before[k - 1] = before[k - 1] + area_before;
        after[k - 1] = after[k - 1] + area_after;
        if (!rests) moves[k - 1] = 1;
      }
    }
    Points all(points.begin(), points.end());
    for (std::size_t k = 0; k < count; ++k) {
      all.push_back(moves[k] ? turned(normals_.values[k], before[k], after[k]) : normals_.values[k]);
    }
    return whole_->with_points(all);
  }

 private:
  static Vec3 area_vector(std::span<const Vec3> points, std::span<const PointId> corners) {
    Vec3 sum{};
    for (std::size_t k = 1; k + 1 < corners.size(); ++k) {
      sum = sum + cross(points[corners[k]] - points[corners[0]], points[corners[k + 1]] - points[corners[0]]);
    }
    return sum;
  }

  /// By the least rotation from the direction of one vector to that of the other.
  static Vec3 turned(const Vec3& normal, const Vec3& before, const Vec3& after) {
    const double a = norm(before), b = norm(after);
    if (!(a > 0 && b > 0 && std::isfinite(a) && std::isfinite(b))) return normal;
    const Vec3 from = (1 / a) * before, to = (1 / b) * after, sum = from + to;
    const double scale = 1 + dot(from, to);
    constexpr double opposite = 1e-12;
    if (scale < opposite) return Vec3{} - normal;
    return normal - (dot(sum, normal) / scale) * sum + (2 * dot(from, normal)) * to;
  }

  const std::unique_ptr<MeshFile> whole_;
  const VertexNormals normals_;
};

enum class Normals { stay, turn };

/// Wavefront OBJ: v, f, g, o, usemtl, and the points of p and l; everything else is stepped over and stays in the file.
class ObjReader {
 public:
  ObjReader(std::string_view bytes, const std::string& name, Normals normals)
      : scanner_(bytes, name, Syntax::obj), normals_(normals) {}

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
  /// After read(), with Normals::turn.
  VertexNormals take_normals() {
    const auto points = static_cast<PointId>(mesh_->points.size());
    std::uint32_t next_point = 0, next_normal = 0;
    for (const bool is_normal : record_is_normal_) {
      vertex_normals_.record_points.push_back(is_normal ? points + next_normal++ : next_point++);
    }
    for (std::uint32_t& k : vertex_normals_.of_corner) k = k == 0 || k > usable_.size() ? 0 : usable_[k - 1];
    return std::move(vertex_normals_);
  }

 private:
  void read_statement() {
    const std::string_view keyword = scanner_.word();
    if (keyword == "v") {
      read_vertex();
    } else if (keyword == "vn" && normals_ == Normals::turn) {
      read_normal();
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
    if (mesh_->points.size() == most_ids) scanner_.fail("more than " + std::to_string(most_ids) + " vertices");
    Vec3 point;
    std::size_t positions[3];
    for (int k = 0; k < 3; ++k) {
      if (!scanner_.next_in_line()) scanner_.fail("expected 3 vertex coordinates, found " + std::to_string(k));
      positions[k] = scanner_.position();
      point[k] = scanner_.number("vertex coordinate");
    }
    mesh_->points.push_back(point);
    records_.tokens.push_back(CoordinateTokens::at(positions, scanner_));
    if (normals_ == Normals::turn) record_is_normal_.push_back(false);
  }

  /// Some programs write nan or less than three numbers: such a normal counts and stays as it is.
  void read_normal() {
    if (usable_.size() == most_ids - 1) scanner_.fail("more than " + std::to_string(most_ids - 1) + " normals");
    usable_.push_back(0);
    Vec3 value;
    std::size_t positions[3];
    for (int k = 0; k < 3; ++k) {
      if (!scanner_.next_in_line()) return;
      positions[k] = scanner_.position();
      const std::string_view word = scanner_.word();
      const char* begin = word.data() + (word.starts_with('+') ? 1 : 0);
      const auto [end, error] = std::from_chars(begin, word.data() + word.size(), value[k]);
      if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value[k])) return;
    }
    if (value == Vec3{}) return;
    vertex_normals_.values.push_back(value);
    usable_.back() = static_cast<std::uint32_t>(vertex_normals_.values.size());
    records_.tokens.push_back(CoordinateTokens::at(positions, scanner_));
    record_is_normal_.push_back(true);
  }

  void read_face() {
    if (mesh_->face_sizes.size() == most_ids) scanner_.fail("more than " + std::to_string(most_ids) + " faces");
    const std::size_t first = mesh_->face_points.size();
    while (scanner_.next_in_line()) {
      mesh_->face_points.push_back(read_corner());
      if (normals_ == Normals::turn) vertex_normals_.of_corner.push_back(corner_normal_);
    }
    const std::size_t size = mesh_->face_points.size() - first;
    if (size == 0) scanner_.fail("expected the vertex indices of a face, found none");
    if (size > most_ids) scanner_.fail("a face with more than " + std::to_string(most_ids) + " corners");
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
    corner_normal_ = 0;
    for (int part = 0; part < 2 && scanner_.peek() == '/'; ++part) {
      scanner_.advance(1);
      const char c = scanner_.peek();
      if (c == '/' || scanner_.at_end() || is_delimiter(c)) continue;
      const std::int64_t index = scanner_.integer("texture or normal index");
      if (part == 1) corner_normal_ = normal_number(index);
    }
    if (!scanner_.at_end() && !is_delimiter(scanner_.peek())) {
      scanner_.move_to(at);
      scanner_.fail("expected a face corner like 1, 1/2, 1//3 or 1/2/3, found " + scanner_.quoted());
    }
    return point;
  }

  /// 1 + the number of a normal, which may stand further down; 0 where there cannot be one.
  std::uint32_t normal_number(std::int64_t index) const {
    const auto count = static_cast<std::int64_t>(usable_.size());
    const std::int64_t number = index < 0 ? (index >= -count ? count + index + 1 : 0) : index;
    return number > 0 && number < static_cast<std::int64_t>(most_ids) ? static_cast<std::uint32_t>(number) : 0;
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
    if (absolute > most_ids) {
      scanner_.fail_at(at,
                       "vertex index " + std::to_string(index) + " is out of range, the limit is " + std::to_string(most_ids));
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

  const Normals normals_;
  // With Normals::turn:
  VertexNormals vertex_normals_;        // corners by the numbers of the file until the end
  std::vector<std::uint32_t> usable_;   // per vn: 1 + its place among the values, 0 for none
  std::vector<bool> record_is_normal_;  // per record
  std::uint32_t corner_normal_ = 0;     // of the corner read last
};

std::unique_ptr<MeshFile> parse_obj(std::string bytes, const std::string& name) {
  ObjReader reader(bytes, name, Normals::stay);
  reader.read();
  return make_text_mesh_file(Format::obj, std::move(bytes), reader.mesh(), reader.take_records());
}

/// The points of a mesh and its normals behind them, and which of them the records of the file are.
struct RecordedPoints : Mesh {
  std::vector<PointId> record_points;
};

std::unique_ptr<MeshFile> parse_turning_normals(std::string bytes, const std::string& name) {
  ObjReader reader(bytes, name, Normals::turn);
  reader.read();
  VertexNormals normals = reader.take_normals();
  auto whole = std::make_shared<RecordedPoints>();
  whole->points = reader.mesh()->points;
  whole->points.insert(whole->points.end(), normals.values.begin(), normals.values.end());
  whole->record_points = std::move(normals.record_points);
  TextRecords records = reader.take_records();
  records.record_points = whole->record_points;
  auto file = make_text_mesh_file(Format::obj, std::move(bytes), std::move(whole), std::move(records));
  return std::make_unique<TurningObjFile>(reader.mesh(), std::move(file), std::move(normals));
}

}  // namespace

Reader obj_reader() {
  return {.format = Format::obj,
          .name = "OBJ",
          .extensions = {".obj"},
          .parse = parse_obj,
          .parse_turning_normals = parse_turning_normals,
          .new_file = new_obj};
}

}  // namespace deform::io
