// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "core/constraints/constraint.h"
#include "core/mesh/mesh.h"

/// A part whose sets of points lie on shapes and in each other.
namespace deform::test::contract {

using PartSet = std::pair<ConstraintKind, std::vector<PointId>>;

struct Part {
  Mesh mesh;
  /// Sets of which each one has points in common with the others: a plane and its rim; a cylinder and its rim; a cylinder and an
  /// arc; all of these; a cylinder, two of its circles and a generator.
  std::vector<std::vector<PartSet>> families;
};

/// A closed cylinder along z, 2 long, with `around` points in each of `rows` circles and one ring within each cap; or a cone,
/// whose radius is smaller by `taper` at its upper end.
inline Part capped_cylinder(std::size_t around, std::size_t rows, double taper = 0) {
  constexpr double turn = 6.283185307179586;
  Part part;
  Mesh& mesh = part.mesh;
  const auto ring = [&](double radius, double z) {
    std::vector<PointId> ids;
    for (std::size_t i = 0; i < around; ++i) {
      const double a = turn * static_cast<double>(i) / static_cast<double>(around);
      ids.push_back(static_cast<PointId>(mesh.points.size()));
      mesh.points.push_back({radius * std::cos(a), radius * std::sin(a), z});
    }
    return ids;
  };
  const auto join = [&](const std::vector<PointId>& a, const std::vector<PointId>& b) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      const std::size_t j = (i + 1) % a.size();
      for (const PointId id : {a[i], a[j], b[j], a[i], b[j], b[i]}) mesh.face_points.push_back(id);
      mesh.face_sizes.insert(mesh.face_sizes.end(), {3, 3});
    }
  };
  std::vector<std::vector<PointId>> circles;
  for (std::size_t r = 0; r < rows; ++r) {
    const double height = static_cast<double>(r) / static_cast<double>(rows - 1);
    circles.push_back(ring(0.5 - taper * height, 2 * height));
  }
  for (std::size_t r = 1; r < rows; ++r) join(circles[r - 1], circles[r]);
  std::vector<std::vector<PointId>> caps;
  for (const bool top : {false, true}) {
    const std::vector<PointId>& rim = top ? circles.back() : circles.front();
    const double z = mesh.points[rim[0]][2];
    const std::vector<PointId> within = ring(0.25, z);
    top ? join(rim, within) : join(within, rim);
    const auto centre = static_cast<PointId>(mesh.points.size());
    mesh.points.push_back({0, 0, z});
    for (std::size_t i = 0; i < around; ++i) {
      const PointId a = within[i], b = within[(i + 1) % around];
      for (const PointId id : {top ? a : b, top ? b : a, centre}) mesh.face_points.push_back(id);
      mesh.face_sizes.push_back(3);
    }
    std::vector<PointId> cap = rim;
    cap.insert(cap.end(), within.begin(), within.end());
    cap.push_back(centre);
    caps.push_back(std::move(cap));
  }
  std::vector<PointId> side, generator;
  for (const auto& circle : circles) {
    side.insert(side.end(), circle.begin(), circle.end());
    generator.push_back(circle[0]);
  }
  const std::vector<PointId>& middle = circles[rows / 2];
  const std::vector<PointId> arc(middle.begin(), middle.begin() + static_cast<std::ptrdiff_t>(around / 2 + 1));
  if (taper != 0) {
    const PartSet cone{Conical{}, side};
    part.families = {{cone}, {cone, {Planar{}, caps[1]}}, {cone, {Straight{}, generator}}, {cone, {Planar{}, caps[0]}}};
    return part;
  }
  const PartSet cylinder{Cylindrical{}, side}, plane{Planar{}, caps[1]}, rim{Circular{}, circles.back()};
  part.families = {{plane, rim},
                   {cylinder, rim},
                   {cylinder, {Circular{}, arc}},
                   {plane, rim, cylinder},
                   {cylinder, {Circular{}, middle}, {Circular{}, circles.front()}},
                   {plane, {Planar{}, caps[0]}, {Circular{}, circles.front()}},
                   {cylinder, {Straight{}, generator}}};
  return part;
}

}  // namespace deform::test::contract
