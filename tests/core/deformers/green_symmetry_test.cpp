// SPDX-License-Identifier: GPL-3.0-or-later
// Green coordinates of cages in half models and sectors. The references are the whole cages, made here triangle by triangle from
// the places of their vertices, on the model without planes and with a displacement for each vertex; and their layer potentials
// in extended precision.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/space_map.h"
#include "core/deformers/system.h"
#include "core/numerics/kernels/tiles.h"
#include "tests/core/deformers/dense_controls.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/deformers/half_cages.h"
#include "tests/core/deformers/mirrored.h"
#include "tests/core/deformers/mirrored_sheet.h"
#include "tests/core/deformers/wheel.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"

namespace deform::green_symmetry_test {
namespace {

using test::bent;
using test::cage_cut;
using test::cage_high;
using test::cage_low;
using test::cage_setup;
using test::control_ids;
using test::moved_in;
using test::own_displacements;
using test::pyramids;
using test::shared;

CageOptions green_of(const test::CageMesh& mesh, BasisMode basis = BasisMode::always) {
  CageOptions options = test::options_of(mesh);
  options.coordinates = CageCoordinates::green;
  options.basis = basis;
  return options;
}

/// A cage with its images, and what its vertices do.
struct WholeGreen {
  CageOptions cage;
  std::vector<Vec3> displacements;
};

/// In planes through the origin across the first axes, whose images have numbers: masks of planes. Triangles in planes of `ends`
/// (mask) are left out, and places that are the same are one vertex. `moves` are those of the vertices, zero if they stay.
WholeGreen whole_green(const CageOptions& given, std::size_t planes, unsigned ends, const std::vector<Vec3>& moves) {
  WholeGreen whole{given, {}};
  whole.cage.vertices.clear();
  whole.cage.triangles.clear();
  const auto image = [&](Vec3 x, unsigned g) {
    for (std::size_t k = 0; k < planes; ++k) x[k] = (g >> k & 1u) != 0 ? -x[k] : x[k];
    return x;
  };
  const auto number = [&](const Vec3& x) {
    const auto at = std::find_if(whole.cage.vertices.begin(), whole.cage.vertices.end(),
                                 [&](const Vec3& y) { return distance(x, y) < 1e-9; });
    if (at != whole.cage.vertices.end()) return static_cast<std::uint32_t>(at - whole.cage.vertices.begin());
    whole.cage.vertices.push_back(x);
    whole.displacements.emplace_back();
    return static_cast<std::uint32_t>(whole.cage.vertices.size() - 1);
  };
  for (unsigned g = 0; g < 1u << planes; ++g) {
    if ((g & ~ends) != 0) continue;
    for (const auto& t : given.triangles) {
      bool in_plane = false;
      for (std::size_t k = 0; k < planes; ++k) {
        in_plane = in_plane || ((ends >> k & 1u) != 0 &&
                                std::all_of(t.begin(), t.end(), [&](std::uint32_t v) { return given.vertices[v][k] == 0; }));
      }
      if (in_plane) continue;
      std::array<std::uint32_t, 3> of{};
      for (std::size_t c = 0; c < 3; ++c) of[c] = number(image(given.vertices[t[c]], g));
      if (std::popcount(g) % 2 != 0) std::swap(of[1], of[2]);
      whole.cage.triangles.push_back(of);
    }
  }
  for (unsigned g = 0; g < 1u << planes; ++g) {
    for (std::size_t v = 0; v < given.vertices.size(); ++v) {
      if (norm(moves[v]) == 0) continue;
      const Vec3 x = image(given.vertices[v], g);
      for (std::size_t w = 0; w < whole.cage.vertices.size(); ++w) {
        if (distance(whole.cage.vertices[w], x) < 1e-9) whole.displacements[w] = image(moves[v], g);
      }
    }
  }
  return whole;
}

Vec3 swapped(const Vec3& x) { return {x[1], x[0], x[2]}; }

/// The same for the plane y = 0.
WholeGreen whole_across(const CageOptions& given, bool ends, const std::vector<Vec3>& moves) {
  CageOptions turned = given;
  std::vector<Vec3> turned_moves = moves;
  for (Vec3& x : turned.vertices) x = swapped(x);
  for (Vec3& u : turned_moves) u = swapped(u);
  WholeGreen whole = whole_green(turned, 1, ends ? 1 : 0, turned_moves);
  for (Vec3& x : whole.cage.vertices) x = swapped(x);
  for (Vec3& u : whole.displacements) u = swapped(u);
  return whole;
}

/// Whether the halves of a system are those of the whole cage, to `tolerance`, and points in the plane stay there exactly.
void expect_whole(const System& system, const Mesh& half, const WholeGreen& whole, const Design& design, double tolerance) {
  const Points expected = moved_in(whole.cage, half, whole.displacements);
  const Points got = system.evaluate(design);
  double off = 0, farthest = 0;
  for (std::size_t i = 0; i < got.size(); ++i) {
    off = std::max(off, distance(got[i], expected[i]));
    farthest = std::max(farthest, distance(got[i], half.points[i]));
    if (half.points[i][1] == 0) {
      EXPECT_EQ(got[i][1], 0);
    }
  }
  EXPECT_LT(off, tolerance);
  EXPECT_GT(farthest, 1e6 * tolerance);
  const DesignReport report = system.bind({&design, 1}, EvaluationPath::automatic, {})->report(0);
  EXPECT_LT(report.error, 100 * tolerance);
  EXPECT_GT(report.error, off / 10);
  // By their definition, off the planes of the triangles.
  const test::dense_controls::GreenOracle oracle(whole.cage);
  test::dense_controls::Matrix moves(static_cast<Eigen::Index>(whole.displacements.size()), 3);
  for (std::size_t v = 0; v < whole.displacements.size(); ++v) {
    for (std::size_t k = 0; k < 3; ++k)
      moves(static_cast<Eigen::Index>(v), static_cast<Eigen::Index>(k)) = whole.displacements[v][k];
  }
  for (std::size_t i = 0; i < got.size(); i += 7) {
    if (half.points[i][1] == 0) continue;
    const auto u = oracle.displacement(half.points[i], moves);
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(got[i][k], half.points[i][k] + static_cast<double>(u[k]), 10 * tolerance) << i;
    }
  }
}

/// In another unit.
struct Scaled {
  Scaled(const Mesh& mesh, const deform::Setup& given, double unit) : setup(given) {
    Mesh result = mesh;
    for (Vec3& x : result.points) x = unit * x;
    half = shared(std::move(result));
    for (Vec3& x : std::get<CageOptions>(setup.method).vertices) x = unit * x;
    for (DesignVariable& variable : setup.variables) {
      const auto scale = [&](VariableMotion& kind) {
        if (auto* translation = std::get_if<Translation>(&kind)) translation->direction = unit * translation->direction;
        if (auto* rotation = std::get_if<Rotation>(&kind)) rotation->centre = unit * rotation->centre;
        if (auto* scaling = std::get_if<Scaling>(&kind)) scaling->centre = unit * scaling->centre;
      };
      scale(variable.kind);
      for (DrivenHandle& driven : variable.also) scale(driven.kind);
    }
    setup.symmetry = {{SymmetryPlane::Plane{unit * Vec3{0.7, 0, 0.2}, {0, 2, 0}}}};
  }
  std::shared_ptr<const Mesh> half;
  deform::Setup setup;
};

TEST(GreenSymmetry, HalfCagesAreTheWholeOnes) {
  for (const std::size_t columns : {23u, 45u}) {
    for (const double unit : {1.0, 1000.0}) {
      for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
        SCOPED_TRACE(testing::Message() << columns << " columns, unit " << unit);
        const Mesh sheet = test::bumpy_sheet(columns, columns / 2 + 1);
        // On the side of the mesh, and behind the plane.
        for (const bool behind : {false, true}) {
          test::CageMesh mesh = pyramids(cage_cut, cage_high);
          for (Vec3& x : mesh.vertices) x = behind ? test::across(x) : x;
          for (Cage::Triangle& t : mesh.triangles) std::swap(t[1], t[behind ? 2 : 1]);
          deform::Setup setup = cage_setup(green_of(mesh, basis), {1, 3, 5, 7});
          if (behind) {
            // Handles are where the vertices are.
            for (DesignVariable& variable : setup.variables) {
              if (auto* rotation = std::get_if<Rotation>(&variable.kind)) rotation->centre = test::across(rotation->centre);
            }
          }
          const Scaled scaled(sheet, setup, unit);
          const CageOptions& cage = std::get<CageOptions>(scaled.setup.method);
          const auto system = prepare(scaled.half, scaled.setup);
          const auto moves = own_displacements(scaled.setup, *scaled.half, cage, bent);
          expect_whole(*system, *scaled.half, whole_across(cage, true, moves), bent, 1e-12 * unit);
          EXPECT_THAT(system->info().notes,
                      testing::Contains(testing::HasSubstr("triangles where it ends, it has 22 vertices and 40 triangles.")));
          EXPECT_EQ(system->info().functions, 14u);
          test::expect_bounds(estimate(*scaled.half, scaled.setup), system->info());
        }
      }
    }
  }
}

