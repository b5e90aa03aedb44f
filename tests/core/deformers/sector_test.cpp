// SPDX-License-Identifier: GPL-3.0-or-later
// Sectors of wheels: they deform as the whole wheel does, periodic boundaries stay periodic, and what does not fit is refused.
#include "core/deformers/handles/sector.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "core/deformers/system.h"
#include "tests/core/deformers/shapes.h"
#include "tests/core/deformers/wheel.h"
#include "tests/support/expect_error.h"

namespace deform::sector_test {
namespace {

using test::SectorModel;
using test::SectorShape;
using test::WholeWheel;

double distance_of_first(const Points& sector, const Points& whole) {
  return test::distance(sector, Points(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(sector.size())));
}

double diagonal(const Mesh& mesh) { return bounding_box(mesh.points).diagonal(); }

RbfOptions& options(deform::Setup& setup) { return std::get<RbfOptions>(setup.method); }

struct Method {
  Kernel kernel;
  int degree;
};
const std::vector<Method> sector_methods = {{Kernel::triharmonic, 1}, {Kernel::triharmonic, 2}, {Kernel::biharmonic, 0},
                                            {Kernel::biharmonic, 1},  {Kernel::quintic, 2},     {Kernel::wendland_c2, -1}};

void use_method(deform::Setup& setup, const Method& method) {
  options(setup).kernel = method.kernel;
  options(setup).polynomial_degree = method.degree;
  options(setup).reduction = CentreReduction::off;
  if (method.kernel == Kernel::wendland_c2) options(setup).shape = 0.4;
}

TEST(Sector, DeformsAsTheWholeWheel) {
  for (const auto& frame : {test::Frame{}, test::oblique()}) {
    for (const std::size_t count : {2, 3, 4, 7, 36}) {
      for (const double hub : {0.4, 0.0}) {
        for (const Method& method : sector_methods) {
          if (count == 36 && method.kernel != Kernel::triharmonic) continue;
          SectorModel model({count, hub, count, count == 36 ? 2u : 3u, 3, 2}, frame);
          use_method(model.setup, method);
          const WholeWheel whole(model);
          const auto system = prepare(model.sector, model.setup);
          const auto wheel = prepare(whole.wheel, whole.setup);
          const double D = diagonal(*model.sector);
          SCOPED_TRACE(std::to_string(count) + " sectors, hub " + std::to_string(hub) + ", " + properties(method.kernel).name +
                       " " + std::to_string(method.degree));
          for (const bool affine : {false, true}) {
            const Points got = system->evaluate(affine ? model.affine_design() : model.design());
            const Points expected = wheel->evaluate(affine ? whole.affine_design : whole.design);
            EXPECT_LT(distance_of_first(got, expected), 1e-10 * D);
            EXPECT_GT(test::distance(got, model.sector->points), 0.02);
            EXPECT_LE(model.out_of_turn(got), 1e-14 * (D + norm(frame.origin)));
          }
        }
      }
    }
  }
}

TEST(Sector, EveryKernelWithAShapeDeformsAsTheWholeWheel) {
  for (const Kernel kernel : {Kernel::gaussian, Kernel::multiquadric, Kernel::inverse_multiquadric, Kernel::wendland_c2}) {
    SectorModel model({5, 0.4, 3, 3, 3, 2}, test::oblique());
    use_method(model.setup, {kernel, -1});
    options(model.setup).shape = kernel == Kernel::wendland_c2 ? 0 : 0.1;
    const WholeWheel whole(model);
    const Points got = prepare(model.sector, model.setup)->evaluate(model.design());
    const Points expected = prepare(whole.wheel, whole.setup)->evaluate(whole.design);
    EXPECT_LT(distance_of_first(got, expected), 1e-10 * diagonal(*model.sector)) << properties(kernel).name;
  }
}

TEST(Sector, IterativeSolverTakesAllImagesAsCentres) {
  for (const std::size_t count : {2, 3, 7}) {
    for (const double hub : {0.4, 0.0}) {
      SectorModel model({count, hub, 1}, test::oblique());
      const Points dense = prepare(model.sector, model.setup)->evaluate(model.design());
      options(model.setup).solver = Solver::iterative;
      options(model.setup).tolerance = 1e-8;
      const auto system = prepare(model.sector, model.setup);
      const double D = diagonal(*model.sector);
      const std::vector<Design> both{model.design(), model.affine_design()};
      for (const EvaluationPath path : {EvaluationPath::automatic, EvaluationPath::direct}) {
        const auto evaluation = system->bind(both, path, {});
        const std::vector<Points> got = system->evaluate(both, path);
        EXPECT_LT(test::distance(got[0], dense), 1e-7 * D);
        EXPECT_LE(model.out_of_turn(got[0]), 1e-14 * (D + norm(model.frame.origin)));
        EXPECT_LE(model.out_of_turn(got[1]), 1e-14 * (D + norm(model.frame.origin)));
        EXPECT_TRUE(evaluation->report(0).converged);
        EXPECT_GE(2 * evaluation->report(0).error, test::distance(got[0], dense));
      }
      const std::vector<Points> on_basis = system->evaluate({&both[1], 1}, EvaluationPath::basis);
      EXPECT_LT(test::distance(on_basis[0], system->evaluate({&both[1], 1}, EvaluationPath::direct)[0]), 1e-7 * D);
    }
  }
}

TEST(Sector, BasisEqualsDirectSolve) {
  for (const std::size_t count : {2, 3, 8}) {
    for (const double hub : {0.4, 0.0}) {
      const SectorModel model({count, hub, 2}, test::oblique());
      const auto system = prepare(model.sector, model.setup);
      EXPECT_EQ(system->info().basis_fields, 4u);
      const Design affine = model.affine_design();
      const std::vector<Design> both{affine, model.design(), affine};
      const Points basis = system->evaluate({&affine, 1}, EvaluationPath::basis)[0];
      const Points direct = system->evaluate({&affine, 1}, EvaluationPath::direct)[0];
      const double D = diagonal(*model.sector);
      EXPECT_LT(test::distance(basis, direct), 1e-11 * D);
      EXPECT_LE(model.out_of_turn(basis), 1e-14 * (D + norm(model.frame.origin)));
      // Populations of mixed paths give the same bits.
      const std::vector<Points> population = system->evaluate(both, EvaluationPath::automatic);
      EXPECT_EQ(population[0], basis);
      EXPECT_EQ(population[2], basis);
      EXPECT_EQ(population[1], system->evaluate(model.design()));
      const auto evaluation = system->bind(both, EvaluationPath::direct, {});
      for (std::size_t i = 0; i < both.size(); ++i) {
        EXPECT_LT(evaluation->report(i).interpolation_residual, 1e-11 * D);
        EXPECT_LT(evaluation->report(i).error, 1e-10 * D);
        EXPECT_GT(evaluation->report(i).prescribed_displacement, 0.05);
      }
      const auto on_basis = system->bind(both, EvaluationPath::automatic, {});
      EXPECT_LT(on_basis->report(0).interpolation_residual, 1e-11 * D);
      EXPECT_LT(on_basis->report(0).error, 1e-10 * D);
    }
  }
}

deform::Setup with_variables(const SectorModel& model) {
  deform::Setup setup = model.setup;
  const auto& frame = model.frame;
  setup.variables = {{"stretch", "blade", DesignVariable::Scale{frame.origin, frame.axes[1]}, -0.5, 0.5},
                     {"lift", "blade", DesignVariable::Translate{frame.axes[2]}, -0.5, 0.5},
                     {"stagger", "blade", DesignVariable::Rotate{frame.axes[1], frame.point({0.4, 0.7, 0})}, -0.5, 0.5}};
  return setup;
}

TEST(Sector, DerivativesAreThoseOfTheDeformation) {
  for (const Solver solver : {Solver::automatic, Solver::iterative}) {
    for (const BasisMode basis : {BasisMode::always, BasisMode::never}) {
      for (const std::size_t count : {2, 5}) {
        for (const double hub : {0.4, 0.0}) {
          const SectorModel model({count, hub, 1}, test::oblique());
          deform::Setup setup = with_variables(model);
          options(setup).basis = basis;
          options(setup).solver = solver;
          options(setup).tolerance = solver == Solver::iterative ? 1e-9 : 0;
          const auto system = prepare(model.sector, setup);
          const std::vector<double> at{0.1, -0.05, 0.07}, direction{0.3, 1, -0.4};
          const auto moved = [&](double t) {
            std::vector<double> values = at;
            for (std::size_t k = 0; k < at.size(); ++k) values[k] += t * direction[k];
            return system->evaluate(Design{values, {}});
          };
          const double h = 1e-4, near = solver == Solver::iterative ? 1e-5 : 1e-8;
          const Points high = moved(h), low = moved(-h), derivative = system->jacobian_vector(at, direction, {});
          std::mt19937_64 random(7);
          std::uniform_real_distribution<double> uniform(-1, 1);
          Points cotangent(derivative.size());
          double product = 0;
          for (std::size_t i = 0; i < derivative.size(); ++i) {
            for (std::size_t k = 0; k < 3; ++k) {
              EXPECT_NEAR(derivative[i][k], (high[i][k] - low[i][k]) / (2 * h), near);
              cotangent[i][k] = uniform(random);
              product += cotangent[i][k] * derivative[i][k];
            }
          }
          const std::vector<double> gradient = system->vector_jacobian(at, cotangent, {});
          double same = 0;
          for (std::size_t k = 0; k < at.size(); ++k) same += gradient[k] * direction[k];
          EXPECT_NEAR(same, product, (solver == Solver::iterative ? 1e-9 : 1e-11) * std::max(1.0, std::abs(product)));
        }
      }
    }
  }
}

// A hub that slides along the axis and a casing that turns about it have points on both periodic boundaries.
TEST(Sector, HandlesMayHoldPartners) {
  SectorModel model({6, 0.4, 2}, test::oblique());
  const WholeWheel whole(model);
  Region::Ids hub, casing;
  for (std::size_t i = 0; i <= model.shape.around; ++i) {
    for (std::size_t k = 0; k <= model.shape.along; ++k) {
      hub.ids.push_back(model.at_grid(i, 0, k));
      casing.ids.push_back(model.at_grid(i, model.shape.outwards, k));
    }
  }
  model.setup.fixed.clear();
  model.setup.handles.push_back({"hub", {hub}});
  model.setup.handles.push_back({"casing", {casing}});
  const auto& frame = model.frame;
  model.setup.variables = {{"slide", "hub", DesignVariable::Translate{frame.axes[0]}},
                           {"turn", "casing", DesignVariable::Rotate{frame.axes[0], frame.origin}},
                           {"grow", "casing", DesignVariable::Scale{frame.origin, {}}},
                           {"aside", "hub", DesignVariable::Translate{frame.axes[1]}}};
  const auto system = prepare(model.sector, model.setup);
  const double D = diagonal(*model.sector);
  const Points got = system->evaluate(Design{{0.1, 0.2, 0.05, 0}, {}});
  EXPECT_LE(model.out_of_turn(got), 1e-14 * (D + norm(frame.origin)));
  EXPECT_GT(test::distance(got, model.sector->points), 0.05);
  // Against the whole wheel, whose hub and casing are one handle each.
  deform::Setup setup = model.setup;
  setup.symmetry.clear();
  for (Handle& handle : setup.handles) {
    Region::Ids all;
    for (const auto& images : whole.image_of) {
      for (const PointId id : std::get<Region::Ids>(handle.region.kind).ids) all.ids.push_back(images[id]);
    }
    handle.region = {all};
  }
  const Points expected = prepare(whole.wheel, setup)->evaluate(Design{{0.1, 0.2, 0.05, 0}, {}});
  EXPECT_LT(distance_of_first(got, expected), 1e-10 * D);

  const std::vector<double> rest{0, 0, 0, 0}, aside{0, 0, 0, 1}, turn{0, 1, 0, 0};
  test::expect_error(ErrorCode::invalid_argument,
                     {"designs[0]", "\"hub\"", "partners on the periodic boundaries", "`difference`"}, [&] {
                       system->evaluate(Design{aside, {}});
                     });
  test::expect_error(ErrorCode::invalid_argument, {"direction", "\"hub\"", "partners"},
                     [&] { system->jacobian_vector(rest, aside, {}); });
  EXPECT_NO_THROW(system->jacobian_vector(rest, turn, {}));
  test::expect_error(ErrorCode::invalid_argument, {"variable \"aside\"", "\"hub\""},
                     [&] { system->vector_jacobian(rest, model.sector->points, {}); });
}

// A passage between two blades: the suction side of one and the pressure side of the next, on the periodic boundaries.
TEST(Sector, SidesOfABladeMoveAsImagesOfEachOther) {
  SectorModel model({9, 0.4, 2}, test::oblique());
  Region::Ids suction, pressure;
  for (std::size_t k = 1; k < model.shape.along; ++k) {
    for (std::size_t j = 1; j + 1 < model.shape.outwards; ++j) {
      suction.ids.push_back(model.at_grid(0, j, k));
      pressure.ids.push_back(model.at_grid(model.shape.around, j, k));
    }
  }
  model.setup.handles = {{"suction", {suction}}, {"pressure", {pressure}}};
  const auto system = prepare(model.sector, model.setup);
  const Affine motion = model.motion(), next = test::turned_motion(model, motion, 1);
  const Points got = system->evaluate(Design{{}, {{0, motion}, {1, next}}});
  EXPECT_LE(model.out_of_turn(got), 1e-14 * (diagonal(*model.sector) + norm(model.frame.origin)));
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "\"suction\"", "\"pressure\"", "partners"}, [&] {
    system->evaluate(Design{{}, {{0, motion}, {1, motion}}});
  });
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "partners"}, [&] {
    system->evaluate(Design{{}, {{0, motion}}});
  });
}

