// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mesh/cells.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "core/base/error.h"
#include "tests/core/mesh/polyhedral.h"

namespace deform::cells_test {
namespace {

/// Two tetrahedra on both sides of a triangle, and a point that belongs to none of them.
constexpr std::size_t points = 6;
PolyhedralCells two_tetrahedra() {
  Elements elements;
  elements.add(ElementType::tetrahedron, std::vector<PointId>{0, 1, 2, 3});
  elements.add(ElementType::tetrahedron, std::vector<PointId>{0, 2, 1, 4});
  return test::by_faces(elements);
}

std::string refusal(const std::function<void(PolyhedralCells&)>& change) {
  PolyhedralCells cells = two_tetrahedra();
  change(cells);
  try {
    cells.validate(points);
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::invalid_argument);
    return error.what();
  }
  return "none";
}

TEST(PolyhedralCells, AreValid) {
  const PolyhedralCells cells = two_tetrahedra();
  EXPECT_EQ(cells.face_count(), 7u);
  EXPECT_EQ(cells.internal_faces(), 1u);
  EXPECT_EQ(cells.face(6).size(), 3u);
  EXPECT_EQ(refusal([](PolyhedralCells&) {}), "none");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.empty_faces.assign(7, 1); }), "none");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.face_points[4] = points - 1; }), "none");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.owner[3] = 1; }), "none");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.neighbour.assign(7, 1); }), "none");
}

TEST(PolyhedralCells, AreRefusedByArrayIndexAndLimit) {
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.cell_count = 0; }), "cells: there must be at least one");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.face_offsets.clear(); }), "cells: face_offsets[0]: must be 0");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.face_offsets[0] = 1; }), "cells: face_offsets[0]: must be 0");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.face_offsets[1] = 0; }), "cells: face_offsets[1]: a face needs a corner");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.face_offsets[4] = c.face_offsets[3]; }),
            "cells: face_offsets[4]: a face needs a corner");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.face_offsets[7] = 17; }), "cells: face_offsets[7]: a face needs a corner");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.face_offsets[7] = 22; }),
            "cells: face_offsets: they end at 22, face_points has 21");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.face_points.push_back(0); }),
            "cells: face_offsets: they end at 21, face_points has 22");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.owner.pop_back(); }), "cells: owner: has 6 entries, expected 7");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.owner.push_back(0); }), "cells: owner: has 8 entries, expected 7");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.neighbour.assign(8, 1); }), "cells: neighbour: 8, more than faces");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.empty_faces = {1}; }), "cells: empty_faces: has 1 entries, expected 7");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.face_points[4] = points; }),
            "cells: face_points[4]: point 6 is out of range, there are 6 points");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.owner[3] = 2; }), "cells: owner[3]: cell 2 is out of range, there are 2 cells");
  EXPECT_EQ(refusal([](PolyhedralCells& c) { c.neighbour[0] = 2; }),
            "cells: neighbour[0]: cell 2 is out of range, there are 2 cells");
}

}  // namespace
}  // namespace deform::cells_test
