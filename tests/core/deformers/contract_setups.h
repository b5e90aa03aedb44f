// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/mirrored_mesh.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/contract_parts.h"
#include "tests/core/deformers/shapes.h"
#include "tests/core/deformers/space_cases.h"
#include "tests/core/deformers/wheel.h"
#include "tests/core/deformers/wide.h"

/// Random setups over all methods, from one seed each, with what they prescribe in double-double.
namespace deform::test::contract {

class Dice {
 public:
  explicit Dice(std::uint64_t seed) : random_(seed) {}
  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  double power(double low, double high) { return std::pow(10.0, uniform(low, high)); }
  std::size_t pick(std::size_t count) { return std::uniform_int_distribution<std::size_t>(0, count - 1)(random_); }
  bool once_in(std::size_t count) { return pick(count) == 0; }
  Vec3 direction() {
    std::normal_distribution<double> normal;
    const Vec3 v{normal(random_), normal(random_), normal(random_)};
    return (1 / norm(v)) * v;
  }

 private:
  std::mt19937_64 random_;
};

using WideMap = std::array<Wide, 12>;

inline WideVec displacement(const WideMap& map, const WideVec& x) {
  WideVec u;
  for (std::size_t k = 0; k < 3; ++k) {
    u[k] = map[4 * k + 3] - x[k];
    for (std::size_t l = 0; l < 3; ++l) u[k] += map[4 * k + l] * x[l];
  }
  return u;
}

inline WideMap wide_map(const Affine& map) {
  WideMap result;
  for (std::size_t i = 0; i < 12; ++i) result[i] = map[i];
  return result;
}

/// a after b.
inline WideMap after(const WideMap& a, const WideMap& b) {
  WideMap result;
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t l = 0; l < 4; ++l) {
      Wide sum = l == 3 ? a[4 * k + 3] : Wide();
      for (std::size_t j = 0; j < 3; ++j) sum += a[4 * k + j] * b[4 * j + l];
      result[4 * k + l] = sum;
    }
  }
  return result;
}

/// With the linear part that leaves `centre` where it is.
inline WideMap about(const std::array<Wide, 9>& linear, const Vec3& centre) {
  WideMap map;
  for (std::size_t k = 0; k < 3; ++k) {
    map[4 * k + 3] = centre[k];
    for (std::size_t l = 0; l < 3; ++l) {
      map[4 * k + l] = linear[3 * k + l];
      map[4 * k + 3] -= linear[3 * k + l] * Wide(centre[l]);
    }
  }
  return map;
}

inline WideVec wide_unit(const Vec3& axis) {
  WideVec a = wide(axis);
  const Wide length = sqrt(dot(a, a));
  for (Wide& value : a) value = value / length;
  return a;
}

/// By so many radians, right-handed.
inline std::array<Wide, 9> wide_rotation(const Vec3& axis, long double angle) {
  const WideVec a = wide_unit(axis);
  const Wide c = Wide::of(std::cos(angle)), s = Wide::of(std::sin(angle));
  std::array<Wide, 9> linear;
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t l = 0; l < 3; ++l) {
      linear[3 * k + l] = (Wide(1) - c) * a[k] * a[l] + (k == l ? c : Wide());
      if (k != l) linear[3 * k + l] += ((k + 1) % 3 == l ? -s : s) * a[3 - k - l];
    }
  }
  return linear;
}

/// What a design variable prescribes, by the formulas of its documentation.
inline WideMap variable_map(const VariableMotion& motion, double v) {
  if (const auto* shift = std::get_if<Translation>(&motion)) {
    WideMap map = wide_map(identity_affine);
    for (std::size_t k = 0; k < 3; ++k) map[4 * k + 3] = Wide(v) * Wide(shift->direction[k]);
    return map;
  }
  if (const auto* turn = std::get_if<Rotation>(&motion)) {
    const long double angle = turn->unit == AngleUnit::degrees ? v * std::numbers::pi_v<long double> / 180 : v;
    return about(wide_rotation(turn->axis, angle), turn->centre);
  }
  std::array<Wide, 9> linear;
  const auto& scaling = std::get<Scaling>(motion);
  const bool all = scaling.axis == Vec3{};
  const WideVec a = all ? WideVec{} : wide_unit(scaling.axis);
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t l = 0; l < 3; ++l) {
      linear[3 * k + l] = k == l ? Wide(1) : Wide();
      linear[3 * k + l] += Wide(v) * (all ? (k == l ? Wide(1) : Wide()) : a[k] * a[l]);
    }
  }
  return about(linear, scaling.centre);
}

/// What one design prescribes to one handle.
struct Prescribed {
  WideMap map = wide_map(identity_affine);
  std::vector<Vec3> displacements;  ///< for each point, if not empty; the linear part of `map` turns them
};

enum class Kind { rbf, shell, subspace, mls, ffd, ffd_mesh, ffd_controls, cage, cage_mesh, composed, green, damped };

struct Case {
  Kind kind = Kind::rbf;
  std::shared_ptr<const Mesh> mesh;
  deform::Setup setup;
  EvaluationPath path = EvaluationPath::automatic;
  std::vector<std::vector<PointId>> handles;  ///< points, or control points
  std::array<std::vector<PointId>, 2> fixed;  ///< of each method
  std::vector<Design> designs;
  std::vector<std::vector<Prescribed>> prescribed;  ///< of each design and handle
  std::optional<double> symmetric;                  ///< the plane y = this
  bool flat = false;                                ///< all points have the same z
  std::size_t images = 1;                           ///< in a whole model: those that it is made of
  std::vector<std::vector<PointId>> sets;           ///< points of each constraint
  double unit = 1;                                  ///< length of the model, about