TEST(Sector, PointsOnTheAxisStayOnIt) {
  SectorModel model({5, 0, 2}, test::oblique());
  model.setup.handles.push_back({"shaft", {Region::Ids{{model.axis[0], model.axis[1]}}}});
  model.setup.variables = {{"along", "shaft", DesignVariable::Translate{model.frame.axes[0]}},
                           {"off", "shaft", DesignVariable::Translate{model.frame.axes[1]}}};
  const auto system = prepare(model.sector, model.setup);
  const std::vector<double> rest{0, 0}, along{0.05, 0}, off{0, 0.05};
  const Points got = system->evaluate(Design{along, {}});
  EXPECT_LE(model.out_of_turn(got), 1e-14 * (diagonal(*model.sector) + norm(model.frame.origin)));
  EXPECT_NEAR(distance(got[model.axis[0]], model.sector->points[model.axis[0]]), 0.05, 1e-12);
  EXPECT_GT(distance(got[model.axis[3]], model.sector->points[model.axis[3]]), 1e-5);
  test::expect_error(ErrorCode::invalid_argument, {"designs[0]", "\"shaft\"", "axis"}, [&] {
    system->evaluate(Design{off, {}});
  });
  test::expect_error(ErrorCode::invalid_argument, {"direction", "\"shaft\"", "axis"},
                     [&] { system->jacobian_vector(rest, off, {}); });
}

