// SPDX-License-Identifier: GPL-3.0-or-later
// Symmetry planes with the method cage and control CONTROLS. The references are the same cage, or with its mirror image, on the
// whole model without planes, with a displacement for each vertex that is placed by where images of vertices lie.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/space_map.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/deformers/half_cages.h"
#include "tests/core/deformers/mirrored.h"
#include "tests/core/deformers/mirrored_sheet.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"

namespace deform::cage_symmetry_test {
namespace {

using test::across;
using test::bent;
using test::cage_setup;
using test::moved_in;
using test::options_of;
using test::own_displacements;
using test::pyramids;
using test::shared;

constexpr Vec3 low = test::cage_low, high = test::cage_high, cut = test::cage_cut;

void expect_points(const System& system, const Mesh& half, const Design& design, const Points& expected) {
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const Points got = system.evaluate({&design, 1}, path)[0];
    double farthest = 0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      EXPECT_LT(distance(got[i], expected[i]), 1e-12) << i;
      farthest = std::max(farthest, distance(got[i], half.points[i]));
      if (half.points[i][1] == 0) {
        EXPECT_EQ(got[i][1], 0);
      }
    }
    EXPECT_GT(farthest, 0.05);
    EXPECT_LT(system.bind({&design, 1}, path, {})->report(0).error, 1e-10);
  }
}

TEST(CageSymmetry, ACageThatIsItsOwnImageMovesWithTheImagesOfItsHandles) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  const CageOptions cage = options_of(pyramids(low, high));
  deform::Setup setup = cage_setup(cage);
  std::vector<Vec3> displacements = own_displacements(setup, *half, cage, bent);
  for (std::size_t v = 0; v < displacements.size(); ++v) {
    if (norm(displacements[v]) == 0) continue;
    const Vec3 at = across(cage.vertices[v]);
    const auto image =
        std::find_if(cage.vertices.begin(), cage.vertices.end(), [&](const Vec3& x) { return distance(x, at) < 1e-12; });
    ASSERT_NE(image, cage.vertices.end());
    displacements[static_cast<std::size_t>(image - cage.vertices.begin())] = across(displacements[v]);
  }
  const Points expected = moved_in(cage, *half, displacements);
  const auto system = prepare(half, setup);
  expect_points(*system, *half, bent, expected);
  EXPECT_THAT(system->info().notes, testing::Contains(testing::HasSubstr("3 are mirror images of these")));
  setup.handles[0].region = test::control_ids({1, 3, 5, 7});  // with the images
  expect_points(*prepare(half, setup), *half, bent, expected);
  // Places on the other side.
  const auto map = system->bind_in_space(bent, {});
  std::vector<Vec3> at;
  for (const Vec3& x : half->points) at.push_back(across(x));
  Points out(at.size());
  EXPECT_EQ(map->evaluate(at, 0, out, {}).still, 0u);
  for (std::size_t i = 0; i < at.size(); ++i) EXPECT_LT(distance(across(out[i]), expected[i]), 1e-12);
}

