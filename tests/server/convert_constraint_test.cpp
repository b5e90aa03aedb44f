// Messages of energy methods and constraints to core types, and their canonical forms.
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <functional>

#include "core/base/error.h"
#include "server/convert_setup.h"
#include "tests/server/refusal.h"
#include "tests/server/test_mesh.h"

namespace deform::server {
namespace {

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

std::string setup_refusal(const std::string& json) {
  return refusal([&] { setup_from_proto(with(json), 10); });
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
  EXPECT_EQ(options.kernel, SubspaceKernel::wendland_c2);
  EXPECT_EQ(options.centres, 300u);
  EXPECT_EQ(options.cover, 50);
  const auto defaults = [](const std::string& kernel) {
    const v1::Setup setup = canonical_setup(with(R"({"method": {"subspace": {"kernel": ")" + kernel + R"("}}})"), geometry);
    return std::get<SubspaceOptions>(setup_from_proto(setup, 10).method);
  };
  EXPECT_EQ(defaults("SUBSPACE_DEFAULT").kernel, SubspaceKernel::mls);
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
}

TEST(ConvertConstraint, RefusalsNameTheField) {
  const std::pair<const char*, const char*> rows[] = {
      {R"({"constraints": [{"planar": {}}]})", "constraints[0].name: must not be empty"},
      {R"({"constraints": [{"name": "c"}]})", "constraints[0]: no kind of constraint is given"},
      {R"({"constraints": [{"name": "c", "planar": {}, "regions": [{}]}]})", "constraints[0].regions[0]: no kind of region"},
      {R"({"constraints": [{"name": "c", "planar": {}, "weight": "NaN"}]})", "constraints[0].weight"},
      {R"({"constraints": [{"name": "c", "fixedPlane": {"point": [0, 0]}}]})",
       "constraints[0].fixed_plane.point: expected 3 numbers"},
      {R"({"constraints": [{"name": "c", "symmetric": {"point": [0, 0, 0]}}]})", "constraints[0].symmetric: point and normal"},
      {R"({"constraints": [{"name": "c", "circular": {"radius": 9}}]})", "constraints[0].circular.radius: unknown value 9"},
      {R"({"constraints": [{"name": "c", "extent": {"axis": [1, 0, 0], "bound": 9}}]})",
       "constraints[0].extent.bound: unknown value 9"},
      {R"({"method": {"shell": {"energy": {"stretching": "NaN"}}}})", "method.shell.energy.stretching"},
      {R"({"method": {"shell": {"energy": {"handles": 9}}}})", "method.shell.energy.handles: unknown value 9"},
      {R"({"method": {"subspace": {"kernel": 9}}})", "method.subspace.kernel: unknown value 9"},
      {R"({"method": {"mls": {"weights": [{"bending": 1}]}}})", "method.mls.weights[0].region: is missing"},
  };
  for (const auto& [json, expected] : rows) {
    EXPECT_NE(setup_refusal(json).find(expected), std::string::npos) << json << " gave " << setup_refusal(json);
  }
}

TEST(ConvertMethod, MessagesThatMeanTheSameHaveTheSameId) {
  EXPECT_EQ(id_of(R"({"method": {"shell": {}}})"), id_of(R"({"method": {"shell": {"energy": {"bending": 1, "fixing": 9}}}})"));
  EXPECT_NE(id_of(R"({"method": {"shell": {}}})"), id_of(R"({"method": {"shell": {"energy": {"stretching": 1}}}})"));
  EXPECT_NE(id_of(R"({"method": {"shell": {}}})"), id_of(R"({"method": {"mls": {}}})"));
  EXPECT_EQ(id_of(R"({"method": {"mls": {}}})"), id_of(R"({"method": {"mls": {"cover": 12, "cubature": 4}}})"));
  EXPECT_EQ(id_of(R"({"method": {"subspace": {}}})"),
            id_of(R"({"method": {"subspace": {"kernel": "SUBSPACE_MLS", "centres": 1000}}})"));
  EXPECT_EQ(id_of(R"({"constraints": [{"name": "c", "circular": {}}]})"),
            id_of(R"({"constraints": [{"name": "c", "circular": {"radius": "FREE"}}]})"));
  EXPECT_NE(id_of(R"({"constraints": [{"name": "c", "circular": {}}]})"),
            id_of(R"({"constraints": [{"name": "c", "circular": {"radius": "KEPT"}}]})"));
}

}  // namespace
}  // namespace deform::server
