// SPDX-License-Identifier: GPL-3.0-or-later
// Symmetry planes with the method ffd and control CONTROLS. The references are triple sums over the control points of the whole
// model, whose displacements are placed by where the images of control points lie.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/compiled_form.h"
#include "core/deformers/ffd/lattice_images.h"
#include "core/deformers/space_map.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/deformers/lattice_by_hand.h"
#include "tests/core/deformers/mirrored.h"
#include "tests/core/deformers/mirrored_sheet.h"
#include "tests/support/expect_error.h"

namespace deform::ffd_symmetry_test {
namespace {

using test::across;
using test::bent;
using test::shared;
using Layers = std::optional<Region::LatticeRange::Range>;

constexpr std::array<LatticeBasis, 3> all_bases{LatticeBasis::uniform_cubic, LatticeBasis::clamped_cubic,
                                                LatticeBasis::bernstein};

Region layers(const Layers& i, const Layers& j = std::nullopt, const Layers& k = std::nullopt) {
  return {Region::LatticeRange{{i, j, k}}};
}

/// The lattice from y = `low` to 1.1 with cells of 0.55 for splines with uniform knots.
FfdOptions lattice_from(double low, std::size_t points, LatticeBasis basis = LatticeBasis::uniform_cubic) {
  FfdOptions options;
  options.control = FfdControl::controls;
  options.lattice.frame = LatticeFrame{{-0.2, low, -0.6}, {{{2.5, 0, 0}, {0, 1.1 - low, 0}, {0, 0, 1.3}}}};
  options.lattice.points = {7, points, 4};
  options.lattice.basis = basis;
  return options;
}

/// "end" holds layers from `plane` on along the second axis, "middle" two control points of the last but one.
deform::Setup controls_setup(const FfdOptions& options, std::uint32_t plane) {
  deform::Setup setup = test::half_setup(options);
  const auto last = static_cast<std::uint32_t>(options.lattice.points[1] - 1);
  setup.handles[0].region = layers({{5, 6}}, {{plane, last}}, {{1, 3}});
  setup.handles[1].region = layers({{2, 3}}, {{last - 1, last - 1}}, {{1, 1}});
  setup.fixed = {layers({{0, 1}})};
  return setup;
}

using Moved = std::vector<std::pair<std::size_t, Vec3>>;  // control points and their displacements

/// What the handles move, without images.
Moved moved_by(const deform::Setup& setup, const Mesh& mesh, const std::vector<Vec3>& places, const Design& design) {
  const SelectedRegions regions = validate(setup, mesh);
  const std::vector<Affine> motions = handle_motions(setup, design.variables);
  Moved moved;
  for (std::size_t h = 0; h < motions.size(); ++h) {
    for (const PointId p : regions.handles[h]) moved.emplace_back(p, transformed(motions[h], places[p]) - places[p]);
  }
  return moved;
}

/// The displacements of all control points of a whole lattice: of those at the given places, and at the images of these.
std::vector<Vec3> with_images(const LatticeOptions& whole, const std::vector<Vec3>& places, const Moved& moved,
                              const std::vector<std::function<Vec3(const Vec3&)>>& images, const Vec3& origin) {
  const std::vector<Vec3> all = test::rest_places(whole);
  std::vector<Vec3> values(all.size());
  for (const auto& [p, u] : moved) {
    for (const auto& image : images) {
      const Vec3 at = origin + image(places[p] - origin);
      const auto found = std::find_if(all.begin(), all.end(), [&](const Vec3& c) { return distance(c, at) < 1e-9; });
      EXPECT_NE(found, all.end());
      if (found != all.end()) values[static_cast<std::size_t>(found - all.begin())] = image(u);
    }
  }
  return values;
}

std::vector<Vec3> with_images(const LatticeOptions& whole, const std::vector<Vec3>& places, const Moved& moved) {
  return with_images(whole, places, moved, {[](const Vec3& v) { return v; }, across}, {});
}

/// Both paths of a design against a reference for the displacement of each point; points with y = 0 stay there exactly.
void expect_displacements(const System& system, const Mesh& half, const Design& design,
                          const std::function<Vec3(const Vec3&)>& reference, double least_motion = 0.1) {
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const Points got = system.evaluate({&design, 1}, path)[0];
    double off = 0, farthest = 0, out = 0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      const Vec3 u = reference(half.points[i]);
      off = std::max(off, distance(got[i], half.points[i] + u));
      farthest = std::max(farthest, norm(u));
      if (half.points[i][1] == 0) out = std::max(out, std::abs(got[i][1]));
    }
    EXPECT_LT(off, 1e-13);
    EXPECT_EQ(out, 0);
    EXPECT_GT(farthest, least_motion);
    EXPECT_LT(system.bind({&design, 1}, path, {})->report(0).error, 1e-11);
  }
}

