// SPDX-License-Identifier: Apache-2.0
#include "core/io/assembly/coordinate_records.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/io/binary/byte_order.h"

namespace deform::io {

namespace {

std::size_t record_point(std::span<const PointId> record_points, std::size_t record) {
  return record_points.empty() ? record : record_points[record];
}

class TextMeshFile : public MeshFile {
 public:
  TextMeshFile(Format format, std::string bytes, std::shared_ptr<const Mesh> mesh, TextRecords records)
      : MeshFile(format, std::move(mesh)), bytes_(std::move(bytes)), records_(std::move(records)) {}

  std::string with_points(std::span<const Vec3> points) const override {
    check_points(points, original_points().size());
    if (records_.dimensions == 2) check_plane(points, original_points());
    std::string out;
    out.reserve(bytes_.size() + bytes_.size() / 4);
    std::size_t copied = 0;
    for (std::size_t record = 0; record < records_.tokens.size(); ++record) {
      const CoordinateTokens& tokens = records_.tokens[record];
      const std::size_t point = record_point(records_.record_points, record);
      const std::size_t positions[3] = {tokens.first, tokens.first + tokens.second, tokens.first + tokens.third};
      for (int i = 0; i < records_.dimensions; ++i) {
        const int axis = records_.axes[i];
        if (same_bits(points[point][axis], original_points()[point][axis])) continue;
        out.append(bytes_, copied, positions[i] - copied);
        append_number(out, points[point][axis]);
        copied = token_end(positions[i]);
      }
    }
    out.append(bytes_, copied);
    return out;
  }

  bool two_dimensional() const override { return records_.dimensions == 2; }

 private:
  /// Readers have seen a number there: letters, digits, signs and points.
  std::size_t token_end(std::size_t position) const {
    const auto belongs = [](char c) {
      return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '+' || c == '-' || c == '.';
    };
    while (position < bytes_.size() && belongs(bytes_[position])) ++position;
    return position;
  }

  const std::string bytes_;
  const TextRecords records_;
};

class BinaryMeshFile : public MeshFile {
 public:
  BinaryMeshFile(Format format, std::string bytes, std::shared_ptr<const Mesh> mesh, BinaryRecords records)
      : MeshFile(format, std::move(mesh)), bytes_(std::move(bytes)), records_(std::move(records)) {}

  std::string with_points(std::span<const Vec3> points) const override {
    check_points(points, original_points().size());
    std::string out = bytes_;
    for (std::uint64_t record = 0; record < records_.count; ++record) {
      const std::size_t point = record_point(records_.record_points, record);
      if (point == fixed_record) continue;
      for (int axis = 0; axis < 3; ++axis) {
        const double value = points[point][axis];
        if (same_bits(value, original_points()[point][axis])) continue;
        char* at = out.data() + records_.offset(record, axis);
        if (records_.scalar_bytes == 8) {
          store_scalar(at, std::bit_cast<std::uint64_t>(value), records_.order);
        } else {
          store_scalar(at, std::bit_cast<std::uint32_t>(as_float(value, point, axis)), records_.order);
        }
      }
    }
    return out;
  }

 private:
  const std::string bytes_;
  const BinaryRecords records_;
};

}  // namespace

void check_points(std::span<const Vec3> points, std::size_t expected) {
  if (points.size() != expected) {
    throw Error(ErrorCode::invalid_argument,
                "points: there are " + std::to_string(points.size()) + ", the mesh file has " + std::to_string(expected));
  }
  check_finite(points, "points");
}

void append_number(std::string& out, double value) {
  char buffer[32];
  const auto result = std::to_chars(buffer, buffer + sizeof buffer, value);
  out.append(buffer, result.ptr);
}

float as_float(double value, std::size_t point, int axis) {
  const auto narrow = static_cast<float>(value);
  if (!std::isfinite(narrow)) {
    throw Error(ErrorCode::invalid_argument, "points[" + std::to_string(point) + "]: coordinate " + "xyz"[axis] +
                                                 " is beyond the range of the file's 32-bit floats");
  }
  return narrow;
}

void check_plane(std::span<const Vec3> points, const Points& original) {
  const double tolerance = 1e-12 * bounding_box(original).diagonal();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double moved = points[i][2] - original[i][2];
    if (std::abs(moved) <= tolerance) continue;
    char text[32];
    std::snprintf(text, sizeof text, "%.3g", moved);
    throw Error(ErrorCode::invalid_argument, "points[" + std::to_string(i) + "]: z moves by " + text +
                                                 ", but the mesh file is two-dimensional: points must stay in its plane");
  }
}

bool same_points(std::span<const Vec3> a, std::span<const Vec3> b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Vec3& p, const Vec3& q) {
    return same_bits(p[0], q[0]) && same_bits(p[1], q[1]) && same_bits(p[2], q[2]);
  });
}

std::unique_ptr<MeshFile> make_text_mesh_file(Format format, std::string bytes, std::shared_ptr<const Mesh> mesh,
                                              TextRecords records) {
  return std::make_unique<TextMeshFile>(format, std::move(bytes), std::move(mesh), std::move(records));
}

std::unique_ptr<MeshFile> make_binary_mesh_file(Format format, std::string bytes, std::shared_ptr<const Mesh> mesh,
                                                BinaryRecords records) {
  return std::make_unique<BinaryMeshFile>(format, std::move(bytes), std::move(mesh), std::move(records));
}

}  // namespace deform::io
