// SPDX-License-Identifier: GPL-3.0-or-later
// The error that a report tells of the energy methods, against solutions whose residuals carry twice the digits, at every point:
// never less than half of what it is, in the median not 20 times as large, and large or small enough for the right verdict.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/constrained/energy_solver.h"
#include "core/deformers/energy/residual_correction.h"
#include "core/deformers/energy/spaces/lattice_space.h"
#include "core/deformers/energy/spaces/mls.h"
#include "core/deformers/energy/spaces/shell.h"
#include "core/deformers/energy/spaces/subspace.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/shapes.h"
#include "tests/core/deformers/space_cases.h"

namespace deform {
namespace {

__extension__ typedef __float128 Quad;
using Extended = long double;
using Matrix = Eigen::Matrix<Extended, Eigen::Dynamic, Eigen::Dynamic>;
using Field = std::vector<std::array<Quad, 3>>;

struct Case {
  std::string name;
  std::shared_ptr<const Mesh> mesh;
  deform::Setup setup;
  Design design;
  std::vector<RegionIndex> region_of;
};

class Dice {
 public:
  explicit Dice(std::uint32_t seed) : random_(seed) {}
  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  double power(double low, double high) { return std::pow(10.0, uniform(low, high)); }
  std::size_t pick(std::size_t count) { return std::uniform_int_distribution<std::size_t>(0, count - 1)(random_); }