TEST(FfdSymmetry, IsTheWholeLattice) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  for (const LatticeBasis basis : all_bases) {
    SCOPED_TRACE(static_cast<int>(basis));
    const FfdOptions options = lattice_from(-1.1, 7, basis);
    const std::vector<Vec3> places = test::rest_places(options.lattice);
    deform::Setup setup = controls_setup(options, 3);
    const std::vector<Vec3> values = with_images(options.lattice, places, moved_by(setup, *half, places, bent));
    const auto reference = [&](const Vec3& x) {
      return test::triple_sum(options.lattice, values, test::local(*options.lattice.frame, x));
    };
    const auto system = prepare(half, setup);
    expect_displacements(*system, *half, bent, reference);
    EXPECT_EQ(system->info().points, half->point_count());
    EXPECT_THAT(system->info().notes,
                testing::Contains(testing::HasSubstr("26 control points are in handles, 20 are mirror images")));
    // Nor does it matter whether a handle holds the images itself.
    setup.handles[0].region = layers({{5, 6}}, std::nullopt, {{1, 3}});
    expect_displacements(*prepare(half, setup), *half, bent, reference);
  }
}

// The mesh with its mirror image, deformed without planes.
TEST(FfdSymmetry, IsTheWholeModel) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  const FfdOptions options = lattice_from(-1.1, 7);
  const std::vector<Vec3> places = test::rest_places(options.lattice);
  const deform::Setup setup = controls_setup(options, 3);
  deform::Setup whole_setup;
  whole_setup.method = options;
  whole_setup.handles = {{"all", layers(std::nullopt)}};
  Mesh whole = *half;
  for (const Vec3& x : half->points) whole.points.push_back(across(x));
  const Points expected = prepare(shared(std::move(whole)), whole_setup)
                              ->evaluate({{}, {{0, with_images(options.lattice, places, moved_by(setup, *half, places, bent))}}});
  const Points got = prepare(half, setup)->evaluate(bent);
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_LT(distance(got[i], expected[i]), 1e-13);
    EXPECT_LT(distance(across(got[i]), expected[got.size() + i]), 1e-13);
  }
}

// One side of the lattice of the whole model, or one that goes on for a cell: with uniform knots the whole lattice is known.
TEST(FfdSymmetry, LatticesThatEndInThePlaneOrBeyondAreContinued) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  const FfdOptions whole = lattice_from(-1.1, 7);
  const std::vector<Vec3> places = test::rest_places(whole.lattice);
  const std::vector<Vec3> values = with_images(whole.lattice, places, moved_by(controls_setup(whole, 3), *half, places, bent));
  const auto reference = [&](const Vec3& x) {
    return test::triple_sum(whole.lattice, values, test::local(*whole.lattice.frame, x));
  };
  for (const auto& [low, points, plane] : {std::tuple{0.0, 5u, 1u}, std::tuple{-0.55, 6u, 2u}}) {
    const auto system = prepare(half, controls_setup(lattice_from(low, points), plane));
    expect_displacements(*system, *half, bent, reference);
    EXPECT_EQ(system->bind({&bent, 1}, EvaluationPath::automatic, {})->report(0).torn_edges, 0u);
    // Also on the other side.
    const auto map = system->bind_in_space(bent, {});
    const std::vector<Vec3> at{{1.9, 0.3, 0}, {1.9, -0.3, 0}, {1.9, 0, 0}, {1.9, 1.05, 0.1}, {1.9, -1.05, 0.1}, {1.9, -2, 0}};
    Points out(at.size());
    EXPECT_EQ(map->evaluate(at, 0, out, {}).still, 1u);
    for (std::size_t i = 0; i + 1 < at.size(); ++i) EXPECT_LT(distance(out[i], at[i] + reference(at[i])), 1e-13) << i;
    EXPECT_EQ(out.back(), at.back());
  }
  for (const LatticeBasis basis : {LatticeBasis::clamped_cubic, LatticeBasis::bernstein}) {
    const FfdOptions options = lattice_from(0, 5, basis);
    const deform::Setup setup = controls_setup(options, 0);
    const std::vector<Vec3> own_places = test::rest_places(options.lattice);
    std::vector<Vec3> own(own_places.size());
    for (const auto& [p, u] : moved_by(setup, *half, own_places, bent)) own[p] = u;
    expect_displacements(*prepare(half, setup), *half, bent, [&](const Vec3& x) {
      return test::triple_sum(options.lattice, own, test::local(*options.lattice.frame, x));
    });
  }
}