TEST(GreenSymmetry, CagesThatAreTheirOwnImagesMoveWithTheImagesOfHandles) {
  for (const double unit : {1.0, 1000.0}) {
    deform::Setup setup = cage_setup(green_of(pyramids(cage_low, cage_high)));
    const Scaled scaled(test::bumpy_sheet(23, 12), setup, unit);
    const CageOptions& cage = std::get<CageOptions>(scaled.setup.method);
    const auto moves = own_displacements(scaled.setup, *scaled.half, cage, bent);
    const WholeGreen whole = whole_across(cage, false, moves);
    const auto system = prepare(scaled.half, scaled.setup);
    expect_whole(*system, *scaled.half, whole, bent, 1e-12 * unit);
    EXPECT_THAT(system->info().notes,
                testing::Contains(testing::HasSubstr("3 vertices of the cage are in handles, 3 are mirror images of these")));
    test::expect_bounds(estimate(*scaled.half, scaled.setup), system->info());
    setup = scaled.setup;
    setup.handles[0].region = control_ids({1, 3, 5, 7});  // with the images
    expect_whole(*prepare(scaled.half, setup), *scaled.half, whole, bent, 1e-12 * unit);
  }
}

TEST(GreenSymmetry, SeveralPlanesInAnyDirection) {
  for (const std::size_t planes : {1u, 2u, 3u}) {
    for (unsigned ends = 0; ends < 1u << planes; ++ends) {
      SCOPED_TRACE(testing::Message() << planes << " planes, ends in " << ends);
      const test::HalfModel model(planes, test::oblique());
      Vec3 from{-1.3, -1.3, -1.3};
      for (std::size_t k = 0; k < planes; ++k) from[k] = (ends >> k & 1u) != 0 ? 0 : from[k];
      const CageOptions local = green_of(pyramids(from, {1.3, 1.3, 1.3}));
      CageOptions cage = local;
      for (Vec3& x : cage.vertices) x = model.frame.point(x);
      deform::Setup setup;
      setup.method = cage;
      setup.symmetry = model.setup.symmetry;
      setup.handles = {{"corner", control_ids({7, 9, 11})}};
      std::vector<Vec3> given, moves(local.vertices.size());
      for (const std::size_t v : {7u, 9u, 11u}) {
        moves[v] = {0.1 + 0.01 * static_cast<double>(v), -0.2, 0.15};
        for (std::size_t k = 0; k < planes; ++k) moves[v][k] = local.vertices[v][k] == 0 ? 0 : moves[v][k];
        given.push_back(model.frame.vector(moves[v]));
      }
      WholeGreen whole = whole_green(local, planes, ends, moves);
      for (Vec3& x : whole.cage.vertices) x = model.frame.point(x);
      for (Vec3& u : whole.displacements) u = model.frame.vector(u);
      const auto system = prepare(model.half, setup);
      const Points got = system->evaluate({{}, {{0, given}}});
      const Points expected = moved_in(whole.cage, *model.half, whole.displacements);
      double farthest = 0;
      for (std::size_t i = 0; i < got.size(); ++i) {
        EXPECT_LT(distance(got[i], expected[i]), 1e-12 * norm(model.frame.origin)) << i;
        farthest = std::max(farthest, distance(got[i], model.half->points[i]));
      }
      EXPECT_GT(farthest, 0.02);
      EXPECT_LT(model.out_of_planes(got), 1e-14 * norm(model.frame.origin));
      test::expect_bounds(estimate(*model.half, setup), system->info());
      // One column for each vertex and triangle that moves, and one more for each plane in which the cage ends.
      std::vector<char> moved;
      for (const Vec3& x : cage.vertices) {
        moved.push_back(0);
        for (std::size_t w = 0; w < whole.cage.vertices.size(); ++w) {
          const bool same = distance(whole.cage.vertices[w], x) < 1e-9;
          moved.back() = same && norm(whole.displacements[w]) > 0 ? 1 : moved.back();
        }
      }
      auto expected_columns = static_cast<std::size_t>(std::count(moved.begin(), moved.end(), 1));
      for (const auto& t : cage.triangles) {
        bool inside = false;
        for (std::size_t k = 0; k < planes; ++k) {
          inside = inside || ((ends >> k & 1u) != 0 && local.vertices[t[0]][k] == 0 && local.vertices[t[1]][k] == 0 &&
                              local.vertices[t[2]][k] == 0);
        }
        expected_columns += !inside && (moved[t[0]] != 0 || moved[t[1]] != 0 || moved[t[2]] != 0) ? 1 : 0;
      }
      expected_columns *= std::min(3, 1 + std::popcount(ends));  // with three planes nothing is along all of them
      std::get<CageOptions>(setup.method).basis = BasisMode::never;
      const std::size_t columns = (system->info().bytes - prepare(model.half, setup)->info().bytes) / sizeof(double) /
                                  (tile_count(model.half->point_count()) * tile_size);
      EXPECT_EQ(columns, expected_columns);
    }
  }
}

