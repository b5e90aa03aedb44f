// SPDX-License-Identifier: GPL-3.0-or-later
// Half models: they deform as the whole model does, their planes stay planes, and what does not fit is refused.
#include "core/deformers/handles/symmetry.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "core/deformers/system.h"
#include "tests/core/deformers/mirrored.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/expect_error.h"

namespace deform::symmetry_test {
namespace {

using test::HalfModel;
using test::WholeModel;

/// Largest distance over the points of the half model, which come first.
double distance_of_half(const Points& half, const Points& whole) {
  return test::distance(half, Points(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(half.size())));
}

double diagonal(const Mesh& mesh) { return bounding_box(mesh.points).diagonal(); }

void use(deform::Setup& setup, Kernel kernel, int degree) {
  auto& options = std::get<RbfOptions>(setup.method);
  options.kernel = kernel;
  options.polynomial_degree = degree;
  if (kernel == Kernel::wendland_c2) options.shape = 0.4;
}

struct Method {
  Kernel kernel;
  int degree;
};
const std::vector<Method> methods = {{Kernel::triharmonic, 1}, {Kernel::triharmonic, 2},  {Kernel::biharmonic, 0},
                                     {Kernel::biharmonic, 1},  {Kernel::wendland_c2, -1}, {Kernel::quintic, 2}};

// What the planes allow: turned about the only normal or stretched, moved along.
Affine sliding_motion(const HalfModel& model) {
  const std::size_t p = model.planes;
  const double c = std::cos(0.3), s = std::sin(0.3);
  const double linear[3][3] = {{1.2, 0, 0}, {0, p == 1 ? c : 0.9, p == 1 ? -s : 0}, {0, p == 1 ? s : 0, p == 1 ? c : 1.1}};
  const Vec3 shift{0, p < 2 ? 0.04 : 0.0, p < 3 ? 0.03 : 0.0};
  const auto& axes = model.frame.axes;
  Affine motion{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      for (std::size_t a = 0; a < 3; ++a) {
        for (std::size_t b = 0; b < 3; ++b) motion[4 * i + j] += axes[a][i] * linear[a][b] * axes[b][j];
      }
      motion[4 * i + 3] -= motion[4 * i + j] * model.frame.origin[j];
    }
    motion[4 * i + 3] += model.frame.origin[i] + model.frame.vector(shift)[i];
  }
  return motion;
}

TEST(Symmetry, HalfModelDeformsAsTheWholeOne) {
  for (const auto& frame : {test::Frame{}, test::oblique()}) {
    for (std::size_t planes = 1; planes <= 3; ++planes) {
      for (const Method& method : methods) {
        HalfModel half(planes, frame);
        use(half.setup, method.kernel, method.degree);
        const WholeModel whole(half);
        const auto system = prepare(half.half, half.setup);
        const Points got = system->evaluate(half.design());
        const Points expected = prepare(whole.whole, whole.setup)->evaluate(whole.design);
        const double D = diagonal(*half.half);
        EXPECT_LT(distance_of_half(got, expected), 1e-10 * D)
            << planes << " planes, " << properties(method.kernel).name << " " << method.degree;
        EXPECT_GT(test::distance(got, half.half->points), 0.05);
        EXPECT_LE(half.out_of_planes(got), frame.origin == test::Frame{}.origin ? 0 : 1e-15 * D);
      }
    }
  }
}

/// A half model with its points in this order.
struct Reordered {
  Reordered(const HalfModel& model, const std::vector<PointId>& order) : setup(model.setup) {
    Mesh mesh;
    for (const PointId id : order) mesh.points.push_back(model.half->points[id]);
    half = test::shared(std::move(mesh));
    for (Region* const region : {&setup.handles[0].region, &setup.fixed[0]}) {
      for (PointId& id : std::get<Region::Ids>(region->kind).ids) {
        id = static_cast<PointId>(std::find(order.begin(), order.end(), id) - order.begin());
      }
    }
  }
  std::shared_ptr<const Mesh> half;
  deform::Setup setup;
};

// With handle and fixed points between those that follow, and with these one after the other.
TEST(Symmetry, OrderOfThePointsDoesNotMatter) {
  for (std::size_t planes = 1; planes <= 3; ++planes) {
    const HalfModel model(planes, test::oblique());
    const auto& fixed = std::get<Region::Ids>(model.setup.fixed[0].kind).ids;
    std::vector<PointId> order(model.half->point_count());
    std::iota(order.begin(), order.end(), 0u);
    std::stable_partition(order.begin(), order.end(), [&](PointId id) {
      return std::count(fixed.begin(), fixed.end(), id) + std::count(model.handle().begin(), model.handle().end(), id) == 0;
    });
    const Reordered reordered(model, order);
    const Design design{{}, {{0, sliding_motion(model)}}};
    for (const EvaluationPath path : {EvaluationPath::basis, EvaluationPath::direct}) {
      const Points expected = prepare(model.half, model.setup)->evaluate({&design, 1}, path)[0];
      const Points got = prepare(reordered.half, reordered.setup)->evaluate({&design, 1}, path)[0];
      for (std::size_t i = 0; i < order.size(); ++i) EXPECT_LT(test::distance(got[i], expected[order[i]]), 1e-11) << order[i];
    }
  }
}

TEST(Symmetry, EverySolverAndShapeDeformsAsTheWholeModel) {
  for (const Kernel kernel : {Kernel::gaussian, Kernel::multiquadric, Kernel::inverse_multiquadric, Kernel::wendland_c2}) {
    for (const Solver solver : {Solver::automatic, Solver::ldlt}) {
      HalfModel half(2, test::Frame{});
      auto& options = std::get<RbfOptions>(half.setup.method);
      options.kernel = kernel;
      options.solver = solver;
      options.shape = kernel == Kernel::wendland_c2 ? 0 : 0.1;
      const WholeModel whole(half);
      const Points got = prepare(half.half, half.setup)->evaluate(half.design());
      const Points expected = prepare(whole.whole, whole.setup)->evaluate(whole.design);
      EXPECT_LT(distance_of_half(got, expected), 1e-10 * diagonal(*half.half))
          << properties(kernel).name << " " << to_string(solver);
    }
  }
}

TEST(Symmetry, IterativeSolverTakesImagesAsCentres) {
  for (std::size_t planes = 1; planes <= 3; ++planes) {
    HalfModel half(planes, test::oblique());
    auto& options = std::get<RbfOptions>(half.setup.method);
    const Points dense = prepare(half.half, half.setup)->evaluate(half.design());
    options.solver = Solver::iterative;
    options.tolerance = 1e-8;
    const auto system = prepare(half.half, half.setup);
    const Points got = system->evaluate(half.design());
    const double D = diagonal(*half.half);
    EXPECT_LT(test::distance(got, dense), 1e-6 * D);
    EXPECT_LE(half.out_of_planes(got), 1e-15 * D);
    const Design affine{{}, {{0, sliding_motion(half)}}};
    const Points basis = system->evaluate({&affine, 1}, EvaluationPath::basis)[0];
    const Points direct = system->evaluate({&affine, 1}, EvaluationPath::direct)[0];
    EXPECT_LT(test::distance(basis, direct), 1e-6 * D);
    EXPECT_LE(half.out_of_planes(basis), 1e-15 * D);
  }
}

TEST(Symmetry, BasisEqualsDirectSolve) {
  for (const auto& frame : {test::Frame{}, test::oblique()}) {
    for (std::size_t planes = 1; planes <= 3; ++planes) {
      const HalfModel half(planes, frame);
      const auto system = prepare(half.half, half.setup);
      EXPECT_EQ(system->info().basis_fields, 4u);
      const Design affine{{}, {{0, sliding_motion(half)}}};
      const std::vector<Design> both{affine, half.design(), affine};
      const Points basis = system->evaluate({&affine, 1}, EvaluationPath::basis)[0];
      const Points direct = system->evaluate({&affine, 1}, EvaluationPath::direct)[0];
      const double D = diagonal(*half.half);
      EXPECT_LT(test::distance(basis, direct), 1e-11 * D);
      EXPECT_GT(test::distance(basis, half.half->points), 0.05);
      EXPECT_LE(half.out_of_planes(basis), 1e-15 * D);
      // Populations of mixed paths give the same bits.
      const std::vector<Points> population = system->evaluate(both, EvaluationPath::automatic);
      EXPECT_EQ(population[0], basis);
      EXPECT_EQ(population[2], basis);
      EXPECT_EQ(population[1], system->evaluate(half.design()));
      const auto evaluation = system->bind(both, EvaluationPath::direct, {});
      for (std::size_t i = 0; i < both.size(); ++i) EXPECT_LT(evaluation->report(i).interpolation_residual, 1e-11 * D);
      EXPECT_LT(system->bind(both, EvaluationPath::automatic, {})->report(0).interpolation_residual, 1e-11 * D);
      EXPECT_GT(evaluation->report(1).prescribed_displacement, 0.05);
    }
  }
}

// The fields of a handle on a plane are smooth across it, so that the basis has the digits of the direct path.
TEST(Symmetry, BasisHasTheDigitsOfTheDirectPath) {
  for (const auto& frame : {test::Frame{}, test::oblique()}) {
    for (const Kernel kernel : {Kernel::triharmonic, Kernel::quintic}) {
      Mesh half = test::bumpy_sheet(61, 31);
      for (Vec3& x : half.points) x = frame.point(x);
      deform::Setup setup;
      setup.handles = {{"end", {Region::Ids{}}}};
      setup.fixed = {{Region::Ids{}}};
      for (PointId id = 0; id < half.point_count(); ++id) {
        const PointId column = id % 61;
        if (column >= 30) std::get<Region::Ids>(setup.handles[0].region.kind).ids.push_back(id);
        if (column <= 8) std::get<Region::Ids>(setup.fixed[0].kind).ids.push_back(id);
      }
      setup.symmetry = {{SymmetryPlane::Plane{frame.origin, frame.axes[1]}}};
      use(setup, kernel, -1);
      setup.variables = {{"turn", "end", DesignVariable::Rotate{frame.axes[1], frame.point({1.5, 0.3, 0})}},
                         {"wider", "end", DesignVariable::Scale{frame.origin, frame.axes[1]}},
                         {"up", "end", DesignVariable::Translate{frame.axes[2]}}};
      const auto mesh = std::make_shared<const Mesh>(half);
      const auto system = prepare(mesh, setup);
      const Design design{{0.2, 0.3, 0.1}, {}};
      const Points basis = system->evaluate({&design, 1}, EvaluationPath::basis)[0];
      const Points direct = system->evaluate({&design, 1}, EvaluationPath::direct)[0];
      EXPECT_LT(test::distance(basis, direct), 1e-10 * diagonal(half)) << properties(kernel).name;
      EXPECT_GT(test::distance(basis, half.points), 0.05);
    }
  }
}

deform::Setup with_variables(const HalfModel& half) {
  deform::Setup setup = half.setup;
  const auto& frame = half.frame;
  setup.variables.push_back({"stretch", "corner", DesignVariable::Scale{frame.origin, frame.axes[0]}, -0.5, 0.5});
  if (half.planes < 3) setup.variables.push_back({"along", "corner", DesignVariable::Translate{frame.axes[2]}, -0.5, 0.5});
  if (half.planes < 2) {
    setup.variables.push_back({"turn", "corner", DesignVariable::Rotate{frame.axes[0], frame.origin}, -0.5, 0.5});
  }
  return setup;
}

TEST(Symmetry, DerivativesAreThoseOfTheDeformation) {
  for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
    for (std::size_t planes = 1; planes <= 3; ++planes) {
      const HalfModel half(planes, test::oblique());
      deform::Setup setup = with_variables(half);
      std::get<RbfOptions>(setup.method).basis = basis;
      const auto system = prepare(half.half, setup);
      const std::size_t count = setup.variables.size();
      std::mt19937_64 random(7);
      std::uniform_real_distribution<double> uniform(-1, 1);
      std::vector<double> at(count), direction(count);
      for (std::size_t k = 0; k < count; ++k) {
        at[k] = 0.1 * uniform(random);
        direction[k] = uniform(random);
      }
      const auto moved = [&](double t) {
        std::vector<double> values = at;
        for (std::size_t k = 0; k < count; ++k) values[k] += t * direction[k];
        return system->evaluate(Design{values, {}});
      };
      const double h = 1e-5;
      const Points high = moved(h), low = moved(-h), derivative = system->jacobian_vector(at, direction, {});
      Points cotangent(derivative.size());
      double product = 0;
      for (std::size_t i = 0; i < derivative.size(); ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
          EXPECT_NEAR(derivative[i][k], (high[i][k] - low[i][k]) / (2 * h), 1e-9);
          cotangent[i][k] = uniform(random);
          product += cotangent[i][k] * derivative[i][k];
        }
      }
      const std::vector<double> gradient = system->vector_jacobian(at, cotangent, {});
      double same = 0;
      for (std::size_t k = 0; k < count; ++k) same += gradient[k] * direction[k];
      EXPECT_NEAR(same, product, 1e-11 * std::max(1.0, std::abs(product)));
    }
  }
}

