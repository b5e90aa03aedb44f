// SPDX-License-Identifier: Apache-2.0
#include "client/upload.h"

#include <algorithm>

namespace deform::client {

namespace {

constexpr std::size_t id_bytes = sizeof(std::uint32_t);

template <typename T>
void append(std::string& bytes, std::span<const T> values) {
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
}

}  // namespace

GeometryMessages::GeometryMessages(const GeometryArrays& arrays, const std::string& id) : arrays_(arrays), id_(id) {
  std::size_t corners = 0;
  for (const auto size : arrays.face_sizes) corners += size;
  if (corners != arrays.face_points.size()) {
    throw Error(ErrorCode::invalid_argument, "geometry: the face sizes add up to " + std::to_string(corners) +
                                                 ", face_points has " + std::to_string(arrays.face_points.size()) + " entries");
  }
  total_bytes_ = arrays.points.size_bytes() + arrays.face_sizes.size_bytes() + arrays.face_points.size_bytes();
  for (const auto& group : arrays.groups) total_bytes_ += group.points.size_bytes() + group.faces.size_bytes();
  const CellsView& cells = arrays.cells;
  for (std::size_t f = 0; f + 1 < cells.face_offsets.size(); ++f) {
    cell_face_sizes_.push_back(static_cast<std::uint32_t>(cells.face_offsets[f + 1] - cells.face_offsets[f]));
  }
  cell_bytes_ = cells.element_types.size_bytes() + cells.element_points.size_bytes() + cell_face_sizes_.size() * id_bytes +
                cells.face_points.size_bytes() + cells.owner.size_bytes() + cells.neighbour.size_bytes() +
                cells.empty_faces.size_bytes();
  total_bytes_ += cell_bytes_;
}

double GeometryMessages::fraction() const {
  return total_bytes_ == 0 ? 1.0 : static_cast<double>(sent_bytes_) / static_cast<double>(total_bytes_);
}

bool GeometryMessages::next(v1::RegisterGeometryRequest& message) {
  message.Clear();
  if (part_ == Part::points && point_ == arrays_.points.size()) part_ = Part::faces;
  if (part_ == Part::faces && face_ == arrays_.face_sizes.size() && corners_due_ == 0) part_ = Part::groups;
  if (part_ == Part::groups && group_ == arrays_.groups.size()) part_ = Part::cells;
  if (part_ == Part::cells && cell_byte_ == cell_bytes_) part_ = Part::end;
  switch (part_) {
    case Part::header:
      fill_header(*message.mutable_header());
      part_ = Part::points;
      return true;
    case Part::points:
      fill_points(*message.mutable_points());
      return true;
    case Part::faces:
      fill_faces(*message.mutable_faces());
      return true;
    case Part::groups:
      fill_group(*message.mutable_group());
      return true;
    case Part::cells:
      fill_cells(*message.mutable_cells());
      return true;
    case Part::end:
      break;
  }
  return false;
}

void GeometryMessages::fill_header(v1::GeometryHeader& header) const {
  header.set_point_count(arrays_.points.size());
  header.set_face_count(arrays_.face_sizes.size());
  header.set_corner_count(arrays_.face_points.size());
  header.set_group_count(static_cast<std::uint32_t>(arrays_.groups.size()));
  header.set_name(arrays_.name);
  header.set_id(id_);
  const CellsView& cells = arrays_.cells;
  if (!cells.any()) return;
  v1::CellCounts& counts = *header.mutable_cells();
  counts.set_elements(cells.element_types.size());
  counts.set_element_points(cells.element_points.size());
  counts.set_cells(cells.cell_count);
  counts.set_faces(cell_face_sizes_.size());
  counts.set_face_points(cells.face_points.size());
  counts.set_internal_faces(cells.neighbour.size());
  counts.set_empty_faces(!cells.empty_faces.empty());
}

void GeometryMessages::fill_points(v1::PointChunk& chunk) {
  const std::size_t count = std::min(message_payload / sizeof(Vec3), arrays_.points.size() - point_);
  append(*chunk.mutable_xyz(), arrays_.points.subspan(point_, count));
  point_ += count;
  sent_bytes_ += count * sizeof(Vec3);
}

void GeometryMessages::fill_faces(v1::FaceChunk& chunk) {
  std::size_t room = message_payload / id_bytes;
  const std::size_t first = face_;
  // Whole faces as long as they fit; a face that alone is too large goes on in the next chunks.
  while (face_ < arrays_.face_sizes.size() &&
         (corners_due_ + (face_ - first) + 1 + arrays_.face_sizes[face_] <= room || face_ == first)) {
    if (corners_due_ > 0 && face_ == first) break;
    corners_due_ += arrays_.face_sizes[face_++];
  }
  append(*chunk.mutable_sizes(), arrays_.face_sizes.subspan(first, face_ - first));
  room -= face_ - first;
  const std::size_t count = std::min(corners_due_, room);
  append(*chunk.mutable_corners(), arrays_.face_points.subspan(corner_, count));
  corner_ += count;
  corners_due_ -= count;
  sent_bytes_ += (face_ - first + count) * id_bytes;
}

void GeometryMessages::fill_group(v1::GroupChunk& chunk) {
  const auto& group = arrays_.groups[group_];
  if (!group_begun_) chunk.set_name(std::string(group.name));
  group_begun_ = true;
  std::size_t room = message_payload / id_bytes;
  const std::size_t points = std::min(room, group.points.size() - group_point_);
  append(*chunk.mutable_points(), group.points.subspan(group_point_, points));
  group_point_ += points;
  room -= points;
  const std::size_t faces = std::min(room, group.faces.size() - group_face_);
  append(*chunk.mutable_faces(), group.faces.subspan(group_face_, faces));
  group_face_ += faces;
  sent_bytes_ += (points + faces) * id_bytes;
  if (group_point_ < group.points.size() || group_face_ < group.faces.size()) return;
  ++group_;
  group_point_ = group_face_ = 0;
  group_begun_ = false;
}

// The arrays one after the other, as if they were one.
void GeometryMessages::fill_cells(v1::CellChunk& chunk) {
  std::size_t room = message_payload;
  std::size_t begin = 0;  // of the array among all
  const auto take = [&](auto values, std::string* (v1::CellChunk::*field)()) {
    constexpr std::size_t width = sizeof(values[0]);
    const std::size_t end = begin + values.size_bytes();
    if (cell_byte_ < end && room >= width) {
      const std::size_t first = (cell_byte_ - begin) / width;
      const auto piece = values.subspan(first, std::min(room / width, values.size() - first));
      append(*(chunk.*field)(), piece);
      cell_byte_ += piece.size_bytes();
      sent_bytes_ += piece.size_bytes();
      room = cell_byte_ < end ? 0 : room - piece.size_bytes();
    }
    begin = end;
  };
  const CellsView& cells = arrays_.cells;
  take(cells.element_types, &v1::CellChunk::mutable_element_types);
  take(cells.element_points, &v1::CellChunk::mutable_element_points);
  take(std::span<const std::uint32_t>(cell_face_sizes_), &v1::CellChunk::mutable_face_sizes);
  take(cells.face_points, &v1::CellChunk::mutable_face_points);
  take(cells.owner, &v1::CellChunk::mutable_owners);
  take(cells.neighbour, &v1::CellChunk::mutable_neighbours);
  take(cells.empty_faces, &v1::CellChunk::mutable_empty_faces);
}

}  // namespace deform::client
