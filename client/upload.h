// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "client/client.h"

namespace deform::client {

/// Payload of one message to the server, bytes; messages stay below 1 MiB with what surrounds it.
inline constexpr std::size_t message_payload = 768 * 1024;

/// A geometry as the messages of RegisterGeometry, one after the other, so that only one is in memory at a time. Views the
/// arrays.
class GeometryMessages {
 public:
  /// Throws Error(invalid_argument) for arrays that no message can carry (sizes that do not add up).
  GeometryMessages(const GeometryArrays& arrays, const std::string& id);

  /// False after the last one.
  bool next(v1::RegisterGeometryRequest& message);
  /// The fraction of the payload that was handed out so far, 0..1.
  double fraction() const;

 private:
  enum class Part { header, points, faces, groups, cells, end };

  void fill_header(v1::GeometryHeader& header) const;
  void fill_points(v1::PointChunk& chunk);
  void fill_faces(v1::FaceChunk& chunk);
  void fill_group(v1::GroupChunk& chunk);
  void fill_cells(v1::CellChunk& chunk);

  const GeometryArrays& arrays_;
  const std::string id_;
  std::size_t total_bytes_ = 0, sent_bytes_ = 0;
  Part part_ = Part::header;
  std::size_t point_ = 0;              ///< next
  std::size_t face_ = 0, corner_ = 0;  ///< next
  std::size_t corners_due_ = 0;        ///< of faces whose sizes were sent
  std::size_t group_ = 0, group_point_ = 0, group_face_ = 0;
  bool group_begun_ = false;
  std::vector<std::uint32_t> cell_face_sizes_;
  std::size_t cell_bytes_ = 0, cell_byte_ = 0;  ///< of all arrays of the cells; next
};

}  // namespace deform::client
