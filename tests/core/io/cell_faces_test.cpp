// SPDX-License-Identifier: GPL-3.0-or-later
// Cells with all of their faces become owners and neighbours, against a table of the cells that have the same corners; text in
// XML.
#include "core/io/assembly/cell_faces.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "core/io/formats/vtk/xml_tree.h"
#include "tests/support/expect_error.h"

namespace deform::io::cell_faces_test {
namespace {

/// nx x ny x nz cubes, each with its six faces in an order of its own, which begin anywhere.
CellFaces cubes(std::uint32_t nx, std::uint32_t ny, std::uint32_t nz, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  CellFaces cells;
  for (std::uint32_t k = 0; k < nz; ++k) {
    for (std::uint32_t j = 0; j < ny; ++j) {
      for (std::uint32_t i = 0; i < nx; ++i) {
        const auto point = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
          return static_cast<PointId>(i + a + (nx + 1) * (j + b + (ny + 1) * (k + c)));
        };
        std::vector<std::array<PointId, 4>> faces = {{point(0, 0, 0), point(0, 1, 0), point(1, 1, 0), point(1, 0, 0)},
                                                     {point(0, 0, 1), point(1, 0, 1), point(1, 1, 1), point(0, 1, 1)},
                                                     {point(0, 0, 0), point(1, 0, 0), point(1, 0, 1), point(0, 0, 1)},
                                                     {point(0, 1, 0), point(0, 1, 1), point(1, 1, 1), point(1, 1, 0)},
                                                     {point(0, 0, 0), point(0, 0, 1), point(0, 1, 1), point(0, 1, 0)},
                                                     {point(1, 0, 0), point(1, 1, 0), point(1, 1, 1), point(1, 0, 1)}};
        std::shuffle(faces.begin(), faces.end(), random);
        for (auto& face : faces) {
          std::rotate(face.begin(), face.begin() + static_cast<std::ptrdiff_t>(random() % 4), face.end());
          cells.add_face(face);
        }
        cells.end_cell();
      }
    }
  }
  return cells;
}

TEST(CellFaces, AreJoinedToOwnersAndNeighbours) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const CellFaces cells = cubes(2, 3, 2, seed);
    std::map<std::set<PointId>, std::vector<std::uint32_t>> cells_of;
    for (std::uint32_t c = 0; c < cells.cell_count(); ++c) {
      for (std::uint64_t f = cells.cell_offsets[c]; f < cells.cell_offsets[c + 1]; ++f) {
        const auto face = cells.face(f);
        cells_of[{face.begin(), face.end()}].push_back(c);
      }
    }
    const PolyhedralCells joint = joined(cells);
    EXPECT_EQ(joint.cell_count, 12u);
    EXPECT_EQ(joint.face_count(), cells_of.size()) << "each face once";
    EXPECT_EQ(joint.internal_faces(), 20u);
    std::set<std::set<PointId>> found;
    for (std::size_t f = 0; f < joint.face_count(); ++f) {
      const auto face = joint.face(f);
      const std::set<PointId> corners(face.begin(), face.end());
      found.insert(corners);
      const std::vector<std::uint32_t>& wanted = cells_of.at(corners);
      EXPECT_EQ(wanted.size(), f < joint.internal_faces() ? 2u : 1u) << "those between cells come first";
      EXPECT_EQ(joint.owner[f], wanted.front());
      if (f < joint.internal_faces()) {
        EXPECT_EQ(joint.neighbour[f], wanted.back());
      }
      // As the owner has it: it looks out of it.
      const std::vector<PointId> ring(face.begin(), face.end());
      bool as_given = false;
      for (std::uint64_t g = cells.cell_offsets[wanted.front()]; g < cells.cell_offsets[wanted.front() + 1]; ++g) {
        const auto given = cells.face(g);
        as_given = as_given || std::equal(ring.begin(), ring.end(), given.begin(), given.end());
      }
      EXPECT_TRUE(as_given);
    }
    EXPECT_EQ(found.size(), joint.face_count());
  }
}

TEST(CellFaces, BelongToTwoCellsAtMost) {
  const std::array<PointId, 3> face{0, 1, 2}, same{2, 0, 1};
  CellFaces twice;
  twice.add_face(face);
  twice.add_face(same);
  twice.end_cell();
  test::expect_error(ErrorCode::invalid_argument, {"twice"}, [&] { (void)joined(twice); });
  CellFaces three;
  for (int c = 0; c < 3; ++c) {
    three.add_face(face);
    three.end_cell();
  }
  test::expect_error(ErrorCode::invalid_argument, {"two other cells"}, [&] { (void)joined(three); });
}

TEST(XmlText, HasTheCharactersThatEntitiesStandFor) {
  EXPECT_EQ(xml_text(""), "");
  EXPECT_EQ(xml_text("plain text"), "plain text");
  EXPECT_EQ(xml_text("a &lt; b &amp;&amp; c &gt; d"), "a < b && c > d");
  EXPECT_EQ(xml_text("&quot;it&apos;s&quot;"), "\"it's\"");
  EXPECT_EQ(xml_text("&amp;lt; & &unknown; &lt"), "&lt; & &unknown; &lt");
}

}  // namespace
}  // namespace deform::io::cell_faces_test
