// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/constraints/detection/detect.h"
#include "tests/core/constraints/detection/parts.h"

namespace deform::test {

inline double face_area(const Mesh& mesh, std::size_t f) {
  const Vec3 &a = mesh.points[mesh.face_points[3 * f]], &b = mesh.points[mesh.face_points[3 * f + 1]],
             &c = mesh.points[mesh.face_points[3 * f + 2]];
  const Vec3 u{b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v{c[0] - a[0], c[1] - a[1], c[2] - a[2]};
  return std::hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]) / 2;
}

inline bool same_kind(Kind truth, PrimitiveKind found) {
  return truth != Kind::none && static_cast<int>(truth) == static_cast<int>(found);
}

/// For a mesh of triangles: every truth of more than 1 % of the area has its primitive, nothing else is found, and 98 % of the
/// faces are labelled right (those of truths that are too small to be found belong to nothing). Negative: sizes are not compared.
inline void expect_found(const Part& part, const Detection& found, const std::string& what, double size_tolerance) {
  SCOPED_TRACE(what);
  const std::size_t faces = part.mesh.face_count();
  std::vector<int> of_face(faces, -1);
  for (std::size_t p = 0; p < found.primitives.size(); ++p) {
    for (const FaceId f : found.primitives[p].faces) of_face[f] = static_cast<int>(p);
  }
  std::vector<double> areas(part.truths.size(), 0);
  double all = 0;
  for (std::size_t f = 0; f < faces; ++f) {
    const double area = face_area(part.mesh, f);
    areas[static_cast<std::size_t>(part.labels[f])] += area;
    all += area;
  }
  // The truth that most faces of each primitive belong to.
  std::vector<int> truth_of(found.primitives.size(), -1);
  std::vector<std::size_t> finds(part.truths.size(), 0);
  for (std::size_t p = 0; p < found.primitives.size(); ++p) {
    std::vector<std::size_t> votes(part.truths.size(), 0);
    for (const FaceId f : found.primitives[p].faces) ++votes[static_cast<std::size_t>(part.labels[f])];
    const auto t = static_cast<std::size_t>(std::max_element(votes.begin(), votes.end()) - votes.begin());
    truth_of[p] = static_cast<int>(t);
    const Primitive& primitive = found.primitives[p];
    if (part.truths[t].kind == Kind::none) {
      EXPECT_LE(primitive.area, 0.02 * all) << primitive.name << " on what is no primitive";
      continue;
    }
    ++finds[t];
    EXPECT_TRUE(same_kind(part.truths[t].kind, primitive.kind)) << primitive.name << " for truth " << t;
    if (size_tolerance < 0) continue;
    if (primitive.kind == PrimitiveKind::cylinder || primitive.kind == PrimitiveKind::sphere) {
      EXPECT_NEAR(primitive.radius, part.truths[t].size, size_tolerance) << primitive.name;
    }
    if (primitive.kind == PrimitiveKind::cone) {
      EXPECT_NEAR(primitive.half_angle, part.truths[t].size, size_tolerance) << primitive.name;
    }
  }
  for (std::size_t t = 0; t < part.truths.size(); ++t) {
    if (part.truths[t].kind == Kind::none || areas[t] < 0.011 * all) continue;
    EXPECT_EQ(finds[t], 1u) << "truth " << t << ", area " << areas[t] / all;
  }
  std::size_t right = 0;
  std::map<std::pair<int, std::string>, int> wrong;  // truth and what was found instead
  for (std::size_t f = 0; f < faces; ++f) {
    const int label = part.labels[f], p = of_face[f];
    const auto t = static_cast<std::size_t>(label);
    const bool none = part.truths[t].kind == Kind::none || (p < 0 && areas[t] < 0.0099 * all);
    const bool good = p < 0 ? none : truth_of[static_cast<std::size_t>(p)] == label && !none;
    right += good ? 1 : 0;
    if (!good) ++wrong[{label, p < 0 ? "nothing" : found.primitives[static_cast<std::size_t>(p)].name}];
  }
  EXPECT_GE(static_cast<double>(right), 0.98 * static_cast<double>(faces))
      << right << " of " << faces << " faces; wrong " << testing::PrintToString(wrong);
}

}  // namespace deform::test
