// SPDX-License-Identifier: GPL-3.0-or-later
// Messages to core types: paths of fields in refusals, canonical forms, ids.
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "core/base/error.h"
#include "proto/convert/setup.h"
#include "tests/server/refusal.h"
#include "tests/server/test_mesh.h"

namespace deform::convert::setup_test {
namespace {

using server::refusal;
using server::sheet_mesh;
using server::sheet_setup;

const std::string geometry(64, 'a');
constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double infinite = std::numeric_limits<double>::infinity();

/// As a client sees it: whether the message cannot be read, or core refuses what it means.
std::string setup_refusal(const std::function<void(v1::Setup&)>& spoil) {
  v1::Setup setup = sheet_setup(geometry);
  spoil(setup);
  return refusal([&] { validate(setup_from_proto(setup, 10), sheet_mesh(8, 4)); });
}

v1::Region& region(v1::Setup& setup) {
  auto* handle = setup.add_handles();
  handle->set_name("second");
  return *handle->mutable_region();
}

TEST(ConvertSetup, everything_arrives) {
  v1::Setup message = sheet_setup(geometry);
  message.mutable_method()->mutable_rbf()->set_kernel(v1::GAUSSIAN);
  message.mutable_method()->mutable_rbf()->set_shape(0.25);
  message.mutable_method()->mutable_rbf()->set_polynomial_degree(0);
  message.mutable_method()->mutable_rbf()->set_solver(v1::LU);
  message.mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_OFF);
  message.mutable_method()->mutable_rbf()->set_basis(v1::BASIS_NEVER);
  message.set_seed(77);
  const deform::Setup setup = setup_from_proto(message, 10);
  const auto& rbf = std::get<RbfOptions>(setup.method);
  EXPECT_EQ(rbf.kernel, Kernel::gaussian);
  EXPECT_EQ(rbf.shape, 0.25);
  EXPECT_EQ(rbf.polynomial_degree, 0);
  EXPECT_EQ(rbf.solver, Solver::ldlt) << "LU of earlier setups";
  EXPECT_EQ(rbf.reduction, CentreReduction::off);
  EXPECT_EQ(rbf.basis, BasisMode::never);
  EXPECT_EQ(setup.seed, 77u);
  ASSERT_EQ(setup.handles.size(), 1u);
  EXPECT_EQ(setup.handles[0].name, "right");
  EXPECT_EQ(std::get<Region::GroupName>(setup.handles[0].region.kind).name, "right");
  ASSERT_EQ(setup.variables.size(), 2u);
  EXPECT_EQ(setup.variables[0].lower, -0.5);
  EXPECT_EQ(std::get<DesignVariable::Translate>(setup.variables[0].kind).direction, (Vec3{0, 0, 1}));
  EXPECT_EQ(std::get<DesignVariable::Rotate>(setup.variables[1].kind).centre, (Vec3{1, 0, 0}));
  EXPECT_EQ(setup.variables[1].upper, infinite);
}

/// The setup of a sheet with a second method, whose handle is in its middle.
v1::Setup two_methods() {
  v1::Setup message = sheet_setup(geometry);
  auto& stage = *message.add_then();
  stage.mutable_method()->mutable_shell()->mutable_energy()->set_stretching(0.5);
  auto& handle = *stage.add_handles();
  handle.set_name("middle");
  handle.mutable_region()->add_ids(12);
  stage.add_fixed()->add_ids(0);
  return message;
}

TEST(ConvertSetup, MethodsFollowEachOther) {
  const deform::Setup setup = setup_from_proto(two_methods(), 10);
  ASSERT_EQ(setup.then.size(), 1u);
  EXPECT_EQ(std::get<ShellOptions>(setup.then[0].method).stretching, 0.5);
  ASSERT_EQ(setup.then[0].fixed.size(), 1u);
  EXPECT_EQ(std::get<Region::Ids>(setup.then[0].fixed[0].kind).ids, (std::vector<PointId>{0}));
  ASSERT_EQ(setup.handles.size(), 2u);
  EXPECT_EQ(setup.handles[0].stage, 0u);
  EXPECT_EQ(setup.handles[1].name, "middle");
  EXPECT_EQ(setup.handles[1].stage, 1u);
  const auto refused = [](const std::function<void(v1::Setup&)>& spoil) {
    v1::Setup message = two_methods();
    spoil(message);
    return refusal([&] { validate(setup_from_proto(message, 10), sheet_mesh(8, 4)); });
  };
  EXPECT_EQ(refused([](auto&) {}), "");
  EXPECT_EQ(refused([](auto& s) { s.mutable_then(0)->mutable_handles(0)->clear_region(); }),
            "then[0].handles[0].region: is missing");
  EXPECT_EQ(
      refused([](auto& s) { s.mutable_then(0)->mutable_fixed(0)->mutable_sphere()->set_radius(nan); }).find("then[0].fixed[0]"),
      0u);
  EXPECT_EQ(refused([](auto& s) {
              s.mutable_then(0)->mutable_method()->mutable_shell()->mutable_energy()->set_handles(static_cast<v1::HandleMode>(7));
            }),
            "then[0].method.shell.energy.handles: unknown value 7");
  EXPECT_EQ(refused([](auto& s) {
              while (s.then_size() < 8) *s.add_then() = s.then(0);
            }),
            "then: 8 entries are more than the limit of 7");
  EXPECT_EQ(refused([](auto& s) {
              while (s.then(0).handles_size() < 10) *s.mutable_then(0)->add_handles() = s.then(0).handles(0);
            }),
            "handles: 11 entries are more than the limit of 10");
  EXPECT_EQ(refused([](auto& s) {
              while (s.then(0).fixed_size() < 11) *s.mutable_then(0)->add_fixed() = s.then(0).fixed(0);
            }),
            "then[0].fixed: 11 entries are more than the limit of 10");
  // All problems at once, each under its field.
  v1::Setup message = two_methods();
  message.mutable_handles(0)->clear_region();
  message.mutable_then(0)->mutable_handles(0)->clear_region();
  message.mutable_then(0)->mutable_method()->mutable_shell()->mutable_energy()->set_fixing(-1);
  message.mutable_then(0)->mutable_method()->mutable_shell()->mutable_energy()->set_handles(v1::HANDLES_SOFT);
  Problems problems(Problems::Mode::collect);
  const deform::Setup spoiled = setup_from_proto(message, 10, problems);
  validate(spoiled, sheet_mesh(8, 4), problems);
  ASSERT_EQ(problems.list().size(), 3u);
  EXPECT_EQ(problems.list()[0].field, "handles[0].region");
  EXPECT_EQ(problems.list()[1].field, "then[0].handles[0].region");
  EXPECT_EQ(problems.list()[2].field, "then[0].method.shell.energy.fixing");
  EXPECT_EQ(problems.list()[2].message.find("then[0].method.shell.energy.fixing"), 0u) << problems.list()[2].message;
}

/// What cannot be converted keeps its default, and hides nothing else.
TEST(ConvertSetup, OptionsOfAMethodAreConvertedEachForItself) {
  const auto found = [](const v1::Method& method) {
    v1::Setup message = two_methods();
    *message.mutable_method() = method;
    *message.mutable_then(0)->mutable_method() = method;
    Problems problems(Problems::Mode::collect);
    const deform::Setup setup = setup_from_proto(message, 10, problems);
    validate(setup, sheet_mesh(8, 4), problems);
    std::vector<std::string> first, second;
    const std::string prefix = "then[0].";
    for (const Problem& problem : problems.list()) {
      EXPECT_EQ(problem.message.find(problem.field), 0u) << problem.field << ": " << problem.message;
      if (problem.field.starts_with(prefix)) {
        second.push_back(problem.field.substr(prefix.size()));
      } else {
        first.push_back(problem.field);
      }
    }
    EXPECT_EQ(first, second);
    return first;
  };
  using Fields = std::vector<std::string>;
  v1::Method method;
  v1::RbfMethod& rbf = *method.mutable_rbf();
  rbf.set_kernel(static_cast<v1::Kernel>(99));
  rbf.set_automatic_shape(static_cast<v1::AutomaticShape>(99));
  rbf.set_polynomial_degree(4'000'000'000u);
  rbf.set_solver(static_cast<v1::Solver>(99));
  rbf.set_centre_order(static_cast<v1::CentreOrder>(99));
  rbf.set_reduction(static_cast<v1::CentreReduction>(99));
  rbf.set_reduction_rings(4'000'000'000u);
  rbf.set_basis(static_cast<v1::BasisMode>(99));
  rbf.set_basis_tolerance(NAN);
  rbf.set_tolerance(2);
  for (int i = 0; i < 1001; ++i) rbf.add_samples();
  EXPECT_EQ(found(method),
            (Fields{"method.rbf.kernel", "method.rbf.automatic_shape", "method.rbf.polynomial_degree", "method.rbf.solver",
                    "method.rbf.centre_order", "method.rbf.samples", "method.rbf.reduction", "method.rbf.reduction_rings",
                    "method.rbf.basis", "method.rbf.basis_tolerance", "method.rbf.tolerance"}));
  rbf.Clear();
  rbf.set_kernel(static_cast<v1::Kernel>(99));
  rbf.set_polynomial_degree(0);  // which kernels allow it is not known
  EXPECT_EQ(found(method), Fields{"method.rbf.kernel"});
  v1::Energy& energy = *method.mutable_shell()->mutable_energy();
  energy.set_stretching(NAN);
  energy.set_bending(NAN);
  energy.set_handles(static_cast<v1::HandleMode>(99));
  energy.set_fixing(NAN);
  energy.set_basis(static_cast<v1::BasisMode>(99));
  energy.set_basis_tolerance(NAN);
  energy.set_misfit(static_cast<v1::MisfitRule>(99));
  const Fields of_energy{"stretching", "bending", "handles", "fixing", "basis", "basis_tolerance", "misfit"};
  const auto of_path = [&](const std::string& path, const Fields& more) {
    Fields all;
    for (const std::string& field : of_energy) all.push_back(path + ".energy." + field);
    for (const std::string& field : more) all.push_back(path + "." + field);
    return all;
  };
  EXPECT_EQ(found(method), of_path("method.shell", {}));
  const v1::Energy wrong = energy;
  v1::SubspaceMethod& subspace = *method.mutable_subspace();
  *subspace.mutable_energy() = wrong;
  subspace.set_kernel(static_cast<v1::SubspaceKernel>(99));
  subspace.set_centres(2);
  EXPECT_EQ(found(method), of_path("method.subspace", {"kernel", "centres"}));
  subspace.set_kernel(v1::SUBSPACE_MLS);
  subspace.set_linear(static_cast<v1::SubspaceLinear>(99));
  EXPECT_EQ(found(method), of_path("method.subspace", {"linear", "centres"}));
  v1::MlsMethod& mls = *method.mutable_mls();
  *mls.mutable_energy() = wrong;
  mls.set_domain(static_cast<v1::MlsDomain>(99));
  mls.add_weights()->set_stretching(NAN);
  mls.add_weights()->mutable_region()->set_group("nobody");
  mls.mutable_weights(1)->set_bending(1);
  mls.set_cover(2);
  EXPECT_EQ(found(method),
            of_path("method.mls", {"domain", "weights[0].region", "weights[0].stretching", "cover", "weights[1]"}));
  v1::FfdMethod& ffd = *method.mutable_ffd();
  *ffd.mutable_energy() = wrong;
  ffd.mutable_lattice()->add_points(3);
  ffd.set_control(static_cast<v1::FfdControl>(99));
  ffd.set_clamp(NAN);
  EXPECT_EQ(found(method), of_path("method.ffd", {"lattice", "control", "clamp"}));
  v1::CageMethod& cage = *method.mutable_cage();
  cage.set_coordinates(static_cast<v1::CageCoordinates>(99));
  cage.set_control(v1::ENERGY);
  cage.add_vertices(1);
  cage.set_clamp(NAN);
  cage.set_basis(static_cast<v1::BasisMode>(99));
  cage.set_basis_tolerance(NAN);
  EXPECT_EQ(found(method), (Fields{"method.cage.coordinates", "method.cage.control", "method.cage", "method.cage.clamp",
                                   "method.cage.basis", "method.cage.basis_tolerance"}));
}

TEST(ConvertSetup, AGeneratedCageIsOfFilesOnly) {
  EXPECT_EQ(setup_refusal([](auto& s) {
              s.mutable_method()->mutable_cage()->mutable_generate()->set_points(100);
            }).find("method.cage.generate: only setup files have it"),
            0u);
}

TEST(ConvertSetup, EveryKernelHasItsNameOnTheWire) {
  const auto& messages = *v1::Kernel_descriptor();
  ASSERT_EQ(static_cast<std::size_t>(messages.value_count()), all_kernels().size() + 1);
  for (int i = 1; i < messages.value_count(); ++i) {
    v1::Setup message = sheet_setup(geometry);
    message.mutable_method()->mutable_rbf()->set_kernel(static_cast<v1::Kernel>(messages.value(i)->number()));
    const auto rbf = std::get<RbfOptions>(setup_from_proto(message, 10).method);
    EXPECT_EQ(rbf.kernel, all_kernels()[static_cast<std::size_t>(i - 1)].kernel) << messages.value(i)->name();
  }
}

TEST(ConvertSetup, incremental_qr) {
  v1::Setup message = sheet_setup(geometry);
  v1::RbfMethod& method = *message.mutable_method()->mutable_rbf();
  method.set_solver(v1::INCREMENTAL_QR);
  const auto options = [&] { return std::get<RbfOptions>(setup_from_proto(message, 10).method); };
  EXPECT_EQ(options().solver, Solver::incremental_qr);
  EXPECT_EQ(options().tolerance, 1e-4);
  EXPECT_EQ(options().centre_order, CentreOrder::farthest_point);
  EXPECT_EQ(canonical_setup(message, geometry).method().rbf().tolerance(), 1e-4);
  method.set_tolerance(1e-5);
  method.set_centre_order(v1::GREEDY);
  method.add_samples()->add_variables(0.25);
  method.mutable_samples(0)->add_variables(0.5);
  EXPECT_EQ(options().tolerance, 1e-5);
  EXPECT_EQ(options().centre_order, CentreOrder::greedy);
  EXPECT_EQ(options().samples, (std::vector<std::vector<double>>{{0.25, 0.5}}));
  EXPECT_EQ(canonical_setup(message, geometry).method().rbf().samples_size(), 1);
  method.set_solver(v1::CHOLESKY);  // which has neither
  v1::Setup plain = sheet_setup(geometry);
  plain.mutable_method()->mutable_rbf()->set_solver(v1::CHOLESKY);
  EXPECT_EQ(system_id(canonical_setup(message, geometry)), system_id(canonical_setup(plain, geometry)));
}

TEST(ConvertSetup, every_kind_of_region) {
  v1::Setup message;
  const auto add = [&]() -> v1::Region& { return *message.add_fixed(); };
  add().set_group("g");
  v1::Region& box = add();
  for (const double x : {0., 1., 2.}) box.mutable_box()->add_min(x);
  for (const double x : {3., 4., 5.}) box.mutable_box()->add_max(x);
  v1::Region& sphere = add();
  for (const double x : {0., 1., 2.}) sphere.mutable_sphere()->add_centre(x);
  sphere.mutable_sphere()->set_radius(2);
  v1::Region& cylinder = add();
  for (const double x : {0., 1., 2.}) cylinder.mutable_cylinder()->add_start(x);
  for (const double x : {0., 1., 3.}) cylinder.mutable_cylinder()->add_end(x);
  cylinder.mutable_cylinder()->set_radius(1);
  v1::Region& half = add();
  for (const double x : {0., 1., 2.}) half.mutable_half_space()->add_point(x);
  for (const double x : {0., 0., 1.}) half.mutable_half_space()->add_normal(x);
  add().add_ids(7);
  add().set_open_boundary(true);
  add().set_all(true);
  add().set_boundary(true);
  add().add_union_()->set_all(true);
  add().add_intersection()->set_all(true);
  add().add_difference()->set_all(true);
  add().mutable_complement()->set_all(true);
  v1::Region& grow = add();
  grow.mutable_grow()->mutable_region()->set_group("g");
  grow.mutable_grow()->set_rings(2);
  v1::Region& around = add();
  for (const double x : {0., 1., 2.}) around.mutable_patch()->add_seed(x);
  v1::Region& at = add();
  at.mutable_patch()->set_point(0);
  at.mutable_patch()->set_angle(45);
  const deform::Setup setup = setup_from_proto(message, 100);
  ASSERT_EQ(setup.fixed.size(), 16u);
  EXPECT_EQ(std::get<Vec3>(std::get<Region::Patch>(setup.fixed[14].kind).seed), (Vec3{0, 1, 2}));
  EXPECT_EQ(std::get<Region::Patch>(setup.fixed[14].kind).angle, 30);
  EXPECT_EQ(std::get<PointId>(std::get<Region::Patch>(setup.fixed[15].kind).seed), 0u);
  EXPECT_EQ(std::get<Region::Patch>(setup.fixed[15].kind).angle, 45);
  EXPECT_EQ(std::get<Region::InBox>(setup.fixed[1].kind).max, (Vec3{3, 4, 5}));
  EXPECT_EQ(std::get<Region::InSphere>(setup.fixed[2].kind).radius, 2);
  EXPECT_EQ(std::get<Region::InCylinder>(setup.fixed[3].kind).end, (Vec3{0, 1, 3}));
  EXPECT_EQ(std::get<Region::InHalfSpace>(setup.fixed[4].kind).normal, (Vec3{0, 0, 1}));
  EXPECT_EQ(std::get<Region::Ids>(setup.fixed[5].kind).ids, std::vector<PointId>{7});
  EXPECT_TRUE(std::holds_alternative<Region::OpenBoundary>(setup.fixed[6].kind));
  EXPECT_TRUE(std::holds_alternative<Region::Boundary>(setup.fixed[8].kind));
  EXPECT_EQ(std::get<Region::Difference>(setup.fixed[11].kind).of.size(), 1u);
  EXPECT_EQ(std::get<Region::Grow>(setup.fixed[13].kind).rings, 2);
}

TEST(ConvertSetup, sector) {
  v1::Setup message = sheet_setup(geometry);
  v1::Sector& sector = *message.add_symmetry()->mutable_sector();
  for (const double x : {0.0, 0.0, 2.0}) sector.add_axis(x);
  sector.set_count(36);
  for (const std::uint32_t id : {2u, 1u, 2u}) sector.add_periodic()->add_ids(id);
  sector.mutable_periodic()->RemoveLast();
  const deform::Setup setup = setup_from_proto(message, 8);
  const auto& given = std::get<SectorOptions>(setup.symmetry.at(0).kind);
  EXPECT_EQ(given.origin, (Vec3{}));
  EXPECT_EQ(given.axis, (Vec3{0, 0, 2}));
  EXPECT_EQ(given.count, 36u);
  EXPECT_EQ(given.periodic.size(), 2u);
  const v1::Setup canonical = canonical_setup(message, "id");
  EXPECT_EQ(canonical.symmetry(0).sector().origin_size(), 3);
  for (const double x : {0.0, 0.0, 0.0}) sector.add_origin(x);
  EXPECT_EQ(system_id(canonical_setup(message, "id")), system_id(canonical));
  sector.set_origin(1, 0.5);
  EXPECT_EQ(std::get<SectorOptions>(setup_from_proto(message, 8).symmetry[0].kind).origin, (Vec3{0, 0.5, 0}));
  EXPECT_NE(system_id(canonical_setup(message, "id")), system_id(canonical));
  const auto refused = [&](const std::function<void(v1::SymmetryPlane&)>& spoil) {
    return setup_refusal([&](v1::Setup& s) {
      *s.add_symmetry()->mutable_sector() = sector;
      spoil(*s.mutable_symmetry(0));
    });
  };
  EXPECT_EQ(refused([](auto& s) { s.add_point(0); }),
            "symmetry[0]: expected point and normal, a region or a sector, got several");
  EXPECT_EQ(refused([](auto& s) { s.mutable_sector()->clear_axis(); }), "symmetry[0].sector.axis: expected 3 numbers, got 0");
  EXPECT_EQ(refused([](auto& s) { s.mutable_sector()->add_origin(0); }), "symmetry[0].sector.origin: expected 3 numbers, got 4");
  EXPECT_EQ(refused([](auto& s) { s.mutable_sector()->add_periodic()->set_all(true); }),
            "symmetry[0].sector.periodic: 3 entries are more than the limit of 2");
  EXPECT_EQ(
      refused([](auto& s) { s.mutable_sector()->mutable_periodic(1)->clear_ids(); }),
      "symmetry[0].sector.periodic[1]: no kind of region is given (group, box, sphere, ...); an empty list or false is none");
}

TEST(ConvertSetup, symmetry_planes) {
  v1::Setup message = sheet_setup(geometry);
  const std::string without = system_id(canonical_setup(message, geometry));
  v1::SymmetryPlane& plane = *message.add_symmetry();
  for (const double x : {1., 2., 3.}) plane.add_point(x);
  for (const double x : {0., 0., -2.}) plane.add_normal(x);
  v1::Region& patch = *message.add_symmetry()->mutable_region();
  for (const std::uint32_t id : {5u, 3u, 4u, 3u}) patch.add_ids(id);
  const deform::Setup setup = setup_from_proto(message, 10);
  ASSERT_EQ(setup.symmetry.size(), 2u);
  EXPECT_EQ(std::get<SymmetryPlane::Plane>(setup.symmetry[0].kind).point, (Vec3{1, 2, 3}));
  EXPECT_EQ(std::get<SymmetryPlane::Plane>(setup.symmetry[0].kind).normal, (Vec3{0, 0, -2}));
  EXPECT_TRUE(std::holds_alternative<Region>(setup.symmetry[1].kind));

  const v1::Setup canonical = canonical_setup(message, geometry);
  EXPECT_EQ(canonical.symmetry(0).SerializeAsString(), plane.SerializeAsString());
  EXPECT_EQ(canonical.symmetry(1).region().ids_size(), 3);
  EXPECT_EQ(canonical.symmetry(1).region().ids(0), 3u);
  const std::string id = system_id(canonical);
  EXPECT_NE(id, without);
  message.mutable_symmetry(0)->set_point(2, 4);
  EXPECT_NE(system_id(canonical_setup(message, geometry)), id);

  const auto refused = [](const std::function<void(v1::SymmetryPlane&)>& fill) {
    return setup_refusal([&](v1::Setup& s) { fill(*s.add_symmetry()); });
  };
  EXPECT_EQ(refused([](auto&) {}), "symmetry[0]: expected point and normal, a region or a sector, got none");
  EXPECT_EQ(refused([](auto& p) {
              p.add_normal(1);
              p.mutable_region()->set_all(true);
            }),
            "symmetry[0]: expected point and normal, a region or a sector, got several");
  EXPECT_EQ(refused([](auto& p) {
              for (const double x : {1., 0., 0.}) p.add_normal(x);
            }),
            "symmetry[0].point: expected 3 numbers, got 0");
  EXPECT_EQ(refused([](auto& p) { p.mutable_region(); }),
            "symmetry[0].region: no kind of region is given (group, box, sphere, ...); an empty list or false is none");
  EXPECT_EQ(setup_refusal([](v1::Setup& s) {
              for (int i = 0; i < 4; ++i) s.add_symmetry();
            }),
            "symmetry: 4 entries are more than the limit of 3");
}

// What a server tells of a system lists the handles, and a message has to stay below 1 MiB.
TEST(ConvertSetup, NamesOfAllHandlesHaveALimit) {
  v1::Setup message = sheet_setup(geometry);
  const v1::Handle handle = message.handles(0);
  const auto converted = [&](std::size_t handles) {
    message.clear_handles();
    for (std::size_t i = 0; i < handles; ++i) {
      *message.add_handles() = handle;
      message.mutable_handles(static_cast<int>(i))->set_name(std::string(4092, 'x') + std::to_string(1000 + i));
    }
    return refusal([&] { setup_from_proto(message, 10'000); });
  };
  EXPECT_EQ(converted(160), "");
  EXPECT_EQ(converted(161),
            "handles[160].name: those of the handles up to this one take 659456 bytes, all together may take 655360");
}

TEST(ConvertSetup, refusals_name_the_field) {
  struct Row {
    const char* expected;
    std::function<void(v1::Setup&)> spoil;
  };
  const Row table[] = {
      {"handles[1].region.box.min: expected 3 numbers, got 2",
       [](auto& s) {
         auto& r = region(s);
         r.mutable_box()->add_min(0);
         r.mutable_box()->add_min(0);
       }},
      {"handles[1].region.sphere.centre: expected 3 numbers, got 0", [](auto& s) { region(s).mutable_sphere()->set_radius(1); }},
      {"handles[1].region.sphere.centre[1]: must be a finite number",
       [](auto& s) {
         auto& r = region(s);
         for (const double x : {0., nan, 0.}) r.mutable_sphere()->add_centre(x);
       }},
      {"handles[1].region.sphere.radius: must be a finite number",
       [](auto& s) {
         auto& r = region(s);
         for (const double x : {0., 0., 0.}) r.mutable_sphere()->add_centre(x);
         r.mutable_sphere()->set_radius(infinite);
       }},
      {"handles[1].region: no kind of region", [](auto& s) { region(s); }},
      {"handles[1].region: expected exactly one kind of region, got group and all",
       [](auto& s) {
         auto& r = region(s);
         r.set_group("x");
         r.set_all(true);
       }},
      {"handles[1].region.union[1].complement: no kind of region",
       [](auto& s) {
         auto& r = region(s);
         r.add_union_()->set_all(true);
         r.add_union_()->mutable_complement();
       }},
      {"handles[1].region.grow.rings: 0 is out of range",
       [](auto& s) { region(s).mutable_grow()->mutable_region()->set_all(true); }},
      {"handles[1].region.grow.rings: 1001 is out of range",
       [](auto& s) {
         auto& r = region(s);
         r.mutable_grow()->mutable_region()->set_all(true);
         r.mutable_grow()->set_rings(1001);
       }},
      {"handles[1].region.patch: expected exactly one of seed, point, got neither", [](auto& s) { region(s).mutable_patch(); }},
      {"handles[1].region.patch: expected exactly one of seed, point, got both",
       [](auto& s) {
         auto& r = region(s);
         r.mutable_patch()->add_seed(1);
         r.mutable_patch()->set_point(1);
       }},
      {"handles[1].region.patch.seed: expected 3 numbers, got 1", [](auto& s) { region(s).mutable_patch()->add_seed(1); }},
      {"handles[1].region.patch.angle: must be a finite number",
       [](auto& s) {
         auto& r = region(s);
         r.mutable_patch()->set_point(1);
         r.mutable_patch()->set_angle(nan);
       }},
      {"variables[1].rotate.unit: ",
       [](auto& s) { s.mutable_variables(1)->mutable_rotate()->set_unit(static_cast<v1::AngleUnit>(9)); }},
      {"variables[0].also[0].handle: must not be empty", [](auto& s) { s.mutable_variables(0)->add_also(); }},
      {"variables[0].also[1]: expected exactly one of translate, rotate, scale, got 2",
       [](auto& s) {
         s.mutable_variables(0)->add_also()->set_handle("x");
         auto& driven = *s.mutable_variables(0)->add_also();
         driven.set_handle("y");
         driven.mutable_scale();
         driven.mutable_rotate();
       }},
      {"variables[0].also[0].translate: expected 3 numbers, got 1",
       [](auto& s) {
         s.mutable_variables(0)->add_also()->set_handle("x");
         s.mutable_variables(0)->mutable_also(0)->add_translate(1);
       }},
      {"variables[0].also: 10 entries are more than the limit of 9",
       [](auto& s) {
         for (int i = 0; i < 10; ++i) s.mutable_variables(0)->add_also()->set_handle("x");
       }},
      {"handles[1].region.grow.region: is missing", [](auto& s) { region(s).mutable_grow()->set_rings(1); }},
      {"nested deeper than 64",
       [](auto& s) {
         v1::Region* r = &region(s);
         for (int i = 0; i < 70; ++i) r = r->mutable_complement();
         r->set_all(true);
       }},
      {"handles[0].name: must not be empty", [](auto& s) { s.mutable_handles(0)->clear_name(); }},
      {"handles[0].name: longer than", [](auto& s) { s.mutable_handles(0)->set_name(std::string(5000, 'x')); }},
      {"handles[0].region: is missing", [](auto& s) { s.mutable_handles(0)->clear_region(); }},
      {"fixed[0].half_space.normal: expected 3 numbers, got 1",
       [](auto& s) {
         auto& r = *s.mutable_fixed(0);
         r.clear_group();
         for (const double x : {0., 0., 0.}) r.mutable_half_space()->add_point(x);
         r.mutable_half_space()->add_normal(1);
       }},
      {"variables[0]: expected exactly one of translate, rotate, scale, got 2",
       [](auto& s) { s.mutable_variables(0)->mutable_scale(); }},
      {"variables[0]: expected exactly one of translate, rotate, scale, got 0",
       [](auto& s) { s.mutable_variables(0)->clear_translate(); }},
      {"variables[0].translate: expected 3 numbers, got 4", [](auto& s) { s.mutable_variables(0)->add_translate(1); }},
      {"variables[1].rotate.axis: expected 3 numbers, got 0",
       [](auto& s) { s.mutable_variables(1)->mutable_rotate()->clear_axis(); }},
      {"variables[1].rotate.centre: expected 3 numbers, got 4",
       [](auto& s) { s.mutable_variables(1)->mutable_rotate()->add_centre(1); }},
      {"variables[0].lower: must be a finite number", [](auto& s) { s.mutable_variables(0)->set_lower(-infinite); }},
      {"variables[0].name: must not be empty", [](auto& s) { s.mutable_variables(0)->clear_name(); }},
      {"variables[0].handle: must not be empty", [](auto& s) { s.mutable_variables(0)->clear_handle(); }},
      {"method.rbf.kernel: unknown value 99",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_kernel(static_cast<v1::Kernel>(99)); }},
      {"method.rbf.solver: unknown value -1",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_solver(static_cast<v1::Solver>(-1)); }},
      {"method.rbf.reduction: unknown value 5",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_reduction(static_cast<v1::CentreReduction>(5)); }},
      {"method.rbf.basis: unknown value 5",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_basis(static_cast<v1::BasisMode>(5)); }},
      {"method.rbf.shape: nan is out of range", [](auto& s) { s.mutable_method()->mutable_rbf()->set_shape(nan); }},
      {"method.rbf.polynomial_degree: 3 is out of range",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_polynomial_degree(3); }},
      {"method.rbf.polynomial_degree: 4294967295 is out of range",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_polynomial_degree(0xffffffffu); }},
      {"method.rbf.tolerance: nan is out of range", [](auto& s) { s.mutable_method()->mutable_rbf()->set_tolerance(nan); }},
      {"method.rbf.automatic_shape: unknown value 3",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_automatic_shape(static_cast<v1::AutomaticShape>(3)); }},
      {"method.rbf.reduction_rings: 101 is out of range 1..100",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_reduction_rings(101); }},
      {"method.rbf.reduction_tolerance: 0.2 is out of range",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_reduction_tolerance(0.2); }},
      {"method.rbf.basis_tolerance: 0.01 is out of range 1e-12..0.001",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_basis_tolerance(0.01); }},
      {"method.rbf.basis_tolerance: must be a finite number",
       [](auto& s) { s.mutable_method()->mutable_rbf()->set_basis_tolerance(nan); }},
      {"method.shell.energy.basis_tolerance: must be a finite number",
       [](auto& s) { s.mutable_method()->mutable_shell()->mutable_energy()->set_basis_tolerance(nan); }},
      {"handles: 12 entries are more than the limit of 10",
       [](auto& s) {
         for (int i = 0; i < 11; ++i) region(s).set_all(true);
       }},
      {"variables: 122 entries are more than the limit of 120",
       [](auto& s) {
         for (int i = 0; i < 120; ++i) *s.add_variables() = s.variables(0);
       }},
  };
  for (const auto& row : table) {
    const std::string message = setup_refusal(row.spoil);
    EXPECT_NE(message.find(row.expected), std::string::npos) << "expected \"" << row.expected << "\", got \"" << message << "\"";
  }
}

