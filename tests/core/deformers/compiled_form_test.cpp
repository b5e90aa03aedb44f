// SPDX-License-Identifier: GPL-3.0-or-later
// Compiled deformations of every method against the systems that they come from: points, derivatives, reports and refusals.
#include "core/deformers/compiled_form.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "core/compiled/deformation.h"
#include "core/compiled/reader.h"
#include "core/compiled/records.h"
#include "core/numerics/kernels/tiles.h"
#include "tests/core/deformers/basis_cases.h"
#include "tests/core/deformers/compiled_deformation.h"
#include "tests/core/deformers/mirrored.h"
#include "tests/support/expect_error.h"

namespace deform::compiled_form_test {
namespace {

using test::compiled_deformation;

/// Sums are fused where the processor can, which the system leaves to it.
bool fuses() { return std::string(vector_target()).find("AVX") != std::string::npos; }

class CompiledForms : public testing::TestWithParam<test::BasisCase> {
 protected:
  deform::Setup setup() const { return GetParam().setup(); }
};

std::vector<double> flat_points(const Points& points) { return {points[0].data(), points[0].data() + 3 * points.size()}; }

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

TEST_P(CompiledForms, AreTheSystem) {
  const auto mesh = test::shared(test::bumpy_sheet(41, 23));
  const std::shared_ptr<const System> system = prepare(mesh, setup());
  const compiled::Deformation deformation = compiled_deformation(system);
  const double D = system->info().diagonal;
  ASSERT_EQ(deformation.points(), mesh->point_count());
  EXPECT_EQ(deformation.content().diagonal, D);
  EXPECT_EQ(deformation.content().notes, system->info().notes);

  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> uniform(-0.3, 0.3);
  std::vector<double> flat;
  std::vector<Design> designs(7);
  for (Design& design : designs) {
    for (int k = 0; k < 4; ++k) design.variables.push_back(uniform(random));
    flat.insert(flat.end(), design.variables.begin(), design.variables.end());
  }
  const std::vector<Points> right = system->evaluate(designs, EvaluationPath::basis);
  const std::unique_ptr<const Evaluation> bound = system->bind(designs, EvaluationPath::basis, {});
  const std::size_t size = 3 * mesh->point_count();
  std::vector<double> points(designs.size() * size);
  deformation.evaluate(flat, points, 2);
  for (std::size_t i = 0; i < designs.size(); ++i) {
    const std::vector<double> one(points.begin() + static_cast<std::ptrdiff_t>(i * size),
                                  points.begin() + static_cast<std::ptrdiff_t>((i + 1) * size));
    EXPECT_LE(largest_difference(one, flat_points(right[i])), 1e-14 * D) << i;
    if (GetParam().stored_exactly && fuses()) {
      EXPECT_EQ(one, flat_points(right[i])) << i;
    }
    const compiled::Report report = deformation.report(designs[i].variables);
    const DesignReport& expected = bound->report(i);
    if (expected.misfit > 0) {
      EXPECT_GE(report.error, expected.error * (1 - 1e-12));  // a bound
      EXPECT_LE(report.error, 100 * expected.error);
    } else {
      EXPECT_NEAR(report.error, expected.error, 1e-12 * expected.error);
    }
    if (expected.misfit > 0) {
      EXPECT_GE(report.interpolation_residual, expected.interpolation_residual * (1 - 1e-12));  // a bound
    } else {
      EXPECT_NEAR(report.interpolation_residual, expected.interpolation_residual, 1e-12 * expected.interpolation_residual);
    }
    EXPECT_EQ(report.prescribed_displacement, expected.prescribed_displacement);
    EXPECT_EQ(report.converged, expected.converged);
    const double missed = deformation.largest_misfit(designs[i].variables, one);
    if (expected.misfit > 0) {
      EXPECT_NEAR(missed, expected.misfit, 1e-12 * D);
    }
  }

  const std::vector<double> at{0.1, 0.8, 0.2, -0.6}, direction{0.3, -0.7, 0.5, 0.9};
  std::vector<double> vectors(size), gradient(4);
  deformation.jacobian_vector(at, direction, vectors);
  const std::vector<double> product = flat_points(system->jacobian_vector(at, direction, {}));
  EXPECT_LE(largest_difference(vectors, product), 1e-14 * D);
  if (GetParam().stored_exactly && fuses()) {
    EXPECT_EQ(vectors, product);
  }
  Points cotangent(mesh->point_count());
  for (Vec3& w : cotangent) w = {uniform(random), uniform(random), uniform(random)};
  deformation.vector_jacobian(at, std::span<const double>(cotangent[0].data(), size), gradient);
  const std::vector<double> transposed = system->vector_jacobian(at, cotangent, {});
  double scale = 0;
  for (const double g : transposed) scale = std::max(scale, std::abs(g));
  EXPECT_LE(largest_difference(gradient, transposed), 1e-12 * scale);
}

INSTANTIATE_TEST_SUITE_P(Methods, CompiledForms, testing::ValuesIn(test::basis_cases()),
                         [](const auto& parameter) { return std::string(parameter.param.name); });

TEST(CompiledForm, OfHalfModelsIsTheSystem) {
  for (const std::size_t planes : {1u, 2u, 3u}) {
    for (const test::Frame& frame : {test::Frame{}, test::oblique()}) {
      test::HalfModel model(planes, frame);
      // What slides in all planes: growing about the point where they meet, and a motion along the last axis where it is free.
      model.setup.variables = {{"grow", "corner", DesignVariable::Scale{frame.origin, {}}, -0.5, 0.5}};
      if (planes < 3) model.setup.variables.push_back({"along", "corner", DesignVariable::Translate{frame.axes[2]}, -1, 1});
      RbfOptions options;
      options.basis = BasisMode::always;
      model.setup.method = options;
      const std::shared_ptr<const System> system = prepare(model.half, model.setup);
      const compiled::Deformation deformation = compiled_deformation(system);
      std::vector<double> values(deformation.variables(), 0.2), gradient(values.size());
      const Points right = system->evaluate(Design{values, {}});
      std::vector<double> points(3 * right.size());
      deformation.evaluate(values, points);
      EXPECT_LE(largest_difference(points, flat_points(right)), 1e-14 * system->info().diagonal);
      if (fuses()) {
        EXPECT_EQ(points, flat_points(right)) << planes;
      }
      const Points product = system->jacobian_vector(values, values, {});
      deformation.jacobian_vector(values, values, points);
      if (fuses()) {
        EXPECT_EQ(points, flat_points(product)) << planes;
      }
      deformation.vector_jacobian(values, std::span<const double>(right[0].data(), points.size()), gradient);
      const std::vector<double> transposed = system->vector_jacobian(values, right, {});
      for (std::size_t k = 0; k < gradient.size(); ++k) EXPECT_NEAR(gradient[k], transposed[k], 1e-12 * std::abs(transposed[k]));
    }
  }
}

TEST(CompiledForm, RefusesTheDesignsThatTheSystemRefuses) {
  // Two handles with a point each in one place.
  Mesh mesh = test::bumpy_sheet(21, 11);
  mesh.points.push_back(mesh.points[10]);
  deform::Setup setup = test::sheet_setup();
  setup.handles = {{"a", {Region::Ids{{10}}}}, {"b", {Region::Ids{{21 * 11}}}}};
  setup.variables = {{"up_a", "a", DesignVariable::Translate{{0, 0, 1}}}, {"up_b", "b", DesignVariable::Translate{{0, 0, 1}}}};
  const auto system = prepare(test::shared(std::move(mesh)), setup);
  const compiled::Deformation deformation = compiled_deformation(system);
  std::vector<double> points(3 * deformation.points());
  const std::vector<double> apart{0.1, 0}, together{0.1, 0.1};
  test::expect_error(ErrorCode::invalid_argument, {"coincide"}, [&] { system->evaluate(Design{apart, {}}); });
  test::expect_error(ErrorCode::invalid_argument, {"coincide"}, [&] { deformation.evaluate(apart, points); });
  deformation.evaluate(together, points);
  EXPECT_LE(largest_difference(points, flat_points(system->evaluate(Design{together, {}}))), 1e-14);
}

TEST(CompiledForm, SaysWhyThereIsNone) {
  const auto mesh = test::shared(test::flat_sheet(21, 11));
  const auto refused = [&](const char* says, const deform::Setup& setup) {
    test::expect_error(ErrorCode::failed_precondition, {"cannot be compiled", says},
                       [&] { CompiledForm form(prepare(mesh, setup)); });
  };
  deform::Setup constrained = test::setup_with_variables();
  constrained.method = ShellOptions{};
  constrained.constraints = {{"flat", {test::box({0.5, -1, -1}, {0.8, 2, 1})}, Planar{}}};
  refused("constraints", constrained);
  deform::Setup without_basis = test::setup_with_variables();
  RbfOptions never;
  never.basis = BasisMode::never;
  without_basis.method = never;
  refused("BASIS_ALWAYS", without_basis);
  refused("design variables", test::sheet_setup());
}

TEST(CompiledForm, CompressedBasesKeepTheirBound) {
  const auto mesh = test::shared(test::bumpy_sheet(41, 23));
  deform::Setup setup = test::setup_with_variables();
  RbfOptions options;
  options.basis_tolerance = 1e-4;
  setup.method = options;
  const auto system = prepare(mesh, setup);
  setup.method = RbfOptions{};
  const auto exact = prepare(mesh, setup);
  const compiled::Deformation deformation = compiled_deformation(system);
  const Design design{{0.2, 0.3, -0.1, 0.4}, {}};
  std::vector<double> points(3 * deformation.points());
  deformation.evaluate(design.variables, points);
  const double off = largest_difference(points, flat_points(exact->evaluate(design)));
  EXPECT_GT(off, 0);
  EXPECT_LE(off, deformation.report(design.variables).error);
}

}  // namespace
}  // namespace deform::compiled_form_test