TEST(GreenSymmetry, JacobianProductsAndPopulations) {
  for (const std::size_t columns : {31u, 46u}) {
    const auto half = shared(test::bumpy_sheet(columns, columns / 2));
    for (const Vec3& from : {cage_low, cage_cut}) {
      const auto stored = prepare(half, cage_setup(green_of(pyramids(from, cage_high), BasisMode::always), {1, 3, 5, 7}));
      const auto computed = prepare(half, cage_setup(green_of(pyramids(from, cage_high), BasisMode::never), {1, 3, 5, 7}));
      test::check_jacobians(*stored, 1e-13, 1e-8);
      test::check_jacobians(*computed, 1e-13, 1e-8);
      EXPECT_GT(stored->info().bytes, computed->info().bytes + half->point_count() * 20 * sizeof(double));
      std::vector<Design> designs(5, bent);
      for (std::size_t i = 0; i < designs.size(); ++i) designs[i].variables[i % 4] += 0.2;
      const std::vector<Points> together = stored->evaluate(designs);
      for (std::size_t i = 0; i < designs.size(); ++i) EXPECT_EQ(computed->evaluate(designs[i]), together[i]) << i;
      EXPECT_EQ(stored->evaluate(Design{{0, 0, 0, 0}, {}}), half->points) << "exactly at rest";
      // A rate keeps points in the plane, as the design does.
      const Points rate = stored->jacobian_vector(bent.variables, std::vector<double>{0.3, -0.7, 0.5, 0.9}, {});
      for (std::size_t i = 0; i < rate.size(); ++i) {
        if (half->points[i][1] == 0) {
          EXPECT_EQ(rate[i][1], 0);
        }
      }
    }
  }
}