TEST(ConvertSetup, messages_that_mean_the_same_have_the_same_id) {
  const v1::Setup plain = sheet_setup(geometry);
  const std::string id = system_id(canonical_setup(plain, geometry));
  const auto same = [&](const std::function<void(v1::Setup&)>& change) {
    v1::Setup other = plain;
    change(other);
    return system_id(canonical_setup(other, geometry)) == id;
  };
  EXPECT_TRUE(same([](auto& s) { s.clear_method(); }));
  EXPECT_TRUE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_shape(0); }));
  EXPECT_TRUE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_shape(0.9); })) << "r^3 has no shape";
  EXPECT_TRUE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_polynomial_degree(1); }));
  EXPECT_TRUE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_TOLERANCE); }));
  EXPECT_TRUE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_reduction_tolerance(1e-4); }));
  EXPECT_FALSE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_reduction_tolerance(1e-3); }));
  EXPECT_FALSE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_reduction_rings(3); })) << "rings";
  EXPECT_TRUE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_basis_tolerance(-0.0); }));
  EXPECT_FALSE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_basis_tolerance(1e-8); }));
  EXPECT_TRUE(same([](auto& s) { s.set_geometry(geometry.substr(0, 8)); }));
  EXPECT_FALSE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_kernel(v1::BIHARMONIC); }));
  EXPECT_FALSE(same([](auto& s) { s.mutable_method()->mutable_rbf()->set_polynomial_degree(2); }));
  EXPECT_FALSE(same([](auto& s) { s.mutable_variables(0)->clear_lower(); }));
  EXPECT_TRUE(same([](auto& s) { s.mutable_variables(1)->mutable_rotate()->set_unit(v1::RADIANS); }));
  EXPECT_FALSE(same([](auto& s) { s.mutable_variables(1)->mutable_rotate()->set_unit(v1::DEGREES); }));
  EXPECT_FALSE(same([](auto& s) { s.mutable_variables(0)->add_also()->set_handle("other"); }));
  EXPECT_FALSE(same([](auto& s) { s.mutable_handles(0)->set_name("other"); }));
  EXPECT_FALSE(same([](auto& s) { s.set_seed(1); }));
}

