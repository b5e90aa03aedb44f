// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"
#include "deform/v1/geometry.pb.h"
#include "server/engine/engine.h"
#include "server/engine/memory.h"

namespace deform::server {

class Store;
class MeshCache;

/// Joins the chunks of an upload into a mesh, checking order and counts as geometry.proto prescribes. Memory is charged before it
/// is allocated and grows with what has arrived, never with what the header claims. Not thread-safe.
class UploadBuffer {
 public:
  /// Throws Error(invalid_argument) for counts beyond the limits, Error(out_of_budget) for claims that can never fit.
  UploadBuffer(const v1::GeometryHeader& header, const EngineOptions& limits, MemoryBudget& budget,
               const TenantShare& share = {});

  void add(const v1::RegisterGeometryRequest& part);

  /// Checks that everything has arrived and validates the mesh. Ends the object's use.
  Mesh take();

  /// The charge for everything that take() returns. It no longer counts as an upload's.
  Charge take_charge() {
    charge_.outlive_call();
    return std::move(charge_);
  }

 private:
  enum class Stage { points, faces, groups, cells };
  void add_points(const v1::PointChunk& chunk);
  void add_faces(const v1::FaceChunk& chunk);
  void add_group(const v1::GroupChunk& chunk);
  void add_cells(const v1::CellChunk& chunk);
  void check_groups() const;
  void finish_cells();
  void enter(Stage stage);
  template <typename T>
  void append(std::vector<T>& array, const std::string& bytes, std::size_t limit, const char* field);
  void grow(std::size_t bytes);

  v1::GeometryHeader header_;
  MemoryBudget& budget_;
  const TenantShare share_;
  Charge charge_;
  Mesh mesh_;
  std::size_t names_ = 0;  // bytes, of the groups
  Stage stage_ = Stage::points;
  std::uint64_t corners_claimed_ = 0;  // by the face sizes so far
  Elements elements_;
  PolyhedralCells cells_;
  std::vector<std::uint32_t> cell_face_sizes_;
};

/// What an upload needs of the engine; all outlive it.
struct UploadParts {
  MemoryBudget* memory;
  Store* store;
  MeshCache* meshes;
};

/// Throws as UploadBuffer does, and what Store::require_room() throws.
std::unique_ptr<GeometryUpload> make_upload(const v1::GeometryHeader& header, const EngineOptions& limits,
                                            const UploadParts& parts, const CallContext& call);

}  // namespace deform::server
