// SPDX-License-Identifier: GPL-3.0-or-later
// Supports of moving least squares go around slots of a body.
#include "core/deformers/energy/spaces/body_reach.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/mesh_pieces.h"
#include "core/deformers/space_map.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/core/quality/surface_meshes.h"

namespace deform::body_reach_test {
namespace {

/// Two prongs along x, 0.15 thick, with a slot of 0.05 from x = 0.3 on.
Mesh fork() {
  return test::cubes({20, 4, 7}, 0.05, [](int i, int /*j*/, int k) { return i < 6 || k != 3; });
}

/// The same with the prongs apart from each other all along.
Mesh bars() {
  return test::cubes({20, 4, 7}, 0.05, [](int /*i*/, int /*j*/, int k) { return k != 3; });
}

Setup held_and_bent(MlsDomain domain, std::size_t samples) {
  MlsOptions options;
  options.domain = domain;
  options.surface_samples = options.volume_samples = samples;
  Setup setup;
  setup.method = options;
  setup.fixed = {Region{Region::InBox{{-1, -1, -1}, {0.301, 1, 1}}}};
  setup.handles = {{"tip", Region{Region::InBox{{0.949, -1, 0.19}, {2, 1, 1}}}}};
  return setup;
}

/// How far the points of the other prong move, as a fraction of the motion of the tip.
double other_prong(MlsDomain domain, std::size_t samples) {
  const auto mesh = std::make_shared<const Mesh>(fork());
  const auto system = prepare(mesh, held_and_bent(domain, samples));
  Affine lifted = identity_affine;
  lifted[11] = 0.1;
  const Points moved = system->evaluate({{}, {{0, lifted}}});
  double largest = 0;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    if (mesh->points[i][2] < 0.151 && mesh->points[i][0] > 0.5) largest = std::max(largest, distance(moved[i], mesh->points[i]));
  }
  return largest / 0.1;
}

// The prongs have nothing in common but what is held, so the lower one stays where it is, whatever the upper one does.
TEST(BodyReach, ProngsOfAForkDoNotPullEachOther) {
  EXPECT_GT(other_prong(MlsDomain::enclosed, 500), 0.3);
  EXPECT_LT(other_prong(MlsDomain::connected, 500), 0.03);
}

TEST(BodyReach, HandlesThatMoveAffinelyAreFollowedAroundSlots) {
  const auto mesh = std::make_shared<const Mesh>(fork());
  deform::Setup setup = held_and_bent(MlsDomain::connected, 500);
  setup.handles.push_back({"base", setup.fixed[0]});
  setup.fixed.clear();
  const auto system = prepare(mesh, setup);
  const Affine map{0.9, -0.3, 0.1, 1, 0.2, 1.1, 0, -2, 0.1, 0.2, 1, 0.5};
  const Points moved = system->evaluate({{}, {{0, map}, {1, map}}});
  double worst = 0;
  for (std::size_t i = 0; i < moved.size(); ++i) worst = std::max(worst, distance(moved[i], transformed(map, mesh->points[i])));
  EXPECT_LT(worst, 1e-10);
  const auto& notes = system->info().notes;
  EXPECT_TRUE(std::any_of(notes.begin(), notes.end(), [](const std::string& note) { return note.find("slots") < note.size(); }));
}

// Ways are looked up again for points that are asked for later, when nothing else of the preparation is left.
TEST(BodyReach, PointsOfTheMeshGoWhereItsDesignsPutThemWhenTheyAreAskedForAsPlaces) {
  const auto mesh = std::make_shared<const Mesh>(fork());
  const auto system = prepare(mesh, held_and_bent(MlsDomain::connected, 500));
  Affine lifted = identity_affine;
  lifted[11] = 0.1;
  const Design design{{}, {{0, lifted}}};
  const std::vector<std::vector<double>> other(64, std::vector<double>(1500, 1e3));  // where the samples were
  const Points moved = system->evaluate(design);
  std::vector<Vec3> asked(mesh->point_count());
  system->bind_in_space(design, RunContext())->evaluate(mesh->points, 0, asked, RunContext());
  double worst = 0;
  for (std::size_t i = 0; i < moved.size(); ++i) worst = std::max(worst, distance(asked[i], moved[i]));
  EXPECT_LT(worst, 1e-13) << other.size();  // the basis has the design
}

struct Reached {
  Mesh mesh;
  Samples samples;
  std::unique_ptr<const BodyReach> reach;

  Reached(Mesh of, double radius) : mesh(std::move(of)) {
    const DensePoints dense = dense_points(mesh, mesh.points, {20000, 20000, VolumeOf::enclosed}, 1);
    samples = spread_samples(dense, {600, 600});
    reach = std::make_unique<const BodyReach>(mesh, mesh.points, samples.points, dense, radius, RunContext());
  }
  std::vector<PointTree::Near> near(const Vec3& x, double radius) const {
    std::vector<PointTree::Near> result;
    for (std::uint32_t j = 0; j < samples.points.size(); ++j) {
      const double square = squared_distance(x, samples.points[j]);
      if (square < radius * radius) result.push_back({j, square});
    }
    return result;
  }
};

TEST(BodyReach, DistancesAreThoseOfTheWaysInTheBody) {
  const double radius = 0.2;
  const Reached of(fork(), radius);
  EXPECT_GT(of.reach->cut(), 100u);
  std::vector<double> distances;
  std::size_t around = 0;
  for (const double x : {0.26, 0.33, 0.4, 0.5, 0.9}) {
    const Vec3 at{x, 0.1, 0.2};  // on the upper side of the slot, or beside it
    const auto near = of.near(at, 1.5 * radius);
    of.reach->lengthen(at, near, distances);
    ASSERT_EQ(distances.size(), near.size());
    for (std::size_t i = 0; i < near.size(); ++i) {
      const Vec3& c = of.samples.points[near[i].point];
      const double straight = distance(at, c);
      EXPECT_GE(distances[i], straight - 1e-12);
      if (c[2] > 0.2) {
        EXPECT_NEAR(distances[i], straight, 1e-12);
        continue;
      }
      // Around the end of the slot, in the plane of x and z, which is the shortest way but for the thickness of the slot.
      const double end = 0.3, first = std::hypot(std::max(0.0, at[0] - end), 0.05 * (at[0] > end)),
                   second = std::hypot(std::max(0.0, c[0] - end), std::max(0.0, 0.15 - c[2]));
      const double way = std::hypot(first + second, c[1] - at[1]);
      if (at[0] <= end || c[0] <= end) continue;
      EXPECT_GT(distances[i], std::min(way, 1.5 * radius) / 1.1 - 0.08) << x;  // what is allowed for links
      ++around;
    }
  }
  EXPECT_GT(around, 50u);
}

TEST(BodyReach, BodiesThatAreApartAreAsCloseAsTheyAre) {
  const Reached of(bars(), 0.2);
  EXPECT_EQ(of.reach->cut(), 0u);
  const Vec3 at{0.5, 0.1, 0.2};
  EXPECT_FALSE(of.reach->lengthens(at, of.near(at, 0.2)));
}

TEST(BodyReach, NothingIsCutInABodyWithoutSlots) {
  const Reached of(test::cubes({20, 4, 7}, 0.05, [](int, int, int) { return true; }), 0.2);
  EXPECT_EQ(of.reach->cut(), 0u);
  EXPECT_EQ(Reached(test::sphere(1, 4), 0.6).reach->cut(), 0u);
}

}  // namespace
}  // namespace deform::body_reach_test