// What a store or a client holds from before the densest centres counted: the median, with the id of then.
TEST(ConvertSetup, stored_automatic_shapes_stay_those_of_the_median_and_keep_their_id) {
  for (const v1::Kernel kernel : {v1::GAUSSIAN, v1::MULTIQUADRIC, v1::INVERSE_MULTIQUADRIC}) {
    v1::Setup given = sheet_setup(geometry);
    given.mutable_method()->mutable_rbf()->set_kernel(kernel);
    const auto rule = [](const v1::Setup& setup) { return std::get<RbfOptions>(setup_from_proto(setup, 10).method).shape_rule; };
    const v1::Setup now = canonical_setup(given, geometry);
    EXPECT_EQ(now.method().rbf().automatic_shape(), v1::SHAPE_OF_DENSEST);
    EXPECT_EQ(rule(given), ShapeRule::densest);
    EXPECT_EQ(rule(now), ShapeRule::densest);
    EXPECT_EQ(system_id(canonical_setup(now, geometry)), system_id(now));
    for (const bool rings : {false, true}) {
      v1::Setup before = now;
      auto& rbf = *before.mutable_method()->mutable_rbf();
      rbf.clear_automatic_shape();
      if (rings) {
        rbf.set_reduction(v1::REDUCTION_OFF);
        rbf.set_reduction_rings(3);
        rbf.set_reduction_tolerance(0);
      }
      EXPECT_EQ(rule(before), ShapeRule::median);
      const v1::Setup stored = canonical_setup(before, geometry);
      EXPECT_EQ(stored.method().SerializeAsString(), before.method().SerializeAsString());
      EXPECT_EQ(rule(stored), ShapeRule::median);
      EXPECT_NE(system_id(stored), system_id(now));
      v1::Setup named = given;
      named.mutable_method()->mutable_rbf()->set_automatic_shape(v1::SHAPE_OF_MEDIAN);
      if (rings) named.mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_OFF);
      EXPECT_EQ(rule(named), ShapeRule::median);
      EXPECT_EQ(system_id(canonical_setup(named, geometry)), system_id(stored));
      rbf.set_shape(0.1);
      rbf.set_automatic_shape(v1::SHAPE_OF_DENSEST);
      EXPECT_EQ(canonical_setup(before, geometry).method().rbf().automatic_shape(), v1::AUTOMATIC_SHAPE_DEFAULT) << "not used";
    }
  }
}