TEST(Symmetry, RandomModels) {
  for (std::uint64_t seed = 2; seed < 12; ++seed) {
    HalfModel half(1 + seed % 3, seed % 2 == 0 ? test::Frame{} : test::oblique(), seed, 4 + seed % 2);
    use(half.setup, methods[seed % methods.size()].kernel, methods[seed % methods.size()].degree);
    const WholeModel whole(half);
    const Points got = prepare(half.half, half.setup)->evaluate(half.design());
    const double D = diagonal(*half.half);
    EXPECT_LT(distance_of_half(got, prepare(whole.whole, whole.setup)->evaluate(whole.design)), 1e-10 * D) << seed;
    EXPECT_LE(half.out_of_planes(got), 1e-15 * D) << seed;
  }
}

TEST(Symmetry, PlaneIsFoundFromAPatch) {
  for (std::size_t planes = 1; planes <= 3; ++planes) {
    HalfModel half(planes, test::oblique());
    const Points expected = prepare(half.half, half.setup)->evaluate(half.design());
    for (std::size_t k = 0; k < planes; ++k) {
      Region::Ids patch;
      for (std::size_t i = 0; i < half.mask.size(); ++i) {
        if ((half.mask[i] >> k & 1u) != 0) patch.ids.push_back(static_cast<PointId>(i));
      }
      half.setup.symmetry[k] = {Region{patch}};
    }
    const auto system = prepare(half.half, half.setup);
    EXPECT_LT(test::distance(system->evaluate(half.design()), expected), 1e-12);
    EXPECT_LE(half.out_of_planes(system->evaluate(half.design())), 1e-14);
    EXPECT_THAT(system->info().notes, testing::Contains("Symmetry: plane 1 holds 25 points, 13 of them centres."));
  }
}

