// SPDX-License-Identifier: GPL-3.0-or-later
// Symmetry planes with every method: half models against whole ones that are made here, face by face.
#include "core/deformers/mirrored_system.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/compiled_form.h"
#include "core/mesh/elements.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/estimate_bounds.h"
#include "tests/core/deformers/mirrored.h"
#include "tests/core/deformers/mirrored_sheet.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"

namespace deform::mirrored_system_test {
namespace {

using test::across;
using test::bent;
using test::half_setup;
using test::shared;
using test::WholeSheet;

CageOptions cage_around() {
  const test::CageMesh mesh = test::box_cage({-0.4, -1.5, -0.6}, {2.4, 1.4, 0.7});
  CageOptions options;
  options.vertices = mesh.vertices;
  options.triangles = mesh.triangles;
  options.control = CageControl::mesh;
  options.clamp = 1e-6;
  return options;
}

/// The methods, all without a tolerance of their own.
std::vector<std::pair<std::string, decltype(Setup::method)>> methods() {
  FfdOptions by_mesh;
  by_mesh.control = FfdControl::mesh;
  by_mesh.clamp = 1e-4;
  SubspaceOptions subspace;
  subspace.centres = 60;
  MlsOptions mls;
  mls.surface_samples = 80;
  mls.volume_samples = 40;
  return {{"shell", ShellOptions{}}, {"subspace", subspace}, {"mls", mls},
          {"ffd", FfdOptions{}},     {"ffd MESH", by_mesh},  {"cage MESH", cage_around()}};
}

TEST(MirroredSystem, IsTheWholeModel) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  for (const auto& [name, method] : methods()) {
    const deform::Setup setup = half_setup(method);
    const WholeSheet whole(*half, setup, bent);
    const Points expected = prepare(whole.mesh, whole.setup)->evaluate(whole.design);
    const Points got = prepare(half, setup)->evaluate(bent);
    ASSERT_EQ(got.size(), half->point_count());
    double off = 0, uneven = 0, farthest = 0;
    for (std::size_t i = 0; i < got.size(); ++i) {
      const Vec3 other = across(expected[whole.image[i]]);
      off = std::max(off, distance(got[i], lerp(expected[i], other, 0.5)));
      uneven = std::max(uneven, distance(expected[i], other));
      farthest = std::max(farthest, distance(got[i], half->points[i]));
      if (half->points[i][1] == 0) {
        EXPECT_EQ(got[i][1], 0) << name << ": a point leaves the plane";
      }
      if (half->points[i][0] <= 0.3 && name.find("MESH") == std::string::npos) {
        EXPECT_LT(distance(got[i], half->points[i]), 1e-12) << name;
      }
    }
    EXPECT_LT(off, name.find("MESH") == std::string::npos ? 1e-9 : 1e-7) << name;
    EXPECT_GT(farthest, 0.2) << name;
    if (name == "shell" || name == "ffd") {
      EXPECT_LT(uneven, 1e-8) << name << ": the whole model is not even";
    }
  }
}

/// The whole sheet of half_setup() with its variables. `joined` has one handle on both sides where those of the half touch the
/// plane, the other a handle for each side.
deform::Setup whole_with_variables(const WholeSheet& whole, const deform::Setup& half, const SelectedRegions& regions,
                                   const std::vector<bool>& joined) {
  deform::Setup setup = half;
  setup.symmetry.clear();
  setup.fixed = whole.setup.fixed;
  const auto mirrored = [](const VariableMotion& motion) {
    VariableMotion result = motion;
    if (auto* translation = std::get_if<Translation>(&result)) translation->direction = across(translation->direction);
    if (auto* rotation = std::get_if<Rotation>(&result)) {
      rotation->axis = -1.0 * across(rotation->axis);
      rotation->centre = across(rotation->centre);
    }
    if (auto* scaling = std::get_if<Scaling>(&result)) {
      scaling->axis = across(scaling->axis);
      scaling->centre = across(scaling->centre);
    }
    return result;
  };
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    const std::string name = half.handles[h].name;
    setup.handles[h].region = {Region::Ids{joined[h] ? whole.with_images(regions.handles[h]) : regions.handles[h]}};
    if (joined[h]) continue;
    setup.handles.push_back({name + "2", {Region::Ids{whole.copies[h]}}});
    for (std::size_t k = 0; k < setup.variables.size(); ++k) {
      DesignVariable& variable = setup.variables[k];
      if (variable.handle == name) variable.also.push_back({name + "2", mirrored(half.variables[k].kind)});
      for (const DrivenHandle& driven : half.variables[k].also) {
        if (driven.handle == name) variable.also.push_back({name + "2", mirrored(driven.kind)});
      }
    }
  }
  return setup;
}

