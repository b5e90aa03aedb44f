// SPDX-License-Identifier: GPL-3.0-or-later
// The RBF system as a user of the core sees it: exactness, paths, populations, derivatives.
#include "core/deformers/rbf/rbf_system.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/base/error.h"
#include "core/mesh/ahmed.h"
#include "tests/core/deformers/shapes.h"

namespace deform::rbf_test {
namespace {

Region group(const std::string& name) { return {Region::GroupName{name}}; }

std::shared_ptr<const Mesh> body(std::size_t points = 3000) {
  AhmedOptions options;
  options.target_points = points;
  return std::make_shared<Mesh>(ahmed_body(options));
}

Setup car_setup() {
  deform::Setup setup;
  setup.handles = {{"slant", group("slant")}, {"roof", group("roof")}};
  setup.handles[1].region = {Region::Difference{{group("roof"), group("slant"), group("nose"), group("sides")}}};
  setup.fixed = {group("underbody"), group("stilts")};
  setup.variables.push_back({"roof_up", "roof", DesignVariable::Translate{{0, 0, 1}}, -0.1, 0.1});
  setup.variables.push_back({"slant_turn", "slant", DesignVariable::Rotate{{0, 1, 0}, {0.9, 0, 0.3}}, -0.5, 0.5});
  setup.variables.push_back({"roof_wide", "roof", DesignVariable::Scale{{0.5, 0, 0.3}, {0, 1, 0}}, -0.5, 0.5});
  setup.variables.push_back({"slant_big", "slant", DesignVariable::Scale{{0.9, 0, 0.3}, {}}, -0.5, 0.5});
  setup.handles[0].region = {Region::Difference{{group("slant"), group("sides")}}};
  return setup;
}

double distance(const Points& a, const Points& b) {
  EXPECT_EQ(a.size(), b.size());
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    largest = std::max(largest, std::hypot(a[i][0] - b[i][0], a[i][1] - b[i][1], a[i][2] - b[i][2]));
  }
  return largest;
}

std::vector<Kernel> kernels() {
  return {Kernel::triharmonic,  Kernel::biharmonic,           Kernel::quintic,     Kernel::gaussian,
          Kernel::multiquadric, Kernel::inverse_multiquadric, Kernel::wendland_c2, Kernel::thin_plate};
}

Affine some_affine() { return {1.1, 0.05, -0.02, 0.3, -0.04, 0.95, 0.07, -0.1, 0.02, 0.01, 1.2, 0.05}; }

TEST(Rbf, CommonAffineMotionIsReproducedByEveryKernelAndSolver) {
  const auto mesh = body();
  const double D = bounding_box(mesh->points).diagonal();
  for (const Kernel kernel : kernels()) {
    for (const Solver solver : {Solver::automatic, Solver::ldlt}) {
      deform::Setup setup = car_setup();
      setup.fixed.clear();
      setup.variables.clear();
      RbfOptions options;
      options.kernel = kernel;
      options.solver = solver;
      setup.method = options;
      const auto system = prepare(mesh, setup);
      Design design;
      design.motions = {{0, some_affine()}, {1, some_affine()}};
      Points expected = mesh->points;
      for (Vec3& p : expected) p = transformed(some_affine(), p);
      for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
        const Points got = system->evaluate(std::span<const Design>(&design, 1), path)[0];
        EXPECT_LT(distance(got, expected), 1e-9 * D)
            << properties(kernel).name << " " << to_string(solver) << " used " << to_string(system->info().solver)
            << " condition " << system->info().condition;
      }
    }
  }
}

/// A sheet of which a tenth of the columns is four times as dense as the others.
std::shared_ptr<const Mesh> uneven_sheet() {
  Mesh mesh = test::bumpy_sheet(61, 21);
  for (Vec3& x : mesh.points) x[0] = x[0] < 0.2 ? 0.25 * x[0] : x[0] - 0.15;
  return test::shared(std::move(mesh));
}

Setup uneven_setup() {
  deform::Setup setup = test::sheet_setup();
  setup.fixed = {test::box({-1, -1, -1}, {1.3, 2, 1})};
  return setup;
}

TEST(Rbf, AutomaticShapesSuitTheDensestCentres) {
  const auto sheet = uneven_sheet(), car = body();
  for (const Kernel kernel : {Kernel::gaussian, Kernel::multiquadric, Kernel::inverse_multiquadric}) {
    for (const auto& [mesh, given] : {std::pair(sheet, uneven_setup()), std::pair(car, car_setup())}) {
      deform::Setup setup = given;
      RbfOptions options;
      options.kernel = kernel;
      setup.method = options;
      const auto system = prepare(mesh, setup);
      EXPECT_LT(system->info().condition, 1e12) << properties(kernel).name << ", " << mesh->point_count() << " points";
      EXPECT_EQ(system->info().solver, Solver::cholesky);
    }
  }
}

