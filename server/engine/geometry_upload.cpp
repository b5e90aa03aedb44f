// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/geometry_upload.h"

#include <algorithm>
#include <cstring>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "server/engine/call.h"
#include "server/engine/mesh_cache.h"
#include "server/store/geometry_file.h"
#include "server/store/store.h"

namespace deform::server {

namespace {

[[noreturn]] void refuse(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

std::string of(std::uint64_t got, std::uint64_t expected) {
  return std::to_string(got) + " of " + std::to_string(expected) + " claimed by the header";
}

const ChargePurpose purpose{"registering a geometry", "raise the server's memory budget", 0};

constexpr std::size_t longest_name = 4096;
constexpr std::size_t most_name_bytes = 640 << 10;  // of all groups: a GeometryInfo, which lists them, stays below 1 MiB

void check_cells(const v1::GeometryHeader& header, const EngineOptions& limits) {
  const v1::CellCounts& cells = header.cells();
  constexpr std::uint64_t most = 0xffffffffu;
  check_range(cells.elements(), 0, limits.max_faces, "header.cells.elements");
  check_range(cells.element_points(), cells.elements(), cells.elements() > 0 ? most : 0, "header.cells.element_points");
  check_range(cells.faces(), 0, cells.elements() > 0 ? 0 : limits.max_faces, "header.cells.faces");
  check_range(cells.cells(), cells.faces() > 0 ? 1 : 0, cells.faces(), "header.cells.cells");
  check_range(cells.face_points(), cells.faces(), cells.faces() > 0 ? most : 0, "header.cells.face_points");
  check_range(cells.internal_faces(), 0, cells.faces(), "header.cells.internal_faces");
}

}  // namespace

UploadBuffer::UploadBuffer(const v1::GeometryHeader& header, const EngineOptions& limits, MemoryBudget& budget,
                           const TenantShare& share)
    : header_(header), budget_(budget), share_(share) {
  check_range(header.point_count(), 1, limits.max_points, "header.point_count");
  check_range(header.face_count(), 0, limits.max_faces, "header.face_count");
  check_range(header.corner_count(), header.face_count(), 0xffffffffu, "header.corner_count");
  check_range(header.group_count(), 0, limits.max_groups, "header.group_count");
  if (header.face_count() == 0 && header.corner_count() != 0) refuse("header.corner_count: there are no faces");
  if (header.name().size() > longest_name) refuse("header.name: longer than " + std::to_string(longest_name) + " bytes");
  check_cells(header, limits);
  const v1::CellCounts& cells = header.cells();
  const std::uint64_t bytes = 24 * header.point_count() + 4 * (header.face_count() + header.corner_count()) +
                              9 * cells.elements() + 4 * cells.element_points() + 16 * cells.faces() + 4 * cells.face_points();
  if (bytes > budget.total()) {
    throw Error(ErrorCode::out_of_budget, purpose.what + ": its arrays need " + mebibytes(bytes) + ", the memory budget is " +
                                              mebibytes(budget.total()) + "; " + purpose.advice)
        .refused_for(Refusal::memory);
  }
}

void UploadBuffer::add(const v1::RegisterGeometryRequest& part) {
  switch (part.part_case()) {
    case v1::RegisterGeometryRequest::kPoints:
      return add_points(part.points());
    case v1::RegisterGeometryRequest::kFaces:
      return add_faces(part.faces());
    case v1::RegisterGeometryRequest::kGroup:
      return add_group(part.group());
    case v1::RegisterGeometryRequest::kCells:
      return add_cells(part.cells());
    case v1::RegisterGeometryRequest::kHeader:
      refuse("header: sent twice");
    case v1::RegisterGeometryRequest::PART_NOT_SET:
      refuse("upload message: none of points, faces, group, cells is set");
  }
}

// Chunks of an earlier kind may not follow, and each array must be complete before the next kind begins.
void UploadBuffer::enter(Stage stage) {
  if (stage < stage_) refuse("upload: chunks come in the order points, faces, groups, cells");
  if (stage > Stage::points && mesh_.points.size() != header_.point_count()) {
    refuse("points: only " + of(mesh_.points.size(), header_.point_count()) + " arrived before the next kind of chunk");
  }
  if (stage > Stage::faces) {
    if (mesh_.face_sizes.size() != header_.face_count()) {
      refuse("faces.sizes: only " + of(mesh_.face_sizes.size(), header_.face_count()) + " arrived");
    }
    if (mesh_.face_points.size() != header_.corner_count()) {
      refuse("faces.corners: only " + of(mesh_.face_points.size(), header_.corner_count()) + " arrived");
    }
  }
  if (stage > Stage::groups) check_groups();
  stage_ = stage;
}

void UploadBuffer::check_groups() const {
  if (mesh_.groups.size() != header_.group_count())
    refuse("group: only " + of(mesh_.groups.size(), header_.group_count()) + " arrived");
}

void UploadBuffer::grow(std::size_t bytes) { budget_.grow_upload(charge_, bytes, purpose, share_); }

template <typename T>
void UploadBuffer::append(std::vector<T>& array, const std::string& bytes, std::size_t limit, const char* field) {
  if (bytes.size() % sizeof(T) != 0) {
    refuse(std::string(field) + ": " + std::to_string(bytes.size()) + " bytes are not a multiple of " +
           std::to_string(sizeof(T)));
  }
  const std::size_t count = bytes.size() / sizeof(T);
  if (count == 0) return;
  if (count > limit - array.size()) {
    refuse(std::string(field) + ": more than the " + std::to_string(limit) + " that the header allows");
  }
  const std::size_t size = array.size() + count;
  if (size > array.capacity()) {
    const std::size_t capacity = std::min(limit, std::max(size, 2 * array.capacity()));
    grow((capacity - array.capacity()) * sizeof(T));
    array.reserve(capacity);
  }
  const std::size_t first = array.size();
  array.resize(size);
  std::memcpy(array.data() + first, bytes.data(), bytes.size());
}

void UploadBuffer::add_points(const v1::PointChunk& chunk) {
  enter(Stage::points);
  append(mesh_.points, chunk.xyz(), header_.point_count(), "points.xyz");
}

void UploadBuffer::add_faces(const v1::FaceChunk& chunk) {
  enter(Stage::faces);
  const std::size_t first = mesh_.face_sizes.size();
  append(mesh_.face_sizes, chunk.sizes(), header_.face_count(), "faces.sizes");
  for (std::size_t i = first; i < mesh_.face_sizes.size(); ++i) corners_claimed_ += mesh_.face_sizes[i];
  if (corners_claimed_ > header_.corner_count()) {
    refuse("faces.sizes: they add up to more than the " + std::to_string(header_.corner_count()) + " corners of the header");
  }
  append(mesh_.face_points, chunk.corners(), header_.corner_count(), "faces.corners");
  if (mesh_.face_points.size() > corners_claimed_) refuse("faces.corners: more than the sizes of the faces so far add up to");
}

void UploadBuffer::add_group(const v1::GroupChunk& chunk) {
  enter(Stage::groups);
  if (!chunk.name().empty()) {
    if (mesh_.groups.size() == header_.group_count())
      refuse("group: more than the " + of(header_.group_count(), header_.group_count()));
    if (chunk.name().size() > longest_name) refuse("group.name: longer than " + std::to_string(longest_name) + " bytes");
    names_ += chunk.name().size();
    if (names_ > most_name_bytes) {
      refuse("group.name: those of the first " + std::to_string(mesh_.groups.size() + 1) + " groups take " +
             std::to_string(names_) + " bytes, all together may take " + std::to_string(most_name_bytes));
    }
    grow(sizeof(Group) + chunk.name().size());
    mesh_.groups.emplace_back().name = chunk.name();
  }
  if (mesh_.groups.empty()) refuse("group.name: the first group chunk has none");
  append(mesh_.groups.back().points, chunk.points(), header_.point_count(), "group.points");
  append(mesh_.groups.back().faces, chunk.faces(), header_.face_count(), "group.faces");
}

void UploadBuffer::add_cells(const v1::CellChunk& chunk) {
  enter(Stage::cells);
  const v1::CellCounts& counts = header_.cells();
  const std::size_t first = elements_.types.size();
  append(elements_.types, chunk.element_types(), counts.elements(), "cells.element_types");
  for (std::size_t e = first; e < elements_.types.size(); ++e) {
    if (static_cast<std::size_t>(elements_.types[e]) < element_types) continue;
    refuse("cells.element_types: " + std::to_string(static_cast<int>(elements_.types[e])) + " of element " + std::to_string(e) +
           " is not a type, there are " + std::to_string(element_types));
  }
  append(elements_.points, chunk.element_points(), counts.element_points(), "cells.element_points");
  append(cell_face_sizes_, chunk.face_sizes(), counts.faces(), "cells.face_sizes");
  append(cells_.face_points, chunk.face_points(), counts.face_points(), "cells.face_points");
  append(cells_.owner, chunk.owners(), counts.faces(), "cells.owners");
  append(cells_.neighbour, chunk.neighbours(), counts.internal_faces(), "cells.neighbours");
  append(cells_.empty_faces, chunk.empty_faces(), counts.empty_faces() ? counts.faces() : 0, "cells.empty_faces");
}

void UploadBuffer::finish_cells() {
  const v1::CellCounts& counts = header_.cells();
  const auto complete = [](const char* field, std::uint64_t got, std::uint64_t expected) {
    if (got != expected) refuse(std::string(field) + ": only " + of(got, expected) + " arrived");
  };
  complete("cells.element_types", elements_.types.size(), counts.elements());
  complete("cells.element_points", elements_.points.size(), counts.element_points());
  complete("cells.face_sizes", cell_face_sizes_.size(), counts.faces());
  complete("cells.face_points", cells_.face_points.size(), counts.face_points());
  complete("cells.owners", cells_.owner.size(), counts.faces());
  complete("cells.neighbours", cells_.neighbour.size(), counts.internal_faces());
  complete("cells.empty_faces", cells_.empty_faces.size(), counts.empty_faces() ? counts.faces() : 0);
  if (counts.elements() > 0) {
    grow(elements_.types.size() * sizeof(std::uint64_t));
    elements_.offsets.reserve(elements_.types.size() + 1);
    for (const ElementType type : elements_.types) elements_.offsets.push_back(elements_.offsets.back() + shape(type).nodes);
    mesh_.elements = std::make_shared<const Elements>(std::move(elements_));
  } else if (counts.faces() > 0) {
    grow(cell_face_sizes_.size() * sizeof(std::uint64_t));
    cells_.cell_count = counts.cells();
    cells_.face_offsets.reserve(cell_face_sizes_.size() + 1);
    for (const std::uint32_t size : cell_face_sizes_) cells_.face_offsets.push_back(cells_.face_offsets.back() + size);
    mesh_.cells = std::make_shared<const PolyhedralCells>(std::move(cells_));
  }
}

Mesh UploadBuffer::take() {
  enter(std::max(stage_, Stage::groups));
  if (corners_claimed_ != header_.corner_count()) {
    refuse("faces.sizes: they add up to " + of(corners_claimed_, header_.corner_count()) + " corners");
  }
  check_groups();
  finish_cells();
  mesh_.validate();
  return std::move(mesh_);
}

namespace {

/// About what the file of an upload will take, by what its header claims (which may be anything); groups come on top.
std::size_t stored_bytes(const v1::GeometryHeader& header) {
  const auto times = [](double bytes, std::uint64_t count) { return bytes * static_cast<double>(count); };
  const auto& cells = header.cells();
  const double bytes = times(24, header.point_count()) + times(4, header.face_count()) + times(4, header.corner_count()) +
                       times(1, cells.elements()) + times(4, cells.element_points()) + times(12, cells.faces()) +
                       times(4, cells.face_points()) + times(4, cells.internal_faces());
  return static_cast<std::size_t>(std::min(bytes, 1e18));
}

/// The engine's side of an upload.
class Upload : public GeometryUpload {
 public:
  Upload(const v1::GeometryHeader& header, const EngineOptions& limits, const UploadParts& parts, CallContext call)
      : declared_id_(header.id()),
        name_(header.name()),
        store_(*parts.store),
        meshes_(*parts.meshes),
        call_(std::move(call)),
        buffer_(header, limits, *parts.memory, call_.share()),
        stored_(declared_id_.empty() ? std::nullopt : store_.registered(owned(declared_id_))) {
    if (stored_) return;
    const std::size_t bytes = stored_bytes(header);
    store_.require_room(bytes);
    // Also an upload that will turn out to be there is refused beyond the quota: only its id tells that nothing is added. One
    // that heals what the tenant has adds nothing.
    const bool heals = !declared_id_.empty() && store_.catalog().find_geometry(owned(declared_id_)).has_value();
    if (!heals) store_.require_quota(call_.tenant, {1, 0, bytes}, call_.quota);
  }