TEST(GreenSymmetry, PlacesOnBothSidesOfThePlane) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  for (const Vec3& from : {cage_low, cage_cut, Vec3{-0.2, 4e-10, -0.6}}) {  // which nearly ends in the plane
    const auto system = prepare(half, cage_setup(green_of(pyramids(from, cage_high))));
    const Points expected = system->evaluate(bent);
    std::vector<Vec3> at = half->points;
    for (const Vec3& x : half->points) at.push_back(test::across(x));
    Points out(at.size());
    system->bind_in_space(bent, {})->evaluate(at, 0, out, {});
    for (std::size_t i = 0; i < half->point_count(); ++i) {
      EXPECT_EQ(out[i], expected[i]);
      EXPECT_LT(distance(test::across(out[half->point_count() + i]), expected[i]), 1e-13);
    }
    const std::vector<Vec3> beyond{{0.5, -1.4, 0}};
    test::expect_error(ErrorCode::invalid_argument, {"points[3]", "outside of the cage"},
                       [&] { system->bind_in_space(bent, {})->evaluate(beyond, 3, out, {}); });
  }
}

TEST(GreenSymmetry, SaysWhichVerticesMoveNothing) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  deform::Setup setup = cage_setup(green_of(pyramids(cage_cut, cage_high)));
  setup.variables.resize(2);
  setup.handles[1].region = control_ids({10});  // in the middle of the face in the plane
  const auto idle = testing::HasSubstr("Handle \"middle\": its vertices have only triangles where the cage ends");
  const auto system = prepare(half, setup);
  EXPECT_THAT(system->info().notes, testing::Contains(idle));
  EXPECT_THAT(estimate(*half, setup).notes, testing::Contains(idle));
  EXPECT_EQ(system->evaluate({{}, {{1, std::vector<Vec3>{{0.1, 0, 0.2}}}}}), half->points);
  setup.handles[0].region = control_ids({3, 7, 10});
  setup.handles.pop_back();
  EXPECT_THAT(prepare(half, setup)->info().notes, testing::Contains(testing::HasSubstr("\"end\": 1 of its vertices have")));
  setup.handles[0].region = control_ids({3, 7});
  EXPECT_THAT(prepare(half, setup)->info().notes, testing::Not(testing::Contains(testing::HasSubstr("move nothing"))));
}

// A half model need not reach its plane, nor need its cage.
TEST(GreenSymmetry, CagesBesideThePlaneHaveImagesOfTheirOwn) {
  Mesh sheet = test::bumpy_sheet(23, 12);
  for (Vec3& x : sheet.points) x[1] += 0.5;
  const auto half = shared(std::move(sheet));
  // Beside the plane, and with a vertex in it.
  for (const double nearest : {0.3, 0.0}) {
    test::CageMesh mesh = pyramids({-0.2, 0.3, -0.6}, {2.3, 1.8, 0.7});
    mesh.vertices[10][1] = nearest;
    const CageOptions cage = green_of(mesh);
    deform::Setup setup = cage_setup(cage);
    setup.fixed.clear();
    setup.handles[1].region = control_ids({10});
    const Design design{{0.1, 0.8, 0, 0}, {}};
    const auto moves = own_displacements(setup, *half, cage, design);
    // What is one vertex in two cages, by their places, are two: each has its own fan of triangles.
    CageOptions both = cage;
    std::vector<Vec3> both_moves = moves;
    for (std::size_t v = 0; v < moves.size(); ++v) {
      both.vertices.push_back(test::across(cage.vertices[v]));
      both_moves.push_back(test::across(moves[v]));
    }
    const auto count = static_cast<std::uint32_t>(moves.size());
    for (const auto& [a, b, c] : cage.triangles) both.triangles.push_back({a + count, c + count, b + count});
    expect_whole(*prepare(half, setup), *half, {both, both_moves}, design, 1e-12);
  }
}

