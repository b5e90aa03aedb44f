// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 6.3, 7.2 and 8.6.2 on the stand-ins for Bore and Pipe: the whole boundary moves, all
// of its points are centres. Every fifth of the 20 steps of volume_bench, which prints all of them.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "core/deformers/system.h"
#include "core/io/mesh_file.h"
#include "core/numerics/interpolation/dense_interpolator.h"
#include "core/numerics/interpolation/saddle_factor.h"
#include "core/quality/element_quality.h"
#include "tests/bench/param_case.h"
#include "tests/support/long_tests.h"
#include "tests/support/thesis_options.h"

namespace deform::volume_rows_test {
namespace {

using bench::Method;
using bench::ParamCase;
using bench::Series;
using bench::Walk;

constexpr std::size_t stride = 5;

std::filesystem::path volumes() { return std::filesystem::path(DEFORM_SHARED_DATA) / "B_volume"; }

class Volumes : public testing::TestWithParam<const char*> {
 protected:
  const ParamCase param_ = bench::read_param_case(volumes() / "param", GetParam());
};

TEST_P(Volumes, BoundaryExactNothingInvertedBesideHarmonic) {
  for (const Walk mode : {Walk::absolute, Walk::relative}) {
    const Series ours = walk(param_, Method::triharmonic, mode, stride);
    const Series harmonic = walk(param_, Method::harmonic, mode, stride);
    EXPECT_EQ(ours.failure, "");
    EXPECT_LE(ours.boundary, 1e-9);
    EXPECT_LE(ours.residual, 1e-9);
    for (std::size_t k = 0; k < ours.inverted.size(); ++k) EXPECT_EQ(ours.inverted[k], 0u) << "step " << k * stride;
    const bench::Comparison comparison = compare(ours, harmonic);
    EXPECT_EQ(comparison.steps, 4u);
    if (param_.elements->types[0] == ElementType::hexahedron) {
      EXPECT_EQ(comparison.at_least, comparison.steps) << comparison.shortfall;
    } else {
      // Short of "at least as good in 90 % of the steps" (volume_bench has all of them): single slivers decide. In bore_tet r^3
      // is behind while the change is small and well ahead after; in pipe_tet it is level until the harmonic map keeps the
      // element that is worst on the boundary alone, which nothing can improve, and r^3 another one below that.
      EXPECT_GE(comparison.at_least, 2u);
      EXPECT_LE(comparison.shortfall, 0.007);
      if (param_.name == "bore_tet") {
        EXPECT_LE(comparison.last_below, 1u);
      }
    }
    RecordProperty(mode == Walk::absolute ? "absolute" : "relative", std::to_string(ours.least.back()));
  }
}

// Thesis table 7.1, the whole change at once. Which of r and r^3 is better depends on the case; with quadratic polynomials r^5
// inverts nothing either. (In twenty relative steps it does, one element of pipe_tet: see volume_bench.)
TEST_P(Volumes, KernelOrders) {
  for (const Method method : {Method::biharmonic, Method::quintic}) {
    const Series series = walk(param_, method, Walk::absolute, ParamCase::steps);
    EXPECT_EQ(series.failure, "");
    EXPECT_EQ(series.inverted.back(), 0u) << bench::to_string(method);
    EXPECT_LE(series.boundary, 1e-9);
  }
}

INSTANTIATE_TEST_SUITE_P(All, Volumes, testing::Values("bore_hex", "bore_tet", "pipe_hex", "pipe_tet"),
                         [](const auto& tested) { return std::string(tested.param); });

// Thesis 7.2.4, 1-norm: the condition of the bordered system grows by three orders of magnitude per order of the kernel (by 925
// from r^3 to r^5 here), falls when coordinates are scaled to a unit box, and again when the polynomials are projected out.
TEST(Conditions, ConditionGrowsWithTheOrderAndFallsWithScaling) {
  const ParamCase param = bench::read_param_case(volumes() / "param", "bore_tet");
  const auto condition = [&](Kernel kernel, Solver solver, double scale) {
    std::vector<Vec3> centres = param.places[0];
    for (Vec3& x : centres) x = {scale * x[0], scale * x[1], scale * x[2]};
    InterpolationOptions options;
    options.kernel.kernel = kernel;
    options.polynomial_degree = kernel == Kernel::quintic ? 2 : 1;
    options.solver = solver;
    const DenseInterpolator interpolator(centres, options, {});
    // Not that of differences between close centres, which take the place of a factor without a correct digit.
    return solver == Solver::ldlt ? factor_ldlt({interpolator.kernel(), centres, interpolator.polynomials()}, {})->condition()
                                  : interpolator.condition();
  };
  double before = 0;
  for (const Kernel kernel : {Kernel::biharmonic, Kernel::triharmonic, Kernel::quintic}) {
    const double unit = condition(kernel, Solver::ldlt, 0.25);
    EXPECT_GE(unit, 900 * before);
    EXPECT_GE(condition(kernel, Solver::ldlt, 1000), 1e4 * unit);
    EXPECT_LE(condition(kernel, Solver::cholesky, 0.25), unit);
    EXPECT_LE(unit, 1e13);
    before = unit;
  }
}

// Thesis 8.6.2, figures 8.12 and 8.13, the side of the RBFs.
TEST(ElementQuality, InnerSphereOfABall) {
  double before = 1;
  for (const double shift : {0.1, 0.2, 0.3}) {
    const bench::InnerSphere ball = bench::read_inner_sphere(volumes() / "tet_medit" / "sphere.mesh.gz", shift);
    const Points points = prepare(ball.mesh, ball.setup)->evaluate(ball.design);
    const ElementQuality quality = element_quality(points, *ball.elements);
    EXPECT_EQ(quality.inverted_elements, 0u) << shift;
    EXPECT_LT(quality.least_scaled_jacobian.value, before) << shift;
    before = quality.least_scaled_jacobian.value;
    RecordProperty("least_" + std::to_string(shift), std::to_string(before));
  }
}

// Moving least squares invert nothing and keep the least scaled Jacobian of the RBF to 0.01. The boundary of the pipe changes in
// detail: with hard handles that takes more samples than the 4000 + 2000 of the default (0.91 then).
TEST(ElementQuality, MovingLeastSquaresBesideRbf) {
  const auto compare = [](std::shared_ptr<const Mesh> mesh, deform::Setup setup, const Design& design, const Elements& elements,
                          const MlsOptions& options) {
    const auto quality = [&] { return element_quality(prepare(mesh, setup)->evaluate(design), elements); };
    const double rbf = quality().least_scaled_jacobian.value;
    setup.method = options;
    const ElementQuality mls = quality();
    EXPECT_EQ(mls.inverted_elements, 0u);
    EXPECT_GE(mls.least_scaled_jacobian.value, rbf - 0.01);
    return std::to_string(rbf) + " " + std::to_string(mls.least_scaled_jacobian.value);
  };
  const bench::InnerSphere ball = bench::read_inner_sphere(volumes() / "tet_medit" / "sphere.mesh.gz", 0.2);
  RecordProperty("ball", compare(ball.mesh, ball.setup, ball.design, *ball.elements, {}));
  const ParamCase pipe = bench::read_param_case(volumes() / "param", "pipe_hex");
  const deform::Setup setup = bench::boundary_setup(pipe, Kernel::triharmonic);
  const Design design = bench::boundary_motion(pipe.places.front(), pipe.places.back());
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 8000;
  options.volume_samples = 4000;
  if (test::long_tests()) RecordProperty("pipe_hard", compare(pipe.mesh, setup, design, *pipe.elements, options));
  options = {};
  options.handles = HandleMode::soft;  // as in the thesis
  options.fixing = 1e6;
  RecordProperty("pipe_soft", compare(pipe.mesh, setup, design, *pipe.elements, options));
}

TEST(ElementQuality, Pipe) {
  const ParamCase param = bench::read_param_case(volumes() / "param", "pipe_hex");
  const Series series = walk(param, Method::triharmonic, Walk::absolute, ParamCase::steps);
  EXPECT_EQ(series.inverted.back(), 0u);
  EXPECT_GE(series.least.front(), 0.99);
  EXPECT_GE(series.least.back(), 0.95);  // the thesis: 0.98 before, 0.951 after
  RecordProperty("least", std::to_string(series.least.back()));
}

}  // namespace
}  // namespace deform::volume_rows_test