// As files with few digits have them.
TEST(Sector, PartnersKeepTheirOffset) {
  SectorModel model({7, 0.4, 1}, test::Frame{});
  Mesh rough = *model.sector;
  for (std::size_t p = 0; p < model.highs.size(); ++p) rough.points[model.highs[p]][1] += 2e-7 * std::sin(static_cast<double>(p));
  const auto system = prepare(test::shared(rough), model.setup);
  const Points got = system->evaluate(model.design());
  for (std::size_t p = 0; p < model.highs.size(); ++p) {
    const Vec3 low = got[model.lows[p]] - rough.points[model.lows[p]], high = got[model.highs[p]] - rough.points[model.highs[p]];
    EXPECT_LT(distance(high, model.turned_point(model.frame.origin + low, 1) - model.frame.origin), 1e-14);
    EXPECT_GT(norm(low) + (model.sector->points[model.lows[p]] == got[model.lows[p]] ? 1 : 0), 1e-6);
  }
}

TEST(Sector, FewCentresMeetTheirTolerance) {
  SectorModel model({12, 0.4, 2, 8, 10, 8}, test::Frame{});
  options(model.setup).reduction = CentreReduction::off;
  const Points all = prepare(model.sector, model.setup)->evaluate(model.affine_design());
  options(model.setup).reduction = CentreReduction::rings;
  options(model.setup).reduction_rings = 2;
  const Points rings = prepare(model.sector, model.setup)->evaluate(model.affine_design());
  const double D = diagonal(*model.sector);
  EXPECT_LT(test::distance(all, rings), 0.01 * D);
  EXPECT_LE(model.out_of_turn(rings), 1e-14 * D);
}