TEST(GreenSymmetry, RefusesWhatDoesNotFit) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  const auto refused = [&](const deform::Setup& setup, const std::vector<const char*>& words) {
    test::expect_error(ErrorCode::invalid_argument, words, [&] { prepare(half, setup)->evaluate(bent); });
  };
  test::CageMesh mesh = pyramids(cage_low, cage_high);
  mesh.vertices[5][0] += 1e-5;
  refused(cage_setup(green_of(mesh)), {"method.cage", "symmetry[0]", "vertex 5 has no image"});
  test::expect_error(ErrorCode::invalid_argument, {"method.cage", "vertex 5 has no image"},
                     [&] { estimate(*half, cage_setup(green_of(mesh))); });
  // Its face in the plane does not reach the end of the sheet, nor does its box.
  const deform::Setup narrow = cage_setup(green_of(pyramids({0.5, 0, -0.6}, cage_high)));
  refused(narrow, {"GREEN", "lie outside"});
  test::expect_error(ErrorCode::invalid_argument, {"GREEN", "outside of its box, the first is 0"},
                     [&] { estimate(*half, narrow); });
  // Vertex 10 is the image of 11, which moves.
  deform::Setup setup = cage_setup(green_of(pyramids(cage_low, cage_high)));
  setup.fixed = {control_ids({10})};
  refused(setup, {"\"middle\"", "control point 11", "symmetry[0]", "control point 10"});
  test::expect_error(ErrorCode::invalid_argument, {"\"middle\"", "control point 10"}, [&] { estimate(*half, setup); });
  // 10 and 11 in one handle that turns about an axis in the plane.
  setup = cage_setup(green_of(pyramids(cage_low, cage_high)));
  setup.handles[1].region = control_ids({10, 11});
  refused(setup, {"designs[0]", "control points 10", "mirror images in symmetry[0]", "their motions are not"});
  test::expect_error(ErrorCode::invalid_argument, {"direction", "control points 10", "mirror images in symmetry[0]"}, [&] {
    prepare(half, setup)->jacobian_vector(std::vector<double>{0, 0, 0, 0}, std::vector<double>{0, 0, 0, 1}, {});
  });
  // In the plane, and led out of it.
  setup = cage_setup(green_of(pyramids(cage_cut, cage_high)), {1, 3, 5, 7});
  setup.variables[0].kind = DesignVariable::Translate{{0, 0.1, 1}};
  refused(setup, {"designs[0]", "control point 1 ", "symmetry[0]"});
  // Numbers are those of the cage as given: triangle 14 is that of vertices 7, 3 and 11 or so.
  setup = cage_setup(green_of(pyramids(cage_cut, cage_high)));
  const auto& cage = std::get<CageOptions>(setup.method);
  const std::size_t last = cage.triangles.size() - 1;
  const auto& [a, b, c] = cage.triangles[last];
  setup.handles = {{"middle", control_ids({c})}};
  setup.variables.clear();
  setup.fixed.clear();
  const Vec3 onto = 0.5 * (cage.vertices[a] + cage.vertices[b]) - cage.vertices[c];
  const std::string triangle = "triangle " + std::to_string(last), vertex = std::to_string(c);
  test::expect_error(ErrorCode::invalid_argument, {"onto a line", triangle.c_str(), vertex.c_str()}, [&] {
    prepare(half, setup)->evaluate({{}, {{0, std::vector<Vec3>{onto}}}});
  });
}

// Vertex 6 has two faces in the plane that do not touch each other.
TEST(GreenSymmetry, RefusesCagesThatTheirImagesDoNotClose) {
  test::CageMesh mesh;
  mesh.vertices = {{-2, 0, -1}, {-2, 0, 1}, {0, 1, 1.5}, {2, 0, 1}, {2, 0, -1}, {0, 1, -1.5}, {0, 0, 0}, {0, 3, 0}};
  for (std::uint32_t i = 0; i < 6; ++i) {
    mesh.triangles.push_back({6, (i + 1) % 6, i});
    mesh.triangles.push_back({7, i, (i + 1) % 6});
  }
  deform::Setup setup = cage_setup(green_of(mesh), {7});
  setup.handles.pop_back();
  setup.variables.clear();
  setup.fixed.clear();
  test::expect_error(ErrorCode::invalid_argument, {"method.cage", "with its images", "vertices[6]", "meet at this vertex only"},
                     [&] { prepare(shared(test::bumpy_sheet(23, 12)), setup); });
}

CageOptions green_can(const test::SectorModel& model, std::uint32_t sides, double radius) {
  CageOptions options = green_of({});
  test::make_can(model, sides, radius, options);
  return options;
}