 private:
  std::mt19937 random_;
};

void weigh(EnergyOptions& options, Dice& dice) {
  const std::size_t kind = dice.pick(4);
  options.stretching = kind == 0 ? 0 : dice.power(-3, 3);
  options.bending = kind == 1 ? 0 : dice.power(-3, 3);
  if (dice.pick(6) == 0) options.bending = dice.power(-12, -3);
  options.handles = dice.pick(3) == 0 ? HandleMode::soft : HandleMode::hard;
  options.fixing = dice.power(0, 9);
  options.basis = dice.pick(2) == 0 ? BasisMode::never : BasisMode::always;
}

void choose_method(Case& c, Dice& dice, std::uint32_t seed) {
  if (seed % 4 == 0) {
    ShellOptions options;
    weigh(options, dice);
    c.name = "shell";
    c.setup.method = options;
  } else if (seed % 4 == 1) {
    SubspaceOptions options;
    weigh(options, dice);
    const std::optional<Kernel> kernels[] = {std::nullopt, Kernel::triharmonic, Kernel::biharmonic, Kernel::wendland_c2,
                                             Kernel::gaussian};
    options.kernel = kernels[dice.pick(5)];
    options.centres = 15 + dice.pick(80);
    c.name = options.kernel ? "subspace " + std::string(properties(*options.kernel).name) : "subspace";
    c.setup.method = options;
  } else if (seed % 4 == 2) {
    MlsOptions options;
    weigh(options, dice);
    options.surface_samples = 20 + dice.pick(80);
    if (c.mesh->elements) options.volume_samples = 20 + dice.pick(60);
    c.name = "mls";
    c.setup.method = options;
  } else {
    FfdOptions options;
    weigh(options, dice);
    options.lattice.points = {4 + dice.pick(4), 4 + dice.pick(2), 4 + dice.pick(2)};
    c.name = "ffd";
    c.setup.method = options;
  }
}

const EnergyOptions& energy_options(const Case& c) {
  return std::visit(
      [](const auto& options) -> const EnergyOptions& {
        if constexpr (std::is_base_of_v<EnergyOptions, std::decay_t<decltype(options)>>) return options;
        throw std::logic_error("not an energy method");
      },
      c.setup.method);
}

/// A bumpy sheet with noise, or a cube with cells, in some unit and at some place; its ends move or stay.
Case random_case(std::uint32_t seed) {
  Dice dice(seed);
  Case c;
  const bool solid = seed % 4 >= 2 && dice.pick(3) == 0;
  Mesh mesh = solid ? test::solid_cube(3 + dice.pick(3)) : test::bumpy_sheet(8 + dice.pick(10), 5 + dice.pick(6));
  const double width = solid ? 0.5 : 1, unit = dice.power(-3, 3), away = seed % 5 == 0 ? dice.uniform(0, 20) : 0;
  std::vector<PointId> left, right;
  for (std::size_t i = 0; i < mesh.point_count(); ++i) {
    Vec3& p = mesh.points[i];
    if (p[0] < 0.3 * width) left.push_back(static_cast<PointId>(i));
    if (p[0] > 1.7 * width) right.push_back(static_cast<PointId>(i));
    for (double& value : p) value += dice.uniform(-0.01, 0.01);
    p = unit * (p + Vec3{away, -away, 0.3 * away});
  }
  c.region_of.assign(mesh.point_count(), deformable_region);
  for (const PointId id : left) c.region_of[id] = fixed_region;
  for (const PointId id : right) c.region_of[id] = 0;
  c.setup.handles = {{"right", {Region::Ids{right}}}};
  c.setup.fixed = {{Region::Ids{left}}};
  c.setup.seed = seed;
  Affine affine = identity_affine;
  const double angle = dice.uniform(-0.4, 0.4);
  affine[0] = affine[5] = std::cos(angle);
  affine[1] = -std::sin(angle);
  affine[4] = std::sin(angle);
  // About the place of the mesh, so that the motion is of its size.
  const Vec3 middle = mesh.points[right.front()];
  for (std::size_t k = 0; k < 3; ++k) {
    double shift = middle[k] + unit * dice.uniform(-0.3, 0.3);
    for (std::size_t l = 0; l < 3; ++l) shift -= affine[4 * k + l] * middle[l];
    affine[4 * k + 3] = shift;
  }
  c.design.motions.push_back({0, affine});
  c.mesh = test::shared(std::move(mesh));
  choose_method(c, dice, seed);
  return c;
}

EnergyModel model_of(const Case& c, double D) {
  EnergyModel model;
  if (const auto* shell = std::get_if<ShellOptions>(&c.setup.method)) {
    EnergyModel made = shell_model(*c.mesh, c.region_of, *shell, D);
    swap(model, made);
  } else if (const auto* ffd = std::get_if<FfdOptions>(&c.setup.method)) {
    EnergyModel made = lattice_model(*c.mesh, *ffd, c.region_of, {});
    swap(model, made);
  } else {
    const auto* mls = std::get_if<MlsOptions>(&c.setup.method);
    EnergyModel made{mls != nullptr ? mls_space(*c.mesh, *mls, c.setup.seed)
                                    : shell_subspace(*c.mesh, std::get<SubspaceOptions>(c.setup.method), c.setup.seed),
                     {},
                     false,
                     {}};
    for (std::size_t i = 0; i < c.region_of.size(); ++i) {
      if (c.region_of[i] != deformable_region) made.held.push_back(static_cast<PointId>(i));
    }
    swap(model, made);
  }
  return model;
}

/// Weighted rows of held points, energy and prescribed displacements.
struct Equations {
  const EnergyModel& model;
  std::vector<std::vector<std::pair<Eigen::Index, double>>> rows;  ///< of held points; of an eliminated model the columns of R
  std::vector<double> weights;
  Field h;
  Eigen::Index unknowns;

  /// K w
  Field energy(const Field& w) const {
    const SparseMatrix& K = model.space.energy;
    Field result(w.size());
    for (std::int64_t j = 0; j < K.outerSize(); ++j) {
      for (SparseMatrix::InnerIterator it(K, j); it; ++it) {
        const auto a = static_cast<std::size_t>(it.row()), b = static_cast<std::size_t>(j);
        for (std::size_t k = 0; k < 3; ++k) {
          result[a][k] += Quad(it.value()) * w[b][k];
          if (a != b) result[b][k] += Quad(it.value()) * w[a][k];
        }
      }
    }
    return result;
  }
  /// h - B w
  Field misfit(const Field& w) const {
    Field result = h;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      for (const auto& [j, value] : rows[i]) {
        for (std::size_t k = 0; k < 3; ++k) result[i][k] -= Quad(value) * w[static_cast<std::size_t>(j)][k];
      }
    }
    return result;
  }
  /// Adds B^T x.
  void add_transposed(const Field& x, Field& to) const {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      for (const auto& [j, value] : rows[i]) {
        for (std::size_t k = 0; k < 3; ++k) to[static_cast<std::size_t>(j)][k] += Quad(value) * x[i][k];
      }
    }
  }
};

