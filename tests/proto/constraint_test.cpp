// SPDX-License-Identifier: GPL-3.0-or-later
// Messages of energy methods and constraints to core types, and their canonical forms.
#include <gmock/gmock-matchers.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <functional>

#include "core/base/error.h"
#include "proto/convert/report.h"
#include "proto/convert/setup.h"
#include "tests/server/refusal.h"
#include "tests/server/test_mesh.h"
#include "tests/support/expect_error.h"

namespace deform::convert::constraint_test {
namespace {

using server::refusal;
using server::sheet_mesh;
using server::sheet_setup;

const std::string geometry(64, 'a');

/// As a setup file says it.
v1::Setup with(const std::string& json) {
  v1::Setup setup = sheet_setup(geometry);
  v1::Setup more;
  const auto status = google::protobuf::util::JsonStringToMessage(json, &more);
  EXPECT_TRUE(status.ok()) << status.message().as_string();
  setup.MergeFrom(more);
  return setup;
}

/// As a client sees it: whether the message cannot be read, or core refuses what it means.
std::string setup_refusal(const std::string& json) {
  return refusal([&] { validate(setup_from_proto(with(json), 10), sheet_mesh(8, 4)); });
}

std::string id_of(const std::string& json) { return system_id(canonical_setup(with(json), geometry)); }

TEST(ConvertMethod, Shell) {
  const auto plain = std::get<ShellOptions>(setup_from_proto(with(R"({"method": {"shell": {}}})"), 10).method);
  EXPECT_EQ(plain.stretching, 0);
  EXPECT_EQ(plain.bending, 1);
  EXPECT_EQ(plain.handles, HandleMode::hard);
  const auto options = std::get<ShellOptions>(
      setup_from_proto(with(R"({"method": {"shell": {"energy": {"stretching": 2, "bending": 0, "handles": "HANDLES_SOFT",
                                "fixing": 50, "basis": "BASIS_NEVER"}}}})"),
                       10)
          .method);
  EXPECT_EQ(options.stretching, 2);
  EXPECT_EQ(options.bending, 0);
  EXPECT_EQ(options.handles, HandleMode::soft);
  EXPECT_EQ(options.fixing, 50);
  EXPECT_EQ(options.basis, BasisMode::never);
}

TEST(ConvertMethod, Subspace) {
  const auto options = std::get<SubspaceOptions>(
      setup_from_proto(with(R"({"method": {"subspace": {"kernel": "SUBSPACE_WENDLAND_C2", "centres": 300, "cover": 50}}})"), 10)
          .method);
  EXPECT_EQ(options.kernel, Kernel::wendland_c2);
  EXPECT_EQ(options.centres, 300u);
  EXPECT_EQ(options.cover, 50);
  const auto defaults = [](const std::string& kernel) {
    const v1::Setup setup = canonical_setup(with(R"({"method": {"subspace": {"kernel": ")" + kernel + R"("}}})"), geometry);
    return std::get<SubspaceOptions>(setup_from_proto(setup, 10).method);
  };
  EXPECT_EQ(defaults("SUBSPACE_DEFAULT").kernel, std::nullopt);
  EXPECT_EQ(defaults("SUBSPACE_DEFAULT").centres, 1000u);
  EXPECT_EQ(defaults("SUBSPACE_DEFAULT").cover, 8);
  EXPECT_EQ(defaults("SUBSPACE_GAUSSIAN").cover, 50);
}

TEST(ConvertMethod, Mls) {
  const auto options = std::get<MlsOptions>(
      setup_from_proto(with(R"({"method": {"mls": {"surfaceSamples": 500, "volumeSamples": 200, "cubature": 5, "cover": 20,
                                "energy": {"stretching": 0.5},
                                "weights": [{"region": {"group": "left"}, "stretching": 3, "bending": 4}]}}})"),
                       10)
          .method);
  EXPECT_EQ(options.surface_samples, 500u);
  EXPECT_EQ(options.volume_samples, 200u);
  EXPECT_EQ(options.cubature, 5);
  EXPECT_EQ(options.cover, 20);
  EXPECT_EQ(options.stretching, 0.5);
  EXPECT_EQ(options.bending, 1);
  ASSERT_EQ(options.weights.size(), 1u);
  EXPECT_EQ(std::get<Region::GroupName>(options.weights[0].region.kind).name, "left");
  EXPECT_EQ(options.weights[0].bending, 4);
}