TEST(GreenSectors, ACageAroundTheWheelMovesWithItsImages) {
  for (const std::size_t count : {2, 3, 8}) {
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      SCOPED_TRACE(count);
      const std::uint32_t sides = count == 2 ? 4 : 2, ring = sides * static_cast<std::uint32_t>(count);
      test::SectorModel model({count, 0.0, count}, test::oblique());
      const test::WholeWheel whole(model);
      const test::Frame& frame = model.frame;
      model.setup.variables = {{"along", "blade", DesignVariable::Translate{frame.axes[0] + 0.3 * frame.axes[1]}},
                               {"turn", "blade", DesignVariable::Rotate{frame.axes[2], frame.point({0.4, 0.7, 0})}},
                               {"grow", "blade", DesignVariable::Scale{frame.point({0.4, 0.7, 0}), frame.axes[1]}},
                               {"stagger", "blade", DesignVariable::Rotate{frame.axes[1], frame.point({0.4, 0.7, 0})}}};
      CageOptions can = green_can(model, sides, 2.2);
      can.basis = basis;
      model.setup.fixed.clear();
      model.setup.method = can;
      model.setup.handles[0].region = control_ids({0, ring + 1});
      const Design design{{0.1, 0.15, 0.2, -0.1}, {}};
      const Affine motion = handle_motions(model.setup, design.variables)[0];
      std::vector<Vec3> moves(can.vertices.size());
      for (std::uint32_t g = 0; g < count; ++g) {
        for (const auto& [vertex, first] : {std::pair{0u, 0u}, {ring + 1, ring}}) {
          const std::uint32_t at = first + (vertex - first + g * sides) % ring;
          moves[at] = transformed(test::turned_motion(model, motion, g), can.vertices[at]) - can.vertices[at];
        }
      }
      const Points expected = moved_in(can, *model.sector, moves);
      const double rounding = 1e-14 * (bounding_box(whole.wheel->points).diagonal() + norm(frame.origin));
      const auto system = prepare(model.sector, model.setup);
      const Points got = system->evaluate(design);
      EXPECT_LT(test::distance(got, expected), 1e-12);
      EXPECT_GT(test::distance(got, model.sector->points), 0.02);
      EXPECT_LE(model.out_of_turn(got), rounding);
      test::check_jacobians(*system, 1e-13, 1e-8);
      std::vector<Design> designs(3, design);
      for (std::size_t i = 0; i < designs.size(); ++i) designs[i].variables[i] += 0.1;
      const std::vector<Points> together = system->evaluate(designs);
      for (std::size_t i = 0; i < designs.size(); ++i) EXPECT_EQ(system->evaluate(designs[i]), together[i]) << i;
      test::expect_bounds(estimate(*model.sector, model.setup), system->info());
      // Places of the other sectors.
      Points at, out(got.size());
      for (const Vec3& x : model.sector->points) at.push_back(model.turned_point(x, 1));
      system->bind_in_space(design, {})->evaluate(at, 0, out, {});
      for (std::size_t i = 0; i < got.size(); ++i) EXPECT_LT(distance(out[i], model.turned_point(got[i], 1)), 10 * rounding);
      system->bind_in_space(design, {})->evaluate(model.sector->points, 0, out, {});
      EXPECT_LT(test::distance(out, got), rounding);
    }
  }
}

/// One sector of a can, with faces in the planes through the axis that its walls end in. With a hub there is an inner wall around
/// the axis; the faces in the planes have a vertex in the middle. `vertex(i, z, inner)`: numbers by angle, height and radius.
struct Wedge {
  Wedge(const test::SectorModel& model, std::uint32_t sides, double outer, double inner) : steps(sides + 1), hub(inner > 0) {
    options = green_of({});
    const double angle = 2 * std::numbers::pi / static_cast<double>(sides * model.shape.count);
    for (const double radius : {outer, inner}) {
      for (const double z : {-0.3, 1.2}) {
        for (std::uint32_t i = 0; i < (radius > 0 ? steps : 1); ++i) {
          options.vertices.push_back(model.frame.point({z, radius * std::cos(angle * i), radius * std::sin(angle * i)}));
        }
      }
    }
    for (const std::uint32_t i : {0u, sides}) {
      const double radius = 0.5 * (outer + inner);
      options.vertices.push_back(model.frame.point({0.4, radius * std::cos(angle * i), radius * std::sin(angle * i)}));
    }
    const auto middle = static_cast<std::uint32_t>(options.vertices.size() - 2);
    const auto quad = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
      for (const Cage::Triangle& t : {Cage::Triangle{a, b, c}, {a, c, d}}) {
        if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) options.triangles.push_back(t);
      }
    };
    for (std::uint32_t i = 0; i < sides; ++i) {
      quad(at(i, 0, false), at(i + 1, 0, false), at(i + 1, 1, false), at(i, 1, false));
      if (hub) quad(at(i, 0, true), at(i, 1, true), at(i + 1, 1, true), at(i + 1, 0, true));
      quad(at(i, 0, false), at(i, 0, true), at(i + 1, 0, true), at(i + 1, 0, false));
      quad(at(i, 1, false), at(i + 1, 1, false), at(i + 1, 1, true), at(i, 1, true));
    }
    for (const std::uint32_t i : {0u, sides}) {
      const std::array<std::uint32_t, 4> round{at(i, 0, false), at(i, 1, false), at(i, 1, true), at(i, 0, true)};
      for (std::size_t k = 0; k < 4; ++k) {
        Cage::Triangle t{round[k], round[(k + 1) % 4], middle + (i == 0 ? 0 : 1)};
        if (i != 0) std::swap(t[0], t[1]);
        options.triangles.push_back(t);
      }
    }
  }
  std::uint32_t at(std::uint32_t i, std::uint32_t z, bool inner) const {
    return inner ? 2 * steps + (hub ? z * steps + i : z) : z * steps + i;
  }

  CageOptions options;
  std::uint32_t steps;
  bool hub;
};

