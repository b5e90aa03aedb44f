// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/io/formats/cgns/cgns_zone.h"

namespace deform::io {

namespace {

constexpr std::uint32_t none = 0xffffffff;

/// The cells on both sides of a polygon; the first is the one that its normal leaves, if the file says so.
struct Uses {
  std::uint32_t cells[2]{none, none};
  bool outward[2]{};
};

class Builder {
 public:
  Builder(CgnsMesh&& source, const std::string& name) : source_(std::move(source)), name_(name) {}

  std::shared_ptr<const Mesh> build() {
    collect_uses();
    cells_->cell_count = source_.polyhedra.size();
    mesh_->points = std::move(source_.elements.points);
    for (std::uint32_t polygon = 0; polygon < uses_.size(); ++polygon) {
      if (uses_[polygon].cells[1] != none) add_internal(polygon);
    }
    for (std::uint32_t polygon = 0; polygon < uses_.size(); ++polygon) {
      if (uses_[polygon].cells[0] != none && uses_[polygon].cells[1] == none) add_boundary(polygon);
    }
    add_groups();
    try {
      mesh_->cells = cells_;
      mesh_->validate();
    } catch (const Error& error) {
      throw Error(error.code(), name_ + ": " + error.what());
    }
    return mesh_;
  }

 private:
  void collect_uses() {
    uses_.resize(source_.polygons.size());
    faces_.assign(source_.polygons.size(), none);
    for (std::size_t cell = 0; cell < source_.polyhedra.size(); ++cell) {
      for (const CgnsSide side : source_.polyhedra[cell]) {
        Uses& uses = uses_[side.polygon];
        const std::size_t place = uses.cells[0] == none ? 0 : 1;
        if (uses.cells[place] != none) {
          throw Error(ErrorCode::invalid_argument,
                      name_ + ": face " + std::to_string(side.polygon) + " (from 0, of all NGON_n) belongs to more than 2 cells");
        }
        uses.cells[place] = static_cast<std::uint32_t>(cell);
        uses.outward[place] = side.outward;
      }
    }
  }

  void add_corners(std::uint32_t polygon, bool reversed) {
    const auto corners = source_.polygons[polygon];
    if (reversed) {
      cells_->face_points.insert(cells_->face_points.end(), corners.rbegin(), corners.rend());
    } else {
      cells_->face_points.insert(cells_->face_points.end(), corners.begin(), corners.end());
    }
    cells_->face_offsets.push_back(cells_->face_points.size());
  }

  void add_internal(std::uint32_t polygon) {
    const Uses& uses = uses_[polygon];
    const bool signs_differ = uses.outward[0] != uses.outward[1];
    const std::size_t owner = signs_differ && uses.outward[1] ? 1 : 0;
    cells_->owner.push_back(uses.cells[owner]);
    cells_->neighbour.push_back(uses.cells[1 - owner]);
    add_corners(polygon, !signs_differ && !points_along(polygon, uses.cells[0], uses.cells[1]));
  }

  void add_boundary(std::uint32_t polygon) {
    const Uses& uses = uses_[polygon];
    cells_->owner.push_back(uses.cells[0]);
    add_corners(polygon, !uses.outward[0]);
    faces_[polygon] = static_cast<FaceId>(mesh_->face_sizes.size());
    const auto corners = cells_->face(cells_->face_count() - 1);
    append_face(corners, mesh_->face_sizes, mesh_->face_points);
  }

  /// Where a file gives both cells the same sign: whether the normal goes from the middle of one to that of the other.
  bool points_along(std::uint32_t polygon, std::uint32_t from, std::uint32_t to) const {
    const Vec3 a = middle(from), b = middle(to);
    const auto corners = source_.polygons[polygon];
    const Vec3& base = mesh_->points[corners[0]];
    double sum = 0;
    for (std::size_t c = 1; c + 1 < corners.size(); ++c) {
      sum += dot(b - a, cross(mesh_->points[corners[c]] - base, mesh_->points[corners[c + 1]] - base));
    }
    return sum >= 0;
  }

  Vec3 middle(std::uint32_t cell) const {
    Vec3 sum{};
    double count = 0;
    for (const CgnsSide side : source_.polyhedra[cell]) {
      for (const PointId point : source_.polygons[side.polygon]) {
        sum = sum + mesh_->points[point];
        count += 1;
      }
    }
    return sum / count;
  }

  void add_groups() {
    FaceGroups groups;
    for (const CgnsNamedSet& set : source_.sets) {
      const auto inside = [&](const CgnsElement& e) { return e.kind == CgnsElement::Kind::polygon && faces_[e.index] == none; };
      // A section of the faces between cells is no part that anybody would name.
      if (set.kind == FaceGroups::Kind::section && std::any_of(set.elements.begin(), set.elements.end(), inside)) continue;
      const std::size_t group = groups.find_or_add(set.kind, set.name);
      for (const CgnsElement& element : set.elements) add_member(element, group, groups);
    }
    mesh_->groups = groups.finish();
  }

  void add_member(const CgnsElement& element, std::size_t group, FaceGroups& groups) const {
    const auto add_points = [&](std::span<const PointId> points) {
      for (const PointId point : points) groups.add_point(group, point);
    };
    switch (element.kind) {
      case CgnsElement::Kind::point:
        return groups.add_point(group, element.index);
      case CgnsElement::Kind::edge:
        return add_points(source_.edges[element.index]);
      case CgnsElement::Kind::face:
        return add_points(source_.elements.faces[element.index].corners);
      case CgnsElement::Kind::polygon:
        if (faces_[element.index] == none) return add_points(source_.polygons[element.index]);
        return groups.add_face(group, faces_[element.index]);
      case CgnsElement::Kind::polyhedron:
        for (const CgnsSide side : source_.polyhedra[element.index]) add_points(source_.polygons[side.polygon]);
        return;
      case CgnsElement::Kind::cell:
        return;  // there are none beside polyhedra
    }
  }

  CgnsMesh source_;
  const std::string& name_;
  std::vector<Uses> uses_;     ///< by polygon
  std::vector<FaceId> faces_;  ///< of the boundary, by polygon
  const std::shared_ptr<Mesh> mesh_ = std::make_shared<Mesh>();
  const std::shared_ptr<PolyhedralCells> cells_ = std::make_shared<PolyhedralCells>();
};

}  // namespace

std::shared_ptr<const Mesh> cgns_polyhedra(CgnsMesh&& mesh, const std::string& name) {
  return Builder(std::move(mesh), name).build();
}

}  // namespace deform::io