  bool already_stored() const override { return stored_.has_value(); }

  void add(const v1::RegisterGeometryRequest& part) override {
    check_call();
    if (!stored_) buffer_.add(part);  // what comes all the same is not needed
  }

  v1::GeometryInfo finish() override {
    check_call();
    if (stored_) {  // as it was when the header came: it may have been deleted since
      v1::GeometryInfo info = *stored_;
      info.set_existed(true);
      return info;
    }
    Mesh mesh = buffer_.take();
    const std::string id = mesh_id(mesh, context());
    if (!declared_id_.empty() && id != declared_id_) {
      throw Error(ErrorCode::invalid_argument, "header.id: " + declared_id_ + " was announced, the arrays have id " + id);
    }
    v1::GeometryInfo info = store_.put(mesh, owned(id), name_, {call_.quota, context()});
    meshes_.put(key_of(owned(id)), MeshCache::share(std::move(mesh), buffer_.take_charge()));
    return info;
  }

 private:
  OwnedId owned(const std::string& id) const { return {call_.tenant, id}; }

  RunContext context() const { return context_of(call_); }
  void check_call() const { context().check(); }

  const std::string declared_id_, name_;
  Store& store_;
  MeshCache& meshes_;
  const CallContext call_;
  UploadBuffer buffer_;
  const std::optional<v1::GeometryInfo> stored_;
};

}  // namespace

std::unique_ptr<GeometryUpload> make_upload(const v1::GeometryHeader& header, const EngineOptions& limits,
                                            const UploadParts& parts, const CallContext& call) {
  return std::make_unique<Upload>(header, limits, parts, call);
}

}  // namespace deform::server
