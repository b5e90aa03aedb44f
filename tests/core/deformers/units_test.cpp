// SPDX-License-Identifier: GPL-3.0-or-later
// The same model in other units, in other places, and with points that are off by a rounding: every choice that a method makes
// (centres, samples, supports, functions that handles touch, singular values that count) must come out the same, so that results
// differ by rounding only. Powers of two do not show this, since they change no digit; shifts that change no digit of a
// difference change nothing.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "core/mesh/elements.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/core/deformers/half_cages.h"
#include "tests/core/deformers/shapes.h"
#include "tests/support/long_tests.h"

namespace deform::test::units_test {
namespace {

/// A model with two handles and fixed points.
struct Model {
  std::string name;
  Mesh mesh;
  std::vector<PointId> turned, grown, fixed;
  Vec3 axis_at{}, centre{};  ///< of the rotation about z and of the scaling

  void select(const std::function<bool(const Vec3&)>& turned_at, const std::function<bool(const Vec3&)>& grown_at,
              const std::function<bool(const Vec3&)>& fixed_at) {
    for (std::size_t i = 0; i < mesh.points.size(); ++i) {
      const Vec3& x = mesh.points[i];
      const auto id = static_cast<PointId>(i);
      if (turned_at(x)) {
        turned.push_back(id);
      } else if (grown_at(x)) {
        grown.push_back(id);
      } else if (fixed_at(x)) {
        fixed.push_back(id);
      }
    }
  }
};

/// A spiral tube, symmetric about z = 0, which grows and ends in a straight diffuser; rings of `around` points.
Model scroll(std::size_t rings, std::size_t around) {
  Model model;
  model.name = "scroll";
  const std::size_t straight = rings / 3;
  std::vector<Vec3>& points = model.mesh.points;
  for (std::size_t i = 0; i < rings + straight; ++i) {
    const double t =
        0.15 + (2 * std::numbers::pi - 0.15) * static_cast<double>(std::min(i, rings - 1)) / static_cast<double>(rings - 1);
    const double along = i < rings ? 0 : static_cast<double>(i + 1 - rings) / static_cast<double>(straight);
    const double r = (0.012 + 0.028 * t / (2 * std::numbers::pi)) * (1 + 0.4 * along);
    const double from_axis = i < rings ? 0.13 + r : 0.17;
    const Vec3 out{std::cos(t), std::sin(t), 0}, middle = from_axis * out + Vec3{0, 0.25 * along, 0};
    for (std::size_t k = 0; k < around; ++k) {
      const double a = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(around);
      points.push_back(middle + r * std::cos(a) * out + r * std::sin(a) * Vec3{0, 0, 1});
      if (i == 0) continue;
      const std::size_t next = (k + 1) % around, before = (i - 1) * around, here = i * around;
      model.mesh.face_sizes.push_back(4);
      for (const std::size_t id : {before + k, here + k, here + next, before + next}) {
        model.mesh.face_points.push_back(static_cast<PointId>(id));
      }
    }
  }
  model.axis_at = {0.17, 0.25, 0};
  model.centre = {-0.156, 0, 0};
  model.select([](const Vec3& x) { return x[1] > 0.2; }, [](const Vec3& x) { return x[0] < -0.1 && std::abs(x[1]) <= 0.035; },
               [](const Vec3& x) { return x[0] > 0.1 && x[0] < 0.17 && x[1] >= 0 && x[1] <= 0.05; });
  return model;
}

/// The surface of a bent bar of cubes: all distances occur many times.
Model bar() {
  Model model;
  model.name = "bar";
  model.mesh = cubes({18, 8, 4}, 0.07, [](int i, int j, int) { return i < 6 || j < 5; });
  model.axis_at = {1.26, 0.1, 0.1};
  model.centre = {0.2, 0.56, 0.14};
  model.select([](const Vec3& x) { return x[0] > 1.1; }, [](const Vec3& x) { return x[1] > 0.5; },
               [](const Vec3& x) { return x[0] < 0.22 && x[1] < 0.22; });
  return model;
}

/// A cube of hexahedra, of which a part of the lower side and of the upper one move and two sides stay.
Model block() {
  Model model;
  model.name = "block";
  Cube made = cube(9);
  model.mesh = std::move(made.mesh);
  model.mesh.elements = std::make_shared<const Elements>(std::move(made.elements));
  model.axis_at = {0.5, 0.5, 0};
  model.centre = {0.5, 0.5, 1};
  const auto inner = [](const Vec3& x) { return std::abs(x[0] - 0.5) < 0.3 && std::abs(x[1] - 0.5) < 0.3; };
  model.select([inner](const Vec3& x) { return x[2] < 0.01 && inner(x); },
               [inner](const Vec3& x) { return x[2] > 0.99 && inner(x); },
               [](const Vec3& x) { return x[0] < 0.01 || x[0] > 0.99; });
  return model;
}

/// A flat sheet.
Model sheet() {
  Model model;
  model.name = "sheet";
  model.mesh = square(30);
  model.axis_at = {1, 0.5, 0};
  model.centre = {0.5, 1, 0};
  model.select([](const Vec3& x) { return x[0] > 0.89; }, [](const Vec3& x) { return x[1] > 0.89 && x[0] > 0.3 && x[0] < 0.7; },
               [](const Vec3& x) { return x[0] < 0.11; });
  return model;
}

std::vector<Model> models() { return {scroll(48, 16), scroll(36, 12), bar(), block(), sheet()}; }

/// The model in a unit of 1 / `unit`, with normally distributed noise of this fraction of D, then shifted by so many D.
struct Variant {
  double unit = 1, noise = 0;
  unsigned seed = 0;
  Vec3 shift{};
};

/// Where a variant has the places of the model, but for noise.
struct Placed {
  double unit = 1;
  Vec3 shift{};  ///< in its unit
  Vec3 operator()(const Vec3& x) const { return unit * x + shift; }
};

struct Moved {
  std::vector<Vec3> by;  ///< displacements in the unit of the model
  double largest = 0, error = 0;
};

/// Options for a model in a unit and place.
using MakeMethod = std::function<MethodOptions(const Model& model, const Placed& placed)>;

Moved moved(const Model& model, const MakeMethod& method, const Variant& variant) {
  Mesh mesh = model.mesh;
  std::mt19937_64 random(variant.seed);
  const double diagonal = bounding_box(mesh.points).diagonal();
  const Placed placed{variant.unit, variant.unit * diagonal * variant.shift};
  std::normal_distribution<double> normal(0, variant.noise * diagonal);
  for (Vec3& x : mesh.points) {
    if (variant.noise > 0) x = x + Vec3{normal(random), normal(random), normal(random)};
    x = placed(x);
  }
  const auto shared_mesh = std::make_shared<const Mesh>(std::move(mesh));
  Setup setup;
  setup.method = method(model, placed);
  setup.handles = {{"turned", {Region::Ids{model.turned}}}, {"grown", {Region::Ids{model.grown}}}};
  setup.fixed = {{Region::Ids{model.fixed}}};
  const double c = std::cos(0.14), s = std::sin(0.14);
  const Vec3 about = placed(model.axis_at), from = placed(model.centre);
  const Affine turn{c, -s, 0, about[0] - c * about[0] + s * about[1] + 0.03 * variant.unit,
                    s, c,  0, about[1] - s * about[0] - c * about[1],
                    0, 0,  1, 0};
  const Affine grow{1.2, 0, 0, -0.2 * from[0], 0, 1.2, 0, -0.2 * from[1], 0, 0, 1.2, -0.2 * from[2]};
  const Design design{{}, {{0, turn}, {1, grow}}};
  const auto system = prepare(shared_mesh, setup);
  Moved result;
  result.error = system->bind({&design, 1}, EvaluationPath::automatic, {})->report(0).error / variant.unit;
  const Points points = system->evaluate(design);
  for (std::size_t i = 0; i < points.size(); ++i) {
    result.by.push_back((points[i] - shared_mesh->points[i]) / variant.unit);
    result.largest = std::max(result.largest, norm(result.by.back()));
  }
  return result;
}

struct Case {
  std::string name;
  MakeMethod method;
  bool (*takes)(const Model&) = [](const Model&) { return true; };
  /// Lattices and cages have places of their own, which are rounded where they are.
  enum class Placement { of_mesh, rounded } placed = Placement::of_mesh;
};

void PrintTo(const Case& value, std::ostream* out) { *out << value.name; }

template <typename Options>
Case same(std::string name, Options options, bool (*takes)(const Model&) = Case().takes) {
  return {std::move(name), [options](const Model&, const Placed&) { return MethodOptions(options); }, takes};
}

Case lattice(std::string name, FfdControl control, LatticeBasis basis, std::array<std::size_t, 3> points = {}) {
  FfdOptions options;
  options.control = control;
  options.lattice.basis = basis;
  options.lattice.points = points;
  Case result = same(std::move(name), options);
  result.placed = Case::Placement::rounded;
  return result;
}

Case kernel(std::string name, Kernel kernel, Solver solver = Solver::automatic) {
  RbfOptions options;
  options.kernel = kernel;
  options.solver = solver;
  return same(std::move(name), options);
}

Case subspace(std::string name, std::optional<Kernel> kernel, std::size_t centres) {
  SubspaceOptions options;
  options.kernel = kernel;
  options.centres = centres;
  return same(std::move(name), options);
}

std::vector<Case> cases() {
  MlsOptions few, around;
  few.domain = MlsDomain::connected;  // no more samples than points
  few.surface_samples = 200;
  MlsOptions connected, many;
  connected.domain = MlsDomain::connected;
  many.surface_samples = 1500;
  many.volume_samples = 1000;
  around.surface_samples = 200;
  around.volume_samples = 150;
  ShellOptions soft_shell;
  soft_shell.handles = HandleMode::soft;
  const auto without_cells = [](const Model& model) { return model.mesh.elements == nullptr; };
  const auto in_space = [](const Model& model) { return model.name != "sheet"; };
  // Half a minute for each model.
  const auto in_some = [](const Model& model) { return long_tests() ? model.name != "sheet" : model.name == "bar"; };
  const auto cage = [](const Model& model, const Placed& placed) {
    const Box box = bounding_box(model.mesh.points);
    const double wide = 0.1 * box.diagonal();
    CageMesh mesh = pyramids(box.min - Vec3{wide, wide, wide}, box.max + Vec3{wide, wide, wide});
    for (Vec3& x : mesh.vertices) x = placed(x);
    CageOptions options = options_of(mesh);
    options.control = CageControl::mesh;
    return MethodOptions(options);
  };
  return {same("rbf", RbfOptions()),
          kernel("biharmonic", Kernel::biharmonic),
          kernel("quintic", Kernel::quintic),
          kernel("gaussian", Kernel::gaussian),
          kernel("multiquadric", Kernel::multiquadric),
          kernel("wendland", Kernel::wendland_c2),
          kernel("thin_plate", Kernel::thin_plate),
          kernel("incremental_qr", Kernel::triharmonic, Solver::incremental_qr),
          kernel("iterative", Kernel::triharmonic, Solver::iterative),
          same("shell", ShellOptions(), without_cells),
          same("soft_shell", soft_shell, without_cells),
          subspace("subspace", std::nullopt, 300),
          subspace("subspace_wendland", Kernel::wendland_c2, 200),
          subspace("subspace_gaussian", Kernel::gaussian, 200),
          same("mls", connected),
          same("mls_few", few),
          same("mls_around", around, in_space),
          same("mls_many", many, in_some),
          lattice("ffd", FfdControl::energy, LatticeBasis::uniform_cubic),
          lattice("ffd_odd", FfdControl::energy, LatticeBasis::uniform_cubic, {8, 9, 7}),
          lattice("ffd_clamped", FfdControl::energy, LatticeBasis::clamped_cubic),
          lattice("ffd_bernstein", FfdControl::energy, LatticeBasis::bernstein),
          lattice("ffd_mesh", FfdControl::mesh, LatticeBasis::uniform_cubic),
          lattice("ffd_mesh_coarse", FfdControl::mesh, LatticeBasis::uniform_cubic, {5, 5, 5}),
          lattice("ffd_mesh_bernstein", FfdControl::mesh, LatticeBasis::bernstein),
          {"cage", cage, Case().takes, Case::Placement::rounded}};
}

class Units : public testing::TestWithParam<Case> {};

TEST_P(Units, change_nothing_but_rounding) {
  for (const Model& model : models()) {
    if (!GetParam().takes(model)) continue;
    const auto run = [&](const Variant& variant) { return moved(model, GetParam().method, variant); };
    const Moved given = run({});
    for (const Variant& variant :
         {Variant{1000}, Variant{0.001}, Variant{1, 1e-15, 1}, Variant{1, 1e-15, 2}, Variant{1, 0, 0, {100, -37.31, 61.73}}}) {
      const Moved other = run(variant);
      double off = 0;
      for (std::size_t i = 0; i < given.by.size(); ++i) off = std::max(off, norm(other.by[i] - given.by[i]));
      // Where conditions and tolerances multiply rounding, each result tells how wrong it may be.
      EXPECT_LE(off, std::max(1e-9 * given.largest, given.error + other.error))
          << model.name << ", unit " << variant.unit << ", noise " << variant.noise << ", shift " << variant.shift[0] << ", of "
          << given.largest;
    }
  }
}

/// The rates of all points at which handles are shifted, of the model with coordinates of few digits, so that a shift leaves them
/// all. Positions are rounded where they are; rates are not.
std::vector<Vec3> rates(Model model, const MakeMethod& method, const Vec3& shift) {
  constexpr double digits = 0x1p20;
  for (Vec3& x : model.mesh.points)
    x = Vec3{std::round(digits * x[0]), std::round(digits * x[1]), std::round(digits * x[2])} / digits;
  Setup setup;
  setup.method = method(model, {1, shift});
  for (Vec3& x : model.mesh.points) x = x + shift;
  setup.handles = {{"turned", {Region::Ids{model.turned}}}, {"grown", {Region::Ids{model.grown}}}};
  setup.fixed = {{Region::Ids{model.fixed}}};
  setup.variables = {{"one", "turned", DesignVariable::Translate{{1, 0.5, -0.25}}},
                     {"other", "grown", DesignVariable::Translate{{-0.5, 0.25, 1}}}};
  const std::vector<double> at{0, 0}, along{1, 0.75};
  return prepare(std::make_shared<const Mesh>(std::move(model.mesh)), setup)->jacobian_vector(at, along, {});
}

TEST_P(Units, shifts_without_rounding_change_nothing) {
  for (const Model& model : models()) {
    if (!GetParam().takes(model)) continue;
    const std::vector<Vec3> given = rates(model, GetParam().method, {}),
                            shifted = rates(model, GetParam().method, {64, -128, 32});
    double off = 0;
    for (std::size_t i = 0; i < given.size(); ++i) off = std::max(off, norm(shifted[i] - given[i]));
    if (GetParam().placed == Case::Placement::rounded) {
      EXPECT_LE(off, 1e-8) << model.name;
    } else {
      EXPECT_EQ(off, 0) << model.name;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, Units, testing::ValuesIn(cases()), [](const auto& of) { return of.param.name; });

}  // namespace
}  // namespace deform::test::units_test
