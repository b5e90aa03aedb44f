// SPDX-License-Identifier: GPL-3.0-or-later
// The worst entities of a mesh with their values and positions.
#include "core/quality/report.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "core/base/vectors.h"
#include "core/quality/safe_amplitude.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/quality/cell_shapes.h"

namespace deform::report_test {
namespace {

using namespace test;

TEST(QualityReport, ListsTheWorstElementsWithTheirPlaces) {
  Points points;
  Elements elements;
  for (int e = 0; e < 3; ++e) {
    std::vector<PointId> nodes;
    for (Vec3 p : reference(ElementType::hexahedron)) {
      p[0] += 0.1 * e * p[2] + 10 * e;
      nodes.push_back(static_cast<PointId>(points.size()));
      points.push_back(p);
    }
    elements.add(ElementType::hexahedron, nodes);
  }
  const QualityReport report = quality_report(element_quality(points, elements), points, elements);
  ASSERT_EQ(report.worst.size(), 1u);
  const std::vector<WorstList::Entry>& worst = report.worst[0].entries;
  ASSERT_EQ(worst.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t e = 2 - i;  // the more sheared, the worse
    EXPECT_EQ(worst[i].id, e);
    const double shear = 0.1 * static_cast<double>(e);
    EXPECT_NEAR(worst[i].value.value(), 1 / std::sqrt(1 + shear * shear), 1e-14);
    EXPECT_LT(distance(worst[i].position, Vec3{0.5 + shear / 2 + 10 * static_cast<double>(e), 0.5, 0.5}), 1e-12);
  }
}

TEST(QualityReport, PlacesPolyhedraInTheMiddleOfTheirFaces) {
  const Grid g = grid(2, 1, 1);
  PolyhedralQuality quality = polyhedral_quality(g.points, g.cells);
  quality.inverted = {0, 1};
  quality.wrong_faces = {0};
  const QualityReport report = quality_report(quality, g.points, g.cells);
  ASSERT_EQ(report.worst.size(), 3u);
  ASSERT_EQ(report.worst[0].entries.size(), 2u);
  for (std::size_t c = 0; c < 2; ++c) {
    const WorstList::Entry& entry = report.worst[0].entries[c];
    EXPECT_EQ(entry.id, c);
    EXPECT_EQ(entry.value, quality.cell_volume[c]);
    EXPECT_LT(distance(entry.position, Vec3{0.5 + static_cast<double>(c), 0.5, 0.5}), 1e-14);
  }
  ASSERT_EQ(report.worst[1].entries.size(), 1u);
  EXPECT_EQ(report.worst[1].entries[0].value, std::nullopt);
  EXPECT_LT(distance(report.worst[1].entries[0].position, Vec3{1, 0.5, 0.5}), 1e-14) << "the face between both";
  ASSERT_EQ(report.worst[2].entries.size(), quality.worst.size());
}

/// The reports of a mesh of every kind, with all that may be added.
std::vector<QualityReport> all_reports() {
  const Grid g = grid(2, 2, 2);
  std::vector<QualityReport> reports{quality_report(polyhedral_quality(g.points, g.cells), g.points, g.cells)};
  const auto add = [&](ElementType type) {
    const Points points = with_mid_nodes(type, reference(linear(type)));
    const Elements elements = one(type);
    reports.push_back(quality_report(element_quality(points, elements), points, elements));
  };
  for (const ElementType type : types) add(type);
  for (const ElementType type : quadratic_types) add(type);
  const Mesh mesh = quad_grid(4, 3);
  QualityReport& surface = reports.emplace_back(quality_report(surface_quality(mesh), mesh));
  add_to(surface, plane_quality(mesh.points, mesh, left_handed_cells(mesh.points, &mesh)), mesh.points, mesh);
  add_to(surface, WallQuality{});
  add_to(surface, RegionJumps{});
  add_to(surface, JumpGrowth{});
  add_displacement(surface, mesh.points, mesh.points);
  add_flipped(surface, mesh, {});
  add_intersecting(surface, mesh, {});
  add_newly_intersecting(surface, {});
  return reports;
}

TEST(QualityReport, HasARowForEveryNameAndNoOther) {
  std::map<std::string, bool> listed, found;
  for (const QualityName& name : quality_names()) listed[name.name] = name.counts;
  for (const QualityReport& report : all_reports()) {
    for (const QualityRow& row : report.rows) {
      found[row.name] = row.counts;
      EXPECT_EQ(report.find(row.name)->label, row.label) << row.name << " stands there once";
      EXPECT_NE(row.label, "") << row.name;
    }
  }
  EXPECT_EQ(found, listed);
}

TEST(QualityReport, CountsLeftHandedElementsOfPlanes) {
  Mesh mesh = quad_grid(4, 3);
  for (Vec3& p : mesh.points) p[0] = -p[0];
  QualityReport report = quality_report(surface_quality(mesh), mesh);
  add_to(report, plane_quality(mesh.points, mesh, left_handed_cells(mesh.points, &mesh)), mesh.points, mesh);
  const QualityRow* row = report.find("left_handed_elements");
  ASSERT_NE(row, nullptr);
  EXPECT_EQ(row->value, static_cast<double>(mesh.face_count()));
  EXPECT_TRUE(row->in_table);
  EXPECT_EQ(report.find("inverted_elements")->value, 0);
}

}  // namespace
}  // namespace deform::report_test