/// The automatic clamp sees a handle and its image as the whole model does, whether that has one handle for both or two that the
/// same variables drive.
TEST(MirroredSystem, AutomaticClampsAreThoseOfTheWholeModel) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  FfdOptions lattice;
  lattice.control = FfdControl::mesh;
  CageOptions cage = cage_around();
  cage.clamp = 0;
  for (const MethodOptions& method : {MethodOptions{lattice}, MethodOptions{cage}}) {
    const deform::Setup setup = half_setup(method);
    const WholeSheet whole(*half, setup, bent);
    const SelectedRegions regions = validate(setup, *half);
    const double diagonal = bounding_box(whole.mesh->points).diagonal();
    const Points got = prepare(half, setup)->evaluate(bent);
    for (const std::vector<bool>& joined : {std::vector<bool>{true, false}, {false, false}}) {
      const Points expected = prepare(whole.mesh, whole_with_variables(whole, setup, regions, joined))->evaluate(bent);
      double off = 0;
      for (std::size_t i = 0; i < got.size(); ++i) {
        off = std::max(off, distance(got[i], lerp(expected[i], across(expected[whole.image[i]]), 0.5)));
      }
      EXPECT_LT(off, 1e-9 * diagonal) << method.index() << " " << joined[0];
    }
  }
}

TEST(MirroredSystem, JacobianProductsAndPopulations) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  for (const auto& [name, method] : methods()) {
    SCOPED_TRACE(name);
    const auto system = prepare(half, half_setup(method));
    test::check_jacobians(*system, 1e-11, 1e-6);
    std::vector<Design> designs(3, bent);
    for (std::size_t i = 0; i < designs.size(); ++i) designs[i].variables[i] += 0.1;
    const std::vector<Points> together = system->evaluate(designs);
    for (std::size_t i = 0; i < designs.size(); ++i) EXPECT_EQ(system->evaluate(designs[i]), together[i]);
    const Points rates = system->jacobian_vector(bent.variables, designs[0].variables, {});
    for (std::size_t i = 0; i < rates.size(); ++i) {
      if (half->points[i][1] == 0) {
        EXPECT_EQ(rates[i][1], 0);
      }
    }
    const Points rest = system->evaluate(Design{{0, 0, 0, 0}, {}});
    EXPECT_LT(test::distance(rest, half->points), 1e-15);
  }
}

TEST(MirroredSystem, TakesDisplacementsPerPoint) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  const deform::Setup setup = half_setup(ShellOptions{});
  const SelectedRegions regions = validate(setup, *half);
  const std::vector<Affine> motions = handle_motions(setup, bent.variables);
  Design per_point;
  for (std::size_t h = 0; h < 2; ++h) {
    std::vector<Vec3> displacements;
    for (const PointId id : regions.handles[h])
      displacements.push_back(transformed(motions[h], half->points[id]) - half->points[id]);
    per_point.motions.push_back({h, std::move(displacements)});
  }
  const Design by_maps{{}, {{1, motions[1]}, {0, motions[0]}}};
  const auto system = prepare(half, setup);
  const Points expected = system->evaluate(bent);
  EXPECT_LT(test::distance(system->evaluate(per_point), expected), 1e-10);
  EXPECT_LT(test::distance(system->evaluate(by_maps), expected), 1e-10);
}

// Three oblique planes, with the helper that the tests of rbf have.
/// What the half model's handle and fixed points are missed by.
double missed_by(const Points& got, const Mesh& mesh, const deform::Setup& setup, const Design& design) {
  const SelectedRegions regions = validate(setup, mesh);
  const std::vector<Affine> motions = handle_motions(setup, design.variables);
  double missed = 0;
  for (std::size_t h = 0; h < motions.size(); ++h) {
    for (const PointId id : regions.handles[h])
      missed = std::max(missed, distance(got[id], transformed(motions[h], mesh.points[id])));
  }
  for (const PointId id : regions.fixed) missed = std::max(missed, distance(got[id], mesh.points[id]));
  return missed;
}

