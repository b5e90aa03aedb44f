// SPDX-License-Identifier: GPL-3.0-or-later
// Floods over smooth edges against a union of all pairs of faces, and the nearest face against points spread over all faces.
#include "core/mesh/smooth_patch.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <random>
#include <span>
#include <variant>

#include "core/base/vectors.h"
#include "core/mesh/cells.h"
#include "core/mesh/elements.h"
#include "core/mesh/region.h"
#include "tests/core/mesh/named_meshes.h"
#include "tests/core/quality/surface_meshes.h"
#include "tests/support/expect_error.h"

namespace deform::smooth_patch_test {
namespace {

using Ids = std::vector<PointId>;

SurfaceFaces faces_of(const Mesh& mesh) { return {mesh.points, mesh.face_sizes, mesh.face_points}; }

std::vector<Ids> corners_of(const Mesh& mesh) {
  std::vector<Ids> faces;
  std::size_t first = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    faces.emplace_back(mesh.face_points.begin() + static_cast<std::ptrdiff_t>(first),
                       mesh.face_points.begin() + static_cast<std::ptrdiff_t>(first + size));
    first += size;
  }
  return faces;
}

/// Every pair of faces is looked at; those with a common edge that no third face has, and planes that turn little, go together.
std::vector<char> by_definition(const Mesh& mesh, std::size_t seed, double degrees) {
  const auto faces = corners_of(mesh);
  std::vector<std::size_t> part(faces.size());
  std::iota(part.begin(), part.end(), 0);
  const auto runs = [&](std::size_t f, PointId a, PointId b) {
    int sense = 0;
    for (std::size_t c = 0; c < faces[f].size(); ++c) {
      const PointId from = faces[f][c], to = faces[f][(c + 1) % faces[f].size()];
      sense += from == a && to == b ? 1 : from == b && to == a ? -1 : 0;
    }
    return sense;
  };
  const auto unit = [&](std::size_t f) {
    const Vec3 n =
        cross(mesh.points[faces[f][1]] - mesh.points[faces[f][0]], mesh.points[faces[f][2]] - mesh.points[faces[f][0]]);
    return n / norm(n);
  };
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (std::size_t c = 0; c < faces[f].size(); ++c) {
      const PointId a = faces[f][c], b = faces[f][(c + 1) % faces[f].size()];
      std::vector<std::size_t> along;
      for (std::size_t g = 0; g < faces.size(); ++g) {
        if (runs(g, a, b) != 0) along.push_back(g);
      }
      if (along.size() != 2) continue;
      const std::size_t g = along[0] == f ? along[1] : along[0];
      const double cosine = -runs(f, a, b) * runs(g, a, b) * dot(unit(f), unit(g));
      if (std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / M_PI > degrees) continue;
      const std::size_t from = part[f], to = part[g];
      for (std::size_t& p : part) p = p == from ? to : p;
    }
  }
  std::vector<char> marked(faces.size());
  for (std::size_t f = 0; f < faces.size(); ++f) marked[f] = part[f] == part[seed];
  return marked;
}

std::vector<char> flood(const Mesh& mesh, std::size_t seed, double angle) {
  return smooth_patch(faces_of(mesh), std::span(&seed, 1), angle);
}

/// A sphere whose points are shaken, some faces turned over and some left out.
Mesh rough(unsigned number) {
  std::mt19937 random(number);
  std::uniform_real_distribution<double> shake(-0.04, 0.04), chance(0, 1);
  Mesh mesh = test::sphere(1, 2);
  for (Vec3& p : mesh.points) p = p + Vec3{shake(random), shake(random), shake(random)};
  Mesh kept;
  kept.points = mesh.points;
  for (Ids face : corners_of(mesh)) {
    const double what = chance(random);
    if (what < 0.1) continue;
    if (what < 0.3) std::swap(face[1], face[2]);
    test::add_face(kept, {face[0], face[1], face[2]});
    const auto other = static_cast<PointId>((face[2] + 7) % 18);
    if (what > 0.95 && other != face[0] && other != face[1]) test::add_face(kept, {face[0], face[1], other});
  }
  return kept;
}

TEST(SmoothPatch, IsWhatSmoothEdgesConnect) {
  for (unsigned number = 0; number < 12; ++number) {
    const Mesh mesh = rough(number);
    for (const double angle : {1.0, 12.0, 20.0, 28.0, 60.0, 180.0}) {
      const std::size_t seed = (number * 37) % mesh.face_count();
      EXPECT_EQ(flood(mesh, seed, angle), by_definition(mesh, seed, angle)) << number << ", " << angle;
    }
  }
}

