// SPDX-License-Identifier: Apache-2.0
#include <bit>
#include <cmath>

#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/binary/byte_order.h"
#include "core/io/formats/off/off_header.h"

namespace deform::io {

namespace {

enum class FaceColours { counted, absent };

/// One reading of the bytes; the format has four dialects, and only the right one fits to the last byte.
class Dialect {
 public:
  Dialect(std::string_view bytes, const OffHeader& header, std::endian order, FaceColours colours)
      : bytes_(bytes), at_(header.end), stride_(4 * (3 + header.extras())), order_(order), colours_(colours) {}

  /// Walks the whole structure without storing any of it; false with `problem` set when it does not fit.
  bool fits() {
    if (left() < 12) return reject("the three counts need 12 bytes, " + std::to_string(left()) + " are left");
    vertices_ = next();
    faces_ = next();
    next();  // edges
    if (vertices_ == 0) return reject("the header claims no vertices, at least one is needed");
    const std::uint64_t face_bytes = colours_ == FaceColours::counted ? 12 : 8;
    const std::uint64_t needed = std::uint64_t{vertices_} * stride_ + faces_ * face_bytes;
    if (needed > left()) {
      return reject("the header claims " + std::to_string(vertices_) + " vertices and " + std::to_string(faces_) +
                    " faces, which need at least " + std::to_string(needed) + " bytes, but only " + std::to_string(left()) +
                    " are left");
    }
    first_vertex_ = at_;
    at_ += vertices_ * stride_;
    first_face_ = at_;
    for (std::uint32_t face = 0; face < faces_; ++face) {
      if (!walk_face(face)) return false;
    }
    // A final line feed is harmless; anything else means that the dialect or a count is wrong.
    if (left() > 1 || (left() == 1 && bytes_[at_] != '\n')) {
      return reject(std::to_string(left()) + " bytes are left after the last face");
    }
    return true;
  }

  std::unique_ptr<MeshFile> read(std::string& bytes, const std::string& name) {
    auto mesh = std::make_shared<Mesh>();
    mesh->points.resize(vertices_);
    for (std::uint32_t i = 0; i < vertices_; ++i) {
      for (int k = 0; k < 3; ++k) {
        const std::size_t at = first_vertex_ + i * stride_ + 4 * static_cast<std::size_t>(k);
        mesh->points[i][k] = std::bit_cast<float>(load_scalar<std::uint32_t>(bytes_.data() + at, order_));
        if (!std::isfinite(mesh->points[i][k])) {
          throw Error(ErrorCode::invalid_argument, name + ": byte " + std::to_string(at) + ": coordinate " + "xyz"[k] +
                                                       " of vertex " + std::to_string(i) + " is not a finite number");
        }
      }
    }
    mesh->face_sizes.resize(faces_);
    mesh->face_points.reserve(3 * std::size_t{faces_});
    at_ = first_face_;
    for (std::uint32_t face = 0; face < faces_; ++face) {
      const std::uint32_t size = mesh->face_sizes[face] = next();
      for (std::uint32_t c = 0; c < size; ++c) mesh->face_points.push_back(next());
      if (colours_ == FaceColours::counted) at_ += 4 * std::size_t{next()};
    }
    BinaryRecords records;
    records.count = vertices_;
    records.base = first_vertex_;
    records.block_stride = stride_;
    records.order = order_;
    return make_binary_mesh_file(Format::off, std::move(bytes), std::move(mesh), std::move(records));
  }

  std::size_t reached() const { return at_; }
  const std::string& problem() const { return problem_; }

 private:
  std::size_t left() const { return bytes_.size() - at_; }

  std::uint32_t next() {
    const auto value = load_scalar<std::uint32_t>(bytes_.data() + at_, order_);
    at_ += 4;
    return value;
  }

  bool reject(const std::string& problem) {
    problem_ = problem;
    return false;
  }

  bool walk_face(std::uint32_t face) {
    const auto which = [face] { return "face " + std::to_string(face); };
    if (left() < 4) return reject("the file ends in " + which() + " of " + std::to_string(faces_));
    const std::uint32_t size = next();
    if (size == 0) return reject(which() + " has no corners, at least 1 is needed");
    if (std::uint64_t{size} * 4 > left()) {
      return reject(which() + " claims " + std::to_string(size) + " corners, but only " + std::to_string(left()) +
                    " bytes are left");
    }
    for (std::uint32_t c = 0; c < size; ++c) {
      const std::uint32_t point = next();
      if (point >= vertices_) {
        return reject(which() + ": vertex index " + std::to_string(point) + " is out of range 0.." +
                      std::to_string(vertices_ - 1));
      }
    }
    if (colours_ == FaceColours::absent) return true;
    if (left() < 4) return reject("the file ends in " + which() + " of " + std::to_string(faces_));
    const std::uint32_t components = next();
    if (components > 4 || std::size_t{components} * 4 > left()) {
      return reject(which() + " claims " + std::to_string(components) + " colour components");
    }
    at_ += 4 * std::size_t{components};
    return true;
  }

  const std::string_view bytes_;
  std::size_t at_;
  const std::size_t stride_;
  const std::endian order_;
  const FaceColours colours_;
  std::uint32_t vertices_ = 0, faces_ = 0;
  std::size_t first_vertex_ = 0, first_face_ = 0;
  std::string problem_;
};

}  // namespace

std::unique_ptr<MeshFile> parse_off_binary(std::string bytes, const std::string& name, const OffHeader& header) {
  std::size_t reached = 0;
  std::string problem;
  for (const std::endian order : {std::endian::big, std::endian::little}) {
    for (const FaceColours colours : {FaceColours::counted, FaceColours::absent}) {
      Dialect dialect(bytes, header, order, colours);
      if (dialect.fits()) return dialect.read(bytes, name);
      if (!problem.empty() && dialect.reached() <= reached) continue;
      reached = dialect.reached();
      problem = dialect.problem();
    }
  }
  throw Error(ErrorCode::invalid_argument, name + ": byte " + std::to_string(reached) + ": binary OFF: " + problem);
}

}  // namespace deform::io