/// A handle and its image touch in the plane: the fields of each are missed far more than those of both together.
TEST(MirroredSystem, MisfitsOfSoftHandlesAreThoseOfTheDesign) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  for (const auto& [name, method] : methods()) {
    if (name == "shell") continue;  // has no misfits at points of its own
    SCOPED_TRACE(name);
    deform::Setup setup = half_setup(method);
    std::visit(
        [](auto& options) {
          if constexpr (requires { options.handles; }) options.handles = HandleMode::soft;
        },
        setup.method);
    const auto system = prepare(half, setup);
    const double got = system->bind({&bent, 1}, EvaluationPath::basis, {})->report(0).interpolation_residual;
    const double missed = missed_by(system->evaluate({&bent, 1}, EvaluationPath::basis)[0], *half, setup, bent);
    // The halves of the whole model are not quite alike: the mean of both is delivered.
    EXPECT_GE(got, missed * (1 - 1e-6));
    EXPECT_LE(got, 1.15 * missed);
  }
}

/// With more handle points than the interpolation of misfits has centres, which are all that is met.
TEST(MirroredSystem, ErrorsOfHardHandlesAreThoseOfTheDesign) {
  const auto half = shared(test::bumpy_sheet(121, 61));
  FfdOptions options;
  options.misfit = MisfitRule::centres;
  const auto system = prepare(half, half_setup(options));
  std::vector<Design> designs(4, Design{{0, 0, 0, 0}, {}});
  for (std::size_t k = 0; k < 4; ++k) designs[k].variables[k] = 0.2;
  const auto basis = system->bind(designs, EvaluationPath::basis, {}), direct = system->bind(designs, EvaluationPath::direct, {});
  for (std::size_t i = 0; i < designs.size(); ++i) {
    EXPECT_GT(direct->report(i).error, 1e-9);
    EXPECT_LE(basis->report(i).error, 1.01 * direct->report(i).error);
    EXPECT_GE(basis->report(i).error, 0.57 * direct->report(i).error);  // sqrt(1 / 3): of one point, not of components
  }
}

TEST(MirroredSystem, SeveralPlanesInAnyDirection) {
  for (const std::size_t planes : {1u, 2u, 3u}) {
    const test::HalfModel model(planes, test::oblique());
    const test::WholeModel whole(model);
    deform::Setup half = model.setup, all = whole.setup;
    FfdOptions ffd;
    ffd.lattice.frame = LatticeFrame{model.frame.point({-1.3, -1.3, -1.3}),
                                     {{2.6 * model.frame.axes[0], 2.6 * model.frame.axes[1], 2.6 * model.frame.axes[2]}}};
    ffd.lattice.points = {9, 9, 9};
    half.method = all.method = ffd;
    const Points got = prepare(model.half, half)->evaluate(model.design());
    const Points expected = prepare(whole.whole, all)->evaluate(whole.design);
    for (std::size_t i = 0; i < got.size(); ++i)
      EXPECT_LT(distance(got[i], expected[i]), 1e-8) << planes << " planes, point " << i;
    EXPECT_LT(model.out_of_planes(got), 1e-14 * norm(model.frame.origin) + 1e-15);
  }
}