TEST(Sector, EstimateIsEnough) {
  for (const std::size_t count : {2, 3, 20}) {
    for (const Solver solver : {Solver::automatic, Solver::ldlt, Solver::iterative}) {
      SectorModel model({count, 0.4, 1}, test::Frame{});
      options(model.setup).solver = solver;
      const Estimate expected = estimate(*model.sector, model.setup);
      const SystemInfo info = prepare(model.sector, model.setup)->info();
      EXPECT_EQ(expected.centres, info.centres);
      EXPECT_GE(expected.factor_bytes, info.factor_bytes);
      EXPECT_EQ(expected.basis_bytes, info.basis_bytes);
      EXPECT_GE(expected.resident_bytes, info.bytes);
      EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
      EXPECT_GT(expected.seconds, 0);
      EXPECT_EQ(info.solver, solver == Solver::iterative ? Solver::iterative : Solver::ldlt);
      const std::string note =
          "Sector: one of " + std::to_string(count) + "; 20 pairs of points on the periodic boundaries, 0 points on the axis.";
      EXPECT_THAT(expected.notes, testing::Contains(note));
      EXPECT_THAT(info.notes, testing::Contains(note));
    }
  }
}

struct Refusal {
  const char* name;
  std::function<void(SectorModel&)> spoil;
  std::vector<const char*> parts;
};