TEST(Rbf, HandlesMoveAsToldAndFixedPointsStay) {
  const auto mesh = body();
  const deform::Setup setup = car_setup();
  const auto system = prepare(mesh, setup);
  const std::vector<double> variables{0.05, 0.2, 0.1, -0.1};
  Design design;
  design.variables = variables;
  const Points got = system->evaluate(design);
  const SelectedRegions regions = validate(setup, *mesh);
  const auto motions = handle_motions(setup, variables);
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    for (const PointId id : regions.handles[h]) EXPECT_EQ(got[id], transformed(motions[h], mesh->points[id]));
  }
  for (const PointId id : regions.fixed) EXPECT_EQ(got[id], mesh->points[id]);
  EXPECT_GT(distance(got, mesh->points), 0.04);
  const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
  EXPECT_EQ(evaluation->report(0).path, EvaluationPath::basis);
  EXPECT_LT(evaluation->report(0).interpolation_residual, 1e-9 * system->info().diagonal);
  EXPECT_GT(evaluation->report(0).prescribed_displacement, 0.04);
}

TEST(Rbf, BasisEqualsDirectSolve) {
  const auto mesh = body();
  const auto system = prepare(mesh, car_setup());
  Design design;
  design.variables = {0.05, 0.2, 0.1, -0.1};
  const std::span<const Design> one(&design, 1);
  const Points basis = system->evaluate(one, EvaluationPath::basis)[0];
  const Points direct = system->evaluate(one, EvaluationPath::direct)[0];
  EXPECT_LT(distance(basis, direct), 1e-10 * system->info().diagonal);

  // The same motion as displacements per vertex.
  const deform::Setup setup = car_setup();
  const SelectedRegions regions = validate(setup, *mesh);
  const auto motions = handle_motions(setup, design.variables);
  Design free;
  for (std::size_t h = 0; h < 2; ++h) {
    std::vector<Vec3> displacement;
    for (const PointId id : regions.handles[h]) {
      const Vec3 to = transformed(motions[h], mesh->points[id]);
      displacement.push_back({to[0] - mesh->points[id][0], to[1] - mesh->points[id][1], to[2] - mesh->points[id][2]});
    }
    free.motions.push_back({h, displacement});
  }
  EXPECT_LT(distance(system->evaluate(free), direct), 1e-12);
}

TEST(Rbf, PopulationEqualsSingles) {
  const auto mesh = body();
  const auto system = prepare(mesh, car_setup());
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-0.05, 0.05);
  std::vector<Design> designs(17);
  for (std::size_t i = 0; i < designs.size(); ++i) {
    designs[i].variables = {uniform(random), uniform(random), uniform(random), uniform(random)};
    if (i % 5 == 3) {  // mixed paths
      designs[i].variables[1] = designs[i].variables[3] = 0;
      std::vector<Vec3> displacement(validate(car_setup(), *mesh).handles[0].size(), Vec3{0.01, 0, uniform(random)});
      designs[i].motions = {{0, displacement}};
    }
  }
  for (const EvaluationPath path : {EvaluationPath::automatic, EvaluationPath::direct}) {
    const auto together = system->evaluate(designs, path);
    for (std::size_t i = 0; i < designs.size(); ++i) {
      RunContext one_thread;
      one_thread.threads = 1;
      const Points alone = system->evaluate(std::span<const Design>(&designs[i], 1), path, one_thread)[0];
      EXPECT_TRUE(together[i] == alone) << i;
    }
  }
}

TEST(Rbf, RangesDoNotMatter) {
  const auto mesh = body();
  const auto system = prepare(mesh, car_setup());
  Design design;
  design.variables = {0.05, 0.2, 0.1, -0.1};
  for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
    const auto evaluation = system->bind({&design, 1}, path, {});
    const Points whole = system->evaluate({&design, 1}, path)[0];
    Points pieces(whole.size());
    for (std::size_t begin = 0, step = 1; begin < whole.size(); begin += step, step = step % 97 + 3) {
      Vec3* out = pieces.data() + begin;
      evaluation->evaluate(begin, std::min(begin + step, whole.size()), 0, {&out, 1});
    }
    EXPECT_TRUE(pieces == whole);
  }
}