TEST(MirroredSystem, VolumesKeepTheirCells) {
  Mesh mesh;
  for (int k = 0; k < 3; ++k) {
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 3; ++i) mesh.points.push_back({double(i), double(j), double(k)});
    }
  }
  auto elements = std::make_shared<Elements>();
  for (PointId k = 0; k < 2; ++k) {
    for (PointId j = 0; j < 2; ++j) {
      for (PointId i = 0; i < 2; ++i) {
        const PointId a = i + 3 * j + 9 * k;
        const std::vector<PointId> nodes{a, a + 1, a + 4, a + 3, a + 9, a + 10, a + 13, a + 12};
        elements->add(ElementType::hexahedron, nodes);
      }
    }
  }
  mesh.elements = elements;
  // A face in the plane, and one beside it.
  mesh.face_sizes = {4, 4};
  mesh.face_points = {0, 9, 12, 3, 0, 1, 10, 9};
  const std::vector<SymmetryPlane> planes{{SymmetryPlane::Plane{{0, 0, 0}, {1, 0, 0}}},
                                          {SymmetryPlane::Plane{{0, 2, 0}, {0, 1, 0}}}};
  const MirroredMesh mirrored(mesh, Symmetry(planes, mesh));
  const Mesh& whole = *mirrored.mesh();
  EXPECT_EQ(mirrored.images(), 4u);
  EXPECT_EQ(whole.point_count(), 5u * 5u * 3u);
  EXPECT_EQ(whole.cell_count(), 4u * 8u);
  EXPECT_EQ(whole.face_count(), 4u) << "without that in the plane";
  EXPECT_NO_THROW(whole.validate());
  EXPECT_EQ(mirrored.image(0, 1), 0u) << "on the plane";
  EXPECT_EQ(whole.points[mirrored.image(1, 1)], (Vec3{-1, 0, 0}));
  EXPECT_EQ(whole.points[mirrored.image(1, 3)], (Vec3{-1, 4, 0}));
  EXPECT_EQ(whole.points[mirrored.image(0, 3)], (Vec3{0, 4, 0}));
  EXPECT_TRUE(mirrored.is_own(0, 2));
  EXPECT_FALSE(mirrored.is_own(0, 3));
}

TEST(MirroredSystem, EstimatesBoundWhatIsTaken) {
  const auto half = shared(test::bumpy_sheet(41, 21));
  for (const auto& [name, method] : methods()) {
    SCOPED_TRACE(name);
    const deform::Setup setup = half_setup(method);
    const Estimate expected = estimate(*half, setup);
    const SystemInfo info = prepare(half, setup)->info();
    EXPECT_GE(expected.resident_bytes, info.bytes);
    EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
    EXPECT_EQ(expected.constraint_points, info.constraint_points);
    EXPECT_EQ(info.points, half->point_count());
    EXPECT_EQ(info.points, info.handle_points + info.fixed_points + info.deformable_points);
    EXPECT_THAT(info.notes, testing::Contains(testing::HasSubstr("with its mirror images: 1681 points instead of 861")));
  }
}

TEST(MirroredSystem, RefusesWhatLeavesThePlane) {
  const auto half = shared(test::bumpy_sheet(21, 11));
  deform::Setup setup = half_setup(ShellOptions{});
  setup.variables.push_back({"away", "end", DesignVariable::Translate{{0, 1, 0}}});
  const auto system = prepare(half, setup);
  const std::vector<double> at{0, 0, 0, 0, 0.1}, still(5, 0.0), away{0, 0, 0, 0, 1};
  const std::vector<Design> designs{{still, {}}, {at, {}}};
  test::expect_error(ErrorCode::invalid_argument, {"designs[1]", "point 17", "\"end\"", "symmetry[0]", "0.1", "`difference`"},
                     [&] { system->evaluate(designs); });
  test::expect_error(ErrorCode::invalid_argument, {"direction", "point 17", "symmetry[0]"},
                     [&] { system->jacobian_vector(still, away, {}); });
  test::expect_error(ErrorCode::invalid_argument, {"variable \"away\"", "point 17", "symmetry[0]"},
                     [&] { system->vector_jacobian(still, Points(half->point_count()), {}); });
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "motions[0]", "expected 9 vectors"}, [&] {
    system->evaluate({{}, {{1, std::vector<Vec3>(3)}}});
  });
  test::expect_error(ErrorCode::failed_precondition, {"cannot be compiled", "mirror images"}, [&] { CompiledForm form(system); });

  deform::Setup lattice = half_setup(FfdOptions{});
  std::get<FfdOptions>(lattice.method).lattice.frame = LatticeFrame{{-0.5, -0.5, -1}, {{{3, 0, 0}, {0, 2, 0}, {0, 0, 2}}}};
  test::expect_error(ErrorCode::invalid_argument, {"outside", "with its images", "from 231 on"}, [&] { prepare(half, lattice); });
}

}  // namespace
}  // namespace deform::mirrored_system_test