/// A sum over a lattice that is 0 outside.
Vec3 within(const LatticeOptions& lattice, const std::vector<Vec3>& values, const Vec3& x) {
  const Vec3 u = test::local(*lattice.frame, x);
  for (const double t : u) {
    if (t < 0 || t > 1) return {};
  }
  return test::triple_sum(lattice, values, u);
}

// No lattice continues these: the model has them and their mirror images.
TEST(FfdSymmetry, OtherLatticesAddTheirMirrorImages) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  FfdOptions oblique = lattice_from(-1.1, 7);
  oblique.lattice.frame = LatticeFrame{{-0.2, -0.4, -0.5}, {{{2.6, 0.3, 0.1}, {-0.2, 1.8, 0.2}, {0.1, -0.2, 1.3}}}};
  FfdOptions aside = lattice_from(0.25, 6);  // does not reach the plane
  aside.lattice.frame->axes[0] = {2.5, 0.1, 0};
  for (const auto& [options, reaches] :
       {std::pair{lattice_from(-0.3, 6, LatticeBasis::clamped_cubic), true},
        std::pair{lattice_from(-0.3, 6, LatticeBasis::bernstein), true}, std::pair{lattice_from(-0.3, 6), true},
        std::pair{oblique, true}, std::pair{aside, false}}) {
    const deform::Setup setup = controls_setup(options, 3);
    const std::vector<Vec3> places = test::rest_places(options.lattice);
    std::vector<Vec3> own(places.size());
    for (const auto& [p, u] : moved_by(setup, *half, places, bent)) own[p] = u;
    const auto reference = [&lattice = options.lattice, &own](const Vec3& x) {
      return within(lattice, own, x) + across(within(lattice, own, across(x)));
    };
    const auto system = prepare(half, setup);
    expect_displacements(*system, *half, bent, reference, 0.05);
    const auto note = testing::HasSubstr("not symmetric about symmetry[0] but reaches through");
    if (reaches) {
      EXPECT_THAT(system->info().notes, testing::Contains(note));
    } else {
      EXPECT_THAT(system->info().notes, testing::Not(testing::Contains(note)));
    }
    const auto map = system->bind_in_space(bent, {});
    std::vector<Vec3> at;
    for (const Vec3& x : half->points) at.push_back(across(x));
    Points out(at.size());
    map->evaluate(at, 0, out, {});
    for (std::size_t i = 0; i < at.size(); ++i) EXPECT_LT(distance(out[i], at[i] + reference(at[i])), 1e-13);
  }
}