// What a store or a client holds from before there were tolerances: rings without a name, said as a number.
TEST(ConvertSetup, stored_rings_stay_rings_and_keep_their_id) {
  v1::Setup stored = sheet_setup(geometry);
  auto& rbf = *stored.mutable_method()->mutable_rbf();
  rbf.set_kernel(v1::TRIHARMONIC);
  rbf.set_polynomial_degree(1);
  rbf.set_tolerance(1e-6);
  rbf.set_reduction_rings(3);
  const v1::Setup canonical = canonical_setup(stored, geometry);
  EXPECT_EQ(canonical.method().SerializeAsString(), stored.method().SerializeAsString());
  const auto reduction = [](const v1::Setup& setup) {
    return std::get<RbfOptions>(setup_from_proto(setup, 10).method).reduction;
  };
  EXPECT_EQ(reduction(stored), CentreReduction::rings);
  v1::Setup named = sheet_setup(geometry);
  named.mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_RINGS);
  EXPECT_EQ(reduction(named), CentreReduction::rings);
  EXPECT_EQ(system_id(canonical_setup(named, geometry)), system_id(canonical));
  EXPECT_EQ(reduction(sheet_setup(geometry)), CentreReduction::tolerance);
  EXPECT_EQ(reduction(canonical_setup(sheet_setup(geometry), geometry)), CentreReduction::tolerance);
  rbf.set_reduction(v1::REDUCTION_OFF);
  EXPECT_EQ(canonical_setup(stored, geometry).method().SerializeAsString(), stored.method().SerializeAsString());
  EXPECT_EQ(reduction(stored), CentreReduction::off);
  // Incremental QR chooses its centres itself: all are candidates by default.
  v1::Setup incremental = sheet_setup(geometry);
  incremental.mutable_method()->mutable_rbf()->set_solver(v1::INCREMENTAL_QR);
  EXPECT_EQ(reduction(canonical_setup(incremental, geometry)), CentreReduction::off);
}

