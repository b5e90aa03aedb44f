// SPDX-License-Identifier: GPL-3.0-or-later
// Compiled deformations of half models and sectors whose handles hold control points: the basis path of the system, bit for bit.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/compiled/deformation.h"
#include "core/compiled/reader.h"
#include "core/compiled/records.h"
#include "core/deformers/compiled_form.h"
#include "tests/core/deformers/compiled_deformation.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/mirrored_sheet.h"
#include "tests/core/deformers/wheel.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/expect_error.h"

namespace deform::compiled_controls_test {
namespace {

void expect_basis_path(const std::shared_ptr<const System>& system, const std::vector<double>& at) {
  const compiled::Deformation deformation = test::compiled_deformation(system);
  const Design design{at, {}};
  const Points right = system->evaluate({&design, 1}, EvaluationPath::basis)[0];
  std::vector<double> flat(3 * right.size());
  const auto off = [&](const Points& points) {
    double largest = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) largest = std::max(largest, std::abs(points[i][k] - flat[3 * i + k]));
    }
    return largest;
  };
  deformation.evaluate(at, flat);
  EXPECT_EQ(off(right), 0);
  const DesignReport report = system->bind({&design, 1}, EvaluationPath::basis, {})->report(0);
  EXPECT_NEAR(deformation.report(at).prescribed_displacement, report.prescribed_displacement, 1e-14);
  EXPECT_NEAR(deformation.report(at).error, report.error, 1e-3 * report.error);
  const std::vector<double> direction{0.3, 1, -0.4, 0.2};
  deformation.jacobian_vector(at, direction, flat);
  EXPECT_LE(off(system->jacobian_vector(at, direction, {})), 1e-13);
  std::vector<double> gradient(4);
  deformation.vector_jacobian(at, std::span<const double>(right[0].data(), flat.size()), gradient);
  const std::vector<double> transposed = system->vector_jacobian(at, right, {});
  for (std::size_t k = 0; k < 4; ++k) EXPECT_NEAR(gradient[k], transposed[k], 1e-11 * std::abs(transposed[k]));
}

Region ids(std::vector<std::uint32_t> list) { return {Region::ControlIds{std::move(list)}}; }
Region layers(std::array<std::uint32_t, 2> i, std::array<std::uint32_t, 2> j, std::array<std::uint32_t, 2> k) {
  using Range = Region::LatticeRange::Range;
  return {Region::LatticeRange{{Range{i[0], i[1]}, Range{j[0], j[1]}, Range{k[0], k[1]}}}};
}

/// "end" holds control points in the plane y = 0 and, if `both`, the images of others.
deform::Setup half_lattice(bool both) {
  FfdOptions options;
  options.control = FfdControl::controls;
  options.basis = BasisMode::always;
  options.lattice.frame = LatticeFrame{{-0.2, -1.1, -0.6}, {{{2.5, 0, 0}, {0, 2.2, 0}, {0, 0, 1.3}}}};
  options.lattice.points = {7, 7, 4};
  deform::Setup setup = test::half_setup(options);
  setup.handles[0].region = layers({5, 6}, {both ? 1u : 3u, 5}, {1, 3});
  setup.handles[1].region = layers({2, 3}, {5, 6}, {1, 1});
  setup.fixed = {layers({0, 1}, {0, 6}, {0, 3})};
  return setup;
}

TEST(CompiledControls, OfAHalfModelAreTheBasisPath) {
  const auto half = test::shared(test::bumpy_sheet(23, 12));
  for (const bool both : {false, true}) expect_basis_path(prepare(half, half_lattice(both)), test::bent.variables);
  // A cage that ends in the plane: 2 and 3, 6 and 7 are away from it.
  const test::CageMesh box = test::box_cage({-0.2, 0, -0.6}, {2.3, 1.3, 0.7});
  CageOptions cage;
  cage.vertices = box.vertices;
  cage.triangles = box.triangles;
  cage.basis = BasisMode::always;
  deform::Setup setup = test::half_setup(cage);
  setup.handles[0].region = ids({1, 2, 6});
  setup.handles[1].region = ids({7});
  setup.fixed = {ids({3})};
  expect_basis_path(prepare(half, setup), test::bent.variables);
}

TEST(CompiledControls, MotionsThatWouldHaveToBeCheckedAreRefused) {
  const auto half = test::shared(test::bumpy_sheet(23, 12));
  const auto refused = [&](const deform::Setup& setup, const std::vector<const char*>& parts) {
    const auto system = prepare(half, setup);
    test::expect_error(ErrorCode::failed_precondition, parts, [&] { CompiledForm form(system); });
  };
  const std::vector<VariableMotion> leading_away{
      DesignVariable::Translate{{0, 1, 0}}, DesignVariable::Rotate{{1, 0, 0}, {1.8, 0, 0}},
      DesignVariable::Scale{{1.8, 0.1, 0}, {0, 1, 0}}, DesignVariable::Scale{{1.8, 0, 0}, {0, 1, 1}},
      DesignVariable::Scale{{1.8, 0.1, 0}, {}}};
  for (const VariableMotion& motion : leading_away) {
    deform::Setup setup = half_lattice(false);
    setup.variables.push_back({"away", "end", motion});
    refused(setup, {"cannot be compiled", "\"away\"", "control point", "symmetry[0]"});
    setup.variables.back().handle = "middle";  // which is beside the plane
    EXPECT_NO_THROW(CompiledForm form(prepare(half, setup)));
  }
  for (const VariableMotion& motion :
       {VariableMotion{DesignVariable::Scale{{1.8, 0, 0}, {0, 1, 0}}}, VariableMotion{DesignVariable::Scale{{1.8, 0, 1}, {}}}}) {
    deform::Setup setup = half_lattice(false);
    setup.variables.push_back({"along", "end", motion});
    EXPECT_NO_THROW(CompiledForm form(prepare(half, setup)));
  }
  deform::Setup images = half_lattice(false);
  images.handles[1].region = layers({5, 6}, {1, 1}, {1, 1});  // images of points of "end"
  refused(images, {"\"end\"", "\"middle\"", "images of each other"});
}

TEST(CompiledControls, OfASectorAreTheBasisPath) {
  for (const std::size_t count : {2, 5}) {
    test::SectorModel model({count, 0.0, 1}, test::oblique());
    const test::Frame& frame = model.frame;
    model.setup.method = test::sector_lattice(frame);
    model.setup.fixed.clear();
    model.setup.handles[0].region = layers({1, 3}, {1, 4}, {1, 3});
    model.setup.variables = {{"along", "blade", DesignVariable::Translate{frame.axes[0]}},
                             {"turn", "blade", DesignVariable::Rotate{frame.axes[2], frame.point({0.4, 0.7, 0})}},
                             {"grow", "blade", DesignVariable::Scale{frame.point({0.4, 0.7, 0}), frame.axes[1]}},
                             {"stagger", "blade", DesignVariable::Rotate{frame.axes[1], frame.point({0.4, 0.7, 0})}}};
    expect_basis_path(prepare(model.sector, model.setup), {0.1, 0.15, 0.2, -0.1});
  }
}

}  // namespace
}  // namespace deform::compiled_controls_test