// As files with single precision have them.
TEST(Symmetry, PointsOfAPatchKeepTheirDistance) {
  HalfModel half(1, test::Frame{});
  Mesh mesh = *half.half;
  Region::Ids patch;
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    if (half.mask[i] == 0) continue;
    mesh.points[i][0] += 1e-7 * std::sin(static_cast<double>(i));
    patch.ids.push_back(static_cast<PointId>(i));
  }
  const auto rough = test::shared(mesh);
  test::expect_error(ErrorCode::invalid_argument, {"symmetry[0]", "points lie beyond the plane", "`region`"},
                     [&] { prepare(rough, half.setup); });
  half.setup.symmetry[0] = {Region{patch}};
  const Points got = prepare(rough, half.setup)->evaluate(half.design());
  for (const PointId id : patch.ids) EXPECT_NEAR(got[id][0], mesh.points[id][0], 1e-14);
  HalfModel smooth(1, test::Frame{});
  EXPECT_LT(test::distance(got, prepare(smooth.half, smooth.setup)->evaluate(smooth.design())), 1e-5);
}

TEST(Symmetry, EverythingInThePlaneStaysInIt) {
  const auto mesh = test::shared(test::bumpy_sheet(9, 5));
  Mesh flat = *mesh;
  for (Vec3& p : flat.points) p[2] = 0.25;
  deform::Setup setup = test::sheet_setup();
  setup.symmetry = {{SymmetryPlane::Plane{{0, 0, 0.25}, {0, 0, -2}}}};
  const auto system = prepare(test::shared(flat), setup);
  const Points got = system->evaluate(Design{{}, {{0, Affine{1, 0, 0, 0.1, 0, 1, 0, 0.2, 0, 0, 3, -0.5}}}});
  EXPECT_GT(test::distance(got, flat.points), 0.2);
  for (const Vec3& p : got) EXPECT_EQ(p[2], 0.25);
}