TEST(FfdSymmetry, SeveralPlanesInAnyDirection) {
  for (const std::size_t planes : {1u, 2u, 3u}) {
    const test::HalfModel model(planes, test::oblique());
    const auto& axes = model.frame.axes;
    FfdOptions ffd;
    ffd.control = FfdControl::controls;
    ffd.lattice.frame = LatticeFrame{model.frame.point({-1.3, -1.3, -1.3}), {{2.6 * axes[0], 2.6 * axes[1], 2.6 * axes[2]}}};
    ffd.lattice.points = {7, 7, 7};
    deform::Setup setup;
    setup.method = ffd;
    setup.symmetry = model.setup.symmetry;
    setup.handles = {{"corner", layers({{3, 4}}, {{3, 4}}, {{3, 4}})}};
    const std::vector<Vec3> places = test::rest_places(ffd.lattice);
    Moved moved;
    std::vector<Vec3> given;
    const SelectedRegions regions = validate(setup, *model.half);
    for (const PointId p : regions.handles[0]) {
      const std::array<std::size_t, 3> index{p % 7, p / 7 % 7, p / 49};
      Vec3 u{0.1 + 0.01 * static_cast<double>(p % 5), -0.2, 0.15};  // in the frame
      for (std::size_t k = 0; k < planes; ++k) u[k] = index[k] == 3 ? 0 : u[k];
      moved.emplace_back(p, model.frame.vector(u));
      given.push_back(moved.back().second);
    }
    std::vector<std::function<Vec3(const Vec3&)>> images;
    for (unsigned g = 0; g < 1u << planes; ++g) {
      images.emplace_back([&axes, g](Vec3 v) {
        for (std::size_t k = 0; k < 3; ++k) v = (g >> k & 1u) != 0 ? v - 2 * dot(v, axes[k]) * axes[k] : v;
        return v;
      });
    }
    const std::vector<Vec3> values = with_images(ffd.lattice, places, moved, images, model.frame.origin);
    const Points got = prepare(model.half, setup)->evaluate({{}, {{0, given}}});
    double farthest = 0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      const Vec3& x = model.half->points[i];
      const Vec3 u = test::triple_sum(ffd.lattice, values, test::local(*ffd.lattice.frame, x));
      EXPECT_LT(distance(got[i], x + u), 1e-13 * norm(model.frame.origin)) << planes << " planes, point " << i;
      farthest = std::max(farthest, norm(u));
    }
    EXPECT_GT(farthest, 0.1);
    EXPECT_LT(model.out_of_planes(got), 1e-14 * norm(model.frame.origin));
  }
}

// A plane along the diagonal of the cells exchanges two axes.
TEST(FfdSymmetry, PlanesAlongDiagonals) {
  Mesh mesh;
  for (std::size_t i = 0; i < 200; ++i) {
    const double t = static_cast<double>(i), s = std::fmod(0.618 * t, 1.0), r = std::fmod(0.413 * t, 1.0);
    mesh.points.push_back({std::max(s, r), i % 5 == 0 ? std::max(s, r) : std::min(s, r), std::fmod(0.277 * t, 1.0)});
  }
  const auto half = shared(std::move(mesh));
  const auto swapped = [](const Vec3& v) { return Vec3{v[1], v[0], v[2]}; };
  FfdOptions options;
  options.control = FfdControl::controls;
  options.lattice.frame = LatticeFrame{{-0.1, -0.1, -0.1}, {{{1.2, 0, 0}, {0, 1.2, 0}, {0, 0, 1.2}}}};
  options.lattice.points = {6, 6, 5};
  deform::Setup setup;
  setup.method = options;
  setup.symmetry.push_back({SymmetryPlane::Plane{{0, 0, 0}, {1, -1, 0}}});
  setup.handles = {{"h", layers({{4, 4}}, {{1, 2}}, {{2, 2}})}};
  const std::vector<Vec3> places = test::rest_places(options.lattice);
  const std::vector<Vec3> given{{0.2, -0.1, 0.3}, {-0.1, 0.15, 0.1}};
  const Moved moved{{4 + 6 * (1 + 6 * 2), given[0]}, {4 + 6 * (2 + 6 * 2), given[1]}};
  const std::vector<Vec3> values = with_images(options.lattice, places, moved, {[](const Vec3& v) { return v; }, swapped}, {});
  const Points got = prepare(half, setup)->evaluate({{}, {{0, given}}});
  for (std::size_t i = 0; i < got.size(); ++i) {
    const Vec3& x = half->points[i];
    EXPECT_LT(distance(got[i], x + test::triple_sum(options.lattice, values, test::local(*options.lattice.frame, x))), 1e-13);
    if (i % 5 == 0) {
      EXPECT_NEAR(got[i][0], got[i][1], 1e-15);
    }
  }
}