Quad largest(const Field& field) {
  Quad result = 0;
  for (const auto& row : field) {
    for (const Quad x : row) result = std::max(result, x < 0 ? -x : x);
  }
  return result;
}

/// Dense LU in extended precision, with refinement in quadruple precision.
class Factor {
 public:
  explicit Factor(const Equations& of) : of_(of) {
    Matrix A = Matrix(Eigen::MatrixXd(of.model.space.energy).cast<Extended>()).selfadjointView<Eigen::Lower>();
    if (!of.model.eliminated) {
      for (std::size_t i = 0; i < of.rows.size(); ++i) {
        for (const auto& [a, x] : of.rows[i]) {
          for (const auto& [b, y] : of.rows[i]) A(a, b) += Extended(x) * y * of.weights[i];
        }
      }
    }
    lu_.compute(A);
  }
  /// x of (K + B^T W B) x = b, or of K x = b
  Field solve(const Field& b) const {
    Field x(b.size()), r = b;
    Quad before = 0;
    for (int step = 0; step < 12; ++step) {
      Matrix right(of_.unknowns, 3);
      const Quad size = largest(r);
      if (size == 0 || (step > 1 && size > before / 4)) break;
      before = size;
      for (Eigen::Index i = 0; i < right.rows(); ++i) {
        for (Eigen::Index k = 0; k < 3; ++k) {
          right(i, k) = Extended(r[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)]);
        }
      }
      const Matrix change = lu_.solve(right);
      for (std::size_t i = 0; i < x.size(); ++i) {
        for (std::size_t k = 0; k < 3; ++k) x[i][k] += Quad(change(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)));
      }
      r = residual(b, x);
    }
    return x;
  }

 private:
  Field residual(const Field& b, const Field& x) const {
    Field r = b;
    const Field e = of_.energy(x);
    for (std::size_t i = 0; i < r.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) r[i][k] -= e[i][k];
    }
    if (of_.model.eliminated) return r;
    Field held = of_.misfit(x);  // h - B x
    for (std::size_t i = 0; i < held.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) held[i][k] = Quad(of_.weights[i]) * (held[i][k] - of_.h[i][k]);
    }
    of_.add_transposed(held, r);
    return r;
  }

  const Equations& of_;
  Eigen::PartialPivLU<Matrix> lu_;
};

/// The coefficients of the solution.
Field solution(const Equations& equations, bool soft) {
  const auto size = static_cast<std::size_t>(equations.unknowns);
  Field b(size);
  const auto weighted = [&](const Field& u) {
    Field x = u;
    for (std::size_t i = 0; i < x.size(); ++i) {
      for (Quad& value : x[i]) value *= Quad(equations.weights[i]);
    }
    return x;
  };
  const Factor factor(equations);
  const bool eliminated = equations.model.eliminated;
  Field u = equations.h, w;
  for (int step = 0; step < (eliminated || soft ? 1 : EnergySolver::multiplier_steps); ++step) {
    Field b(size);
    equations.add_transposed(eliminated ? u : weighted(u), b);
    w = factor.solve(b);
    const Field left = equations.misfit(w);
    for (std::size_t i = 0; i < u.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) u[i][k] += left[i][k];
    }
  }
  return w;
}

