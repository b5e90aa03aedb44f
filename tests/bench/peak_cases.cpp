// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/peak_cases.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>

#include "core/mesh/ahmed.h"
#include "core/mesh/elements.h"
#include "tests/core/deformers/block_meshes.h"
#include "tests/core/deformers/wheel.h"
#include "tests/core/numerics/cages.h"
#include "tests/support/thesis_options.h"

namespace deform::test {

namespace {

std::shared_ptr<const Mesh> body(std::size_t points) {
  AhmedOptions options;
  options.target_points = points;
  return std::make_shared<const Mesh>(ahmed_body(options));
}

/// The roof of the Ahmed body moves, its underbody and stilts stay.
template <typename Method>
Setup body_setup(Method method) {
  Setup setup;
  setup.method = std::move(method);
  setup.handles = {{"roof", {Region::GroupName{"roof"}}}};
  setup.fixed = {{Region::GroupName{"underbody"}}, {Region::GroupName{"stilts"}}};
  setup.variables = {{"up", "roof", DesignVariable::Translate{{0, 0, 1}}, -0.1, 0.1}};
  return setup;
}

Setup rbf(Solver solver) {
  RbfOptions options;
  options.solver = solver;
  options.reduction = CentreReduction::off;
  options.basis = BasisMode::never;
  return body_setup(options);
}

/// A tolerance that is never met, so that there are as many centres as can be: the estimate does not know how few suffice.
Setup most_centres() {
  RbfOptions options = std::get<RbfOptions>(rbf(Solver::incremental_qr).method);
  options.tolerance = 1e-10;
  return body_setup(options);
}

/// Four bands of the body as handles: their basis is larger than the factor.
Setup wide_basis() {
  Setup setup = body_setup(RbfOptions{});
  setup.handles.clear();
  setup.variables.clear();
  for (int i = 0; i < 6; ++i) {
    const double x = 0.3 + 0.08 * i;
    setup.handles.push_back({"band" + std::to_string(i), box({x, -1, 0.3}, {x + 0.02, 1, 1})});
  }
  return setup;
}

constexpr std::array<std::size_t, 3> lattice_points{12, 8, 8};
constexpr std::uint32_t cage_sides = 24;
constexpr double beside_body = -0.4;

FfdOptions lattice(FfdControl control) {
  FfdOptions options;
  options.control = control;
  options.lattice.points = lattice_points;
  return options;
}

/// A polygonal column around the body.
CageOptions cage(CageControl control, CageCoordinates coordinates) {
  std::vector<Vec3> polygon;
  for (std::uint32_t k = 0; k < cage_sides; ++k) {
    const double angle = 2 * std::numbers::pi * k / cage_sides;
    polygon.push_back({0.5 + std::cos(angle), 0.7 * std::sin(angle), 0});
  }
  test::CageMesh column = test::prism(polygon, 1);
  for (Vec3& x : column.vertices) x[2] -= 0.3;
  CageOptions options;
  options.vertices = std::move(column.vertices);
  options.triangles = std::move(column.triangles);
  options.control = control;
  options.coordinates = coordinates;
  return options;
}

/// That of a half model, closed in its plane beside the body.
CageOptions half_cage() {
  CageOptions options = cage(CageControl::controls, CageCoordinates::green);
  for (Vec3& x : options.vertices) x[1] = std::max(x[1], beside_body);
  return options;
}

Setup with_plane(Setup setup) {
  setup.symmetry = {{SymmetryPlane::Plane{{0, beside_body, 0}, {0, 1, 0}}}};
  return setup;
}

/// Handles are single control points, or vertices of a cage.
template <typename Method>
Setup by_controls(const Method& method, std::uint32_t handles) {
  Setup setup;
  setup.method = method;
  for (std::uint32_t i = 0; i < handles; ++i) setup.handles.push_back({"h" + std::to_string(i), {Region::ControlIds{{3 * i}}}});
  return setup;
}

Setup with_constraint(Setup setup, const ConstraintKind& kind, bool exact) {
  setup.constraints = {{"slant", {{Region::GroupName{"slant"}}}, kind, 0, exact}};
  return setup;
}

Setup subspace(std::optional<Kernel> kernel, std::size_t centres) {
  SubspaceOptions options = test::thesis_subspace();
  options.kernel = kernel;
  options.centres = centres;
  options.basis = BasisMode::never;
  return body_setup(options);
}

Setup shell() {
  ShellOptions options;
  options.basis = BasisMode::never;
  return body_setup(options);
}

Setup moving_least_squares(std::size_t samples = 4000, double cover = 12) {
  MlsOptions options = test::thesis_mls();
  options.surface_samples = samples;
  options.cover = cover;
  options.basis = BasisMode::never;
  return body_setup(options);
}

Setup enclosed() {
  MlsOptions options;
  options.basis = BasisMode::never;
  return body_setup(options);
}

/// Plates on a bar, with slots between them that most supports go around.
std::shared_ptr<const Mesh> slots() {
  return std::make_shared<const Mesh>(cubes({62, 26, 26}, 0.02, [](int i, int, int k) { return i % 8 < 6 || k < 8; }));
}

/// One end of the bar is held, the other one moved.
Setup slots_setup() {
  Setup setup;
  MlsOptions options;
  options.basis = BasisMode::never;
  setup.method = options;
  setup.handles = {{"end", box({1.23, -1, -1}, {2, 2, 2})}};
  setup.fixed = {box({-1, -1, -1}, {0.01, 2, 2})};
  return setup;
}

std::shared_ptr<const Mesh> solid() {
  Cube made = cube(30);
  made.mesh.elements = std::make_shared<const Elements>(std::move(made.elements));
  return std::make_shared<const Mesh>(std::move(made.mesh));
}

Setup solid_setup() {
  Setup setup;
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 1500;
  options.volume_samples = 1500;
  setup.method = options;
  setup.handles = {{"top", box({-1, -1, 0.99}, {2, 2, 2})}};
  setup.fixed = {box({-1, -1, -1}, {2, 2, 0.01})};
  setup.variables = {{"aside", "top", DesignVariable::Translate{{1, 0, 1}}, -0.1, 0.1}};
  return setup;
}

/// One side of the solid stays plane, between the end that moves and the one that is held.
Setup solid_planar_setup(bool exact) {
  Setup setup = solid_setup();
  setup.constraints = {{"side", {box({-1, -1, 0.1}, {0.01, 2, 0.9})}, Planar{}, 0, exact}};
  return setup;
}

/// Four layers of cells on one side of the solid keep their heights.
Setup with_layers(Setup setup) {
  setup.constraints = {{"wall", {box({-1, 0.05, 0.1}, {0.01, 0.95, 0.9})}, Rigid{4}}};
  return setup;
}

/// A lattice around the solid.
Setup lattice_of_solid() {
  Setup setup = solid_setup();
  FfdOptions options = lattice(FfdControl::energy);
  options.basis = BasisMode::never;
  setup.method = options;
  return setup;
}

/// A method whose basis is stored to a tolerance.
template <typename Method>
Setup to_tolerance(Setup setup, double tolerance) {
  auto& options = std::get<Method>(setup.method);
  options.basis = BasisMode::always;
  options.basis_tolerance = tolerance;
  return setup;
}

/// An energy whose handles are held by weights.
template <typename Method>
Setup softly(Setup setup) {
  std::get<Method>(setup.method).handles = HandleMode::soft;
  return setup;
}

/// A second method moves the slant, where the first one has left it.
template <typename Method>
Setup and_then(Setup setup, const Method& method) {
  setup.then = {{method, {{Region::GroupName{"underbody"}}}}};
  setup.handles.push_back({"slant", {Region::GroupName{"slant"}}, 1});
  setup.variables.push_back({"back", "slant", DesignVariable::Translate{{1, 0, 0}}, -0.1, 0.1});
  return setup;
}

FfdOptions fine_lattice() {
  FfdOptions options = lattice(FfdControl::energy);
  options.basis = BasisMode::never;
  return options;
}

/// A sector whose hub moves and whose casing is held.
test::SectorModel sector_model(std::size_t count, std::size_t around, std::size_t outwards) {
  test::SectorModel model({count, 0.4, 1, around, outwards, around});
  Region::Ids hub, casing;
  for (std::size_t i = 0; i <= around; ++i) {
    for (std::size_t k = 0; k <= around; ++k) {
      hub.ids.push_back(model.at_grid(i, 0, k));
      casing.ids.push_back(model.at_grid(i, outwards, k));
    }
  }
  model.setup.handles[0].region = {hub};
  model.setup.fixed = {{casing}};
  model.setup.variables = {{"along", "blade", DesignVariable::Translate{model.frame.axes[0]}}};
  return model;
}

template <typename Method>
Setup sector_setup(const test::SectorModel& model, const Method& method) {
  Setup setup = model.setup;
  setup.method = method;
  return setup;
}

MlsOptions few_samples() {
  MlsOptions options;
  options.surface_samples = options.volume_samples = 1500;
  return options;
}

}  // namespace

const std::vector<PeakCase>& peak_cases() {
  static const std::vector<PeakCase> cases{
      {"rbf_cholesky", [] { return body(12000); }, [] { return rbf(Solver::cholesky); }},
      {"rbf_ldlt", [] { return body(10000); }, [] { return rbf(Solver::ldlt); }},
      {"rbf_iterative", [] { return body(60000); }, [] { return rbf(Solver::iterative); }},
      {"rbf_incremental_qr", [] { return body(20000); }, most_centres},
      {"rbf_wide_basis", [] { return body(200000); }, wide_basis},
      {"shell", [] { return body(50000); }, shell},
      {"shell_planar", [] { return body(50000); }, [] { return with_constraint(shell(), Planar{}, false); }},
      {"shell_cylindrical_exact", [] { return body(20000); }, [] { return with_constraint(shell(), Cylindrical{}, true); }},
      {"subspace_mls", [] { return body(50000); }, [] { return subspace(std::nullopt, 4000); }},
      {"subspace_wendland", [] { return body(50000); }, [] { return subspace(Kernel::wendland_c2, 4000); }},
      {"subspace_triharmonic", [] { return body(20000); }, [] { return subspace(Kernel::triharmonic, 1000); }},
      {"mls", [] { return body(50000); }, [] { return moving_least_squares(); }},
      {"mls_many_points", [] { return body(200000); }, [] { return moving_least_squares(600); }},
      {"mls_wide", [] { return body(10000); }, [] { return moving_least_squares(3000, 40); }},
      {"mls_enclosed", [] { return body(50000); }, enclosed},
      {"mls_slots", slots, slots_setup},
      {"mls_planar", [] { return body(20000); }, [] { return with_constraint(moving_least_squares(), Planar{}, false); }},
      {"mls_solid", solid, solid_setup},
      {"mls_solid_planar", solid, [] { return solid_planar_setup(false); }},
      {"mls_solid_planar_exact", solid, [] { return solid_planar_setup(true); }},
      {"ffd_energy", [] { return body(100000); }, [] { return body_setup(lattice(FfdControl::energy)); }},
      {"ffd_mesh", [] { return body(100000); }, [] { return body_setup(lattice(FfdControl::mesh)); }},
      {"ffd_controls", [] { return body(200000); }, [] { return by_controls(lattice(FfdControl::controls), 12); }},
      {"cage_controls", [] { return body(200000); },
       [] { return by_controls(cage(CageControl::controls, CageCoordinates::mean_value), 12); }},
      {"cage_mesh", [] { return body(200000); }, [] { return body_setup(cage(CageControl::mesh, CageCoordinates::mean_value)); }},
      {"cage_green", [] { return body(200000); },
       [] { return by_controls(cage(CageControl::controls, CageCoordinates::green), 12); }},
      {"rbf_compressed", [] { return body(200000); }, [] { return to_tolerance<RbfOptions>(wide_basis(), 1e-8); }},
      {"rbf_then_rbf", [] { return body(12000); },
       [] { return and_then(rbf(Solver::cholesky), std::get<RbfOptions>(rbf(Solver::cholesky).method)); }},
      {"mls_then_ffd", [] { return body(50000); }, [] { return and_then(moving_least_squares(), fine_lattice()); }},
      {"rbf_sector", [] { return sector_model(5, 28, 12).sector; },
       [] { return sector_setup(sector_model(5, 28, 12), RbfOptions{}); }},
      {"mls_sector", [] { return sector_model(6, 14, 10).sector; },
       [] { return sector_setup(sector_model(6, 14, 10), few_samples()); }},
      {"ffd_sector", [] { return sector_model(6, 32, 20).sector; },
       [] { return sector_setup(sector_model(6, 32, 20), fine_lattice()); }},
      {"shell_soft", [] { return body(50000); }, [] { return softly<ShellOptions>(shell()); }},
      {"subspace_soft", [] { return body(50000); }, [] { return softly<SubspaceOptions>(subspace(std::nullopt, 4000)); }},
      {"mls_soft", [] { return body(50000); }, [] { return softly<MlsOptions>(moving_least_squares()); }},
      {"ffd_soft", [] { return body(100000); }, [] { return softly<FfdOptions>(body_setup(fine_lattice())); }},
      {"shell_compressed", [] { return body(50000); }, [] { return to_tolerance<ShellOptions>(shell(), 1e-8); }},
      {"ffd_planar_exact", [] { return body(30000); },
       [] { return with_constraint(body_setup(fine_lattice()), Planar{}, true); }},
      {"ffd_planar", [] { return body(30000); },
       [] { return with_constraint(body_setup(lattice(FfdControl::energy)), Planar{}, false); }},
      {"ffd_layers", solid, [] { return with_layers(lattice_of_solid()); }},
      {"ffd_solid_planar", solid,
       [] {
         Setup setup = lattice_of_solid();
         setup.constraints = solid_planar_setup(false).constraints;
         return setup;
       }},
      {"cage_green_half", [] { return body(200000); }, [] { return with_plane(by_controls(half_cage(), 12)); }},
  };
  return cases;
}

}  // namespace deform::test