/// The wedge in all sectors, by the places of vertices, and what its vertices do; triangles between planes through the axis only.
WholeGreen whole_wheel(const test::SectorModel& model, const CageOptions& wedge, const std::vector<Vec3>& moves) {
  WholeGreen whole{wedge, {}};
  whole.cage.vertices.clear();
  whole.cage.triangles.clear();
  const auto angle_of = [&](std::uint32_t v) {
    const Vec3 d = wedge.vertices[v] - model.frame.origin;
    return std::pair{std::hypot(dot(d, model.frame.axes[1]), dot(d, model.frame.axes[2])),
                     std::atan2(dot(d, model.frame.axes[2]), dot(d, model.frame.axes[1]))};
  };
  const double pitch = 2 * std::numbers::pi / static_cast<double>(model.shape.count);
  for (std::size_t g = 0; g < model.shape.count; ++g) {
    for (const auto& t : wedge.triangles) {
      const auto in = [&](double boundary) {
        return std::all_of(t.begin(), t.end(), [&](std::uint32_t v) {
          const auto [radius, angle] = angle_of(v);
          return radius < 1e-9 || std::abs(std::remainder(angle - boundary, 2 * std::numbers::pi)) < 1e-9;
        });
      };
      if (in(0) || in(pitch)) continue;
      std::array<std::uint32_t, 3> of{};
      for (std::size_t c = 0; c < 3; ++c) {
        const Vec3 x = model.turned_point(wedge.vertices[t[c]], static_cast<double>(g));
        const auto known = std::find_if(whole.cage.vertices.begin(), whole.cage.vertices.end(),
                                        [&](const Vec3& y) { return distance(x, y) < 1e-9; });
        of[c] = static_cast<std::uint32_t>(known - whole.cage.vertices.begin());
        if (known != whole.cage.vertices.end()) continue;
        whole.cage.vertices.push_back(x);
        whole.displacements.emplace_back();
      }
      whole.cage.triangles.push_back(of);
    }
  }
  for (std::size_t g = 0; g < model.shape.count; ++g) {
    for (std::size_t v = 0; v < moves.size(); ++v) {
      if (norm(moves[v]) == 0) continue;
      const Vec3 x = model.turned_point(wedge.vertices[v], static_cast<double>(g));
      const Vec3 to = model.turned_point(wedge.vertices[v] + moves[v], static_cast<double>(g));
      for (std::size_t w = 0; w < whole.cage.vertices.size(); ++w) {
        if (distance(whole.cage.vertices[w], x) < 1e-9) whole.displacements[w] = to - x;
      }
    }
  }
  return whole;
}

TEST(GreenSectors, CagesOfOneSectorAreTheWholeOnes) {
  for (const std::size_t count : {2, 3, 8, 20}) {
    for (const bool hub : {false, true}) {
      SCOPED_TRACE(testing::Message() << count << " sectors, hub " << hub);
      test::SectorModel model({count, hub ? 0.4 : 0.0, count}, test::oblique());
      const test::Frame& frame = model.frame;
      const std::uint32_t sides = count == 2 ? 4 : 2;
      const Wedge wedge(model, sides, 2.2, hub ? 0.25 : 0);
      model.setup.variables = {{"along", "blade", DesignVariable::Translate{frame.axes[0] + 0.3 * frame.axes[1]}},
                               {"turn", "blade", DesignVariable::Rotate{frame.axes[2], frame.point({0.4, 0.7, 0})}},
                               {"grow", "blade", DesignVariable::Scale{frame.point({0.4, 0.7, 0}), frame.axes[1]}},
                               {"stagger", "blade", DesignVariable::Rotate{frame.axes[1], frame.point({0.4, 0.7, 0})}}};
      model.setup.fixed.clear();
      model.setup.method = wedge.options;
      // Between the boundaries, and on either of them.
      model.setup.handles[0].region = control_ids({wedge.at(1, 1, false), wedge.at(0, 0, false)});
      const Design design{{0.1, 0.15, 0.2, -0.1}, {}};
      for (const bool second : {false, true}) {
        if (second) model.setup.handles[0].region = control_ids({wedge.at(1, 1, false), wedge.at(sides, 0, false)});
        const auto moves = own_displacements(model.setup, *model.sector, wedge.options, design);
        const WholeGreen whole = whole_wheel(model, wedge.options, moves);
        const Points expected = moved_in(whole.cage, *model.sector, whole.displacements);
        const auto system = prepare(model.sector, model.setup);
        const Points got = system->evaluate(design);
        const double rounding = 1e-14 * (2 * bounding_box(whole.cage.vertices).diagonal() + norm(frame.origin));
        EXPECT_LT(test::distance(got, expected), 1e-12);
        EXPECT_GT(test::distance(got, model.sector->points), 0.01);
        EXPECT_LE(model.out_of_turn(got), rounding);
        test::check_jacobians(*system, 1e-12, 1e-8);
        test::expect_bounds(estimate(*model.sector, model.setup), system->info());
        EXPECT_THAT(system->info().notes, testing::Contains(testing::HasSubstr("With its images in all sectors, and without")));
        EXPECT_THAT(system->info().notes, testing::Not(testing::Contains(testing::HasSubstr("move nothing"))));
        CageOptions computed = wedge.options;
        computed.basis = BasisMode::never;
        deform::Setup setup = model.setup;
        setup.method = computed;
        EXPECT_EQ(prepare(model.sector, setup)->evaluate(design), got);
        // Coordinates of images are added up: three for each vertex and triangle, however many sectors there are.
        const std::size_t columns = (system->info().bytes - prepare(model.sector, setup)->info().bytes) / sizeof(double) /
                                    (tile_count(model.sector->point_count()) * tile_size);
        EXPECT_LE(columns, 3 * (2 + wedge.options.triangles.size()));
      }
      // Both boundaries, moved alike and not.
      model.setup.variables.clear();
      model.setup.handles = {{"first", control_ids({wedge.at(0, 0, false)})},
                             {"second", control_ids({wedge.at(sides, 0, false)})}};
      const Vec3 u = frame.vector({0.1, 0.2, -0.1});
      const Vec3 x = wedge.options.vertices[wedge.at(0, 0, false)];
      const Vec3 turned = model.turned_point(x + u, 1) - model.turned_point(x, 1);
      const auto system = prepare(model.sector, model.setup);
      const Points both = system->evaluate({{}, {{0, std::vector<Vec3>{u}}, {1, std::vector<Vec3>{turned}}}});
      model.setup.handles.pop_back();
      EXPECT_LT(test::distance(prepare(model.sector, model.setup)->evaluate({{}, {{0, std::vector<Vec3>{u}}}}), both), 1e-13);
      test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "images of each other by 1 sector", "their motions are not"},
                         [&] {
                           system->evaluate({{}, {{0, std::vector<Vec3>{u}}, {1, std::vector<Vec3>{u}}}});
                         });
      model.setup.fixed = {control_ids({wedge.at(sides, 0, false)})};
      test::expect_error(ErrorCode::invalid_argument, {"\"first\"", "is in a fixed region", "images of each other by 1 sector"},
                         [&] { prepare(model.sector, model.setup); });
    }
  }
}