TEST(Symmetry, EstimateIsEnough) {
  for (std::size_t planes = 1; planes <= 3; ++planes) {
    for (const Solver solver : {Solver::automatic, Solver::ldlt, Solver::iterative}) {
      HalfModel half(planes, test::Frame{});
      std::get<RbfOptions>(half.setup.method).solver = solver;
      const Estimate expected = estimate(*half.half, half.setup);
      const SystemInfo info = prepare(half.half, half.setup)->info();
      EXPECT_EQ(expected.centres, info.centres);
      EXPECT_GE(expected.factor_bytes, info.factor_bytes);
      EXPECT_EQ(expected.basis_bytes, info.basis_bytes);
      EXPECT_GE(expected.resident_bytes, info.bytes);
      EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
      EXPECT_GT(expected.seconds, 0);
      EXPECT_EQ(info.polynomial_terms, planes == 3 && solver != Solver::iterative ? 3u : 4u);
      EXPECT_EQ(info.affine_hull_dimension, 3);
      const std::string note = "Symmetry: plane 1 holds 25 points, 13 of them centres.";
      EXPECT_THAT(expected.notes, testing::Contains(note));
      EXPECT_THAT(info.notes, testing::Contains(note));
    }
  }
}

// A 2D mesh and its lower half, cut along a line of points.
TEST(Symmetry, LineOfAFlatMesh) {
  const auto sheet = [](std::size_t rows, double low) {
    Mesh mesh = test::bumpy_sheet(13, rows);
    for (Vec3& p : mesh.points) p = {p[0], low + (0.5 - low) * p[1], 0};
    return mesh;
  };
  const auto half = test::shared(sheet(5, 0)), whole = test::shared(sheet(9, -0.5));
  deform::Setup setup = test::sheet_setup();
  std::get<RbfOptions>(setup.method).kernel = Kernel::thin_plate;
  const Affine stretched{1.1, 0, 0, 0, 0, 1.5, 0, 0, 0, 0, 1, 0};
  const Points expected = prepare(whole, setup)->evaluate(Design{{}, {{0, stretched}}});
  Region::Ids line;
  for (PointId i = 0; i < 13; ++i) line.ids.push_back(i);
  setup.symmetry = {{Region{line}}};
  const Points got = prepare(half, setup)->evaluate(Design{{}, {{0, stretched}}});
  EXPECT_LT(test::distance(got, Points(expected.begin() + 13 * 4, expected.end())), 1e-10);
  for (const PointId id : line.ids) EXPECT_EQ(got[id][1], 0);
}

