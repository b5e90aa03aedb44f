// SPDX-License-Identifier: GPL-3.0-or-later
// Symmetry planes with the method cage and control CONTROLS. The references are the same cage, or with its mirror image, on the
// whole model without planes, with a displacement for each vertex that is placed by where images of vertices lie.
#include <gmock/gmock.h>
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
#include "tests/core/deformers/mirrored.h"
#include "tests/core/deformers/mirrored_sheet.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"

namespace deform {
namespace {

using test::across;
using test::bent;
using test::shared;

Region ids(std::vector<std::uint32_t> list) { return {Region::ControlIds{std::move(list)}}; }

CageOptions options_of(const test::CageMesh& mesh) {
  CageOptions options;
  options.control = CageControl::controls;
  options.vertices = mesh.vertices;
  options.triangles = mesh.triangles;
  return options;
}

/// A box whose sides have a vertex in the middle, so that it is its own image in three planes: corners 0 to 7, bit k at the far
/// end of axis k, then two middles for each axis, near and far.
test::CageMesh pyramids(const Vec3& low, const Vec3& high) {
  test::CageMesh mesh;
  for (unsigned c = 0; c < 8; ++c) {
    Vec3 x{};
    for (std::size_t k = 0; k < 3; ++k) x[k] = (c >> k & 1u) != 0 ? high[k] : low[k];
    mesh.vertices.push_back(x);
  }
  for (unsigned k = 0; k < 3; ++k) {
    const unsigned i = 1u << (k + 1) % 3, j = 1u << (k + 2) % 3;
    for (unsigned far = 0; far < 2; ++far) {
      const unsigned base = far << k;
      Vec3 middle = 0.5 * (low + high);
      middle[k] = far != 0 ? high[k] : low[k];
      const auto m = static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.vertices.push_back(middle);
      const std::array<std::uint32_t, 4> round{base, base | i, base | i | j, base | j};
      for (std::size_t e = 0; e < 4; ++e) {
        Cage::Triangle t{round[e], round[(e + 1) % 4], m};
        if (far == 0) std::swap(t[0], t[1]);
        mesh.triangles.push_back(t);
      }
    }
  }
  return mesh;
}

const Vec3 low{-0.2, -1.3, -0.6}, high{2.3, 1.3, 0.7}, cut{-0.2, 0, -0.6};

/// "end" holds the far corners at high y, "middle" the middle of the side there; of a cage from `from` on.
deform::Setup cage_setup(const CageOptions& options, std::vector<std::uint32_t> end = {3, 7}) {
  deform::Setup setup = test::half_setup(options);
  setup.handles[0].region = ids(std::move(end));
  setup.handles[1].region = ids({11});
  setup.fixed = {ids({8})};
  return setup;
}

/// The displacement of each vertex that handles move, zero for the others.
std::vector<Vec3> own_displacements(const deform::Setup& setup, const Mesh& mesh, const CageOptions& cage, const Design& design) {
  const SelectedRegions regions = validate(setup, mesh);
  const std::vector<Affine> motions = handle_motions(setup, design.variables);
  std::vector<Vec3> moved(cage.vertices.size());
  for (std::size_t h = 0; h < motions.size(); ++h) {
    for (const PointId p : regions.handles[h]) moved[p] = transformed(motions[h], cage.vertices[p]) - cage.vertices[p];
  }
  return moved;
}

/// The points of a mesh in a cage of which every vertex has a displacement, without planes.
Points moved_in(const CageOptions& cage, const Mesh& mesh, const std::vector<Vec3>& displacements) {
  std::vector<std::uint32_t> all;
  for (std::uint32_t v = 0; v < cage.vertices.size(); ++v) all.push_back(v);
  deform::Setup setup;
  setup.method = cage;
  setup.handles = {{"all", ids(std::move(all))}};
  return prepare(shared(Mesh(mesh)), setup)->evaluate({{}, {{0, displacements}}});
}

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
  setup.handles[0].region = ids({1, 3, 5, 7});  // with the images
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
      setup.handles = {{"corner", ids({7, 9, 11})}};
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

TEST(CageSymmetry, RefusesOtherCages) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  const auto refused = [&](const CageOptions& cage, const std::vector<const char*>& words) {
    test::expect_error(ErrorCode::invalid_argument, words, [&] { prepare(half, cage_setup(cage)); });
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
  unlike.handles[1].region = ids({9});
  test::expect_error(ErrorCode::invalid_argument, {"symmetry[0]", "triangle 16", "split alike"}, [&] { prepare(half, unlike); });
  refused(options_of(pyramids({-0.2, -0.1, -0.6}, high)), {"symmetry[0]", "vertex 0 has no image"});
  // Its face in the plane does not reach the end of the sheet.
  refused(options_of(pyramids({0.5, 0, -0.6}, high)), {"ends in symmetry[0]", "6 points", "the first is 0"});
  CageOptions green = options_of(pyramids(low, high));
  green.coordinates = CageCoordinates::green;
  refused(green, {"symmetry", "GREEN", "MEAN_VALUE"});
  // Vertex 10 is the image of 11, which moves.
  deform::Setup setup = cage_setup(options_of(pyramids(low, high)));
  setup.fixed = {ids({10})};
  test::expect_error(ErrorCode::invalid_argument, {"\"middle\"", "control point 11", "symmetry[0]", "control point 10"},
                     [&] { prepare(half, setup); });
}

}  // namespace
}  // namespace deform
