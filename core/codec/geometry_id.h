// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "core/base/cells_view.h"
#include "core/base/types.h"

namespace deform::codec {

/// Incremental SHA-256. Not thread-safe.
class Sha256 {
 public:
  /// Starts with the hash of no bytes.
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;
  /// Appends bytes.
  void add(const void* data, std::size_t size);
  /// Finishes the hash and returns it as 64 lower-case hexadecimal digits. The object must not be used afterwards.
  std::string hex();

 private:
  void* context_;
};

/// One group of a geometry, borrowed.
struct GroupView {
  std::string_view name;            ///< bytes in any encoding
  std::span<const PointId> points;  ///< listed by the group itself, without those of its faces; in order
  std::span<const FaceId> faces;    ///< in order
};

/// The arrays of a geometry, borrowed. Its id is the SHA-256 of the bytes described in proto/deform/v1/geometry.proto, which
/// visit_geometry_bytes() passes to the sink piece by piece. A stored geometry consists of exactly these bytes, so its id is also
/// its checksum.
struct GeometryView {
  std::span<const Vec3> points;               ///< n x 3
  std::span<const std::uint32_t> face_sizes;  ///< number of corners of each face
  std::span<const PointId> face_points;       ///< corners of all faces, face by face
  std::span<const GroupView> groups;          ///< in order
  CellsView cells = {};                       ///< cells of a volume mesh
};
using ByteSink = std::function<void(const void* data, std::size_t size)>;
void visit_geometry_bytes(const GeometryView& geometry, const ByteSink& sink);

std::string geometry_id(const GeometryView& geometry);

}  // namespace deform::codec