TEST(SmoothPatch, StopsWhereThreeFacesMeetAndAtFacesWithoutArea) {
  const Mesh three = test::non_manifold_edge();
  EXPECT_EQ(flood(three, 0, 180), by_definition(three, 0, 180));
  const Mesh thin = test::make_mesh({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {1, 1, 0}, {1, -1, 0}}, {{0, 2, 3}, {0, 1, 2}, {0, 4, 2}});
  EXPECT_EQ(flood(thin, 0, 180), (std::vector<char>{1, 0, 0})) << "three faces along 0 2";
  const Mesh between =
      test::make_mesh({{0, 0, 0}, {2, 0, 0}, {1, 1, 0}, {1, 0, 0}, {1, -1, 0}}, {{0, 1, 2}, {0, 3, 1}, {0, 4, 3}});
  EXPECT_EQ(flood(between, 0, 180), (std::vector<char>{1, 0, 0}));
  EXPECT_EQ(flood(between, 1, 180), (std::vector<char>{0, 1, 0}));
}

TEST(NearestFace, IsThatOfTheNearestOfManyPointsOnFaces) {
  Mesh mesh = test::sheet(4, 3, test::Faces::quads, [](unsigned i, unsigned j) { return Vec3{1.0 * i, 1.0 * j, 0.2 * i * j}; });
  for (const Mesh& each : {mesh, rough(3)}) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> coordinate(-2, 3);
    const auto faces = corners_of(each);
    for (int k = 0; k < 60; ++k) {
      const Vec3 place{coordinate(random), coordinate(random), coordinate(random)};
      std::vector<double> away(faces.size(), 1e9);
      for (std::size_t f = 0; f < faces.size(); ++f) {
        Vec3 middle{};
        for (const PointId p : faces[f]) middle = middle + each.points[p] / static_cast<double>(faces[f].size());
        for (std::size_t c = 0; c < faces[f].size(); ++c) {
          const Vec3 &a = each.points[faces[f][c]], &b = each.points[faces[f][(c + 1) % faces[f].size()]];
          constexpr int steps = 60;
          for (int i = 0; i <= steps; ++i) {
            for (int j = 0; i + j <= steps; ++j) {
              const double u = 1.0 * i / steps, v = 1.0 * j / steps;
              away[f] = std::min(away[f], distance(place, u * a + v * b + (1 - u - v) * middle));
            }
          }
        }
      }
      const std::size_t found = nearest_face(faces_of(each), place).face;
      ASSERT_LT(found, faces.size());
      EXPECT_LT(away[found], *std::min_element(away.begin(), away.end()) + 0.02) << k;  // the points are that far apart
    }
  }
  EXPECT_EQ(nearest_face(faces_of(mesh), {0.5, 0.5, 0}).face, 0u);
  EXPECT_EQ(nearest_face(faces_of(mesh), {1, 0.5, 0.1}).face, 0u) << "on an edge: the first";
  EXPECT_EQ(nearest_face({}, {0, 0, 0}).face, 0u) << "there are none";
}

// ---- as a region ----

/// n^3 cubes with six faces of a box around them, as a surface or around cells.
Mesh surface_of_box(unsigned n) {
  Mesh mesh;
  std::map<std::array<unsigned, 3>, PointId> known;
  const auto point = [&](std::array<unsigned, 3> at) {
    const auto [entry, added] = known.try_emplace(at, static_cast<PointId>(mesh.points.size()));
    if (added) mesh.points.push_back({1.0 * at[0], 1.0 * at[1], 1.0 * at[2]});
    return entry->second;
  };
  for (unsigned axis = 0; axis < 3; ++axis) {
    for (const unsigned side : {0u, n}) {
      for (unsigned i = 0; i < n; ++i) {
        for (unsigned j = 0; j < n; ++j) {
          const auto at = [&](unsigned u, unsigned v) {
            std::array<unsigned, 3> place{};
            place[axis] = side, place[(axis + 1) % 3] = u, place[(axis + 2) % 3] = v;
            return point(place);
          };
          test::add_face(mesh, {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});  // half of them inward
        }
      }
    }
  }
  return mesh;
}

Region patch(std::variant<Vec3, PointId> seed, double angle = 30) { return {Region::Patch{seed, angle}}; }