TEST(Rbf, JacobianProducts) {
  const auto mesh = body();
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    deform::Setup setup = car_setup();
    RbfOptions options;
    options.basis = basis;
    options.reduction = CentreReduction::rings;  // the condition of few centres: the limits below are those of rounding
    setup.method = options;
    const auto system = prepare(mesh, setup);
    const std::vector<double> at{0.02, 0.3, 0.1, -0.1};
    const std::vector<double> direction{0.7, -0.4, 0.2, 0.5};
    const Points product = system->jacobian_vector(at, direction, {});

    constexpr double h = 1e-5;
    Design plus, minus;
    for (std::size_t k = 0; k < at.size(); ++k) {
      plus.variables.push_back(at[k] + h * direction[k]);
      minus.variables.push_back(at[k] - h * direction[k]);
    }
    Points difference = system->evaluate(plus);
    const Points behind = system->evaluate(minus);
    for (std::size_t i = 0; i < difference.size(); ++i) {
      for (int k = 0; k < 3; ++k) difference[i][k] = (difference[i][k] - behind[i][k]) / (2 * h);
    }
    EXPECT_LT(distance(product, difference), 1e-6);

    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    Points cotangent(mesh->point_count());
    double left = 0;
    for (std::size_t i = 0; i < cotangent.size(); ++i) {
      for (int k = 0; k < 3; ++k) {
        cotangent[i][k] = normal(random);
        left += cotangent[i][k] * product[i][k];
      }
    }
    const std::vector<double> gradient = system->vector_jacobian(at, cotangent, {});
    double right = 0;
    double size = 0;
    for (std::size_t k = 0; k < at.size(); ++k) {
      right += gradient[k] * direction[k];
      size += std::abs(gradient[k] * direction[k]);
    }
    EXPECT_NEAR(left, right, 1e-12 * size * (basis == BasisMode::always ? 1 : 10));
  }
}

TEST(Rbf, CancelledBeforeAndDuring) {
  const auto mesh = body(6000);
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  EXPECT_THROW(prepare(mesh, car_setup(), context), Error);
  for (const char* stage : {"assemble", "factor", "basis"}) {
    RunContext during;
    std::stop_source stop_during;
    during.stop = stop_during.get_token();
    bool after = false;
    during.on_progress = [&](const std::string& now, double fraction) {
      if (now == stage) stop_during.request_stop();
      if (now == stage && fraction == 1.0) after = true;
    };
    try {
      prepare(mesh, car_setup(), during);
      EXPECT_TRUE(after) << stage;  // the stage's last report may come too late
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::cancelled);
    }
  }
}

// A small square that turns in the middle of a wide one, whose rim stays: what is said where points move farther than
// prescribed (proto/convert/verdict.h).
TEST(Rbf, SmoothKernelsOvershootAroundWhatTurnsAndBiharmonicDoesNot) {
  Mesh mesh = test::bumpy_sheet(81, 41);
  for (Vec3& x : mesh.points) x = {40 * (x[0] - 1), 80 * (x[1] - 0.5), 0};
  std::vector<PointId> square, rim;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    const Vec3& x = mesh.points[i];
    if (std::abs(x[0]) < 2.1 && std::abs(x[1]) < 2.1) square.push_back(static_cast<PointId>(i));
    if (std::abs(x[0]) > 39.9 || std::abs(x[1]) > 39.9) rim.push_back(static_cast<PointId>(i));
  }
  const auto ratio = [&](Kernel kernel) {
    deform::Setup setup;
    RbfOptions options;
    options.kernel = kernel;
    setup.method = options;
    setup.handles = {{"square", {Region::Ids{square}}}};
    setup.fixed = {{Region::Ids{rim}}};
    setup.variables.push_back({"turn", "square", DesignVariable::Rotate{{0, 0, 1}, {0, 0, 0}}});
    const auto system = prepare(test::shared(mesh), setup);
    const Design design{{0.1}, {}};
    const auto evaluation = system->bind({&design, 1}, EvaluationPath::automatic, {});
    return distance(system->evaluate(design), mesh.points) / evaluation->report(0).prescribed_displacement;
  };
  EXPECT_GE(ratio(Kernel::thin_plate), 1.5);
  EXPECT_GE(ratio(Kernel::triharmonic), 1.5);
  EXPECT_GE(ratio(Kernel::wendland_c2), 1.5);
  EXPECT_LE(ratio(Kernel::biharmonic), 1 + 1e-9);
}

TEST(Rbf, EstimateIsAnUpperBound) {
  const auto mesh = body();
  for (const Solver solver : {Solver::automatic, Solver::ldlt}) {
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      deform::Setup setup = car_setup();
      RbfOptions options;
      options.solver = solver;
      options.basis = basis;
      setup.method = options;
      const Estimate expected = estimate(*mesh, setup);
      const auto system = prepare(mesh, setup);
      EXPECT_EQ(expected.centres, system->info().centres);
      EXPECT_GE(expected.factor_bytes, system->info().factor_bytes);
      EXPECT_GE(expected.basis_bytes, system->info().basis_bytes);
      EXPECT_GE(expected.resident_bytes, system->bytes());
      EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
      EXPECT_THROW(prepare(mesh, setup, {}, expected.peak_bytes / 2), Error);
    }
  }
}

}  // namespace
}  // namespace deform::rbf_test