void spoil_mesh(SectorModel& model, const std::function<void(Mesh&)>& change) {
  Mesh mesh = *model.sector;
  change(mesh);
  model.sector = test::shared(std::move(mesh));
}

SectorOptions& sector_of(SectorModel& model) { return std::get<SectorOptions>(model.setup.symmetry[0].kind); }

TEST(Sector, RefusesWhatCannotBe) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Refusal> table = {
      {"no axis", [](SectorModel& m) { sector_of(m).axis = {}; }, {"symmetry[0].sector.axis", "must not be zero"}},
      {"axis not finite", [&](SectorModel& m) { sector_of(m).axis[1] = nan; }, {"symmetry[0].sector.axis", "finite"}},
      {"origin", [&](SectorModel& m) { sector_of(m).origin[2] = nan; }, {"symmetry[0].sector.origin", "finite"}},
      {"one sector",
       [](SectorModel& m) { sector_of(m).count = 1; },
       {"symmetry[0].sector.count", "1 is out of range", "2 to 10000"}},
      {"too many", [](SectorModel& m) { sector_of(m).count = 10001; }, {"symmetry[0].sector.count", "10001"}},
      {"a plane besides",
       [](SectorModel& m) {
         m.setup.symmetry.push_back({SymmetryPlane::Plane{{}, {0, 0, 1}}});
       },
       {"symmetry[0].sector", "planes"}},
      {"two sectors",
       [](SectorModel& m) { m.setup.symmetry.push_back(m.setup.symmetry[0]); },
       {"symmetry[0].sector", "other sectors"}},
      {"three patches",
       [](SectorModel& m) { sector_of(m).periodic.assign(3, Region{Region::All{}}); },
       {"symmetry[0].sector.periodic", "3 regions"}},
      {"unknown patch",
       [](SectorModel& m) { sector_of(m).periodic = {Region{Region::GroupName{"cyclic"}}}; },
       {"symmetry[0].sector.periodic[0]", "cyclic"}},
      {"not a patch",
       [](SectorModel& m) {
         sector_of(m).periodic = {Region{Region::Ids{m.lows}}, Region{Region::All{}}};
       },
       {"symmetry[0].sector.periodic[1]", "has no partner", "away from the nearest point", "others of its points"}},
      {"another count",
       [](SectorModel& m) {
         sector_of(m).count = 8;
         sector_of(m).periodic = {Region{Region::Ids{m.highs}}};
       },
       {"symmetry[0].sector.periodic[0]", "turned by 45 degrees"}},
      {"a point aside",
       [](SectorModel& m) { spoil_mesh(m, [&](Mesh& mesh) { mesh.points[m.at_grid(0, 2, 1)][1] += 1e-4; }); },
       {"symmetry[0].sector: point 9 ", "no partner", "turned by 51.4286 degrees it is 0.0001 away", "all points around it"}},
      {"one partner fixed",
       [](SectorModel& m) { m.setup.fixed.push_back({Region::Ids{{m.at_grid(0, 2, 1)}}}); },
       {"symmetry[0].sector: point 89 is in a fixed region", "point 9,", "`difference`"}},
      {"one partner in the handle",
       [](SectorModel& m) { m.handle_ids().push_back(m.at_grid(m.shape.around, 2, 1)); },
       {"symmetry[0].sector: point 9 is in handle \"blade\"", "point 89,"}},
      {"incremental QR",
       [](SectorModel& m) { options(m.setup).solver = Solver::incremental_qr; },
       {"symmetry[0].sector", "INCREMENTAL_QR"}},
  };
  for (const Refusal& refusal : table) {
    SCOPED_TRACE(refusal.name);
    SectorModel model({7, 0.4, 1}, test::Frame{});
    refusal.spoil(model);
    test::expect_error(ErrorCode::invalid_argument, refusal.parts, [&] { prepare(model.sector, model.setup); });
    test::expect_error(ErrorCode::invalid_argument, refusal.parts, [&] { estimate(*model.sector, model.setup); });
  }
}

