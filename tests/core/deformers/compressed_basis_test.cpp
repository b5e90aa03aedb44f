// SPDX-License-Identifier: GPL-3.0-or-later
// Systems whose basis is stored to a tolerance against the same systems with a basis in doubles: on surfaces and in a volume, in
// units from 1e-3 to 1e3.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/mesh/ahmed.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/support/expect_error.h"

namespace deform::compressed_basis_test {
namespace {

/// A mesh, what is prepared on it, and the name of the case. Regions are lists of points, so that units can be changed.
struct Model {
  const char* name;
  Mesh mesh;
  deform::Setup setup;
};

Region ids_of(const Region& region, const Mesh& mesh) { return {Region::Ids{select(region, mesh, "region")}}; }

void list_points(Model& model) {
  for (Handle& handle : model.setup.handles) handle.region = ids_of(handle.region, model.mesh);
  for (Region& region : model.setup.fixed) region = ids_of(region, model.mesh);
}

Model body(const decltype(deform::Setup::method)& method) {
  AhmedOptions options;
  options.target_points = 4000;
  Model model{"body", ahmed_body(options), {}};
  model.setup.method = method;
  for (int h = 0; h < 4; ++h) {
    const std::string name = "patch" + std::to_string(h);
    model.setup.handles.push_back({name, {Region::InSphere{{0.25 + 0.2 * h, h % 2 == 0 ? -0.1 : 0.1, 0.338}, 0.05}}});
  }
  model.setup.fixed = {test::box({-9, -9, -9}, {9, 9, 0.055})};
  list_points(model);
  return model;
}

Model volume(const decltype(deform::Setup::method)& method, std::size_t n) {
  Model model{"volume", test::cube(n).mesh, {}};
  model.setup.method = method;
  model.setup.handles = {{"top", test::box({0.2, 0.2, 0.99}, {0.8, 0.8, 1})},
                         {"side", test::box({0.99, 0.2, 0.2}, {1, 0.6, 0.6})}};
  model.setup.fixed = {test::box({-1, -1, -1}, {2, 2, 0.01})};
  list_points(model);
  return model;
}

/// No more samples than points.
MlsOptions few_samples() {
  MlsOptions options;
  options.domain = MlsDomain::connected;
  return options;
}

Model in_units(Model model, double unit) {
  for (Vec3& x : model.mesh.points) x = {unit * x[0], unit * x[1], unit * x[2]};
  return model;
}

template <typename Options>
Options with_tolerance(Options options, double tolerance) {
  options.basis_tolerance = tolerance;
  return options;
}

std::shared_ptr<const System> prepared(const Model& model, double tolerance) {
  deform::Setup setup = model.setup;
  std::visit([&](auto& options) { options.basis_tolerance = tolerance; }, setup.method);
  return prepare(test::shared(model.mesh), setup);
}

/// All handles move by D along (1, 2, 2) / 3 and turn by one radian about (1, 1, 1) through the middles of their boxes: what the
/// tolerance is defined by, and the axis that makes the coefficients largest.
Design reference_design(const Model& model) {
  const double D = bounding_box(model.mesh.points).diagonal();
  const double c = std::cos(1.0), off = std::sin(1.0) / std::numbers::sqrt3, n = (1 - c) / 3;
  const double R[3][3] = {{c + n, n - off, n + off}, {n + off, c + n, n - off}, {n - off, n + off, c + n}};
  Design design;
  for (std::size_t h = 0; h < model.setup.handles.size(); ++h) {
    Box box;
    for (const PointId id : std::get<Region::Ids>(model.setup.handles[h].region.kind).ids) box.add(model.mesh.points[id]);
    Affine map{};
    for (std::size_t i = 0; i < 3; ++i) {
      const double middle = 0.5 * (box.min[i] + box.max[i]);
      map[4 * i + 3] = middle + D * (i == 0 ? 1 : 2) / 3.0;
      for (std::size_t j = 0; j < 3; ++j) {
        map[4 * i + j] = R[i][j];
        map[4 * i + 3] -= R[i][j] * 0.5 * (box.min[j] + box.max[j]);
      }
    }
    design.motions.push_back({h, map});
  }
  return design;
}

double reported_error(const System& system, const Design& design) {
  return system.bind({&design, 1}, EvaluationPath::basis, {})->report(0).error;
}

void check_tolerance(const Model& given) {
  for (const double unit : {1e-3, 1.0, 1e3}) {
    const Model model = in_units(given, unit);
    const double D = bounding_box(model.mesh.points).diagonal();
    const Design design = reference_design(model);
    const auto plain = prepared(model, 0);
    const Points exact = plain->evaluate({&design, 1}, EvaluationPath::basis)[0];
    for (const double tolerance : {1e-6, 1e-8}) {
      SCOPED_TRACE(std::string(model.name) + ", unit " + std::to_string(unit) + ", tolerance " + std::to_string(tolerance * 1e8));
      const auto system = prepared(model, tolerance);
      const double off = test::distance(system->evaluate({&design, 1}, EvaluationPath::basis)[0], exact);
      EXPECT_LE(off, tolerance * D);
      EXPECT_GT(off, 1e-3 * tolerance * D) << "finer than it has to be";
      const double more = reported_error(*system, design) - reported_error(*plain, design);
      EXPECT_GE(more, off * (1 - 1e-6));
      EXPECT_LE(more, tolerance * D * (1 + 1e-6));
      EXPECT_LT(system->info().basis_bytes, plain->info().basis_bytes);
      EXPECT_LE(system->info().bytes + plain->info().basis_bytes - system->info().basis_bytes, plain->info().bytes);
    }
  }
}

TEST(CompressedBasis, KeepsTheToleranceOnSurfaces) {
  check_tolerance(body(RbfOptions{}));
  check_tolerance(body(ShellOptions{}));
}

TEST(CompressedBasis, KeepsTheToleranceInAVolume) {
  check_tolerance(volume(RbfOptions{}, 13));
  check_tolerance(volume(few_samples(), 7));
}

TEST(CompressedBasis, DerivativesAreThoseOfWhatIsDelivered) {
  for (const double tolerance : {1e-4, 1e-8}) {
    deform::Setup setup = test::setup_with_variables();
    setup.method = with_tolerance(RbfOptions{}, tolerance);
    const auto rbf = prepare(test::shared(test::bumpy_sheet(61, 31)), setup);
    test::check_jacobians(*rbf, 1e-12, 1e-8);
    setup.method = with_tolerance(ShellOptions{}, tolerance);
    const auto shell = prepare(test::shared(test::bumpy_sheet(61, 31)), setup);
    test::check_jacobians(*shell, 1e-12, 1e-8);
    // A translation is linear: the difference of two designs is its derivative, to rounding, however coarse the basis is.
    const std::vector<double> rest(4, 0.0), up{1, 0, 0, 0};
    const Points derivative = rbf->jacobian_vector(rest, up, {}), at = rbf->evaluate(Design{rest, {}}),
                 to = rbf->evaluate(Design{up, {}});
    double worst = 0;
    for (std::size_t i = 0; i < at.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) worst = std::max(worst, std::abs(to[i][k] - at[i][k] - derivative[i][k]));
    }
    EXPECT_LT(worst, 1e-14);
  }
}

TEST(CompressedBasis, PopulationsAndRangesHaveTheSameBits) {
  deform::Setup setup = test::setup_with_variables();
  setup.method = with_tolerance(RbfOptions{}, 1e-7);
  const auto mesh = test::shared(test::bumpy_sheet(61, 31));
  const auto system = prepare(mesh, setup);
  test::check_population(*system, 17);
  const Design design{{0.1, 0.2, -0.1, 0.3}, {}};
  const Points whole = system->evaluate(design);
  const auto bound = system->bind({&design, 1}, EvaluationPath::automatic, {});
  for (const std::size_t begin : {0, 1, 500, 511, 900}) {
    Points part(777);
    Vec3* out = part.data();
    bound->evaluate(begin, begin + part.size(), 0, std::span<Vec3* const>(&out, 1));
    EXPECT_TRUE(std::equal(part.begin(), part.end(), whole.begin() + static_cast<std::ptrdiff_t>(begin))) << begin;
  }
}

TEST(CompressedBasis, WithPlanesOfSymmetry) {
  Model model{"half", test::cube(9).mesh, {}};
  model.setup.handles = {{"top", test::box({0, 0.2, 0.99}, {0.5, 0.8, 1})}};
  model.setup.fixed = {test::box({-1, -1, -1}, {2, 2, 0.01})};
  model.setup.symmetry.push_back({SymmetryPlane::Plane{{0, 0, 0}, {1, 0, 0}}});
  const auto plain = prepared(model, 0), system = prepared(model, 1e-7);
  const Design design{{}, {{0, Affine{1.1, 0, 0, 0, 0, 1.2, 0.1, 0.05, 0, 0, 1, 0.3}}}};
  const double off = test::distance(system->evaluate({&design, 1}, EvaluationPath::basis)[0],
                                    plain->evaluate({&design, 1}, EvaluationPath::basis)[0]);
  EXPECT_GT(off, 0);
  EXPECT_LE(off, 1e-7 * plain->info().diagonal);
  EXPECT_GE(reported_error(*system, design) - reported_error(*plain, design), off * (1 - 1e-6));
}

// What a basis is stored to is not what the solver was asked for.
TEST(CompressedBasis, DoesNotMakeAnIterativeSolverFail) {
  Model model = body(RbfOptions{});
  RbfOptions options;
  options.solver = Solver::iterative;
  options.tolerance = 1e-7;
  model.setup.method = options;
  const Design design = reference_design(model);
  const auto system = prepared(model, 1e-4);
  const auto bound = system->bind({&design, 1}, EvaluationPath::basis, {});
  EXPECT_TRUE(bound->report(0).converged);
  EXPECT_GT(bound->report(0).error, 1e-6 * system->info().diagonal);
}

TEST(CompressedBasis, EstimatesAreBounds) {
  for (const auto& model : {body(RbfOptions{}), body(ShellOptions{}), volume(few_samples(), 7)}) {
    for (const double tolerance : {1e-4, 1e-6, 1e-8, 1e-12}) {
      deform::Setup setup = model.setup;
      std::visit([&](auto& options) { options.basis_tolerance = tolerance; }, setup.method);
      const Estimate expected = estimate(model.mesh, setup);
      const auto system = prepare(test::shared(model.mesh), setup);
      EXPECT_GE(expected.basis_bytes, system->info().basis_bytes) << tolerance;
      if (model.name != std::string("volume")) {
        EXPECT_GE(expected.resident_bytes, system->bytes()) << tolerance;
      }
      EXPECT_GE(expected.peak_bytes, expected.resident_bytes) << tolerance;
      if (tolerance < 1e-6) continue;
      setup.method = model.setup.method;
      EXPECT_LT(expected.basis_bytes, estimate(model.mesh, setup).basis_bytes) << tolerance;
    }
  }
}

TEST(CompressedBasis, ToleranceHasLimits) {
  const auto mesh = test::shared(test::bumpy_sheet(21, 11));
  for (const double bad : {1e-13, 1e-2, -1e-6, std::nan("")}) {
    deform::Setup setup = test::sheet_setup();
    setup.method = with_tolerance(RbfOptions{}, bad);
    test::expect_error(ErrorCode::invalid_argument, {"method.rbf.basis_tolerance", "1e-12..0.001"},
                       [&] { prepare(mesh, setup); });
    setup.method = with_tolerance(ShellOptions{}, bad);
    test::expect_error(ErrorCode::invalid_argument, {"method.shell.energy.basis_tolerance"}, [&] { prepare(mesh, setup); });
  }
}

// A field whose coefficients are all 0 is not read: a translation gives the same bits beside a design that needs all fields.
TEST(Basis, FieldsThatNothingMovesChangeNoBit) {
  const auto mesh = test::shared(test::bumpy_sheet(61, 31));
  for (const double tolerance : {0.0, 1e-8}) {
    deform::Setup setup = test::setup_with_variables();
    setup.method = with_tolerance(RbfOptions{}, tolerance);
    const auto system = prepare(mesh, setup);
    const std::vector<Design> designs{{{0.2, 0, 0, 0}, {}}, {{0, 0, 0, 0}, {}}, {{0.1, 0.3, -0.2, 0.4}, {}}};
    const auto together = system->evaluate(designs, EvaluationPath::basis);
    for (std::size_t i = 0; i < designs.size(); ++i) {
      EXPECT_TRUE(system->evaluate({&designs[i], 1}, EvaluationPath::basis)[0] == together[i]) << i;
    }
    EXPECT_TRUE(together[1] == mesh->points);
  }
}

}  // namespace
}  // namespace deform::compressed_basis_test