/// Values at places of the triharmonic interpolant, with a linear polynomial, of a misfit at centres.
Matrix interpolated(const std::vector<Vec3>& centres, const Matrix& misfit, const std::vector<Vec3>& places) {
  const auto m = static_cast<Eigen::Index>(centres.size());
  const auto between = [](const Vec3& a, const Vec3& b) {
    Extended square = 0;
    for (std::size_t k = 0; k < 3; ++k) square += (Extended(a[k]) - b[k]) * (Extended(a[k]) - b[k]);
    return square * std::sqrt(square);
  };
  Matrix A = Matrix::Zero(m + 4, m + 4), F = Matrix::Zero(m + 4, misfit.cols());
  F.topRows(m) = misfit;
  for (Eigen::Index i = 0; i < m; ++i) {
    const Vec3& x = centres[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j < m; ++j) A(i, j) = between(x, centres[static_cast<std::size_t>(j)]);
    A(i, m) = A(m, i) = 1;
    for (Eigen::Index k = 0; k < 3; ++k) A(i, m + 1 + k) = A(m + 1 + k, i) = x[static_cast<std::size_t>(k)];
  }
  const Matrix X = A.partialPivLu().solve(F);
  Matrix values(static_cast<Eigen::Index>(places.size()), misfit.cols());
  for (Eigen::Index s = 0; s < values.rows(); ++s) {
    const Vec3& x = places[static_cast<std::size_t>(s)];
    values.row(s) = X.row(m);
    for (Eigen::Index k = 0; k < 3; ++k) values.row(s) += x[static_cast<std::size_t>(k)] * X.row(m + 1 + k);
    for (Eigen::Index j = 0; j < m; ++j) values.row(s) += between(x, centres[static_cast<std::size_t>(j)]) * X.row(j);
  }
  return values;
}

/// Largest distance of the delivered points from the solution.
double truth_of(const Case& c, const Points& delivered) {
  const EnergyOptions& options = energy_options(c);
  const bool soft = options.handles == HandleMode::soft;
  const Box box = bounding_box(c.mesh->points);
  const double D = box.diagonal();
  const EnergyModel model = model_of(c, D);
  Equations equations{model, {}, {}, {}, model.space.energy.rows()};
  std::vector<std::size_t> counts(2);
  for (const RegionIndex region : c.region_of) {
    if (region != deformable_region) ++counts[region == fixed_region ? 1 : 0];
  }
  const Affine& map = std::get<Affine>(c.design.motions[0].value);
  const FunctionRows functions = model.space.functions();
  equations.rows.resize(model.held.size());
  for (std::size_t i = 0; i < model.held.size(); ++i) {
    const PointId id = model.held[i];
    const Vec3& x = c.mesh->points[id];
    const Vec3 to = c.region_of[id] == fixed_region ? x : transformed(map, x);
    equations.h.push_back({Quad(to[0]) - x[0], Quad(to[1]) - x[1], Quad(to[2]) - x[2]});
    if (model.eliminated) {
      for (SparseMatrix::InnerIterator it(model.coupling, static_cast<std::int64_t>(i)); it; ++it) {
        equations.rows[i].emplace_back(it.row(), -it.value());
      }
    } else {
      functions.for_each(id, [&](std::int64_t j, double value) { equations.rows[i].emplace_back(j, value); });
    }
    equations.weights.push_back(soft ? options.fixing / static_cast<double>(counts[c.region_of[id] == fixed_region ? 1 : 0]) : 0);
  }
  if (!soft && !model.eliminated) {
    SparseMatrix transposed(equations.unknowns, static_cast<std::int64_t>(model.held.size()));
    for (std::size_t i = 0; i < equations.rows.size(); ++i) {
      for (const auto& [j, value] : equations.rows[i]) transposed.insert(j, static_cast<std::int64_t>(i)) = value;
    }
    equations.weights.assign(model.held.size(), multiplier_weight(model.space.energy, transposed));
  }
  const Field w = solution(equations, soft);
  std::vector<PointId> ids;
  std::vector<Vec3> places, held;
  const auto unit = [&](PointId id) { return (1 / D) * (c.mesh->points[id] - box.min); };
  for (std::size_t i = 0; i < c.region_of.size(); ++i) {
    if (!soft && c.region_of[i] != deformable_region) continue;
    ids.push_back(static_cast<PointId>(i));
    places.push_back(unit(static_cast<PointId>(i)));
  }
  Matrix added = Matrix::Zero(static_cast<Eigen::Index>(ids.size()), 3);
  if (!soft && !model.eliminated) {
    for (const PointId id : model.held) held.push_back(unit(id));
    const ResidualCorrection correction(held, ResidualCorrection::centres_for(ids.size()), {});
    const Field left = equations.misfit(w);
    std::vector<Vec3> centres;
    Matrix misfit(static_cast<Eigen::Index>(correction.centres().size()), 3);
    for (const std::uint32_t centre : correction.centres()) {
      for (Eigen::Index k = 0; k < 3; ++k) {
        misfit(static_cast<Eigen::Index>(centres.size()), k) = Extended(left[centre][static_cast<std::size_t>(k)]);
      }
      centres.push_back(held[centre]);
    }
    added = interpolated(centres, misfit, places);
  }
  Extended worst = 0;
  for (std::size_t s = 0; s < ids.size(); ++s) {
    Extended square = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      Quad u = Quad(added(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(k)));
      functions.for_each(ids[s], [&](std::int64_t j, double value) { u += Quad(value) * w[static_cast<std::size_t>(j)][k]; });
      const auto difference = Extended(Quad(delivered[ids[s]][k]) - c.mesh->points[ids[s]][k] - u);
      square += difference * difference;
    }
    worst = std::max(worst, std::sqrt(square));
  }
  return static_cast<double>(worst);
}