  bool exact() const {
    const auto& all = setup.constraints;
    return std::any_of(all.begin(), all.end(), [](const Constraint& constraint) { return constraint.exact; });
  }
};

/// Seeds from here have exact constraints.
constexpr std::uint64_t exact_seeds = std::uint64_t{1} << 20;

/// Seeds from here have a symmetry plane and a method that deforms the model with its mirror image; from the next one a sector.
constexpr std::uint64_t half_seeds = std::uint64_t{1} << 21, sector_seeds = std::uint64_t{1} << 22;

/// Makes a setup step by step.
class Maker {
 public:
  Maker(std::uint64_t seed, double most_centres) : dice_(seed * 7919 + 17), seed_(seed), most_(most_centres) {}

  Case made() {
    constexpr Kind kinds[] = {Kind::rbf,      Kind::rbf,      Kind::shell, Kind::rbf, Kind::subspace,
                              Kind::rbf,      Kind::mls,      Kind::rbf,   Kind::ffd, Kind::rbf,
                              Kind::ffd_mesh, Kind::rbf,      Kind::shell, Kind::rbf, Kind::ffd_controls,
                              Kind::rbf,      Kind::subspace, Kind::rbf,   Kind::mls, Kind::cage};
    made_.kind = kinds[seed_ % 20];
    if (made_.kind == Kind::cage) {
      constexpr Kind more[] = {Kind::cage, Kind::cage_mesh, Kind::composed};
      made_.kind = more[seed_ / 20 % 3];
    }
    // Two of the places of rbf are those of what is rare.
    if (seed_ % 20 == 13) made_.kind = seed_ / 20 % 2 == 0 ? Kind::green : Kind::damped;
    if (seed_ % 20 == 17) {
      constexpr Kind energies[] = {Kind::shell, Kind::mls, Kind::shell, Kind::ffd, Kind::shell, Kind::subspace};
      made_.kind = energies[seed_ / 20 % 6];
      constrained_ = true;
    }
    if (exact()) {
      constexpr Kind energies[] = {Kind::shell, Kind::ffd, Kind::shell, Kind::mls, Kind::shell, Kind::subspace};
      made_.kind = energies[seed_ % 6];
      constrained_ = true;
    }
    if (halved()) {
      constexpr Kind with_images[] = {Kind::shell, Kind::mls, Kind::ffd, Kind::ffd_mesh, Kind::subspace};
      made_.kind = with_images[seed_ % 5];
      constrained_ = false;
    }
    if (of_sector()) {
      constexpr Kind with_images[] = {Kind::rbf, Kind::shell, Kind::mls, Kind::ffd, Kind::ffd_mesh, Kind::subspace};
      made_.kind = with_images[seed_ % 6];
      constrained_ = false;
      return sector();
    }
    large_ = made_.kind == Kind::rbf && most_ > 1000 && dice_.once_in(60);
    choose_mesh();
    const bool of_controls = made_.kind == Kind::ffd_controls || made_.kind == Kind::cage || made_.kind == Kind::green;
    choose_method();
    if (!of_controls) choose_regions();
    if (exact()) {
      choose_exact();
    } else if (constrained_) {
      choose_constraints();
    }
    return finished();
  }

 private:
  bool halved() const { return (seed_ & half_seeds) != 0; }
  bool of_sector() const { return (seed_ & sector_seeds) != 0; }

  Case finished() {
    choose_designs();
    made_.setup.seed = seed_;
    made_.mesh = shared(std::move(mesh_));
    return std::move(made_);
  }

  /// A sector of shaken hexahedra, or of the casing, whose handle is within.
  Case sector() {
    SectorShape shape{2 + dice_.pick(5), dice_.once_in(3) ? 0 : 0.4, seed_, 3, 3 + dice_.pick(2), 3};
    const bool surface = made_.kind == Kind::shell || made_.kind == Kind::subspace;
    if (surface) shape = {2 + dice_.pick(6), 0.4, seed_, 6, 2, 8};
    Frame frame = oblique();
    made_.unit = dice_.power(-3, 3);
    const double away = dice_.once_in(2) ? 0 : dice_.uniform(0, 30);
    frame.origin = frame.origin + away * dice_.direction();
    const SectorModel model = surface ? casing(shape, frame) : SectorModel(shape, frame);
    mesh_ = *model.sector;
    for (Vec3& x : mesh_.points) x = made_.unit * x;
    made_.setup = model.setup;
    made_.setup.symmetry = {{SectorOptions{made_.unit * frame.origin, frame.axes[0], static_cast<std::uint32_t>(shape.count)}}};
    made_.handles = {std::get<Region::Ids>(model.setup.handles[0].region.kind).ids};
    for (const Region& region : model.setup.fixed) {
      const auto& ids = std::get<Region::Ids>(region.kind).ids;
      made_.fixed[0].insert(made_.fixed[0].end(), ids.begin(), ids.end());
    }
    std::sort(made_.handles[0].begin(), made_.handles[0].end());
    std::sort(made_.fixed[0].begin(), made_.fixed[0].end());
    held_count_ = made_.fixed[0].size() * shape.count;
    choose_method();
    if (auto* rbf = std::get_if<RbfOptions>(&made_.setup.method)) {
      constexpr Kernel without_shape[] = {Kernel::triharmonic, Kernel::biharmonic, Kernel::thin_plate, Kernel::quintic};
      rbf->kernel = without_shape[dice_.pick(4)];
      rbf->polynomial_degree = -1;
      rbf->reduction = CentreReduction::off;
      if (rbf->solver == Solver::incremental_qr) rbf->solver = Solver::automatic;
    }
    return finished();
  }