// A lattice that was moved symmetrically: half a lattice, and all of it.
TEST(FfdSymmetry, MovedLattices) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  const auto bend = [](std::vector<Vec3> places) {
    for (Vec3& c : places) c = c + Vec3{0.1 * c[1] * c[1], 0.08 * c[1] * std::sin(2 * c[0]), 0.15 * c[0] * c[0]};
    return places;
  };
  FfdOptions whole = lattice_from(-1.4, 8), one_side = lattice_from(0, 5);
  whole.lattice.frame->axes[1] = {0, 2.8, 0};
  one_side.lattice.frame->axes[1] = {0, 1.4, 0};
  whole.lattice.points = {7, 7, 4};
  for (FfdOptions* const options : {&whole, &one_side}) {
    options->lattice.frame->origin[2] = -1;
    options->lattice.frame->axes[2] = {0, 0, 3};
    options->lattice.control_points = bend(test::rest_places(options->lattice));
  }
  deform::Setup setup = controls_setup(whole, 3), of_side = controls_setup(one_side, 1);
  const Points expected = prepare(half, of_side)->evaluate(bent), got = prepare(half, setup)->evaluate(bent);
  double farthest = 0;
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_LT(distance(got[i], expected[i]), 1e-10);
    farthest = std::max(farthest, distance(got[i], half->points[i]));
    if (half->points[i][1] == 0) {
      EXPECT_EQ(got[i][1], 0);
    }
  }
  EXPECT_GT(farthest, 0.1);
  setup.symmetry.clear();  // the whole lattice with both sides of its handles
  setup.handles[0].region = layers({{5, 6}}, std::nullopt, {{1, 3}});
  deform::Setup still = setup;
  still.variables.erase(still.variables.begin() + 2);  // "grow" and "roll" move "middle", whose image is missing
  still.variables.pop_back();
  of_side.variables = still.variables;
  of_side.variables.resize(2);
  still.variables.resize(2);
  const Design of_end{{0.1, 0.8}, {}};
  EXPECT_LT(test::distance(prepare(half, of_side)->evaluate(of_end), prepare(half, still)->evaluate(of_end)), 1e-10);
}

TEST(FfdSymmetry, JacobianProductsAndPopulations) {
  const auto half = shared(test::bumpy_sheet(31, 16));
  for (const auto& [low, points, plane] :
       {std::tuple{-1.1, 7u, 3u}, std::tuple{-1.1, 7u, 0u}, std::tuple{0.0, 5u, 1u}, std::tuple{-0.3, 6u, 2u}}) {
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      FfdOptions options = lattice_from(low, points);
      options.basis = basis;
      const auto system = prepare(half, controls_setup(options, plane));
      EXPECT_EQ(system->info().basis_fields, basis == BasisMode::always ? 8u : 0u);
      test::check_jacobians(*system, 1e-14, 1e-8);
      const Points rates = system->jacobian_vector(bent.variables, std::vector<double>{0.3, -0.7, 0.5, 0.9}, {});
      for (std::size_t i = 0; i < rates.size(); ++i) {
        if (half->points[i][1] == 0) {
          EXPECT_EQ(rates[i][1], 0);
        }
      }
    }
    test::check_population(*prepare(half, controls_setup(lattice_from(low, points), plane)), 5);
  }
}

TEST(FfdSymmetry, TakesADisplacementPerControlPointAndABasisToATolerance) {
  const auto half = shared(test::bumpy_sheet(91, 46));
  FfdOptions options = lattice_from(-1.1, 7);
  options.basis = BasisMode::always;
  const deform::Setup setup = controls_setup(options, 3);
  const std::vector<Vec3> places = test::rest_places(options.lattice);
  const SelectedRegions regions = validate(setup, *half);
  const Moved moved = moved_by(setup, *half, places, bent);
  Design per_point{{}, {}};
  for (std::size_t h = 0, at = 0; h < 2; ++h) {
    std::vector<Vec3> given;
    for (std::size_t i = 0; i < regions.handles[h].size(); ++i) given.push_back(moved[at++].second);
    per_point.motions.push_back({h, std::move(given)});
  }
  const auto system = prepare(half, setup);
  const Points expected = system->evaluate(bent);
  EXPECT_LT(test::distance(system->evaluate(per_point), expected), 1e-14);
  options.basis_tolerance = 1e-6;
  const auto rounded = prepare(half, controls_setup(options, 3));
  EXPECT_LT(rounded->info().basis_bytes, system->info().basis_bytes);
  const double away = test::distance(expected, rounded->evaluate(bent));
  EXPECT_LE(away, rounded->bind({&bent, 1}, EvaluationPath::basis, {})->report(0).error);
  EXPECT_GT(away, 0);
}