// What a store or a client holds from before the domain of moving least squares and the linear functions of a subspace.
TEST(ConvertSetup, stored_spaces_keep_their_meaning_and_their_id) {
  const auto store = [](v1::Energy& energy) {
    energy.set_bending(1);
    energy.set_handles(v1::HANDLES_HARD);
  };
  v1::Setup stored = sheet_setup(geometry), named = stored, plain = stored;
  auto& mls = *stored.mutable_method()->mutable_mls();
  store(*mls.mutable_energy());
  mls.set_cubature(4);
  mls.set_cover(12);
  named.mutable_method()->mutable_mls()->set_domain(v1::DOMAIN_SURFACE);
  named.mutable_method()->mutable_mls()->mutable_energy()->set_misfit(v1::MISFIT_AT_CENTRES);  // as all stored then
  plain.mutable_method()->mutable_mls();
  const auto domain = [](const v1::Setup& setup) { return std::get<MlsOptions>(setup_from_proto(setup, 10).method).domain; };
  EXPECT_EQ(canonical_setup(stored, geometry).method().SerializeAsString(), stored.method().SerializeAsString());
  EXPECT_EQ(canonical_setup(named, geometry).method().SerializeAsString(), stored.method().SerializeAsString());
  for (const v1::Setup& surface : {stored, named}) EXPECT_EQ(domain(surface), MlsDomain::surface);
  v1::Setup enclosed = plain, connected = plain;  // stored before supports went around slots, and before there were more samples
  enclosed.mutable_method()->mutable_mls()->set_domain(v1::DOMAIN_ENCLOSED);
  connected.mutable_method()->mutable_mls()->set_domain(v1::DOMAIN_CONNECTED);
  for (const auto& [setup, expected] :
       {std::pair{plain, MlsDomain::body}, {enclosed, MlsDomain::enclosed}, {connected, MlsDomain::connected}}) {
    for (const v1::Setup& form : {setup, canonical_setup(setup, geometry)}) {
      EXPECT_EQ(domain(form), expected);
      EXPECT_EQ(std::get<MlsOptions>(setup_from_proto(form, 10).method).cover, 20);
    }
  }
  const auto canonical_domain = [](const v1::Setup& setup) { return canonical_setup(setup, geometry).method().mls().domain(); };
  EXPECT_EQ(canonical_domain(enclosed), v1::DOMAIN_ENCLOSED);
  EXPECT_EQ(canonical_domain(connected), v1::DOMAIN_CONNECTED);
  EXPECT_EQ(canonical_domain(plain), v1::DOMAIN_BODY);
  // With both numbers of samples the results, and so the ids, are those from before.
  v1::MlsMethod& numbers = *plain.mutable_method()->mutable_mls();
  numbers.set_surface_samples(300);
  EXPECT_EQ(canonical_domain(plain), v1::DOMAIN_BODY);
  numbers.set_volume_samples(200);
  EXPECT_EQ(canonical_domain(plain), v1::DOMAIN_CONNECTED);

  for (v1::Setup* setup : {&stored, &named, &plain}) {
    *setup = sheet_setup(geometry);
    setup->mutable_method()->mutable_subspace()->set_kernel(v1::SUBSPACE_GAUSSIAN);
  }
  auto& subspace = *stored.mutable_method()->mutable_subspace();
  store(*subspace.mutable_energy());
  subspace.set_centres(1000);
  subspace.set_cover(50);
  named.mutable_method()->mutable_subspace()->set_linear(v1::LINEAR_LEFT_OUT);
  named.mutable_method()->mutable_subspace()->mutable_energy()->set_misfit(v1::MISFIT_AT_CENTRES);
  const auto linear = [](const v1::Setup& setup) { return std::get<SubspaceOptions>(setup_from_proto(setup, 10).method).linear; };
  EXPECT_EQ(canonical_setup(stored, geometry).method().SerializeAsString(), stored.method().SerializeAsString());
  EXPECT_EQ(canonical_setup(named, geometry).method().SerializeAsString(), stored.method().SerializeAsString());
  for (const v1::Setup& left_out : {stored, named}) EXPECT_EQ(linear(left_out), SubspaceLinear::left_out);
  for (const v1::Setup& added : {plain, canonical_setup(plain, geometry)}) EXPECT_EQ(linear(added), SubspaceLinear::added);
}