TEST(ConvertMethod, Ffd) {
  const auto options_of = [](const std::string& ffd) {
    return std::get<FfdOptions>(setup_from_proto(with(R"({"method": {"ffd": )" + ffd + "}}"), 10).method);
  };
  const FfdOptions plain = options_of("{}");
  EXPECT_EQ(plain.control, FfdControl::energy);
  EXPECT_EQ(plain.lattice.basis, LatticeBasis::uniform_cubic);
  EXPECT_EQ(plain.lattice.points, (std::array<std::size_t, 3>{0, 0, 0}));
  EXPECT_FALSE(plain.lattice.frame);
  EXPECT_EQ(plain.clamp, 0);
  const FfdOptions in_box = options_of(R"({"control": "MESH", "clamp": 1e-4, "energy": {"basis": "BASIS_NEVER"}, "lattice": {
      "box": {"min": [0, 1, 2], "max": [1, 3, 5]}, "points": [4, 5, 6], "basis": "BERNSTEIN"}})");
  EXPECT_EQ(in_box.control, FfdControl::mesh);
  EXPECT_EQ(in_box.clamp, 1e-4);
  EXPECT_EQ(in_box.basis, BasisMode::never);
  EXPECT_EQ(in_box.lattice.basis, LatticeBasis::bernstein);
  EXPECT_EQ(in_box.lattice.points, (std::array<std::size_t, 3>{4, 5, 6}));
  EXPECT_EQ(in_box.lattice.frame->origin, (Vec3{0, 1, 2}));
  EXPECT_EQ(in_box.lattice.frame->axes, (std::array<Vec3, 3>{{{1, 0, 0}, {0, 2, 0}, {0, 0, 3}}}));
  const FfdOptions turned =
      options_of(R"({"energy": {"stretching": 2, "handles": "HANDLES_SOFT"}, "lattice": {"basis": "CLAMPED_CUBIC",
      "frame": {"origin": [1, 2, 3], "axes": [1, 2, 0, -2, 1, 0, 0, 0, 4]}}})");
  EXPECT_EQ(turned.stretching, 2);
  EXPECT_EQ(turned.handles, HandleMode::soft);
  EXPECT_EQ(turned.lattice.basis, LatticeBasis::clamped_cubic);
  EXPECT_EQ(turned.lattice.frame->origin, (Vec3{1, 2, 3}));
  EXPECT_EQ(turned.lattice.frame->axes, (std::array<Vec3, 3>{{{1, 2, 0}, {-2, 1, 0}, {0, 0, 4}}}));
}

TEST(ConvertMethod, FfdWithControlPoints) {
  const std::vector<Vec3> places(24, Vec3{0.5, -1, 2});
  v1::Setup message = with(R"({"method": {"ffd": {"control": "CONTROLS", "clamp": 0.1, "lattice": {"points": [4, 3, 2]},
      "energy": {"bending": 3, "basis": "BASIS_NEVER"}}}})");
  message.mutable_handles(0)->mutable_region()->Clear();
  message.clear_fixed();
  auto& range = *message.mutable_handles(0)->mutable_region()->mutable_lattice();
  range.add_i(1);
  range.add_i(2);
  message.add_fixed()->mutable_control()->add_ids(7);
  message.mutable_fixed(0)->mutable_control()->add_ids(3);
  message.mutable_fixed(0)->mutable_control()->add_ids(7);
  message.mutable_method()->mutable_ffd()->mutable_lattice()->set_control_points(places.data(), places.size() * sizeof(Vec3));
  const deform::Setup setup = setup_from_proto(message, 10);
  const auto& options = std::get<FfdOptions>(setup.method);
  EXPECT_EQ(options.control, FfdControl::controls);
  EXPECT_EQ(options.lattice.control_points, places);
  const auto& along = std::get<Region::LatticeRange>(setup.handles[0].region.kind).along;
  EXPECT_EQ(along[0]->first, 1u);
  EXPECT_EQ(along[0]->last, 2u);
  EXPECT_FALSE(along[1] || along[2]);
  EXPECT_EQ(std::get<Region::ControlIds>(setup.fixed[0].kind).ids, (std::vector<std::uint32_t>{7, 3, 7}));

  const v1::Setup canonical = canonical_setup(message, "geometry");
  EXPECT_EQ(canonical.method().ffd().clamp(), 0) << "of MESH only";
  EXPECT_EQ(canonical.method().ffd().energy().bending(), 1) << "of ENERGY only";
  EXPECT_EQ(canonical.method().ffd().energy().basis(), v1::BASIS_NEVER);
  EXPECT_EQ(canonical.method().ffd().control(), v1::CONTROLS);
  EXPECT_EQ(canonical.method().ffd().lattice().control_points(), message.method().ffd().lattice().control_points());
  EXPECT_THAT(canonical.fixed(0).control().ids(), testing::ElementsAre(3, 7));
}