TEST(Sector, RefusesMoreThanOneSector) {
  for (const std::size_t count : {2, 6}) {
    const SectorModel model({count, 0.4, 2}, test::Frame{});
    const WholeWheel whole(model);
    deform::Setup setup = model.setup;
    setup.fixed.clear();
    test::expect_error(ErrorCode::invalid_argument, {"symmetry[0].sector", "covers more than one of"},
                       [&] { prepare(whole.wheel, setup); });
  }
}

// The surface of a blade alone has no periodic boundaries.
TEST(Sector, NeedsNoPeriodicBoundaries) {
  const SectorModel model({7, 0.4, 2}, test::Frame{});
  const WholeWheel whole(model);
  Mesh part = *model.sector;
  part.face_sizes = {3};
  part.face_points = {model.handle()[0], model.handle()[1], model.handle()[2]};
  part.elements.reset();
  deform::Setup setup = model.setup;
  Region::Ids inner;
  for (const PointId id : std::get<Region::Ids>(setup.fixed[0].kind).ids) {
    if (std::find(model.highs.begin(), model.highs.end(), id) == model.highs.end()) inner.ids.push_back(id);
  }
  setup.fixed = {{inner}};
  const auto system = prepare(test::shared(std::move(part)), setup);
  EXPECT_THAT(system->info().notes,
              testing::Contains(
                  "Sector: one of 7; 0 pairs of points on the periodic boundaries, 0 points on the axis. If the mesh ends in "
                  "periodic boundaries, `axis` or `count` is wrong: has it none?"));
  const Points got = system->evaluate(model.design());
  EXPECT_LT(distance_of_first(got, prepare(whole.wheel, whole.setup)->evaluate(whole.design)), 1e-10);
}

// A wrong count without `periodic` matches nothing: the note says which one the two sides of the mesh have.
TEST(Sector, AsksForTheCountThatTheMeshHas) {
  for (const std::size_t count : {2, 3, 7, 36}) {
    for (const std::size_t cells : {3, 20}) {  // the latter with more points than are looked at
      for (const double unit : {1.0, 1000.0, 0.001}) {
        const SectorModel model({count, cells == 3 ? 0.0 : 0.4, count, 4, cells, cells}, test::Frame{});
        Points places = model.local;
        for (Vec3& x : places) x = unit * x;
        const auto note = [&](std::size_t given) {
          const SectorOptions options{{}, {1, 0, 0}, static_cast<std::uint32_t>(given)};
          return Sector(options, *model.sector, places, bounding_box(places).diagonal(), "sector").note();
        };
        const std::string pairs = std::to_string(model.lows.size());
        EXPECT_THAT(note(count), testing::AllOf(testing::HasSubstr("; " + pairs + " pairs"), testing::EndsWith("axis.")));
        EXPECT_THAT(note(count + 1), testing::AllOf(testing::HasSubstr("one of " + std::to_string(count + 1) + "; 0 pairs"),
                                                    testing::EndsWith(" With `count` " + std::to_string(count) + " there were " +
                                                                      pairs + ": is the mesh one of so many sectors?")));
      }
    }
  }
}

}  // namespace
}  // namespace deform::sector_test