TEST(FfdSymmetry, AnAutomaticLatticeSurroundsTheWholeModel) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  FfdOptions options;
  options.control = FfdControl::controls;
  options.lattice.points = {7, 7, 4};
  const Box box = bounding_box(half->points);
  FfdOptions given = options;
  const double diagonal = std::hypot(box.max[0] - box.min[0], 2 * box.max[1], box.max[2] - box.min[2]);
  const Vec3 low = Vec3{box.min[0], -box.max[1], box.min[2]} - 0.02 * diagonal * Vec3{1, 1, 1};
  const Vec3 high = box.max + 0.02 * diagonal * Vec3{1, 1, 1};
  given.lattice.frame = LatticeFrame{low, {{{high[0] - low[0], 0, 0}, {0, high[1] - low[1], 0}, {0, 0, high[2] - low[2]}}}};
  EXPECT_LT(test::distance(prepare(half, controls_setup(options, 3))->evaluate(bent),
                           prepare(half, controls_setup(given, 3))->evaluate(bent)),
            1e-13);
  // Its numbers of control points are those of the whole model, too.
  options.lattice.points = {};
  deform::Setup setup = controls_setup(given, 3);
  setup.method = options;
  setup.handles.pop_back();
  setup.variables.resize(2);
  setup.handles[0].region = layers({{5, 6}});
  EXPECT_THAT(prepare(half, setup)->info().notes, testing::Contains(testing::HasSubstr("11 x 11 x ")));

  setup.symmetry[0].kind = SymmetryPlane::Plane{{0, -0.1, 0}, {0.01, 1, 0}};
  test::expect_error(ErrorCode::invalid_argument, {"method.ffd.lattice", "symmetry[0]", "`frame`"},
                     [&] { prepare(half, setup); });
}

TEST(FfdSymmetry, EstimatesBoundWhatIsTaken) {
  for (const std::size_t columns : {31u, 91u}) {
    const auto half = shared(test::bumpy_sheet(columns, columns / 2 + 1));
    for (const double low : {-1.1, -0.3}) {
      for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
        FfdOptions options = lattice_from(low, 7);
        options.basis = basis;
        const deform::Setup setup = controls_setup(options, 3);
        test::expect_bounds(estimate(*half, setup), prepare(half, setup)->info());
      }
    }
  }
}

// An edge is torn where the mirror image of a lattice ends, as where the lattice does.
TEST(FfdSymmetry, TornEdgesOfMirrorImagesAreCounted) {
  const auto half = shared(test::bumpy_sheet(23, 12));
  const deform::Setup setup = controls_setup(lattice_from(-0.3, 6), 0);
  const auto bound = prepare(half, setup)->bind({&bent, 1}, EvaluationPath::automatic, {});
  EXPECT_GT(bound->report(0).torn_edges, 0u);
}

