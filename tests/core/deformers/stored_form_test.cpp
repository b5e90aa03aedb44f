// SPDX-License-Identifier: GPL-3.0-or-later
// Systems that were stored and restored are, for their handle bases, the systems that they were: bit for bit.
#include "core/deformers/stored_form.h"

#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "core/base/version.h"
#include "core/deformers/compiled_form.h"
#include "core/deformers/mirrored_system.h"
#include "core/deformers/space_map.h"
#include "tests/core/deformers/basis_cases.h"
#include "tests/core/deformers/mirrored.h"
#include "tests/core/deformers/wheel.h"
#include "tests/support/expect_error.h"

namespace deform::stored_form_test {
namespace {

using test::expect_error;

class Bytes : public compiled::ByteSource {
 public:
  explicit Bytes(std::vector<std::byte> bytes) : bytes_(std::move(bytes)) {}
  std::uint64_t size() const override { return bytes_.size(); }
  void read(std::span<std::byte> out) override {
    std::memcpy(out.data(), bytes_.data() + at_, out.size());
    at_ += out.size();
  }

 private:
  const std::vector<std::byte> bytes_;
  std::size_t at_ = 0;
};

std::vector<std::byte> stored_bytes(const deform::Setup& setup, const System& system) {
  const HandleSystem* source = stored_source(setup, system);
  if (source == nullptr) throw std::runtime_error("not stored");
  std::vector<std::byte> bytes;
  StoredBasis::write(*source, [&](const void* data, std::size_t size) {
    const auto* from = static_cast<const std::byte*>(data);
    bytes.insert(bytes.end(), from, from + size);
  });
  EXPECT_EQ(bytes.size(), StoredBasis::bytes(*source));
  return bytes;
}

std::shared_ptr<const System> restored(const std::shared_ptr<const Mesh>& mesh, const deform::Setup& setup,
                                       std::vector<std::byte> bytes) {
  Bytes source(std::move(bytes));
  return restore(mesh, setup, StoredBasis::read(source));
}

void expect_equal(const DesignReport& a, const DesignReport& b) {
  EXPECT_EQ(a.path, b.path);
  EXPECT_EQ(a.interpolation_residual, b.interpolation_residual);
  EXPECT_EQ(a.prescribed_displacement, b.prescribed_displacement);
  EXPECT_EQ(a.error, b.error);
  EXPECT_EQ(a.control_displacement, b.control_displacement);
  EXPECT_EQ(a.misfit, b.misfit);
  EXPECT_EQ(a.torn_edges, b.torn_edges);
  EXPECT_EQ(a.converged, b.converged);
  EXPECT_EQ(a.warnings, b.warnings);
}

/// All but what the memory of the solution takes.
void expect_equal(const SystemInfo& a, const SystemInfo& b) {
  EXPECT_EQ(a.points, b.points);
  EXPECT_EQ(a.fixed_points, b.fixed_points);
  EXPECT_EQ(a.handle_points, b.handle_points);
  EXPECT_EQ(a.deformable_points, b.deformable_points);
  EXPECT_EQ(a.constraint_points, b.constraint_points);
  EXPECT_EQ(a.centres, b.centres);
  EXPECT_EQ(a.held_points, b.held_points);
  EXPECT_EQ(a.samples, b.samples);
  EXPECT_EQ(a.functions, b.functions);
  EXPECT_EQ(a.cubature_points, b.cubature_points);
  EXPECT_EQ(a.merged_duplicates, b.merged_duplicates);
  EXPECT_EQ(a.polynomial_terms, b.polynomial_terms);
  EXPECT_EQ(a.affine_hull_dimension, b.affine_hull_dimension);
  EXPECT_EQ(a.basis_fields, b.basis_fields);
  EXPECT_EQ(a.basis_bytes, b.basis_bytes);
  EXPECT_EQ(a.design_bytes, b.design_bytes);
  EXPECT_EQ(a.diagonal, b.diagonal);
  EXPECT_EQ(a.condition, b.condition);
  EXPECT_EQ(a.tolerance, b.tolerance);
  EXPECT_EQ(a.solver, b.solver);
  EXPECT_EQ(a.reduced, b.reduced);
  EXPECT_EQ(a.reduction_tolerance, b.reduction_tolerance);
  EXPECT_EQ(a.reduction_misfit, b.reduction_misfit);
  EXPECT_EQ(a.notes, b.notes);
  EXPECT_EQ(a.stage_seconds, b.stage_seconds);
  EXPECT_EQ(b.factor_bytes, 0u);
  EXPECT_LE(b.bytes, a.bytes);
}

/// Points, reports, fields and derivatives.
void expect_same(const System& system, const System& other, const std::vector<Design>& designs) {
  expect_equal(system.info(), other.info());
  for (const EvaluationPath path : {EvaluationPath::automatic, EvaluationPath::basis}) {
    EXPECT_EQ(system.evaluate(designs, path), other.evaluate(designs, path));
    const auto a = system.bind(designs, path, {}), b = other.bind(designs, path, {});
    for (std::size_t i = 0; i < designs.size(); ++i) {
      expect_equal(a->report(i), b->report(i));
      const auto motion = a->field_motion(i), restored = b->field_motion(i);
      ASSERT_EQ(motion.has_value(), restored.has_value());
      if (!motion) continue;
      EXPECT_EQ(motion->coefficients, restored->coefficients);
      EXPECT_EQ(motion->uncertainties, restored->uncertainties);
      EXPECT_EQ(motion->rounding, restored->rounding);
    }
  }
  const auto fields = system.displacement_fields(), others = other.displacement_fields();
  ASSERT_EQ(fields == nullptr, others == nullptr);
  if (fields) {
    ASSERT_EQ(fields->count(), others->count());
    std::vector<double> a(fields->count() * system.info().points), b(a.size());
    fields->values(0, fields->count(), a, {});
    others->values(0, fields->count(), b, {});
    EXPECT_EQ(a, b);
  }
  const std::vector<double>& at = designs[0].variables;  // none: there are no derivatives
  if (at.empty()) return;
  const Points product = system.jacobian_vector(at, designs[1].variables, {});
  EXPECT_EQ(product, other.jacobian_vector(at, designs[1].variables, {}));
  EXPECT_EQ(system.vector_jacobian(at, product, {}), other.vector_jacobian(at, product, {}));
}

std::vector<Design> some_designs(std::size_t variables) {
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> uniform(-0.3, 0.3);
  std::vector<Design> designs(5);
  for (Design& design : designs) {
    for (std::size_t k = 0; k < variables; ++k) design.variables.push_back(uniform(random));
  }
  return designs;
}

class StoredForms : public testing::TestWithParam<test::BasisCase> {};

/// Those whose reports need control points are prepared again.
bool is_stored(const std::string& name) { return name != "ffd_mesh" && name != "ffd_controls" && name != "cage"; }

TEST_P(StoredForms, AreTheSystem) {
  const auto mesh = test::shared(test::bumpy_sheet(41, 23));
  const deform::Setup setup = GetParam().setup();
  const auto system = prepare(mesh, setup);
  if (!is_stored(GetParam().name)) {
    EXPECT_FALSE(can_be_stored(setup));
    EXPECT_EQ(stored_source(setup, *system), nullptr);
    return;
  }
  ASSERT_TRUE(can_be_stored(setup));
  const auto other = restored(mesh, setup, stored_bytes(setup, *system));
  std::vector<Design> designs = some_designs(4);
  // One that turns a handle so far that shells warn, and one whose motion is no variable's.
  designs.push_back({{0, 0.9, 0, 0}, {}});
  designs.push_back({{}, {{1, Affine{1.1, 0.2, 0, 0.1, -0.2, 0.9, 0, 0, 0, 0.1, 1, 0.3}}}});
  expect_same(*system, *other, designs);
  EXPECT_EQ(CompiledForm(system).content().bases.size(), CompiledForm(other).content().bases.size());
  EXPECT_EQ(CompiledForm(system).content().allowed_error, CompiledForm(other).content().allowed_error);

  for (const auto& needs : std::vector<std::function<void()>>{
           [&] { other->bind(designs, EvaluationPath::direct, {}); },
           [&] { other->bind_in_space(designs[0], {}); },
       }) {
    expect_error(ErrorCode::failed_precondition, {"only its handle basis was restored"}, needs);
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, StoredForms, testing::ValuesIn(test::basis_cases()),
                         [](const auto& parameter) { return std::string(parameter.param.name); });

TEST(StoredForm, OfHalfModelsIsTheSystem) {
  for (const std::size_t planes : {1u, 3u}) {
    test::HalfModel model(planes, test::oblique());
    model.setup.variables = {{"grow", "corner", DesignVariable::Scale{test::oblique().origin, {}}, -0.5, 0.5}};
    RbfOptions options;
    options.basis = BasisMode::always;
    model.setup.method = options;
    const auto system = prepare(model.half, model.setup);
    const auto other = restored(model.half, model.setup, stored_bytes(model.setup, *system));
    expect_same(*system, *other, some_designs(1));
  }
}

TEST(StoredForm, OfModelsThatAreDeformedWithTheirImagesIsTheSystem) {
  test::HalfModel model(2, test::oblique());
  model.setup.variables = {{"grow", "corner", DesignVariable::Scale{test::oblique().origin, {}}, -0.5, 0.5}};
  model.setup.method = MlsOptions{};
  test::SectorModel wheel({5, 0.4});
  wheel.setup.variables = {{"out", "blade", DesignVariable::Scale{{}, {}}, -0.5, 0.5}};
  wheel.setup.method = MlsOptions{};
  for (const auto& [mesh, setup] : {std::pair(model.half, model.setup), std::pair(wheel.sector, wheel.setup)}) {
    ASSERT_TRUE(is_mirrored(setup));
    const auto system = prepare(mesh, setup);
    const auto other = restored(mesh, setup, stored_bytes(setup, *system));
    expect_same(*system, *other, some_designs(1));
  }
}

TEST(StoredForm, OfSectorsIsTheSystem) {
  const test::SectorModel model({5, 0.0}, test::oblique());
  deform::Setup setup = model.setup;
  std::get<RbfOptions>(setup.method).basis = BasisMode::always;
  setup.variables.clear();
  const auto system = prepare(model.sector, setup);
  const auto other = restored(model.sector, setup, stored_bytes(setup, *system));
  std::vector<Design> designs(2);
  designs[1].motions = {{0, Affine{1, 0.05, 0, 0.01, -0.05, 1, 0, 0.02, 0, 0, 1, 0.03}}};
  expect_same(*system, *other, designs);
}

TEST(StoredForm, ThereIsNoneOfSystemsWithoutBasisOrWithConstraints) {
  const auto mesh = test::shared(test::flat_sheet(21, 11));
  deform::Setup constrained = test::setup_with_variables();
  constrained.method = ShellOptions{};
  constrained.constraints = {{"flat", {test::box({0.5, -1, -1}, {0.8, 2, 1})}, Planar{}}};
  EXPECT_FALSE(can_be_stored(constrained));
  deform::Setup without_basis = test::setup_with_variables();
  RbfOptions never;
  never.basis = BasisMode::never;
  without_basis.method = never;
  EXPECT_EQ(stored_source(without_basis, *prepare(mesh, without_basis)), nullptr);
}

TEST(StoredForm, RefusesAnotherMeshAnotherSetupAndBytesThatAreNone) {
  const auto mesh = test::shared(test::bumpy_sheet(21, 11));
  const deform::Setup setup = test::setup_with_variables();
  const std::vector<std::byte> bytes = stored_bytes(setup, *prepare(mesh, setup));
  expect_error(ErrorCode::data_loss, {"unit coordinates"}, [&] {
    Mesh larger = *mesh;
    for (Vec3& x : larger.points) x = 2 * x;
    restored(test::shared(std::move(larger)), setup, bytes);
  });
  expect_error(ErrorCode::data_loss, {"points"}, [&] {
    Mesh more = *mesh;
    more.points.push_back(more.points.back());
    restored(test::shared(std::move(more)), setup, bytes);
  });
  deform::Setup fewer = setup;
  fewer.handles.pop_back();
  fewer.variables.resize(1);
  expect_error(ErrorCode::data_loss, {"handles"}, [&] { restored(mesh, fewer, bytes); });
  // Wherever it ends, and whatever is said of lengths.
  for (std::size_t size = 0; size < bytes.size(); size += 1 + size / 7) {
    expect_error(ErrorCode::data_loss, {"stored basis"}, [&] {
      Bytes source({bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size)});
      StoredBasis::read(source);
    });
  }
  auto longer = bytes;
  longer.push_back({});
  expect_error(ErrorCode::data_loss, {"left over"}, [&] { restored(mesh, setup, longer); });
  auto other_layout = bytes;
  other_layout[13] = std::byte{'9'};
  expect_error(ErrorCode::data_loss, {"layout"}, [&] { restored(mesh, setup, other_layout); });
  auto other_version = bytes;
  other_version[16 + sizeof(std::uint64_t)] = std::byte{'9'};
  const std::string own = "which has version " + std::string(version());
  expect_error(ErrorCode::data_loss, {"version 9", own.c_str()}, [&] { restored(mesh, setup, other_version); });
  std::mt19937_64 random(3);
  for (int i = 0; i < 300; ++i) {
    auto hostile = bytes;
    const std::size_t at = random() % std::min<std::size_t>(hostile.size(), 2000);
    for (std::size_t k = at; k < std::min(hostile.size(), at + 8); ++k) hostile[k] = static_cast<std::byte>(random());
    try {
      restored(mesh, setup, hostile);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::data_loss) << error.what();
    }
  }
}

}  // namespace
}  // namespace deform::stored_form_test
