// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/io/mesh_file.h"

namespace deform::io {

/// The positions of the three coordinates of a point in a text file: 16 bytes per point instead of the tokens.
struct CoordinateTokens {
  std::uint64_t first = 0;              ///< byte offset of the token that comes first in the file
  std::uint32_t second = 0, third = 0;  ///< distances of the other two from it

  /// The record for tokens at these positions, in ascending order. Fails through the scanner if they are 4 GiB or more apart.
  template <typename Scanner>
  static CoordinateTokens at(const std::size_t (&positions)[3], const Scanner& scanner) {
    const std::size_t second = positions[1] - positions[0], third = positions[2] - positions[0];
    if (std::max(second, third) > std::numeric_limits<std::uint32_t>::max()) {
      scanner.fail_at(positions[0], "the coordinates of one point are more than 4 GiB apart");
    }
    return {positions[0], static_cast<std::uint32_t>(second), static_cast<std::uint32_t>(third)};
  }
};

/// Throws Error(invalid_argument) unless the number of points is as expected and all are finite.
void check_points(std::span<const Vec3> points, std::size_t expected);
/// Whether two numbers have the same bits; zero and minus zero differ.
inline bool same_bits(double a, double b) { return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b); }
/// Rounds a coordinate to float. Throws Error(invalid_argument) naming point and axis if it is out of range.
float as_float(double value, std::size_t point, int axis);
/// Appends the shortest decimal that parses to the same double.
void append_number(std::string& out, double value);

/// The data that a text reader passes to the writer. Record i of the file is point `record_points[i]`, or point i if that
/// is empty.
struct TextRecords {
  std::vector<CoordinateTokens> tokens;  ///< in file order
  std::array<int, 3> axes{0, 1, 2};      ///< axis of the first, second and third token
  int dimensions = 3;                    ///< 2: there is no third token, and z must not change (see check_plane())
  /// Several records may refer to one point (STL). Borrowed from the mesh, which lives as long.
  std::span<const PointId> record_points;
};

/// Checks the points of a 2D file, which cannot store z: throws Error(invalid_argument) naming the point if a z differs from that
/// of `original` by more than 1e-12 of its bounding-box diagonal. Sizes must agree.
void check_plane(std::span<const Vec3> points, const Points& original);

/// Whether all coordinates have the same bits.
bool same_points(std::span<const Vec3> a, std::span<const Vec3> b);

/// A text file. Tokens of changed coordinates are replaced, all other bytes are copied.
std::unique_ptr<MeshFile> make_text_mesh_file(Format format, std::string bytes, std::shared_ptr<const Mesh> mesh,
                                              TextRecords records);

inline constexpr PointId fixed_record = 0xffffffffu;

/// The data that a binary reader passes to the writer. Coordinate k of record i is at offsets[3 i + k] or, if that is empty, at
/// base + (i / per_block) * block_stride + (i % per_block) * record_stride + axis_offsets[k].
struct BinaryRecords {
  std::uint64_t count = 0;
  std::vector<std::uint64_t> offsets;  ///< only if records differ in size
  std::uint64_t base = 0, block_stride = 0, record_stride = 0;
  std::uint32_t per_block = 1;
  std::array<std::uint64_t, 3> axis_offsets{0, 4, 8};
  int scalar_bytes = 4;  ///< 4: float, 8: double
  std::endian order = std::endian::little;
  std::span<const PointId> record_points;  ///< as in TextRecords; fixed_record: not written

  std::uint64_t offset(std::uint64_t record, int axis) const {
    if (!offsets.empty()) return offsets[3 * record + static_cast<std::uint64_t>(axis)];
    return base + record / per_block * block_stride + record % per_block * record_stride + axis_offsets[axis];
  }
};

/// A binary file. Changed coordinates are overwritten in place.
std::unique_ptr<MeshFile> make_binary_mesh_file(Format format, std::string bytes, std::shared_ptr<const Mesh> mesh,
                                                BinaryRecords records);

}  // namespace deform::io
