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

/// SHA-256, incremental. One thread.
class Sha256 {
 public:
  /// Of no bytes yet.
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;
  /// Appends bytes.
  void add(const void* data, std::size_t size);
  /// Lower-case hexadecimal, 64 characters. Ends the object's use.
  std::string hex();

 private:
  void* context_;
};

/// One group as it enters the id.
struct GroupView {
  std::string_view name;            ///< bytes, in whatever encoding
  std::span<const PointId> points;  ///< named by the group itself, in order
  std::span<const FaceId> faces;    ///< in order
};

/// The arrays of a geometry, borrowed. Its id is the SHA-256 of the bytes that proto/deform/v1/geometry.proto describes, which
/// visit_geometry_bytes() hands to the sink piece by piece. A stored geometry is exactly these bytes, so that the id is its
/// checksum.
struct GeometryView {
  std::span<const Vec3> points;               ///< n x 3
  std::span<const std::uint32_t> face_sizes;  ///< f: corners per face
  std::span<const PointId> face_points;       ///< c: corners of all faces, one face after the other
  std::span<const GroupView> groups;          ///< in order
  CellsView cells = {};                       ///< of a volume mesh
};
using ByteSink = std::function<void(const void* data, std::size_t size)>;
void visit_geometry_bytes(const GeometryView& geometry, const ByteSink& sink);

std::string geometry_id(const GeometryView& geometry);

}  // namespace deform::codec