struct Refusal {
  const char* name;
  std::function<void(HalfModel&)> spoil;
  std::vector<const char*> parts;
};

TEST(Symmetry, RefusesPlanesThatCannotBe) {
  const auto plane = [](const Vec3& point, const Vec3& normal) { return SymmetryPlane{SymmetryPlane::Plane{point, normal}}; };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Refusal> table = {
      {"no normal",
       [&](HalfModel& m) {
         m.setup.symmetry = {plane({0, 0, 0}, {0, 0, 0})};
       },
       {"symmetry[0].normal"}},
      {"not finite",
       [&](HalfModel& m) {
         m.setup.symmetry = {plane({0, nan, 0}, {0, 0, 1})};
       },
       {"symmetry[0].point"}},
      {"oblique to each other",
       [&](HalfModel& m) {
         m.setup.symmetry[1] = plane(m.frame.origin, {1e-8, 1, 0});
       },
       {"symmetry[1]", "not orthogonal to symmetry[0]", "1e-08", "1e-09"}},
      {"twice", [&](HalfModel& m) { m.setup.symmetry[1] = m.setup.symmetry[0]; }, {"symmetry[1]", "not orthogonal"}},
      {"four", [&](HalfModel& m) { m.setup.symmetry.resize(4, m.setup.symmetry[0]); }, {"symmetry[3]", "at most 3"}},
      {"both sides",
       [&](HalfModel& m) {
         m.setup.symmetry[0] = plane({0.55, 0, 0}, {1, 0, 0});
       },
       {"symmetry[0]", "points lie beyond the plane", "the first is point", "at a distance of"}},
      {"unknown patch",
       [&](HalfModel& m) { m.setup.symmetry[1] = {Region{Region::GroupName{"sym"}}}; },
       {"symmetry[1].region", "sym"}},
      {"two points",
       [&](HalfModel& m) {
         m.setup.symmetry[0] = {Region{Region::Ids{{0, 5}}}};
       },
       {"symmetry[0].region", "2 points"}},
      {"not a plane",
       [&](HalfModel& m) { m.setup.symmetry[0] = {Region{Region::All{}}}; },
       {"symmetry[0].region", "do not lie in one plane", "point", "away", "1e-06"}},
  };
  for (const Refusal& refusal : table) {
    SCOPED_TRACE(refusal.name);
    HalfModel model(2, test::Frame{});
    refusal.spoil(model);
    test::expect_error(ErrorCode::invalid_argument, refusal.parts, [&] { prepare(model.half, model.setup); });
    test::expect_error(ErrorCode::invalid_argument, refusal.parts, [&] { estimate(*model.half, model.setup); });
  }
}