TEST(ReportedError, OfEnergyMethodsBoundsWhatItIs) {
  const bool many = std::getenv("DEFORM_LONG") != nullptr;
  std::vector<double> ratios;
  for (std::uint32_t seed = 0; seed < (many ? 1000u : 50u); ++seed) {
    const Case c = random_case(seed);
    std::shared_ptr<const System> system;
    try {
      system = prepare(c.mesh, c.setup);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::numerical_failure) << error.what();
      continue;
    }
    const auto evaluation = system->bind({&c.design, 1}, EvaluationPath::automatic, {});
    const Points points = system->evaluate(c.design);
    const DesignReport& report = evaluation->report(0);
    const double truth = truth_of(c, points), motion = report.prescribed_displacement;
    EXPECT_GE(report.error, 0.5 * truth) << seed << ' ' << c.name << ", condition " << system->info().condition;
    // Verdicts: bad beyond 1e-3 of the motion, never within 1e-6 (proto/convert/verdict.cpp).
    const bool bad = !report.converged || report.error > 1e-3 * motion;
    EXPECT_TRUE(bad || truth <= 1e-3 * motion) << seed << ' ' << c.name;
    EXPECT_FALSE(bad && truth <= 1e-6 * motion) << seed << ' ' << c.name;
    ratios.push_back(report.error / std::max(truth, 1e-300));
  }
  ASSERT_GE(ratios.size(), many ? 900u : 45u);
  std::nth_element(ratios.begin(), ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2), ratios.end());
  EXPECT_LE(ratios[ratios.size() / 2], 20);
}

/// What coarse functions miss at handles is no error, but it is said.
TEST(ReportedError, FunctionsThatAreCoarserThanHandlesHaveANote) {
  Mesh mesh = test::bumpy_sheet(31, 16);
  Dice dice(3);
  for (Vec3& p : mesh.points) p[2] += dice.uniform(-0.05, 0.05);
  const auto notes = [&](std::array<std::size_t, 3> points) {
    deform::Setup setup = test::sheet_setup();
    FfdOptions options;
    options.lattice.points = points;
    setup.method = options;
    const auto system = prepare(test::shared(mesh), setup);
    std::string all;
    for (const std::string& note : system->info().notes) all += note;
    return all;
  };
  EXPECT_NE(notes({4, 4, 4}).find("The functions miss shifts of the handles by up to "), std::string::npos);
  EXPECT_EQ(notes({16, 8, 6}).find("The functions miss"), std::string::npos);
}

}  // namespace
}  // namespace deform