  /// The bounding box of the model with its images.
  Box whole_box() const {
    Box box = bounding_box(mesh_.points);
    if (made_.setup.symmetry.empty()) return box;
    const MirroredMesh whole(mesh_, Symmetry(made_.setup.symmetry, mesh_));
    return bounding_box(whole.mesh()->points);
  }

  bool exact() const { return (seed_ & exact_seeds) != 0; }
  bool is_energy() const {
    return made_.kind == Kind::shell || made_.kind == Kind::subspace || made_.kind == Kind::mls || made_.kind == Kind::ffd;
  }
  bool of_rbf() const { return made_.kind == Kind::rbf || made_.kind == Kind::composed; }

  /// A sheet, a torus, a block with cells or a cloud, about 2 long, with noise; then in some unit at some place.
  void choose_mesh() {
    held_count_ = static_cast<std::size_t>(std::pow(10.0, dice_.uniform(std::log10(30.0), std::log10(of_rbf() ? most_ : 120.0))));
    if (large_) held_count_ = static_cast<std::size_t>(dice_.power(std::log10(3000.0), std::log10(20000.0)));
    std::size_t count = static_cast<std::size_t>(static_cast<double>(held_count_) * dice_.uniform(1.3, 4)) + 40;
    if (is_energy()) count = std::min<std::size_t>(count, constrained_ ? 180 : most_ > 1000 ? 500 : 300);
    if (constrained_) held_count_ = std::min<std::size_t>(held_count_, 60);
    if (made_.kind == Kind::damped) count = std::max<std::size_t>(count, 250);
    if (exact()) {
      held_count_ = 8 + dice_.pick(24);
      count = 60 + dice_.pick(60);
      if (!dice_.once_in(3)) return make_part();
    }
    if (halved()) count = std::min<std::size_t>(count, 130);
    const std::size_t shape = halved() ? 2 * dice_.pick(2) : dice_.pick(is_energy() ? 3 : 5);
    const bool cells = shape == 2 && made_.kind != Kind::shell && made_.kind != Kind::subspace;
    double spacing = 0;
    if (cells) {
      const auto n = std::max<std::size_t>(3, static_cast<std::size_t>(std::cbrt(static_cast<double>(count))) - 1);
      mesh_ = solid_cube(n);
      spacing = 1 / static_cast<double>(n);
    } else if (shape == 1) {
      const auto n = std::max<std::size_t>(5, static_cast<std::size_t>(std::sqrt(static_cast<double>(count) / 3)));
      make_torus(3 * n, n);
      spacing = 1.2 / static_cast<double>(n);
    } else if (shape == 4) {
      for (std::size_t i = 0; i < count; ++i) {
        mesh_.points.push_back({dice_.uniform(0, 2), dice_.uniform(0.01, 1), dice_.uniform(-0.5, 0.5)});
      }
    } else {
      const auto rows = std::max<std::size_t>(5, static_cast<std::size_t>(std::sqrt(static_cast<double>(count) / 2)));
      mesh_ = bumpy_sheet(2 * rows, rows);
      spacing = 1 / static_cast<double>(rows);
      made_.flat = shape == 3 && of_rbf();
    }
    const bool symmetric = halved() || (made_.kind == Kind::rbf && !large_ && shape == 0 && dice_.once_in(3));
    place_mesh(spacing, symmetric);
  }

  /// The shapes hold exactly, or nearly.
  void make_part() {
    const std::size_t around = 8 + dice_.pick(6), rows = 3 + dice_.pick(4);
    Part part = capped_cylinder(around, rows, dice_.once_in(4) ? dice_.uniform(0.1, 0.25) : 0.0);
    mesh_ = std::move(part.mesh);
    families_ = std::move(part.families);
    constexpr double noise[] = {0, 1e-6, 1e-2};
    place_mesh(noise[dice_.pick(3)], false);
  }

  void place_mesh(double spacing, bool symmetric) {
    made_.unit = dice_.power(-3, 3);
    const std::size_t where = dice_.pick(4);
    const double away = where < 2 ? 0 : where == 2 ? dice_.uniform(0, 30) : dice_.uniform(0, 1000);
    const Vec3 place = away * dice_.direction();
    for (Vec3& p : mesh_.points) {
      const bool on_plane = symmetric && p[1] == 0;
      for (double& value : p) value += spacing * dice_.uniform(-0.2, 0.2);
      if (made_.flat) p[2] = 0;
      if (on_plane) p[1] = 0;
      p = made_.unit * (p + place);
      if (on_plane) made_.symmetric = p[1];
    }
    if (made_.symmetric) made_.setup.symmetry = {{SymmetryPlane::Plane{{0, *made_.symmetric, 0}, {0, 1, 0}}}};
  }