TEST(FfdSymmetry, RefusesWhatIsNotSymmetric) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  const FfdOptions options = lattice_from(-1.1, 7);
  deform::Setup setup = controls_setup(options, 3);
  setup.variables.push_back({"away", "end", DesignVariable::Translate{{0, 1, 0}}});
  auto system = prepare(half, setup);
  const std::vector<double> at{0, 0, 0, 0, 0.1}, still(5, 0.0), away{0, 0, 0, 0, 1};
  const std::vector<Design> designs{{still, {}}, {at, {}}};
  test::expect_error(ErrorCode::invalid_argument,
                     {"designs[1]", "control point 75 ", "\"end\"", "symmetry[0]", "0.1", "`difference`"},
                     [&] { system->evaluate(designs); });
  test::expect_error(ErrorCode::invalid_argument, {"direction", "control point 75 ", "symmetry[0]"},
                     [&] { system->jacobian_vector(still, away, {}); });
  test::expect_error(ErrorCode::invalid_argument, {"variable \"away\"", "control point 75 ", "symmetry[0]"},
                     [&] { system->vector_jacobian(still, Points(half->point_count()), {}); });
  test::expect_error(ErrorCode::failed_precondition, {"cannot be compiled", "\"away\"", "control point"},
                     [&] { CompiledForm form(system); });

  // Both sides in one handle that moves to one side, without those in the plane; and in two handles.
  setup.handles[0].region = {Region::Union{{layers({{5, 5}}, {{1, 1}}, {{1, 1}}), layers({{5, 5}}, {{5, 5}}, {{1, 1}})}}};
  system = prepare(half, setup);
  test::expect_error(ErrorCode::invalid_argument,
                     {"designs[1]", "61 (handle \"end\")", "89 (handle \"end\")", "symmetry[0]", "0.2"},
                     [&] { system->evaluate(designs); });
  test::expect_error(ErrorCode::invalid_argument, {"direction", "61 (", "mirror images in symmetry[0]", "2;"},
                     [&] { system->jacobian_vector(still, away, {}); });
  test::expect_error(ErrorCode::invalid_argument, {"variable \"away\"", "61 ("},
                     [&] { system->vector_jacobian(still, Points(half->point_count()), {}); });
  setup.handles[0].region = layers({{3, 3}}, {{1, 1}}, {{1, 1}});
  system = prepare(half, setup);
  test::expect_error(ErrorCode::invalid_argument, {"\"end\"", "\"middle\"", "symmetry[0]"}, [&] {
    system->evaluate(Design{{0.1, 0.8, 0.2, -0.6, 0}, {}});
  });

  setup.handles[0].region = layers({{5, 5}}, {{1, 1}}, {{1, 1}});
  setup.fixed = {layers({{5, 5}}, {{5, 5}}, {{1, 1}})};
  for (const auto& call :
       {std::function<void()>([&] { prepare(half, setup); }), std::function<void()>([&] { estimate(*half, setup); })}) {
    test::expect_error(ErrorCode::invalid_argument, {"\"end\"", "control point 61 ", "control point 89", "symmetry[0]", "fixed"},
                       call);
  }
  setup.symmetry[0].kind = SymmetryPlane::Plane{{0, 0, 0}, {0, 0, 0}};
  test::expect_error(ErrorCode::invalid_argument, {"symmetry[0].normal"}, [&] { prepare(half, setup); });
}

/// In planes across each axis and along the diagonals of each two, against a search among all places.
TEST(FfdSymmetry, ControlPointsAreImagesOfThoseInTheirReflections) {
  struct Plane {
    Vec3 normal;
    double at;
  };
  std::vector<Plane> planes;
  for (std::size_t a = 0; a < 3; ++a) {
    const std::size_t b = (a + 1) % 3;
    Plane across{{}, 0.5}, down{{}, 0}, up{{}, std::sqrt(0.5)};
    across.normal[a] = 1;
    down.normal[a] = up.normal[a] = up.normal[b] = std::sqrt(0.5);
    down.normal[b] = -std::sqrt(0.5);
    planes.insert(planes.end(), {across, down, up, Plane{across.normal, 0.4}});
  }
  for (const std::array<std::size_t, 3>& counts : {std::array<std::size_t, 3>{6, 6, 5}, {6, 5, 5}, {5, 6, 5}, {5, 5, 5}}) {
    for (const LatticeBasis basis : {LatticeBasis::bernstein, LatticeBasis::uniform_cubic}) {
      LatticeOptions options;
      options.basis = basis;
      options.points = counts;
      options.frame = LatticeFrame{{0, 0, 0}, {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}};
      const Lattice lattice = lattice_around(options, Box{{0, 0, 0}, {1, 1, 1}});
      const std::vector<Vec3> places = lattice.control_points();
      for (const Plane& plane : planes) {
        const auto reflect = [&](const Vec3& x) { return x - 2 * (dot(x, plane.normal) - plane.at) * plane.normal; };
        std::vector<std::uint32_t> expected;
        for (const Vec3& x : places) {
          const Vec3 to = reflect(x);
          const auto found = std::find_if(places.begin(), places.end(), [&](const Vec3& y) { return distance(y, to) < 1e-9; });
          expected.push_back(found == places.end() ? ControlMatches::no_control
                                                   : static_cast<std::uint32_t>(found - places.begin()));
        }
        const bool all = std::count(expected.begin(), expected.end(), ControlMatches::no_control) == 0;
        const std::vector<std::uint32_t> got = lattice_images(lattice, basis, places, reflect, 1e-9);
        EXPECT_EQ(got, all ? expected : std::vector<std::uint32_t>{})
            << counts[0] << ' ' << counts[1] << ' ' << counts[2] << " normal " << plane.normal[0] << ' ' << plane.normal[1] << ' '
            << plane.normal[2] << " at " << plane.at << " basis " << static_cast<int>(basis);
      }
    }
  }
}

}  // namespace
}  // namespace deform::ffd_symmetry_test
