// SPDX-License-Identifier: GPL-3.0-or-later
// Columns of cells on the walls of a real mesh of snappyHexMesh, against numbers counted by another program from the files.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <iterator>

#include "core/io/mesh_file.h"
#include "core/mesh/region.h"
#include "core/mesh/wall_columns.h"

namespace deform::shared_data_test {
namespace {

struct Row {
  const char* patch;
  int layers;
  std::size_t faces, columns, shorter, bare, points;  ///< points: of all columns together
};

TEST(WallColumns, OfACarInOpenFoam) {
  const auto file = io::read_mesh_file(std::filesystem::path(DEFORM_SHARED_DATA) / "B_volume" / "openfoam" / "car_fastback");
  const Mesh& mesh = *file->mesh();
  for (const Row& row :
       {Row{"car_body", 1, 20901, 20488, 0, 413, 168636}, Row{"car_body", 3, 20901, 20488, 1933, 413, 321790},
        Row{"car_body", 1000, 20901, 20488, 20488, 413, 504906}, Row{"car_wheel_fl", 2, 1464, 1260, 490, 204, 13284}}) {
    SCOPED_TRACE(std::string(row.patch) + " " + std::to_string(row.layers));
    const auto patch = select({Region::GroupName{row.patch}}, mesh, row.patch);
    const WallColumns walls = wall_columns(mesh, patch, row.layers, row.patch);
    EXPECT_EQ(walls.faces, row.faces);
    EXPECT_EQ(walls.points.size(), row.columns);
    EXPECT_EQ(walls.shorter, row.shorter);
    EXPECT_EQ(walls.bare, row.bare);
    std::size_t points = 0;
    for (const auto& column : walls.points) {
      points += column.size();
      ASSERT_TRUE(std::is_sorted(column.begin(), column.end()));
      std::vector<PointId> on_wall;
      std::set_intersection(column.begin(), column.end(), patch.begin(), patch.end(), std::back_inserter(on_wall));
      ASSERT_GE(on_wall.size(), 3u);
      ASSERT_GE(column.size(), 6u);
    }
    EXPECT_EQ(points, row.points);
  }
}

}  // namespace
}  // namespace deform::shared_data_test
