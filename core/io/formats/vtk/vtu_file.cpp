// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/io/binary/byte_order.h"
#include "core/io/formats/vtk/vtu_reader.h"
#include "core/io/readers.h"

namespace deform::io {

namespace {

/// Text that takes the place of bytes of the file.
struct Replacement {
  std::size_t begin, end;
  std::string text;
};

class VtuMeshFile : public MeshFile {
 public:
  VtuMeshFile(Format format, std::string bytes, VtuContent content, std::shared_ptr<const Mesh> mesh)
      : MeshFile(format, std::move(mesh)), bytes_(std::move(bytes)), content_(std::move(content)) {}

  std::string with_points(std::span<const Vec3> points) const override {
    check_points(points, original_points().size());
    std::vector<Replacement> replacements;
    std::vector<std::pair<std::uint64_t, std::int64_t>> growth;  // of appended data: behind this offset, by so many bytes
    for (const VtuPoints& piece : content_.pieces) {
      if (!changed(piece, points)) continue;
      Vec3 range{1, 0, 0};  // least, largest
      std::string text = piece.tokens.empty() ? binary(piece, points, range) : decimal(piece, points, range);
      for (const auto& place : piece.ranges) {
        std::string number;
        append_number(number, range[place.bound == VtuPoints::Range::Bound::least ? 0 : 1]);
        replacements.push_back({place.begin, place.end, std::move(number)});
      }
      if (piece.array.form == VtuArray::Form::appended_base64 || piece.array.form == VtuArray::Form::appended_raw) {
        growth.emplace_back(
            piece.array.begin - content_.storage.appended,
            static_cast<std::int64_t>(text.size()) - static_cast<std::int64_t>(piece.array.end - piece.array.begin));
      }
      replacements.push_back({piece.array.begin, piece.array.end, std::move(text)});
    }
    for (const VtuOffset& offset : content_.offsets) {
      std::int64_t shift = 0;
      for (const auto& [behind, by] : growth) shift += offset.value > behind ? by : 0;
      if (shift == 0) continue;
      replacements.push_back({offset.begin, offset.end, std::to_string(static_cast<std::int64_t>(offset.value) + shift)});
    }
    return spliced(std::move(replacements));
  }

 private:
  bool changed(const VtuPoints& piece, std::span<const Vec3> points) const {
    for (std::size_t i = piece.first; i < piece.first + piece.count; ++i) {
      for (int k = 0; k < 3; ++k) {
        if (!same_bits(points[i][k], original_points()[i][k])) return true;
      }
    }
    return false;
  }

  static void widen(Vec3& range, const Vec3& point, bool first) {
    const double distance = length(point);
    range[0] = first ? distance : std::min(range[0], distance);
    range[1] = first ? distance : std::max(range[1], distance);
  }

  std::string decimal(const VtuPoints& piece, std::span<const Vec3> points, Vec3& range) const {
    std::string text;
    std::size_t copied = piece.array.begin;
    for (std::size_t i = 0; i < piece.count; ++i) {
      const CoordinateTokens& tokens = piece.tokens[i];
      const std::size_t positions[3] = {tokens.first, tokens.first + tokens.second, tokens.first + tokens.third};
      const std::size_t point = piece.first + i;
      for (int k = 0; k < 3; ++k) {
        if (same_bits(points[point][k], original_points()[point][k])) continue;
        text.append(bytes_, copied, positions[k] - copied);
        append_number(text, points[point][k]);
        copied = positions[k];
        while (copied<piece.array.end&& static_cast<unsigned char>(bytes_[copied])> ' ') ++copied;
      }
      widen(range, points[point], i == 0);
    }
    text.append(bytes_, copied, piece.array.end - copied);
    return text;
  }

  std::string binary(const VtuPoints& piece, std::span<const Vec3> points, Vec3& range) const {
    const VtuData old = decoded(bytes_, content_.storage, piece.array);
    std::string values = old.values;
    char* at = values.data();
    for (std::size_t i = piece.first; i < piece.first + piece.count; ++i) {
      Vec3 stored{};
      for (int k = 0; k < 3; ++k, at += piece.array.value_bytes) {
        if (!same_bits(points[i][k], original_points()[i][k])) {
          if (piece.array.value_bytes == 8) {
            store_scalar(at, std::bit_cast<std::uint64_t>(points[i][k]), content_.storage.order);
          } else {
            store_scalar(at, std::bit_cast<std::uint32_t>(as_float(points[i][k], i, k)), content_.storage.order);
          }
        }
        stored[k] = load_coordinate(at, content_.storage, piece.array);
      }
      widen(range, stored, i == piece.first);
    }
    return encoded(content_.storage, piece.array, old, values);
  }

  std::string spliced(std::vector<Replacement> replacements) const {
    std::sort(replacements.begin(), replacements.end(), [](const auto& a, const auto& b) { return a.begin < b.begin; });
    std::string out;
    out.reserve(bytes_.size() + bytes_.size() / 16);
    std::size_t copied = 0;
    for (const Replacement& replacement : replacements) {
      out.append(bytes_, copied, replacement.begin - copied);
      out += replacement.text;
      copied = replacement.end;
    }
    return out.append(bytes_, copied);
  }

  const std::string bytes_;
  const VtuContent content_;
};

std::unique_ptr<MeshFile> parse_vtk_xml(Format format, std::string bytes, const std::string& name, std::string_view type) {
  VtuContent content = read_vtu(bytes, name, type);
  std::shared_ptr<const Mesh> mesh = mesh_of(std::move(content.mesh), name);
  return std::make_unique<VtuMeshFile>(format, std::move(bytes), std::move(content), std::move(mesh));
}

}  // namespace

Reader vtu_reader() {
  const auto parse_vtu = [](std::string bytes, const std::string& name) {
    return parse_vtk_xml(Format::vtu, std::move(bytes), name, "UnstructuredGrid");
  };
  return {.format = Format::vtu, .name = "VTU", .extensions = {".vtu"}, .parse = parse_vtu};
}

Reader vtp_reader() {
  const auto parse_vtp = [](std::string bytes, const std::string& name) {
    return parse_vtk_xml(Format::vtp, std::move(bytes), name, "PolyData");
  };
  return {.format = Format::vtp, .name = "VTP", .extensions = {".vtp"}, .parse = parse_vtp};
}

}  // namespace deform::io