// On the side of the mesh, and behind the plane.
TEST(CageSymmetry, ACageThatEndsInThePlaneStaysThere) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  test::CageMesh mesh = pyramids(cut, high);
  for (const bool behind : {false, true}) {
    SCOPED_TRACE(behind);
    const CageOptions cage = options_of(mesh);
    const deform::Setup setup = cage_setup(cage, {1, 3, 5, 7});
    std::vector<Vec3> displacements = own_displacements(setup, *half, cage, bent);
    for (std::size_t v = 0; v < displacements.size(); ++v) {
      if (cage.vertices[v][1] == 0) displacements[v][1] = 0;
    }
    Mesh placed = *half;
    for (Vec3& x : placed.points) x = behind ? across(x) : x;
    Points expected = moved_in(cage, placed, displacements);
    for (Vec3& x : expected) x = behind ? across(x) : x;
    const auto system = prepare(half, setup);
    expect_points(*system, *half, bent, expected);
    EXPECT_THAT(estimate(*half, setup).notes, testing::Not(testing::Contains(testing::HasSubstr("lies in the cage"))));
    EXPECT_THAT(system->info().notes,
                testing::Not(testing::Contains(testing::ContainsRegex("outside|lies in the cage"))));  // on it
    const auto map = system->bind_in_space(bent, {});
    std::vector<Vec3> at = half->points;
    for (const Vec3& x : half->points) at.push_back(across(x));
    Points out(at.size());
    map->evaluate(at, 0, out, {});
    const Points direct = system->evaluate({&bent, 1}, EvaluationPath::direct)[0];
    for (std::size_t i = 0; i < half->point_count(); ++i) {
      EXPECT_EQ(out[i], direct[i]);
      EXPECT_LT(distance(across(out[half->point_count() + i]), expected[i]), 1e-12);
    }
    for (Vec3& x : mesh.vertices) x = across(x);
  }
}

TEST(CageSymmetry, SeveralPlanesInAnyDirection) {
  for (const bool whole : {true, false}) {
    for (const std::size_t planes : {1u, 2u, 3u}) {
      SCOPED_TRACE(planes);
      const test::HalfModel model(planes, test::oblique());
      Vec3 from{-1.3, -1.3, -1.3};
      for (std::size_t k = 0; k < planes && !whole; ++k) from[k] = 0;
      CageOptions cage = options_of(pyramids(from, {1.3, 1.3, 1.3}));
      std::vector<Vec3> local = cage.vertices, moves(cage.vertices.size());
      for (Vec3& x : cage.vertices) x = model.frame.point(x);
      deform::Setup setup;
      setup.method = cage;
      setup.symmetry = model.setup.symmetry;
      setup.handles = {{"corner", test::control_ids({7, 9, 11})}};
      std::vector<Vec3> given;
      for (const std::size_t v : {7u, 9u, 11u}) {
        Vec3 u{0.1 + 0.01 * static_cast<double>(v), -0.2, 0.15};
        for (std::size_t k = 0; k < planes; ++k) u[k] = local[v][k] == 0 ? 0 : u[k];
        given.push_back(model.frame.vector(u));
        for (unsigned g = 0; g < 1u << planes; ++g) {
          Vec3 at = local[v], along = u;
          for (std::size_t k = 0; k < planes; ++k) {
            if ((g >> k & 1u) != 0) at[k] = -at[k], along[k] = -along[k];
          }
          const auto image = std::find_if(local.begin(), local.end(), [&](const Vec3& x) { return distance(x, at) < 1e-12; });
          if (image != local.end()) moves[static_cast<std::size_t>(image - local.begin())] = model.frame.vector(along);
        }
      }
      const Points got = prepare(model.half, setup)->evaluate({{}, {{0, given}}}), expected = moved_in(cage, *model.half, moves);
      double farthest = 0;
      for (std::size_t i = 0; i < got.size(); ++i) {
        EXPECT_LT(distance(got[i], expected[i]), 1e-12 * norm(model.frame.origin)) << i;
        farthest = std::max(farthest, distance(got[i], model.half->points[i]));
      }
      EXPECT_GT(farthest, 0.02);
      EXPECT_LT(model.out_of_planes(got), 1e-14 * norm(model.frame.origin));
    }
  }
}

TEST(CageSymmetry, JacobianProductsAndPopulations) {
  const auto half = shared(test::bumpy_sheet(31, 16));
  for (const Vec3& from : {low, cut}) {
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      CageOptions cage = options_of(pyramids(from, high));
      cage.basis = basis;
      const auto system = prepare(half, cage_setup(cage));
      EXPECT_EQ(system->info().basis_fields, basis == BasisMode::always ? 8u : 0u);
      test::check_jacobians(*system, 1e-13, 1e-8);
    }
    test::check_population(*prepare(half, cage_setup(options_of(pyramids(from, high)))), 5);
  }
}

