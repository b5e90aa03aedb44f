// SPDX-License-Identifier: Apache-2.0
#include "core/measures/faces.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/inspect.h"

namespace deform::measures {

namespace {

void append_fan(std::span<const PointId> corners, FaceId face, FaceTriangles& out) {
  for (std::size_t i = 2; i < corners.size(); ++i) {
    out.triangles.push_back({corners[0], corners[i - 1], corners[i]});
    out.faces.push_back(face);
  }
}

FaceTriangles triangles_around_cells(const Mesh& mesh) {
  FaceTriangles found;
  if (mesh.elements) {
    const BoundaryFaces boundary = boundary_faces(*mesh.elements);
    std::size_t at = 0;
    for (std::size_t f = 0; f < boundary.sizes.size(); at += boundary.sizes[f], ++f) {
      append_fan(std::span(boundary.points).subspan(at, boundary.sizes[f]), static_cast<FaceId>(f), found);
    }
  } else if (mesh.cells) {
    for (std::size_t f = mesh.cells->internal_faces(); f < mesh.cells->face_count(); ++f) {
      append_fan(mesh.cells->face(f), static_cast<FaceId>(f), found);
    }
  } else {
    throw Error(ErrorCode::invalid_argument, "cells: the mesh has none");
  }
  return found;
}

/// The faces of the groups as a mask, or all.
std::vector<char> chosen_faces(const Mesh& mesh, const std::vector<std::string>& groups) {
  std::vector<char> chosen(mesh.face_count(), groups.empty() ? 1 : 0);
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const std::string field = "groups[" + std::to_string(i) + "]";
    const Group* const group = mesh.find_group(groups[i]);
    if (group == nullptr) {
      std::vector<std::string> names;
      for (const Group& each : mesh.groups) names.push_back(each.name);
      const std::string near = nearest_names(groups[i], names);
      throw Error(ErrorCode::invalid_argument,
                  field + ": there is no group \"" + groups[i] + "\"" + (near.empty() ? "" : "; did you mean " + near + "?"));
    }
    if (group->faces.empty()) throw Error(ErrorCode::invalid_argument, field + ": group \"" + groups[i] + "\" has no faces");
    for (const FaceId face : group->faces) chosen[face] = 1;
  }
  return chosen;
}

/// An edge that faces traverse more often in one direction than in the other.
struct RimEdge {
  PointId from, to;       ///< in the direction that is traversed more often
  std::uint32_t surplus;  ///< how much more often
};

std::vector<RimEdge> rim_edges(const std::vector<Triangle>& triangles, const std::vector<PointId>& same) {
  struct Use {
    PointId low, high;
    std::int32_t way;
  };
  std::vector<Use> uses;
  uses.reserve(3 * triangles.size());
  for (const Triangle& triangle : triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const PointId from = same[triangle[i]], to = same[triangle[(i + 1) % 3]];
      if (from != to) uses.push_back({std::min(from, to), std::max(from, to), from < to ? 1 : -1});
    }
  }
  std::sort(uses.begin(), uses.end(),
            [](const Use& s, const Use& t) { return s.low != t.low ? s.low < t.low : s.high < t.high; });
  std::vector<RimEdge> rims;
  for (std::size_t i = 0, end = 0; i < uses.size(); i = end) {
    std::int32_t sum = 0;
    for (end = i; end < uses.size() && uses[end].low == uses[i].low && uses[end].high == uses[i].high; ++end)
      sum += uses[end].way;
    if (sum > 0) rims.push_back({uses[i].low, uses[i].high, static_cast<std::uint32_t>(sum)});
    if (sum < 0) rims.push_back({uses[i].high, uses[i].low, static_cast<std::uint32_t>(-sum)});
  }
  return rims;
}

/// The connected parts of edges: a number of its part for each point of one, and no_part for the others.
class Parts {
 public:
  static constexpr PointId no_part = ~PointId{0};

  Parts(std::size_t points, const std::vector<RimEdge>& edges) : parent_(points, no_part) {
    for (const RimEdge& edge : edges) {
      for (const PointId end : {edge.from, edge.to}) {
        if (parent_[end] == no_part) parent_[end] = end;
      }
      const PointId s = root(edge.from), t = root(edge.to);
      parent_[std::max(s, t)] = std::min(s, t);
    }
  }

  bool holds(PointId point) const { return parent_[point] != no_part; }
  /// The least point of the part.
  PointId root(PointId point) {
    while (parent_[point] != point) {
      parent_[point] = parent_[parent_[point]];
      point = parent_[point];
    }
    return point;
  }

 private:
  std::vector<PointId> parent_;
};

}  // namespace