// What a store or a client holds from before misfits were interpolated at all joins.
TEST(ConvertSetup, stored_energies_keep_the_misfits_that_they_had_and_their_id) {
  const auto energy_of = [](v1::Setup& setup) {
    v1::Method& method = *setup.mutable_method();
    return method.has_ffd()   ? method.mutable_ffd()->mutable_energy()
           : method.has_mls() ? method.mutable_mls()->mutable_energy()
                              : method.mutable_subspace()->mutable_energy();
  };
  const auto rule = [](const v1::Setup& setup) {
    return std::visit(
        [](const auto& options) {
          if constexpr (std::is_base_of_v<EnergyOptions, std::decay_t<decltype(options)>>) return options.misfit;
          return MisfitRule::centres;
        },
        setup_from_proto(setup, 10).method);
  };
  for (const int kind : {0, 1, 2}) {
    v1::Setup plain = sheet_setup(geometry);
    if (kind == 0) plain.mutable_method()->mutable_ffd();
    if (kind == 1) plain.mutable_method()->mutable_mls();
    if (kind == 2) plain.mutable_method()->mutable_subspace();
    v1::Setup named = plain, soft = plain;
    const v1::Setup canonical = canonical_setup(plain, geometry);
    v1::Setup stored = canonical;
    EXPECT_EQ(energy_of(stored)->misfit(), v1::MISFIT_AT_JOINS);
    energy_of(stored)->clear_misfit();
    energy_of(named)->set_misfit(v1::MISFIT_AT_CENTRES);
    for (const v1::Setup& joins : {plain, canonical}) EXPECT_EQ(rule(joins), MisfitRule::joins) << kind;
    for (const v1::Setup& centres : {stored, named, canonical_setup(named, geometry)}) {
      EXPECT_EQ(rule(centres), MisfitRule::centres) << kind;
      EXPECT_EQ(canonical_setup(centres, geometry).SerializeAsString(), stored.SerializeAsString()) << kind;
    }
    energy_of(soft)->set_handles(v1::HANDLES_SOFT);
    energy_of(soft)->set_misfit(v1::MISFIT_AT_JOINS);
    v1::Setup softened = canonical_setup(soft, geometry);
    EXPECT_EQ(energy_of(softened)->misfit(), v1::MISFIT_DEFAULT) << kind;
  }
  v1::Setup shell = sheet_setup(geometry);
  shell.mutable_method()->mutable_shell()->mutable_energy()->set_misfit(v1::MISFIT_AT_JOINS);
  EXPECT_EQ(canonical_setup(shell, geometry).method().shell().energy().misfit(), v1::MISFIT_DEFAULT);
  v1::Setup mesh = sheet_setup(geometry);
  mesh.mutable_method()->mutable_ffd()->set_control(v1::MESH);
  EXPECT_EQ(canonical_setup(mesh, geometry).method().ffd().energy().misfit(), v1::MISFIT_DEFAULT);
}