// With MESH the half model is deformed with its image, around which the cage is to be, too.
TEST(CageSymmetry, SaysBeforeItIsPreparedThatACageIsNotAroundTheImages) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  const auto notes_of = [&](const Vec3& from) {
    CageOptions options = options_of(pyramids(from, high));
    options.control = CageControl::mesh;
    deform::Setup setup = cage_setup(options);
    setup.handles[0].region = {Region::Ids{{30, 31, 32}}};
    setup.handles[1].region = {Region::Ids{{200, 201}}};
    setup.fixed = {{Region::Ids{{270, 275}}}};
    const std::vector<std::string> before = estimate(*half, setup).notes, after = prepare(half, setup)->info().notes;
    std::string found;
    for (const std::string& note : before) {
      if (note.find("outside") == std::string::npos) continue;
      found = note;
      EXPECT_THAT(after, testing::Contains(note));
    }
    return found;
  };
  EXPECT_EQ(notes_of(low), "");
  // 11 rows of 23 points with y > 0, but for those at the tips, are images that no face is around.
  const std::string note = notes_of(cut);
  EXPECT_THAT(note, testing::HasSubstr("253 points lie outside of the cage, the first is 276: with control MESH"));
  EXPECT_THAT(note, testing::HasSubstr("below 276"));
}

TEST(CageSymmetry, RefusesOtherCages) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  const auto refused = [&](const CageOptions& cage, const std::vector<const char*>& words) {
    test::expect_error(ErrorCode::invalid_argument, words, [&] { prepare(half, cage_setup(cage)); });
    test::expect_error(ErrorCode::invalid_argument, words, [&] { estimate(*half, cage_setup(cage)); });
  };
  test::CageMesh mesh = pyramids(low, high);
  mesh.vertices[5][0] += 1e-5;
  refused(options_of(mesh), {"method.cage", "symmetry[0]", "vertex 5 has no image"});
  mesh = pyramids(low, high);  // the sides across x are split along diagonals that are no images of each other
  std::erase_if(mesh.triangles, [](const Cage::Triangle& t) { return t[2] == 8 || t[2] == 9; });
  for (const Cage::Triangle& t : {Cage::Triangle{0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}}) mesh.triangles.push_back(t);
  for (Cage::Triangle& t : mesh.triangles) {
    for (std::uint32_t& v : t) v -= v > 9 ? 2 : 0;
  }
  mesh.vertices.erase(mesh.vertices.begin() + 8, mesh.vertices.begin() + 10);
  deform::Setup unlike = cage_setup(options_of(mesh));
  unlike.handles[1].region = test::control_ids({9});
  test::expect_error(ErrorCode::invalid_argument, {"symmetry[0]", "triangle 16", "split alike"}, [&] { prepare(half, unlike); });
  refused(options_of(pyramids({-0.2, -0.1, -0.6}, high)), {"symmetry[0]", "vertex 0 has no image"});
  // Its face in the plane does not reach the end of the sheet.
  refused(options_of(pyramids({0.5, 0, -0.6}, high)), {"ends in symmetry[0]", "6 points", "the first is 0"});
  // It does not reach the plane.
  refused(options_of(pyramids({-0.2, 1e-3, -0.6}, high)), {"ends in symmetry[0]", "23 points", "the first is 0"});
  EXPECT_NO_THROW(estimate(*half, cage_setup(options_of(pyramids(cut, high)))));
  // Vertex 10 is the image of 11, which moves.
  deform::Setup setup = cage_setup(options_of(pyramids(low, high)));
  setup.fixed = {test::control_ids({10})};
  test::expect_error(ErrorCode::invalid_argument, {"\"middle\"", "control point 11", "symmetry[0]", "control point 10"},
                     [&] { prepare(half, setup); });
}

}  // namespace
}  // namespace deform::cage_symmetry_test