TEST(PatchRegion, IsTheSideOfABoxAroundTheSeed) {
  const Mesh mesh = surface_of_box(4);
  const Ids top = select(patch(Vec3{2.2, 1.7, 4.3}), mesh, "x");
  EXPECT_EQ(top, select({Region::InBox{{0, 0, 4}, {4, 4, 4}}}, mesh, "x"));
  EXPECT_EQ(top.size(), 25u);
  EXPECT_EQ(select(patch(Vec3{2, 2, 4.3}, 89), mesh, "x").size(), 25u);
  EXPECT_EQ(select(patch(Vec3{2, 2, 4.3}, 91), mesh, "x").size(), mesh.point_count());
  const Ids corner = select({Region::InBox{{0, 0, 0}, {0, 0, 0}}}, mesh, "x");
  ASSERT_EQ(corner.size(), 1u);
  EXPECT_EQ(select(patch(corner[0]), mesh, "x").size(), 3u * 16 + 3 * 4 + 1) << "three sides meet there";
}

TEST(PatchRegion, IsOnTheBoundaryOfVolumeMeshes) {
  Mesh mesh = surface_of_box(1);
  Elements elements;
  const auto at = [&](double x, double y, double z) { return select({Region::InBox{{x, y, z}, {x, y, z}}}, mesh, "x").at(0); };
  elements.add(ElementType::hexahedron,
               Ids{at(0, 0, 0), at(1, 0, 0), at(1, 1, 0), at(0, 1, 0), at(0, 0, 1), at(1, 0, 1), at(1, 1, 1), at(0, 1, 1)});
  Mesh volume;
  volume.points = mesh.points;
  volume.elements = std::make_shared<const Elements>(elements);
  const Ids side = select({Region::InBox{{1, 0, 0}, {1, 1, 1}}}, mesh, "x");
  EXPECT_EQ(select(patch(Vec3{1.05, 0.5, 0.5}), volume, "x"), side);
  // Two cubes with the face between them first.
  Mesh two;
  for (double x : {0, 1, 2}) {
    for (const auto& [y, z] : {std::pair{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}, {0.0, 1.0}}) two.points.push_back({x, y, z});
  }
  PolyhedralCells cells;
  const auto add = [&](std::initializer_list<PointId> face, std::uint32_t owner) {
    cells.face_points.insert(cells.face_points.end(), face);
    cells.face_offsets.push_back(cells.face_points.size());
    cells.owner.push_back(owner);
  };
  add({4, 5, 6, 7}, 0);
  cells.neighbour = {1};
  add({0, 3, 2, 1}, 0);
  add({8, 9, 10, 11}, 1);
  for (std::uint32_t c = 0; c < 2; ++c) {
    for (PointId k = 0; k < 4; ++k) {
      const PointId a = 4 * c + k, b = 4 * c + (k + 1) % 4;
      add({a, b, b + 4, a + 4}, c);
    }
  }
  cells.cell_count = 2;
  two.cells = std::make_shared<const PolyhedralCells>(cells);
  EXPECT_EQ(select(patch(Vec3{0.5, 0.5, -0.1}), two, "x"), select({Region::InBox{{0, 0, 0}, {2, 1, 0}}}, two, "x"));
  EXPECT_EQ(select(patch(Vec3{1, 0.5, 0.1}, 10), two, "x").size(), 6u) << "not the face inside, which is nearest";
}

TEST(PatchRegion, RefusesWhatIsNotOnTheSurface) {
  Mesh mesh = surface_of_box(2);
  const auto refused = [&](const Region& region, std::vector<const char*> parts) {
    parts.push_back("fixed[0]: patch");
    test::expect_error(ErrorCode::invalid_argument, parts, [&] { select(region, mesh, "fixed[0]"); });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refused(patch(Vec3{0, nan, 0}), {"patch.seed", "coordinate y"});
  EXPECT_NO_THROW(select(patch(Vec3{1, 1, 2.17}), mesh, "x"));  // 5 % of the diagonal are 0.1732
  refused(patch(Vec3{1, 1, 2.18}), {"patch.seed", "0.18 from the surface", "at most 0.173", "5 % of the diagonal"});
  for (const double angle : {0.0, -1.0, 181.0, nan}) refused(patch(Vec3{0, 0, 0}, angle), {"patch.angle", "180"});
  refused(patch(PointId{999}), {"patch.point", "999"});
  mesh.points.push_back({9, 9, 9});
  refused(patch(static_cast<PointId>(mesh.point_count() - 1)), {"patch.point", "not on the surface"});
  mesh.face_sizes.clear();
  mesh.face_points.clear();
  refused(patch(Vec3{0, 0, 0}), {"no faces"});
}

}  // namespace
}  // namespace deform::smooth_patch_test