Box FaceTriangles::box(std::span<const Vec3> points) const {
  Box box;
  for (const Triangle& triangle : triangles) {
    for (const PointId corner : triangle) box.add(points[corner]);
  }
  return box;
}

FaceTriangles chosen_triangles(const Mesh& mesh, const FaceChoice& choice) {
  if (choice.source == FaceSource::cells) {
    if (!choice.groups.empty()) {
      throw Error(ErrorCode::invalid_argument, "groups: cells have none; groups are of faces of the mesh");
    }
    return triangles_around_cells(mesh);
  }
  const std::vector<char> chosen = chosen_faces(mesh, choice.groups);
  FaceTriangles found;
  std::size_t at = 0;
  for (std::size_t f = 0; f < mesh.face_count(); at += mesh.face_sizes[f], ++f) {
    if (chosen[f] != 0) append_fan(std::span(mesh.face_points).subspan(at, mesh.face_sizes[f]), static_cast<FaceId>(f), found);
  }
  if (found.triangles.empty()) throw Error(ErrorCode::invalid_argument, "faces: the mesh has none with three corners or more");
  return found;
}

Body::Body(const Mesh& mesh, const FaceChoice& choice, Rims rims) : points_(mesh.point_count()) {
  FaceTriangles chosen = chosen_triangles(mesh, choice);
  const Box box = chosen.box(mesh.points);
  triangles_ = std::move(chosen.triangles);
  faces_ = std::move(chosen.faces);
  close(mesh, choice, rims);
  const Points placed = with_centres(mesh.points);
  const Vec3 middle = 0.5 * (box.min + box.max);
  double volume = 0, area = 0;
  for (const Triangle& triangle : triangles_) {
    const Vec3 a = placed[triangle[0]] - middle, b = placed[triangle[1]] - middle, c = placed[triangle[2]] - middle;
    volume += dot(a, cross(b, c)) / 6;
    area += length(cross(b - a, c - a)) / 2;
  }
  if (!(std::abs(volume) > 1e-12 * area * box.diagonal())) {
    throw Error(ErrorCode::invalid_argument, "faces: they enclose no volume, so that nothing says what is inside");
  }
  turned_ = volume < 0;
  if (turned_) {
    for (Triangle& triangle : triangles_) std::swap(triangle[1], triangle[2]);
  }
}

void Body::close(const Mesh& mesh, const FaceChoice& choice, Rims rims) {
  const std::vector<RimEdge> edges = rim_edges(triangles_, coincident_points(mesh.points));
  if (edges.empty()) return;
  for (const RimEdge& edge : edges) {
    // Two faces that meet at an edge traverse it in opposite directions.
    if (edge.surplus > 1) {
      throw Error(ErrorCode::invalid_argument, "faces: those at the edge of points " + std::to_string(edge.from) + " and " +
                                                   std::to_string(edge.to) + " are oriented against each other");
    }
  }
  if (rims == Rims::refuse) {
    throw Error(ErrorCode::invalid_argument, std::string(choice.groups.empty() ? "faces" : "groups") +
                                                 ": the faces are not closed, such as at the edge of points " +
                                                 std::to_string(edges[0].from) + " and " + std::to_string(edges[0].to) +
                                                 ", one of " + std::to_string(edges.size()) + "; closing the rims is an option");
  }
  Parts parts(points_, edges);
  std::vector<PointId> number(points_);
  for (PointId point = 0; point < points_; ++point) {
    if (!parts.holds(point)) continue;
    const PointId root = parts.root(point);
    if (root == point) {
      number[point] = static_cast<PointId>(rims_.size());
      rims_.emplace_back();
    }
    rims_[number[root]].push_back(point);
  }
  for (const RimEdge& edge : edges) {
    triangles_.push_back({edge.to, edge.from, static_cast<PointId>(points_ + number[parts.root(edge.from)])});
  }
}

Points Body::with_centres(std::span<const Vec3> points) const {
  Points placed(points.begin(), points.end());
  placed.reserve(points_ + rims_.size());
  for (const auto& rim : rims_) {
    Vec3 sum{};
    for (const PointId point : rim) sum = sum + points[point];
    placed.push_back(sum / static_cast<double>(rim.size()));
  }
  return placed;
}

void Body::carry_centres(Points& gradient) const {
  for (std::size_t k = 0; k < rims_.size(); ++k) {
    const Vec3 share = gradient[points_ + k] / static_cast<double>(rims_[k].size());
    for (const PointId point : rims_[k]) gradient[point] = gradient[point] + share;
  }
  gradient.resize(points_);
}

}  // namespace deform::measures