constexpr const char* tetrahedron =
    R"("vertices": [0, 0, 0, 4, 0, 0, 0, 4, 0, 0, 0, 4], "triangles": [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])";

std::string cage_json(const std::string& more, const std::string& mesh = tetrahedron) {
  return R"({"method": {"cage": {)" + mesh + more + R"(}}, "handles": [{"name": "a", "region": {"control": {"ids": [2]}}}]})";
}

v1::Setup cage_message(const std::string& json) {
  v1::Setup message;
  EXPECT_TRUE(google::protobuf::util::JsonStringToMessage(json, &message).ok()) << json;
  return message;
}

TEST(ConvertMethod, Cage) {
  const auto options = std::get<CageOptions>(
      setup_from_proto(cage_message(cage_json(R"(, "basis": "BASIS_NEVER", "basisTolerance": 1e-6)")), 10).method);
  EXPECT_EQ(options.vertices, (std::vector<Vec3>{{0, 0, 0}, {4, 0, 0}, {0, 4, 0}, {0, 0, 4}}));
  EXPECT_EQ(options.triangles, (std::vector<std::array<std::uint32_t, 3>>{{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}));
  EXPECT_EQ(options.control, CageControl::controls);
  EXPECT_EQ(options.basis, BasisMode::never);
  EXPECT_EQ(options.basis_tolerance, 1e-6);
  const auto direct =
      std::get<CageOptions>(setup_from_proto(cage_message(cage_json(R"(, "control": "MESH", "clamp": 1e-3)")), 10).method);
  EXPECT_EQ(direct.control, CageControl::mesh);
  EXPECT_EQ(direct.clamp, 1e-3);
  EXPECT_EQ(direct.coordinates, CageCoordinates::mean_value);
  const auto green = std::get<CageOptions>(setup_from_proto(cage_message(cage_json(R"(, "coordinates": "GREEN")")), 10).method);
  EXPECT_EQ(green.coordinates, CageCoordinates::green);

  const auto id = [](const std::string& json) { return system_id(canonical_setup(cage_message(json), "geometry")); };
  EXPECT_EQ(id(cage_json("")), id(cage_json(R"(, "coordinates": "MEAN_VALUE", "control": "CONTROLS", "basisTolerance": -0.0)")));
  EXPECT_NE(id(cage_json("")), id(cage_json(R"(, "coordinates": "GREEN")")));
  EXPECT_NE(id(cage_json("")), id(cage_json(R"(, "basis": "BASIS_NEVER")")));
  EXPECT_EQ(id(cage_json("")), id(cage_json(R"(, "clamp": 0.1)")));
  EXPECT_NE(id(cage_json("")), id(cage_json(R"(, "control": "MESH")")));
  EXPECT_NE(id(cage_json(R"(, "control": "MESH")")), id(cage_json(R"(, "control": "MESH", "clamp": 0.1)")));
  EXPECT_NE(id(cage_json("")),
            id(cage_json(
                "", R"("vertices": [0, 0, 0, 4, 0, 0, 0, 4, 0, 0, 0, 5], "triangles": [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3])")));
}

TEST(ConvertMethod, CagesThatAreRefused) {
  const std::pair<std::string, const char*> rows[] = {
      {cage_json(R"(, "file": "cage.obj")"), "method.cage.file: only setup files"},
      {cage_json(R"(, "control": "ENERGY")"), "method.cage.control: a cage has no ENERGY"},
      {cage_json(R"(, "control": "MESH", "clamp": "NaN")"), "method.cage.clamp"},
      {cage_json(R"(, "control": 9)"), "method.cage.control: unknown value 9"},
      {cage_json(R"(, "coordinates": 9)"), "method.cage.coordinates: unknown value 9"},
      {cage_json(R"(, "basisTolerance": "NaN")"), "method.cage.basis_tolerance"},
      {cage_json("", R"("vertices": [0, 0])"), "method.cage.vertices: 2 numbers are not a multiple of 3"},
      {cage_json("", R"("triangles": [0, 0])"), "method.cage.triangles: 2 numbers are not a multiple of 3"},
  };
  for (const auto& [json, expected] : rows) {
    test::expect_error(ErrorCode::invalid_argument, {expected}, [&] { setup_from_proto(cage_message(json), 10); });
  }
}

TEST(ConvertConstraint, EveryKind) {
  const struct {
    const char* json;
    const char* kind;
  } rows[] = {{R"("planar": {})", "planar"},
              {R"("circular": {"radius": "KEPT"})", "circular"},
              {R"("cylindrical": {})", "cylindrical"},
              {R"("spherical": {})", "spherical"},
              {R"("conical": {"angle": "KEPT"})", "conical"},
              {R"("straight": {})", "straight"},
              {R"("featureLine": {})", "feature_line"},
              {R"("rigid": {})", "rigid"},
              {R"("fixedPlane": {"point": [0, 0, 1], "normal": [0, 0, 2]})", "fixed_plane"},
              {R"("symmetric": {"point": [0, 0, 1], "normal": [0, 0, 2]})", "symmetric"},
              {R"("coplanar": {})", "coplanar"},
              {R"("parallel": {})", "parallel"},
              {R"("orthogonal": {})", "orthogonal"},
              {R"("distance": {"bound": "MAXIMUM", "value": 0.5})", "distance"},
              {R"("extent": {"axis": [0, 0, 1], "value": 2})", "extent"}};
  for (const auto& row : rows) {
    const std::string json =
        std::string(R"({"constraints": [{"name": "c", "weight": 7, "regions": [{"group": "left"}], )") + row.json + "}]}";
    const deform::Setup setup = setup_from_proto(with(json), 10);
    ASSERT_EQ(setup.constraints.size(), 1u) << row.kind;
    const Constraint& constraint = setup.constraints[0];
    EXPECT_EQ(constraint.name, "c");
    EXPECT_EQ(constraint.weight, 7);
    EXPECT_EQ(constraint.regions.size(), 1u);
    EXPECT_EQ(kind_name(constraint.kind), row.kind);
    const v1::Setup canonical = canonical_setup(with(json), geometry);
    EXPECT_EQ(canonical.SerializeAsString(), canonical_setup(canonical, geometry).SerializeAsString()) << row.kind;
  }
}

TEST(ConvertConstraint, ValuesArrive) {
  const auto kind = [](const std::string& json) {
    return setup_from_proto(with(R"({"constraints": [{"name": "c", )" + json + "}]}"), 10).constraints[0].kind;
  };
  EXPECT_EQ(std::get<Circular>(kind(R"("circular": {"radius": "KEPT"})")).radius, Size::kept);
  EXPECT_EQ(std::get<Cylindrical>(kind(R"("cylindrical": {})")).radius, Size::free);
  EXPECT_EQ(std::get<FixedPlane>(kind(R"("fixedPlane": {"point": [1, 2, 3], "normal": [0, 0, 2]})")).normal, (Vec3{0, 0, 2}));
  EXPECT_FALSE(std::get<Symmetric>(kind(R"("symmetric": {})")).plane.has_value());
  EXPECT_EQ(std::get<Symmetric>(kind(R"("symmetric": {"tolerance": 0.05})")).tolerance, 0.05);
  EXPECT_FALSE(std::get<Distance>(kind(R"("distance": {})")).value.has_value());
  EXPECT_EQ(std::get<Distance>(kind(R"("distance": {"bound": "MINIMUM", "value": 0.5})")).bound, Bound::minimum);
  const auto extent = std::get<Extent>(kind(R"("extent": {"axis": [0, 0, 1], "value": 2, "ends": 0.1})"));
  EXPECT_EQ(extent.bound, Bound::minimum);
  EXPECT_EQ(extent.value, 2);
  EXPECT_EQ(extent.ends, 0.1);
  EXPECT_EQ(std::get<Rigid>(kind(R"("rigid": {})")).layers, 0);
  EXPECT_EQ(std::get<Rigid>(kind(R"("rigid": {"layers": 1000})")).layers, 1000);
}

TEST(ConvertConstraint, ExactOnesAndOptionsArrive) {
  const auto setup = [](const std::string& json) { return setup_from_proto(with(json), 10); };
  const auto plain = setup(R"({"constraints": [{"name": "c", "planar": {}}]})");
  EXPECT_FALSE(plain.constraints[0].exact);
  EXPECT_EQ(plain.constraint_options.tolerance, ConstraintOptions().tolerance);
  EXPECT_EQ(plain.constraint_options.iterations, ConstraintOptions().iterations);
  const auto told = setup(R"({"constraints": [{"name": "c", "planar": {}, "exact": true}],
                              "constraintOptions": {"tolerance": 1e-9, "iterations": 1000000}})");
  EXPECT_TRUE(told.constraints[0].exact);
  EXPECT_EQ(told.constraint_options.tolerance, 1e-9);
  EXPECT_EQ(told.constraint_options.iterations, 1000000);
  const v1::Setup canonical = canonical_setup(with(R"({"constraints": [{"name": "c", "planar": {}}]})"), geometry);
  EXPECT_EQ(canonical.constraint_options().tolerance(), 1e-7);
  EXPECT_EQ(canonical.constraint_options().iterations(), 3000u);
  EXPECT_FALSE(canonical_setup(with(R"({"constraintOptions": {"iterations": 5}})"), geometry).has_constraint_options())
      << "without constraints they say nothing, and systems keep their ids";
}