TEST(Symmetry, RefusesMotionsOutOfThePlane) {
  HalfModel half(2, test::Frame{});
  half.setup.variables.push_back({"away", "corner", DesignVariable::Translate{{0, 1, 0}}});
  half.setup.variables.push_back({"along", "corner", DesignVariable::Translate{{0, 0, 1}}});
  const auto system = prepare(half.half, half.setup);
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "point 0", "\"corner\"", "symmetry[1]", "0.01", "`difference`"},
                     [&] {
                       system->evaluate(Design{{0.01, 0}, {}});
                     });
  Design design = half.design();
  auto& u = std::get<std::vector<Vec3>>(design.motions[0].value);
  u[1][1] = -0.002;  // on the second plane only
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "point 1 ", "symmetry[1]", "-0.002"},
                     [&] { system->evaluate(design); });
  u[1][1] = 1e-9;
  EXPECT_EQ(half.out_of_planes(system->evaluate(design)), 0);
  const std::vector<double> at{0, 0.1}, away{1, 0}, along{0, 1};
  test::expect_error(ErrorCode::invalid_argument, {"direction", "point 0", "symmetry[1]"},
                     [&] { system->jacobian_vector(at, away, {}); });
  EXPECT_NO_THROW(system->jacobian_vector(at, along, {}));
  test::expect_error(ErrorCode::invalid_argument, {"variable \"away\"", "point 0", "symmetry[1]"},
                     [&] { system->vector_jacobian(at, half.half->points, {}); });
}

}  // namespace
}  // namespace deform::symmetry_test