TEST(ConvertSetup, id_lists_are_sets) {
  v1::Setup a = sheet_setup(geometry), b = a;
  for (const std::uint32_t id : {3u, 1u, 2u, 3u}) a.mutable_fixed(0)->add_ids(id);
  for (const std::uint32_t id : {1u, 2u, 3u}) b.mutable_fixed(0)->add_ids(id);
  a.mutable_fixed(0)->clear_group();
  b.mutable_fixed(0)->clear_group();
  EXPECT_EQ(system_id(canonical_setup(a, geometry)), system_id(canonical_setup(b, geometry)));
}

TEST(ConvertSetup, a_canonical_setup_is_its_own_canonical_form_and_means_the_same) {
  v1::Setup message = sheet_setup(geometry);
  message.mutable_method()->mutable_rbf()->set_kernel(v1::QUINTIC);
  message.mutable_variables(1)->mutable_rotate()->clear_centre();
  message.mutable_variables(1)->add_also()->set_handle("first");
  auto& driven = *message.mutable_variables(1)->add_also();
  driven.set_handle("second");
  driven.mutable_scale();
  message.add_fixed()->mutable_grow()->mutable_region()->mutable_patch()->set_point(7);
  message.mutable_fixed(message.fixed_size() - 1)->mutable_grow()->set_rings(1);
  const v1::Setup canonical = canonical_setup(message, geometry);
  EXPECT_EQ(canonical.SerializeAsString(), canonical_setup(canonical, geometry).SerializeAsString());
  EXPECT_EQ(canonical.method().rbf().polynomial_degree(), 2u);
  EXPECT_EQ(canonical.variables(1).rotate().centre_size(), 3);
  const deform::Setup setup = setup_from_proto(canonical, 10);
  EXPECT_EQ(std::get<DesignVariable::Rotate>(setup.variables[1].kind).centre, (Vec3{0, 0, 0}));
  EXPECT_EQ(canonical.fixed(canonical.fixed_size() - 1).grow().region().patch().angle(), 30);
  EXPECT_EQ(canonical.variables(1).also(1).scale().centre_size(), 3);
  ASSERT_EQ(setup.variables[1].also.size(), 2u);
  EXPECT_EQ(setup.variables[1].also[0].handle, "first");
  EXPECT_EQ(std::get<DesignVariable::Rotate>(setup.variables[1].also[0].kind).axis,
            std::get<DesignVariable::Rotate>(setup.variables[1].kind).axis)
      << "as the first handle";
  EXPECT_TRUE(std::holds_alternative<DesignVariable::Scale>(setup.variables[1].also[1].kind));
}

}  // namespace
}  // namespace deform::convert::setup_test