// What a store or a client holds from before steps of exact points were carried to all joins.
TEST(ConvertConstraint, StoredExactConstraintsKeepTheirStepsAndTheirId) {
  const auto rule = [](const v1::Setup& setup) { return setup_from_proto(setup, 10).constraint_options.exact_steps; };
  for (const char* method : {"shell", "mls", "subspace", "ffd"}) {
    const std::string head = std::string(R"({"method": {")") + method + R"(": {}}, )";
    const v1::Setup plain =
        with(head + R"("constraints": [{"name": "s", "planar": {}}, {"name": "c", "planar": {}, "exact": true}]})");
    v1::Setup named = plain, said = plain, soft = plain;
    const v1::Setup canonical = canonical_setup(plain, geometry);
    EXPECT_EQ(canonical.constraint_options().exact_steps(), v1::EXACT_STEPS_AT_JOINS) << method;
    v1::Setup stored = canonical;
    stored.mutable_constraint_options()->clear_exact_steps();
    named.mutable_constraint_options()->set_exact_steps(v1::EXACT_STEPS_AT_CENTRES);
    for (const v1::Setup& centres : {stored, named, canonical_setup(named, geometry)}) {
      EXPECT_EQ(rule(centres), ExactSteps::centres) << method;
      EXPECT_EQ(canonical_setup(centres, geometry).SerializeAsString(), stored.SerializeAsString()) << method;
    }
    // Somebody may say both numbers.
    said.mutable_constraint_options()->set_tolerance(1e-7);
    said.mutable_constraint_options()->set_iterations(3000);
    for (const v1::Setup& joins : {plain, said, canonical}) {
      EXPECT_EQ(rule(joins), ExactSteps::joins) << method;
      EXPECT_EQ(canonical_setup(joins, geometry).SerializeAsString(), canonical.SerializeAsString()) << method;
    }
    soft.mutable_constraints(1)->set_exact(false);
    soft.mutable_constraint_options()->set_exact_steps(v1::EXACT_STEPS_AT_JOINS);
    EXPECT_EQ(canonical_setup(soft, geometry).constraint_options().exact_steps(), v1::EXACT_STEPS_DEFAULT) << method;
  }
}

/// The canonical form, from which systems are prepared, does not name it where nothing is exact: that is not a setup of old,
/// whose constraints are met without what is interpolated afterwards.
TEST(ConvertConstraint, ExactStepsOfSoftConstraintsAreThoseOfToday) {
  for (const char* method : {R"("ffd": {})", R"("mls": {})", R"("subspace": {})"}) {
    for (const char* options :
         {"{}", R"({"exactSteps": "EXACT_STEPS_AT_CENTRES"})", R"({"exactSteps": "EXACT_STEPS_AT_JOINS"})"}) {
      const v1::Setup setup = with(R"({"method": {)" + std::string(method) +
                                   R"(}, "constraints": [{"name": "c", "planar": {}}], "constraintOptions": )" + options + "}");
      const v1::Setup canonical = canonical_setup(setup, geometry);
      EXPECT_EQ(canonical.constraint_options().exact_steps(), v1::EXACT_STEPS_DEFAULT);
      for (const v1::Setup& each : {setup, canonical}) {
        EXPECT_EQ(setup_from_proto(each, 10).constraint_options.exact_steps, ExactSteps::joins) << method << options;
      }
    }
  }
}

TEST(ConvertConstraint, ReportsTellHowTheSolutionWent) {
  DesignReport report;
  report.constraints = {{4, 3, 2, 1, true}};
  report.iterations = 20;
  report.newton_steps = 3;
  report.convergence_error = 1e-9;
  report.energy = 0.5;
  report.converged = false;
  const auto message =
      constraints_report(report, setup_from_proto(with(R"({"constraints": [{"name": "c", "planar": {}}]})"), 10));
  EXPECT_EQ(message.iterations(), 23u);
  EXPECT_EQ(message.newton_steps(), 3u);
  EXPECT_EQ(message.convergence_error(), 1e-9);
  EXPECT_EQ(message.energy(), 0.5);
  EXPECT_FALSE(message.converged());
  ASSERT_EQ(message.residuals_size(), 1);
  EXPECT_EQ(message.residuals(0).name(), "c");
  EXPECT_EQ(message.residuals(0).free_largest(), 4);
  EXPECT_EQ(message.residuals(0).rms(), 1);
  EXPECT_TRUE(message.residuals(0).missed());
}

TEST(ConvertConstraint, ReportsTellWhatHeldPointsMiss) {
  const auto setup = setup_from_proto(with(R"({"constraints": [{"name": "c", "planar": {}}, {"name": "d", "planar": {}}]})"), 10);
  DesignReport report;
  report.at_rounding = true;
  report.constraints.resize(2);
  report.constraints[0].held = {{0, 8}, {ConstraintReport::Held::fixed, 4}};
  report.constraints[0].held_misfit = {0.2, 0.1};
  const v1::ConstraintsReport message = constraints_report(report, setup);
  EXPECT_TRUE(message.at_rounding());
  const v1::ConstraintResidual& of = message.residuals(0);
  ASSERT_EQ(of.held_size(), 2);
  EXPECT_EQ(of.held(0).handle(), "right") << "the first handle of all setups here";
  EXPECT_EQ(of.held(0).points(), 8u);
  EXPECT_EQ(of.held(1).handle(), "");
  EXPECT_EQ(of.held(1).points(), 4u);
  EXPECT_EQ(of.held_largest(), 0.2);
  EXPECT_EQ(of.held_rms(), 0.1);
  EXPECT_EQ(message.residuals(1).held_size(), 0);
  EXPECT_FALSE(message.residuals(1).has_held_largest());
  EXPECT_FALSE(message.residuals(1).has_held_rms());
}

TEST(ConvertConstraint, HeightsOfLayersAreThoseOfTheReport) {
  const auto setup = setup_from_proto(with(R"({"constraints": [{"name": "c", "planar": {}}, {"name": "d", "planar": {}}]})"), 10);
  DesignReport report;
  report.constraints.resize(2);
  report.constraints[1].heights = {0.9, 1.1};
  report.constraints[1].heights_before = {0.8, 1.2};
  const v1::ConstraintsReport message = constraints_report(report, setup);
  EXPECT_FALSE(message.residuals(0).has_least_height());
  EXPECT_FALSE(message.residuals(0).has_free_largest_height());
  EXPECT_EQ(message.residuals(1).least_height(), 0.9);
  EXPECT_EQ(message.residuals(1).largest_height(), 1.1);
  EXPECT_EQ(message.residuals(1).free_least_height(), 0.8);
  EXPECT_EQ(message.residuals(1).free_largest_height(), 1.2);
}

TEST(ConvertConstraint, ExactSetsThatWereGivenUpAreNamedInAWarning) {
  const auto setup = setup_from_proto(
      with(R"({"constraints": [{"name": "rim", "planar": {}}, {"name": "bore", "planar": {}}, {"name": "top", "planar": {}}]})"),
      10);
  DesignReport report;
  report.constraints = {{4, 3, 2, 1, true, true}, {4, 3, 0, 0, false, false}, {4, 3, 2, 1, true, true}};
  EXPECT_TRUE(constraints_report(report, setup).exact_given_up());
  const std::string warning = given_up_warning(report, setup);
  EXPECT_NE(warning.find("\"rim\", \"top\""), std::string::npos) << warning;
  EXPECT_EQ(warning.find("bore"), std::string::npos) << warning;
  for (ConstraintReport& constraint : report.constraints) constraint.given_up = false;
  EXPECT_FALSE(constraints_report(report, setup).exact_given_up()) << "missed is something else";
  EXPECT_EQ(given_up_warning(report, setup), "");
}

TEST(ConvertConstraint, RefusalsNameTheField) {
  const std::pair<const char*, const char*> rows[] = {
      {R"({"method": {"shell": {}}, "constraints": [{"planar": {}}]})", "constraints[0].name: must not be empty"},
      {R"({"constraints": [{"name": "c"}]})", "constraints[0]: no kind of constraint is given"},
      {R"({"constraints": [{"name": "c", "planar": {}, "regions": [{}]}]})", "constraints[0].regions[0]: no kind of region"},
      {R"({"method": {"shell": {}}, "constraints": [{"name": "c", "planar": {}, "weight": "NaN"}]})",
       "constraints[0].weight: nan is out of range"},
      {R"({"constraints": [{"name": "c", "fixedPlane": {"point": [0, 0]}}]})",
       "constraints[0].fixed_plane.point: expected 3 numbers"},
      {R"({"constraints": [{"name": "c", "symmetric": {"point": [0, 0, 0]}}]})", "constraints[0].symmetric: point and normal"},
      {R"({"constraints": [{"name": "c", "circular": {"radius": 9}}]})", "constraints[0].circular.radius: unknown value 9"},
      {R"({"constraints": [{"name": "c", "extent": {"axis": [1, 0, 0], "bound": 9}}]})",
       "constraints[0].extent.bound: unknown value 9"},
      {R"({"method": {"shell": {}}, "constraints": [{"name": "c", "rigid": {"layers": 1001}, "regions": [{"group": "left"}]}]})",
       "constraints[0].rigid.layers: 1001 is out of range 0..1000"},
      {R"({"constraints": [{"name": "c", "rigid": {"layers": 4294967295}}]})", "constraints[0].rigid.layers: 4294967295"},
      {R"({"constraintOptions": {"tolerance": "NaN"}})", "constraint_options.tolerance"},
      {R"({"constraintOptions": {"tolerance": 0.5}})", "constraint_options.tolerance: 0.5 is out of range 1e-12..0.01"},
      {R"({"constraintOptions": {"tolerance": -1e-7}})", "constraint_options.tolerance: -1e-07 is out of range"},
      {R"({"constraintOptions": {"iterations": 1000001}})", "constraint_options.iterations: 1000001 is out of range"},
      {R"({"constraintOptions": {"exactSteps": 9}})", "constraint_options.exact_steps: unknown value 9"},
      {R"({"method": {"shell": {"energy": {"stretching": "NaN"}}}})", "method.shell.energy.stretching"},
      {R"({"method": {"shell": {"energy": {"handles": 9}}}})", "method.shell.energy.handles: unknown value 9"},
      {R"({"method": {"subspace": {"cover": "NaN"}}})", "method.subspace.cover: nan is out of range"},
      {R"({"method": {"mls": {"cover": "Infinity"}}})", "method.mls.cover: inf is out of range"},
      {R"({"method": {"mls": {"cubature": "NaN"}}})", "method.mls.cubature: nan is out of range"},
      {R"({"method": {"subspace": {"kernel": 9}}})", "method.subspace.kernel: unknown value 9"},
      {R"({"method": {"mls": {"weights": [{"bending": 1}]}}})", "method.mls.weights[0].region: is missing"},
      {R"({"method": {"ffd": {"control": 9}}})", "method.ffd.control: unknown value 9"},
      {R"({"method": {"ffd": {"control": "MESH", "clamp": "NaN"}}})", "method.ffd.clamp"},
      {R"({"method": {"ffd": {"control": "MESH", "clamp": 0.9}}})", "method.ffd.clamp: 0.9 is out of range 1e-15..0.5"},
      {R"({"method": {"ffd": {"lattice": {"basis": 9}}}})", "method.ffd.lattice.basis: unknown value 9"},
      {R"({"method": {"ffd": {"lattice": {"controlPoints": "AAAA"}}}})",
       "method.ffd.lattice.control_points: 3 bytes are not a multiple of 24"},
      {R"({"fixed": [{"lattice": {"k": [1]}}]})", ".lattice.k: must have two numbers"},
      {R"({"fixed": [{"control": {}}]})", ".control.ids: must not be empty"},
      {R"({"fixed": [{"control": {"ids": [1]}}]})", ": control: control points"},
      {R"({"fixed": [{"lattice": {}, "ids": [1]}]})", "expected exactly one kind of region"},
      {R"({"method": {"ffd": {"lattice": {"points": [4, 4]}}}})", "method.ffd.lattice.points: must have three numbers"},
      {R"({"method": {"ffd": {"lattice": {"points": [4, 0, 4]}}}})", "method.ffd.lattice.points[1]: must not be 0"},
      {R"({"method": {"ffd": {"lattice": {"points": [4, 4, 3]}}}})", "method.ffd.lattice.points[2]: 3 is out of range 4..1000"},
      {R"({"method": {"ffd": {"lattice": {"box": {"min": [0, 0, 0], "max": [1, 0, 1]}}}}})",
       "method.ffd.lattice.box: min must be"},
      {R"({"method": {"ffd": {"lattice": {"frame": {"origin": [0, 0, 0], "axes": [1, 0, 0]}}}}})",
       "method.ffd.lattice.frame.axes: must have nine numbers"},
      {R"({"method": {"ffd": {"lattice": {"frame": {"origin": [0, 0], "axes": [1, 0, 0, 0, 1, 0, 0, 0, 1]}}}}})",
       "method.ffd.lattice.frame.origin: expected 3 numbers"},
      {R"({"method": {"ffd": {"lattice": {"frame": {"origin": [0, 0, 0], "axes": [1, 0, 0, 0, 1, 0, 0, "NaN", 1]}}}}})",
       "method.ffd.lattice.frame.axes[7]"},
      {R"({"method": {"ffd": {"lattice": {"frame": {"origin": [0, 0, 0], "axes": [1, 0, 0, 2, 0, 0, 0, 0, 1]}}}}})",
       "method.ffd.lattice: the axes"},
  };
  for (const auto& [json, expected] : rows) {
    EXPECT_NE(setup_refusal(json).find(expected), std::string::npos) << json << " gave " << setup_refusal(json);
  }
}

TEST(ConvertMethod, MessagesThatMeanTheSameHaveTheSameId) {
  EXPECT_EQ(id_of(R"({"method": {"shell": {}}})"), id_of(R"({"method": {"shell": {"energy": {"bending": 1, "fixing": 9}}}})"));
  EXPECT_NE(id_of(R"({"method": {"shell": {}}})"), id_of(R"({"method": {"shell": {"energy": {"stretching": 1}}}})"));
  EXPECT_NE(id_of(R"({"method": {"shell": {}}})"), id_of(R"({"method": {"mls": {}}})"));
  EXPECT_EQ(id_of(R"({"method": {"mls": {}}})"), id_of(R"({"method": {"mls": {"cover": 20, "cubature": 4}}})"));
  const std::string ffd = id_of(R"({"method": {"ffd": {}}})");
  EXPECT_EQ(ffd, id_of(R"({"method": {"ffd": {"control": "ENERGY", "clamp": 0.1, "lattice": {"basis": "UNIFORM_CUBIC"}}}})"));
  EXPECT_NE(ffd, id_of(R"({"method": {"ffd": {"lattice": {"points": [5, 5, 5]}}}})"));
  EXPECT_NE(ffd, id_of(R"({"method": {"ffd": {"control": "MESH"}}})"));
  EXPECT_EQ(
      id_of(R"({"method": {"ffd": {"control": "MESH"}}})"),
      id_of(
          R"({"method": {"ffd": {"control": "MESH", "clamp": -0.0, "energy": {"stretching": 4, "handles": "HANDLES_SOFT"}}}})"));
  EXPECT_NE(id_of(R"({"method": {"ffd": {"control": "MESH"}}})"),
            id_of(R"({"method": {"ffd": {"control": "MESH", "energy": {"basis": "BASIS_NEVER"}}}})"));
  EXPECT_EQ(id_of(R"({"method": {"subspace": {}}})"),
            id_of(R"({"method": {"subspace": {"kernel": "SUBSPACE_MLS", "centres": 1000}}})"));
  EXPECT_EQ(id_of(R"({"constraints": [{"name": "c", "circular": {}}]})"),
            id_of(R"({"constraints": [{"name": "c", "circular": {"radius": "FREE"}}]})"));
  EXPECT_NE(id_of(R"({"constraints": [{"name": "c", "circular": {}}]})"),
            id_of(R"({"constraints": [{"name": "c", "circular": {"radius": "KEPT"}}]})"));
  const std::string rigid = R"({"constraints": [{"name": "c", "rigid": {}}]})";
  const auto changed = [&](const std::string& more) { return id_of(R"({"constraints": [{"name": "c", )" + more + "}"); };
  EXPECT_EQ(id_of(rigid), changed(R"("rigid": {"layers": 0}, "exact": false}], "constraintOptions": {})"));
  EXPECT_EQ(id_of(rigid), changed(R"("rigid": {}}], "constraintOptions": {"tolerance": 1e-7, "iterations": 3000})"));
  EXPECT_NE(id_of(rigid), changed(R"("rigid": {}}], "constraintOptions": {"tolerance": 1e-8})"));
  EXPECT_NE(id_of(rigid), changed(R"("rigid": {}}], "constraintOptions": {"iterations": 10})"));
  EXPECT_NE(id_of(rigid), changed(R"("rigid": {"layers": 1}}])"));
  EXPECT_NE(id_of(rigid), changed(R"("rigid": {}, "exact": true}])"));
  EXPECT_EQ(id_of("{}"), id_of(R"({"constraintOptions": {"tolerance": 1e-8, "iterations": 10}})"));
}

}  // namespace
}  // namespace deform::convert::constraint_test