// Exactly, where the axis is a coordinate axis.
TEST(GreenSectors, PointsOnTheAxisMoveAlongIt) {
  test::SectorModel model({3, 0.0, 2});
  const Wedge wedge(model, 2, 2.2, 0);
  model.setup.fixed.clear();
  model.setup.method = wedge.options;
  model.setup.handles[0].region = control_ids({wedge.at(1, 1, false)});
  model.setup.variables = {{"up", "blade", DesignVariable::Translate{{0.3, 0.2, 0.1}}}};
  const auto system = prepare(model.sector, model.setup);
  const Points got = system->evaluate(Design{{0.5}, {}});
  const Points rate = system->jacobian_vector(std::vector<double>{0.5}, std::vector<double>{1}, {});
  Points across(got.size());
  ASSERT_FALSE(model.axis.empty());
  for (const PointId id : model.axis) {
    EXPECT_NE(got[id][0], model.sector->points[id][0]);
    EXPECT_EQ(got[id][1], model.sector->points[id][1]);
    EXPECT_EQ(got[id][2], model.sector->points[id][2]);
    EXPECT_EQ(rate[id], (Vec3{rate[id][0], 0, 0}));
    across[id] = {0, 0.3, -0.7};
  }
  EXPECT_EQ(system->vector_jacobian(std::vector<double>{0.5}, across, {}), std::vector<double>{0});
}

TEST(GreenSectors, RefusesCagesOfOneSectorThatDoNotFit) {
  test::SectorModel model({5, 0.4, 1});
  const Wedge wedge(model, 2, 2.2, 0.25);
  model.setup.fixed.clear();
  model.setup.handles[0].region = control_ids({wedge.at(1, 1, false)});
  const auto refused = [&](const CageOptions& cage, const std::vector<const char*>& words) {
    model.setup.method = cage;
    test::expect_error(ErrorCode::invalid_argument, words, [&] { prepare(model.sector, model.setup); });
  };
  CageOptions cage = wedge.options;
  cage.coordinates = CageCoordinates::mean_value;
  refused(cage, {"method.cage", "ends in the periodic boundaries", "MEAN_VALUE", "GREEN"});
  refused(Wedge(model, 2, 0.8, 0.25).options, {"GREEN", "lie outside"});
  model.setup.handles[0].region = control_ids({wedge.at(2, 1, false)});
  model.setup.fixed = {control_ids({wedge.at(0, 1, false)})};
  refused(wedge.options, {"\"blade\"", "is in a fixed region", "images of each other by 4 sectors"});
  model.setup.fixed.clear();
  const Wedge wide(test::SectorModel({4, 0.4, 1}), 2, 2.2, 0.25);
  refused(wide.options, {"method.cage", "wheel of 5 sectors", "has no image"});
  test::SectorModel many({3000, 0.4, 1});
  const Wedge thin(many, 2, 2.2, 0.25);
  many.setup.fixed.clear();
  many.setup.handles[0].region = control_ids({0});
  many.setup.method = thin.options;
  test::expect_error(ErrorCode::invalid_argument, {"method.cage", "3000 sectors", "24000 vertices", "10000"},
                     [&] { prepare(many.sector, many.setup); });
}

TEST(GreenSectors, RefusesOtherCages) {
  test::SectorModel model({5, 0.4, 1});
  CageOptions can = green_can(model, 2, 2.2);
  can.vertices[3][0] -= 0.01;
  model.setup.method = can;
  model.setup.fixed.clear();
  model.setup.handles[0].region = control_ids({0});
  test::expect_error(ErrorCode::invalid_argument, {"method.cage", "wheel of 5 sectors", "vertex 1 has no image"},
                     [&] { prepare(model.sector, model.setup); });
}

}  // namespace
}  // namespace deform::green_symmetry_test
