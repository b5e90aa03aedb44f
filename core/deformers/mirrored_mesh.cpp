// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/mirrored_mesh.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <string>
#include <utility>

#include "core/base/vectors.h"
#include "core/deformers/option_checks.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"

namespace deform {

MirroredMesh::MirroredMesh(const Mesh& half, const Symmetry& symmetry) : symmetry_(symmetry) {
  const std::size_t n = half.point_count(), images = symmetry.images();
  constexpr std::size_t most = std::numeric_limits<PointId>::max();
  if (images * n > most) {
    refuse_argument("symmetry: with its mirror images the mesh has more than " + std::to_string(most) + " points");
  }
  on_.resize(n);
  for (std::size_t i = 0; i < n; ++i) on_[i] = static_cast<std::uint8_t>(symmetry.on(static_cast<PointId>(i)));
  if (symmetry.is_sector()) partner_.resize(n);
  for (const Sector::Pair& pair : symmetry.sector().pairs()) {
    on_[pair.first] |= first_boundary;
    on_[pair.second] |= second_boundary;
    partner_[pair.first] = pair.second;
    partner_[pair.second] = pair.first;
  }
  for (const PointId id : symmetry.sector().axis_points()) on_[id] = first_boundary | second_boundary | axis;
  auto whole = std::make_shared<Mesh>();
  whole->points.reserve(images * n);
  for (std::size_t g = 0; g < images; ++g) {
    std::vector<PointId>& ids = ids_.emplace_back();
    ids.reserve(n + 1);
    for (std::size_t i = 0; i < n; ++i) {
      ids.push_back(static_cast<PointId>(whole->points.size()));
      if (is_own(static_cast<PointId>(i), g)) whole->points.push_back(reflected_point(half.points[i], g));
    }
    ids.push_back(static_cast<PointId>(whole->points.size()));
  }
  add_faces(half, *whole);
  add_cells(half, *whole);
  mesh_ = std::move(whole);
}

MirroredMesh::Place MirroredMesh::owner(PointId id, std::size_t image) const {
  if (!symmetry_.is_sector()) return {id, image & ~std::size_t{on_[id]}};
  if ((on_[id] & axis) != 0) return {id, 0};
  if ((on_[id] & second_boundary) != 0 && image + 1 == images()) return {partner_[id], 0};
  if ((on_[id] & first_boundary) != 0 && image > 0) return {partner_[id], image - 1};
  return {id, image};
}

void MirroredMesh::add_faces(const Mesh& half, Mesh& whole) const {
  for (std::size_t g = 0; g < images(); ++g) {
    const PointId* corners = half.face_points.data();
    for (const std::uint32_t size : half.face_sizes) {
      unsigned in_plane = ~0u;
      for (std::size_t c = 0; c < size; ++c) in_plane &= on_[corners[c]];
      if (size > 0 && in_plane == 0) {
        whole.face_sizes.push_back(size);
        const std::size_t begin = whole.face_points.size();
        for (std::size_t c = 0; c < size; ++c) whole.face_points.push_back(image(corners[c], g));
        if (!symmetry_.is_sector() && std::popcount(g) % 2 != 0) {
          std::reverse(whole.face_points.begin() + static_cast<std::ptrdiff_t>(begin), whole.face_points.end());
        }
      }
      corners += size;
    }
  }
}

void MirroredMesh::add_cells(const Mesh& half, Mesh& whole) const {
  if (half.elements) {
    auto elements = std::make_shared<Elements>();
    std::vector<PointId> nodes;
    for (std::size_t g = 0; g < images(); ++g) {
      for (std::size_t e = 0; e < half.elements->size(); ++e) {
        nodes.clear();
        for (const PointId id : half.elements->nodes(e)) nodes.push_back(image(id, g));
        elements->add(half.elements->types[e], nodes);
      }
    }
    whole.elements = std::move(elements);
  }
  if (half.cells) {
    const PolyhedralCells& from = *half.cells;
    auto cells = std::make_shared<PolyhedralCells>();
    const auto add = [&](std::size_t begin, std::size_t end) {
      for (std::size_t g = 0; g < images(); ++g) {
        const auto first = static_cast<std::uint32_t>(g * from.cell_count);
        for (std::size_t f = begin; f < end; ++f) {
          for (const PointId id : from.face(f)) cells->face_points.push_back(image(id, g));
          cells->face_offsets.push_back(cells->face_points.size());
          cells->owner.push_back(first + from.owner[f]);
          if (f < from.internal_faces()) cells->neighbour.push_back(first + from.neighbour[f]);
          if (!from.empty_faces.empty()) cells->empty_faces.push_back(from.empty_faces[f]);
        }
      }
    };
    add(0, from.internal_faces());
    add(from.internal_faces(), from.face_count());
    cells->cell_count = images() * from.cell_count;
    whole.cells = std::move(cells);
  }
}

std::vector<PointId> MirroredMesh::own_images(std::span<const PointId> ids, std::size_t image) const {
  std::vector<PointId> result;
  for (const PointId id : ids) {
    if (is_own(id, image)) result.push_back(ids_[image][id]);
  }
  return result;
}

Vec3 MirroredMesh::reflected(const Vec3& vector, std::size_t image) const {
  if (symmetry_.is_sector()) return symmetry_.turned(vector, image);
  Vec3 result = vector;
  for (std::size_t k = 0; k < symmetry_.planes(); ++k) {
    if ((image >> k & 1u) != 0) result = result - 2 * dot(symmetry_.normal(k), result) * symmetry_.normal(k);
  }
  return result;
}

Vec3 MirroredMesh::reflected_point(const Vec3& point, std::size_t image) const {
  if (symmetry_.is_sector()) return image == 0 ? point : symmetry_.turned_point(point, image);
  Vec3 result = point;
  for (std::size_t k = 0; k < symmetry_.planes(); ++k) {
    if ((image >> k & 1u) != 0) result = symmetry_.reflected(result, k);
  }
  return result;
}

std::array<PointId, 2> MirroredMesh::own_range(std::size_t begin, std::size_t end, std::size_t image) const {
  return {ids_[image][begin], ids_[image][end]};
}

std::size_t MirroredMesh::bytes_for(std::size_t points, std::size_t images) {
  return sizeof(MirroredMesh) + (2 + sizeof(PointId)) * points + images * (points + 1) * sizeof(PointId);
}

std::size_t MirroredMesh::mesh_bytes() const {
  const Mesh& mesh = *mesh_;
  return mesh.points.size() * sizeof(Vec3) + mesh.face_sizes.size() * sizeof(std::uint32_t) +
         mesh.face_points.size() * sizeof(PointId) + (mesh.elements ? mesh.elements->bytes() : 0) +
         (mesh.cells ? mesh.cells->bytes() : 0);
}

}  // namespace deform