  void make_torus(std::size_t along, std::size_t around) {
    constexpr double turn = 6.283185307179586;
    for (std::size_t i = 0; i < along; ++i) {
      for (std::size_t j = 0; j < around; ++j) {
        const double u = turn * static_cast<double>(i) / static_cast<double>(along);
        const double v = turn * static_cast<double>(j) / static_cast<double>(around);
        const double r = 0.7 + 0.3 * std::cos(v);
        mesh_.points.push_back({1 + r * std::cos(u), r * std::sin(u), 0.3 * std::sin(v)});
        const auto at = [&](std::size_t a, std::size_t b) { return static_cast<PointId>(a % along * around + b % around); };
        for (const PointId id : {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j), at(i + 1, j + 1), at(i, j + 1)}) {
          mesh_.face_points.push_back(id);
        }
        mesh_.face_sizes.insert(mesh_.face_sizes.end(), {3, 3});
      }
    }
  }

  BasisMode basis() { return dice_.once_in(2) ? BasisMode::never : BasisMode::always; }
  double basis_tolerance(BasisMode mode) { return mode == BasisMode::always && dice_.once_in(5) ? dice_.power(-12, -4) : 0; }

  void weigh(EnergyOptions& options) {
    const std::size_t kind = dice_.pick(4);
    options.stretching = kind == 0 ? 0 : dice_.power(-3, 3);
    options.bending = kind == 1 ? 0 : dice_.power(-3, 3);
    if (dice_.once_in(6)) options.bending = dice_.power(-12, -3);
    options.handles = dice_.once_in(3) ? HandleMode::soft : HandleMode::hard;
    if (constrained_ && made_.kind != Kind::shell && seed_ % 3 != 1) options.handles = HandleMode::soft;
    options.fixing = dice_.power(0, 9);
    options.basis = basis();
    options.basis_tolerance = basis_tolerance(options.basis);
  }

  void choose_method() {
    switch (made_.kind) {
      case Kind::rbf:
        made_.setup.method = rbf_options();
        break;
      case Kind::composed: {
        RbfOptions first = rbf_options(), second = rbf_options();
        first.reduction = second.reduction = CentreReduction::off;
        made_.setup.method = first;
        made_.setup.then = {{second, {}}};
        break;
      }
      case Kind::shell: {
        ShellOptions options;
        weigh(options);
        made_.setup.method = options;
        break;
      }
      case Kind::subspace: {
        constexpr Kernel kernels[] = {Kernel::triharmonic, Kernel::biharmonic, Kernel::wendland_c2, Kernel::gaussian};
        SubspaceOptions options;
        weigh(options);
        if (!dice_.once_in(4)) options.kernel = kernels[dice_.pick(4)];
        options.centres = 15 + dice_.pick(most_ > 1000 ? 250 : 80);
        made_.setup.method = options;
        break;
      }
      case Kind::mls: {
        constexpr MlsDomain domains[] = {MlsDomain::surface, MlsDomain::enclosed, MlsDomain::connected};
        MlsOptions options;
        weigh(options);
        options.domain = domains[dice_.pick(3)];
        options.surface_samples = 20 + dice_.pick(most_ > 1000 ? 200 : 80);
        if (mesh_.elements || mesh_.face_sizes.front() == 3) options.volume_samples = 20 + dice_.pick(60);
        made_.setup.method = options;
        break;
      }
      case Kind::ffd: {
        FfdOptions options;
        weigh(options);
        options.lattice.points = {4 + dice_.pick(4), 4 + dice_.pick(2), 4 + dice_.pick(2)};
        options.lattice.basis = static_cast<LatticeBasis>(dice_.pick(3));
        made_.setup.method = options;
        break;
      }
      case Kind::ffd_mesh:
      case Kind::ffd_controls:
      case Kind::damped:
        choose_lattice();
        break;
      case Kind::cage:
      case Kind::cage_mesh:
      case Kind::green:
        choose_cage();
        break;
    }
  }

  RbfOptions rbf_options() {
    RbfOptions options;
    const auto kernels = all_kernels();
    options.kernel = kernels[dice_.pick(kernels.size())].kernel;
    constexpr Solver solvers[] = {Solver::automatic,      Solver::cholesky,       Solver::cholesky,  Solver::ldlt,
                                  Solver::incremental_qr, Solver::incremental_qr, Solver::iterative, Solver::iterative};
    options.solver = solvers[dice_.pick(8)];
    if (large_) {
      constexpr Kernel for_many[] = {Kernel::triharmonic, Kernel::biharmonic, Kernel::thin_plate};
      options.kernel = for_many[dice_.pick(3)];
      constexpr Solver of_many[] = {Solver::iterative, Solver::iterative, Solver::incremental_qr, Solver::automatic};
      options.solver = of_many[dice_.pick(held_count_ < 8000 ? 4 : 3)];
    }
    const KernelProperties known = properties(*options.kernel);
    if (options.solver == Solver::iterative && !known.smooth) options.solver = Solver::ldlt;
    if (known.has_shape && !dice_.once_in(3)) options.shape = dice_.power(-1.7, held_count_ < 200 ? -0.3 : -1);
    if (dice_.once_in(4)) options.polynomial_degree = std::max(0, known.order - 1) + static_cast<int>(dice_.pick(2));
    options.polynomial_degree = std::min(options.polynomial_degree, 2);
    if (to_tolerance(options.solver)) {
      options.tolerance = dice_.power(-10, -3);
      if (options.solver == Solver::incremental_qr) options.tolerance = dice_.power(-6, -2);
      if (dice_.once_in(6)) options.tolerance = 0;
    }
    options.centre_order = dice_.once_in(2) ? CentreOrder::greedy : CentreOrder::farthest_point;
    constexpr CentreReduction reductions[] = {CentreReduction::off, CentreReduction::off, CentreReduction::rings,
                                              CentreReduction::tolerance};
    options.reduction = reductions[dice_.pick(4)];
    // A thin band of some thousand centres of each shape is as long as ten thousand.
    if (large_ && options.reduction == CentreReduction::rings) options.reduction = CentreReduction::tolerance;
    options.reduction_rings = 1 + static_cast<int>(dice_.pick(4));
    options.basis = large_ ? BasisMode::never : basis();
    options.basis_tolerance = basis_tolerance(options.basis);
    return options;
  }

  void choose_lattice() {
    FfdOptions options;
    options.control = made_.kind == Kind::ffd_controls ? FfdControl::controls : FfdControl::mesh;
    options.basis = basis();
    options.basis_tolerance = basis_tolerance(options.basis);
    const Box box = whole_box();
    const double D = box.diagonal();
    // Some points may lie outside of what control points move.
    const double margin = options.control == FfdControl::controls && dice_.once_in(4) ? -0.05 * D : 0.08 * D;
    LatticeFrame frame;
    for (std::size_t k = 0; k < 3; ++k) {
      frame.origin[k] = box.min[k] - margin;
      frame.axes[k] = {};
      frame.axes[k][k] = std::max(box.max[k] - box.min[k] + 2 * margin, 0.1 * D);
      // Not orthogonal, by less than the margin.
      if (margin > 0) frame.axes[k][(k + 1) % 3] = dice_.uniform(-0.02, 0.02) * D;
    }
    options.lattice.frame = frame;
    options.lattice.points = {4 + dice_.pick(3), 4 + dice_.pick(2), 4 + dice_.pick(2)};
    options.lattice.basis = static_cast<LatticeBasis>(dice_.pick(3));
    if (dice_.once_in(2)) options.clamp = dice_.power(-9, -1);
    if (made_.kind == Kind::damped) {  // more than 4,000 control points reach the handles
      options.lattice.points = {36 + dice_.pick(8), 30 + dice_.pick(8), 30 + dice_.pick(8)};
      options.lattice.basis = dice_.once_in(2) ? LatticeBasis::uniform_cubic : LatticeBasis::clamped_cubic;
      options.clamp = dice_.power(-6, -0.5);
    }
    if (options.control == FfdControl::controls) {
      options.clamp = 0;
      choose_controls(options.lattice.points[0] * options.lattice.points[1] * options.lattice.points[2]);
    }
    made_.setup.method = options;
  }

  void choose_cage() {
    CageOptions options;
    options.control = made_.kind == Kind::cage_mesh ? CageControl::mesh : CageControl::controls;
    options.basis = basis();
    if (made_.kind == Kind::green) {
      options.coordinates = CageCoordinates::green;
    } else {
      options.basis_tolerance = basis_tolerance(options.basis);
    }
    const Box box = bounding_box(mesh_.points);
    const double D = box.diagonal();
    const std::size_t n = 1 + dice_.pick(3);
    std::map<std::array<std::size_t, 3>, std::uint32_t> ids;
    const auto corner = [&](const std::array<std::size_t, 3>& at) {
      const auto [entry, added] = ids.try_emplace(at, static_cast<std::uint32_t>(options.vertices.size()));
      if (added) {
        Vec3 x{};
        for (std::size_t k = 0; k < 3; ++k) {
          const double low = box.min[k] - 0.15 * D, high = box.max[k] + 0.15 * D;
          x[k] = low + (high - low) * static_cast<double>(at[k]) / static_cast<double>(n) + dice_.uniform(-0.04, 0.04) * D;
        }
        options.vertices.push_back(x);
      }
      return entry->second;
    };
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (const std::size_t side : {std::size_t{0}, n}) {
        for (std::size_t i = 0; i < n * n; ++i) {
          std::array<std::uint32_t, 4> quad{};
          for (std::size_t c = 0; c < 4; ++c) {
            std::array<std::size_t, 3> at{};
            at[axis] = side;
            at[u] = i % n + (c == 1 || c == 2 ? 1 : 0);
            at[v] = i / n + (c >= 2 ? 1 : 0);
            quad[c] = corner(at);
          }
          if (side == 0) std::swap(quad[1], quad[3]);
          options.triangles.push_back({quad[0], quad[1], quad[2]});
          options.triangles.push_back({quad[0], quad[2], quad[3]});
        }
      }
    }
    if (options.control == CageControl::mesh && dice_.once_in(2)) options.clamp = dice_.power(-9, -1);
    if (options.control == CageControl::controls) choose_controls(options.vertices.size());
    made_.setup.method = options;
  }

  /// Handles are some of the control points.
  void choose_controls(std::size_t count) {
    std::vector<std::uint32_t> ids(count);
    for (std::size_t i = 0; i < count; ++i) ids[i] = static_cast<std::uint32_t>(i);
    for (std::size_t i = count; i-- > 1;) std::swap(ids[i], ids[dice_.pick(i + 1)]);
    const std::size_t handles = 1 + dice_.pick(3);
    std::size_t next = 0;
    for (std::size_t h = 0; h < handles; ++h) {
      const std::size_t size = 1 + dice_.pick(count / (2 * handles));
      std::vector<PointId> own(ids.begin() + static_cast<std::ptrdiff_t>(next),
                               ids.begin() + static_cast<std::ptrdiff_t>(next + size));
      std::sort(own.begin(), own.end());
      next += size;
      made_.setup.handles.push_back({"handle " + std::to_string(h), {Region::ControlIds{own}}});
      made_.handles.push_back(std::move(own));
    }
  }

  /// About `count` of the points nearest to one of them that are not taken, as one of the kinds of regions.
  Region region(std::size_t count, std::vector<Region>& before, std::vector<bool>& taken, std::vector<PointId>& ids) {
    std::size_t centre = dice_.pick(mesh_.point_count());
    while (taken[centre]) centre = (centre + 1) % mesh_.point_count();
    const Vec3 at = mesh_.points[centre];
    // A part has points at the same distance, and so has a plane of points.
    const std::size_t kind = families_.empty() && !halved() ? dice_.pick(4) : 2 + dice_.pick(2);
    std::vector<std::pair<double, PointId>> order;
    for (std::size_t i = 0; i < mesh_.point_count(); ++i) {
      const Vec3 d = mesh_.points[i] - at;
      const double away = kind == 0 ? std::max({std::abs(d[0]), std::abs(d[1]), std::abs(d[2])}) : norm(d);
      order.emplace_back(away, static_cast<PointId>(i));
    }
    std::sort(order.begin(), order.end());
    count = std::min(count, order.size() - 1);
    const double radius = 0.5 * (order[count - 1].first + order[count].first);
    std::vector<PointId> own;
    for (std::size_t i = 0; i < count; ++i) own.push_back(order[i].second);
    std::sort(own.begin(), own.end());
    Region result;
    if (kind == 0) {
      result.kind = Region::InBox{at - Vec3{radius, radius, radius}, at + Vec3{radius, radius, radius}};
    } else if (kind == 1) {
      result.kind = Region::InSphere{at, radius};
    } else if (kind == 2) {
      const std::string name = "group " + std::to_string(mesh_.groups.size());
      mesh_.groups.push_back({name, own, {}});
      result.kind = Region::GroupName{name};
    } else {
      result.kind = Region::Ids{own};
    }
    Region whole = result;
    if (!before.empty()) {
      Region::Difference difference{{result}};
      difference.of.insert(difference.of.end(), before.begin(), before.end());
      whole.kind = difference;
    }
    before.push_back(result);
    for (const PointId id : own) {
      if (!taken[id]) ids.push_back(id);
      taken[id] = true;
    }
    return whole;
  }

  void choose_regions() {
    const std::size_t stages = made_.kind == Kind::composed ? 2 : 1;
    const bool all_handles = large_ && std::get<RbfOptions>(made_.setup.method).reduction == CentreReduction::tolerance;
    for (std::size_t stage = 0; stage < stages; ++stage) {
      std::vector<Region> before;
      std::vector<bool> taken(mesh_.point_count());
      const std::size_t handles = 1 + dice_.pick(3), share = std::max<std::size_t>(4, held_count_ / (2 * handles));
      // In two or three pieces, apart from each other.
      const std::size_t pieces = 1 + dice_.pick(2);
      std::vector<Region> fixed;
      for (std::size_t i = 0; i < pieces; ++i) {
        std::vector<PointId> ids;
        fixed.push_back(region(std::max<std::size_t>(4, held_count_ / (2 * pieces)), before, taken, ids));
        if (all_handles) {
          made_.setup.handles.push_back({"still " + std::to_string(i), fixed.back()});
          std::sort(ids.begin(), ids.end());
          made_.handles.push_back(ids);
        } else {
          made_.fixed[stage].insert(made_.fixed[stage].end(), ids.begin(), ids.end());
        }
      }
      if (!all_handles) (stage == 0 ? made_.setup.fixed : made_.setup.then[0].fixed) = fixed;
      std::sort(made_.fixed[stage].begin(), made_.fixed[stage].end());
      for (std::size_t h = 0; h < handles; ++h) {
        if (std::count(taken.begin(), taken.end(), false) < 2) break;
        std::vector<PointId> ids;
        const Region own = region(share, before, taken, ids);
        made_.setup.handles.push_back({"handle " + std::to_string(stage) + "." + std::to_string(h), own, stage});
        std::sort(ids.begin(), ids.end());
        made_.handles.push_back(std::move(ids));
      }
    }
  }

  /// One or two, which may have points in common, of points that nothing holds.
  void choose_constraints() {
    std::vector<bool> held(mesh_.point_count());
    std::vector<PointId> free;
    for (const PointId id : made_.fixed[0]) held[id] = true;
    for (const auto& ids : made_.handles) {
      for (const PointId id : ids) held[id] = true;
    }
    for (std::size_t i = 0; i < held.size(); ++i) {
      if (!held[i]) free.push_back(static_cast<PointId>(i));
    }
    if (free.size() < 12) return;
    const std::size_t count = 1 + dice_.pick(2);
    for (std::size_t t = 0; t < count; ++t) {
      const Vec3 at = mesh_.points[free[dice_.pick(free.size())]];
      std::vector<std::pair<double, PointId>> order;
      for (const PointId id : free) order.emplace_back(norm(mesh_.points[id] - at), id);
      std::sort(order.begin(), order.end());
      std::vector<PointId> ids;
      const std::size_t size = 8 + dice_.pick(std::min<std::size_t>(32, free.size() - 8));
      for (std::size_t i = 0; i < size; ++i) ids.push_back(order[i].second);
      std::sort(ids.begin(), ids.end());
      const ConstraintKind kinds[] = {Planar{}, Straight{}, Rigid{}, Spherical{}, FixedPlane{at, dice_.direction()}};
      Constraint constraint{"constraint " + std::to_string(t), {{Region::Ids{ids}}}, kinds[dice_.pick(5)]};
      if (dice_.once_in(2)) constraint.weight = dice_.power(1, 9);
      made_.setup.constraints.push_back(std::move(constraint));
      made_.sets.push_back(std::move(ids));
    }
    if (dice_.once_in(2)) made_.setup.constraint_options.tolerance = dice_.power(-10, -3);
  }

  /// One to three that have points in common, or one in another, half of them with held points in them.
  void choose_exact() {
    std::vector<bool> held(mesh_.point_count());
    const bool inside = dice_.once_in(2);
    for (const PointId id : made_.fixed[0]) held[id] = !inside;
    for (const auto& ids : made_.handles) {
      for (const PointId id : ids) held[id] = !inside;
    }
    std::vector<PartSet> sets = families_.empty() ? nested_sets() : families_[dice_.pick(families_.size())];
    for (auto& [kind, ids] : sets) {
      std::erase_if(ids, [&](PointId id) { return static_cast<bool>(held[id]); });
      std::sort(ids.begin(), ids.end());
      if (ids.size() < (std::holds_alternative<Straight>(kind) ? 3 : std::holds_alternative<Circular>(kind) ? 5 : 8)) continue;
      if (dice_.once_in(3)) keep_size(kind);
      Constraint constraint{"constraint " + std::to_string(made_.sets.size()), {{Region::Ids{ids}}}, kind};
      if (dice_.once_in(2)) constraint.weight = dice_.power(3, 9);
      constraint.exact = !dice_.once_in(8) || made_.sets.empty();
      made_.setup.constraints.push_back(std::move(constraint));
      made_.sets.push_back(std::move(ids));
    }
    if (dice_.once_in(2)) made_.setup.constraint_options.tolerance = dice_.power(-10, -3);
    vigour_ = dice_.power(-2, 0);
  }

  static void keep_size(ConstraintKind& kind) {
    if (auto* circle = std::get_if<Circular>(&kind)) circle->radius = Size::kept;
    if (auto* cylinder = std::get_if<Cylindrical>(&kind)) cylinder->radius = Size::kept;
    if (auto* sphere = std::get_if<Spherical>(&kind)) sphere->radius = Size::kept;
    if (auto* cone = std::get_if<Conical>(&kind)) cone->angle = Size::kept;
  }

  /// Blobs around one point, each in the one before.
  std::vector<PartSet> nested_sets() {
    const Vec3 at = mesh_.points[dice_.pick(mesh_.point_count())];
    std::vector<std::pair<double, PointId>> order;
    for (std::size_t i = 0; i < mesh_.point_count(); ++i) order.emplace_back(norm(mesh_.points[i] - at), static_cast<PointId>(i));
    std::sort(order.begin(), order.end());
    std::vector<PartSet> sets;
    std::size_t size = 12 + dice_.pick(24);
    const std::size_t count = 1 + dice_.pick(2);
    for (std::size_t t = 0; t < count; ++t) {
      const ConstraintKind kinds[] = {Spherical{}, Planar{}, Rigid{}, FixedPlane{at, dice_.direction()}, Straight{}};
      auto& [kind, ids] = sets.emplace_back(kinds[t == 0 ? dice_.pick(4) : 1 + dice_.pick(4)], std::vector<PointId>{});
      for (std::size_t i = 0; i < std::min(size, order.size()); ++i) ids.push_back(order[i].second);
      if (std::holds_alternative<Spherical>(kind)) break;  // it would end as a plane
      size = std::max<std::size_t>(6, size / 2);
    }
    return sets;
  }

  /// Where a handle is: a place about which it turns.
  Vec3 middle(std::size_t handle) {
    Vec3 at = mesh_.points[made_.handles[handle].front() % mesh_.point_count()];
    return at + 0.2 * made_.unit * dice_.direction();
  }

  Vec3 shift() {
    Vec3 v = vigour_ * dice_.uniform(0.02, 0.4) * made_.unit * dice_.direction();
    if (made_.symmetric) v[1] = 0;
    return v;
  }

  Affine affine_motion(std::size_t handle) {
    Affine map = identity_affine;
    const std::size_t kind = dice_.pick(4);
    const Vec3 by = shift();
    if (kind == 0 || made_.setup.handles[handle].stage > 0) {
      for (std::size_t k = 0; k < 3; ++k) map[4 * k + 3] = by[k];
      return map;
    }
    const Vec3 at = middle(handle);
    const double angle = vigour_ * dice_.uniform(-0.5, 0.5), c = std::cos(angle), s = std::sin(angle);
    const std::size_t axis = made_.symmetric ? 1 : dice_.pick(3), u = (axis + 1) % 3, v = (axis + 2) % 3;
    map[4 * u + u] = map[4 * v + v] = c;
    map[4 * u + v] = -s;
    map[4 * v + u] = s;
    if (kind >= 2) {
      for (std::size_t k = 0; k < 3; ++k) {
        for (std::size_t l = 0; l < 3; ++l) {
          if (!made_.symmetric || (k != 1 && l != 1)) map[4 * k + l] += vigour_ * dice_.uniform(-0.15, 0.15);
        }
      }
    }
    for (std::size_t k = 0; k < 3; ++k) {
      if (made_.symmetric && k == 1) continue;
      map[4 * k + 3] = at[k] + by[k];
      for (std::size_t l = 0; l < 3; ++l) map[4 * k + 3] -= map[4 * k + l] * at[l];
    }
    return map;
  }

  /// A wave over the points of a handle.
  std::vector<Vec3> wave(std::size_t handle) {
    const Vec3 by = shift(), turns = 3 * dice_.direction();
    std::vector<Vec3> result;
    for (const PointId id : made_.handles[handle]) {
      const Vec3& x = mesh_.points[id % mesh_.point_count()];
      result.push_back(std::sin(1 + dot(turns, x) / made_.unit) * by);
    }
    return result;
  }

  void add_variables() {
    for (std::size_t h = 0; h < made_.setup.handles.size(); ++h) {
      const std::string name = made_.setup.handles[h].name;
      const Vec3 along = dice_.uniform(0.1, 3) * (made_.symmetric ? Vec3{0.6, 0, 0.8} : dice_.direction());
      made_.setup.variables.push_back({name + " shift", name, Translation{along}});
      if (made_.setup.handles[h].stage > 0) continue;
      Rotation turn{made_.symmetric ? Vec3{0, 1, 0} : dice_.uniform(0.1, 3) * dice_.direction(), middle(h)};
      if (dice_.once_in(2)) turn.unit = AngleUnit::degrees;
      made_.setup.variables.push_back({name + " turn", name, turn});
      if (made_.symmetric || !dice_.once_in(2)) continue;
      made_.setup.variables.push_back({name + " scale", name, Scaling{middle(h), dice_.once_in(2) ? Vec3{} : dice_.direction()}});
    }
    auto* options = std::get_if<RbfOptions>(&made_.setup.method);
    if (options == nullptr || options->solver != Solver::incremental_qr || !dice_.once_in(2) || made_.kind == Kind::composed)
      return;
    for (std::size_t i = 0; i < 1 + dice_.pick(3); ++i) options->samples.push_back(values());
  }

  std::vector<double> values() {
    std::vector<double> result;
    for (const DesignVariable& variable : made_.setup.variables) {
      double largest = 0.3;
      if (std::holds_alternative<Translation>(variable.kind)) largest = 0.3 * made_.unit;
      if (const auto* turn = std::get_if<Rotation>(&variable.kind); turn != nullptr && turn->unit == AngleUnit::degrees)
        largest = 25;
      result.push_back(vigour_ * dice_.uniform(-largest, largest));
    }
    return result;
  }

  void choose_designs() {
    const bool by_variables = dice_.once_in(3);
    if (by_variables) add_variables();
    const std::size_t count = large_ || is_energy() ? 1 + dice_.pick(2) : 1 + dice_.pick(4), handles = made_.setup.handles.size();
    for (std::size_t d = 0; d < count; ++d) {
      Design design;
      std::vector<Prescribed> prescribed(handles);
      if (by_variables) {
        design.variables = values();
        for (std::size_t h = 0; h < handles; ++h) prescribed[h].map = composed(h, design.variables);
      }
      for (std::size_t h = 0; h < handles && !by_variables; ++h) {
        if (made_.setup.handles[h].name.starts_with("still")) continue;
        if (dice_.once_in(5)) {
          prescribed[h].displacements = wave(h);
          design.motions.push_back({h, prescribed[h].displacements});
        } else {
          const Affine map = affine_motion(h);
          prescribed[h].map = wide_map(map);
          design.motions.push_back({h, map});
        }
      }
      made_.designs.push_back(std::move(design));
      made_.prescribed.push_back(std::move(prescribed));
    }
    made_.path = dice_.once_in(3) ? EvaluationPath::direct : EvaluationPath::automatic;
    const auto* options = std::get_if<RbfOptions>(&made_.setup.method);
    if (made_.kind != Kind::rbf || options->solver != Solver::iterative || !dice_.once_in(5)) return;
    for (Design& design : made_.designs) design.tolerance = dice_.power(-10, -3);
  }

  WideMap composed(std::size_t handle, const std::vector<double>& values) const {
    WideMap map = wide_map(identity_affine);
    for (std::size_t v = 0; v < values.size(); ++v) {
      const DesignVariable& variable = made_.setup.variables[v];
      if (variable.handle == made_.setup.handles[handle].name) map = after(variable_map(variable.kind, values[v]), map);
    }
    return map;
  }

  Dice dice_;
  const std::uint64_t seed_;
  const double most_;
  bool large_ = false, constrained_ = false;
  std::vector<std::vector<PartSet>> families_;  ///< of the part, if the mesh is one
  std::size_t held_count_ = 0;
  double vigour_ = 1;  ///< of motions
  Mesh mesh_;
  Case made_;
};

}  // namespace deform::test::contract
