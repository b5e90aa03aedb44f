// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <stdexcept>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/constrained/energy_solver.h"
#include "core/deformers/energy/residual_correction.h"
#include "core/deformers/energy/spaces/lattice_space.h"
#include "core/deformers/energy/spaces/mls.h"
#include "core/deformers/energy/spaces/shell.h"
#include "core/deformers/energy/spaces/subspace.h"
#include "core/deformers/handles/constraint_points.h"
#include "core/deformers/setup.h"

/// Dense solutions of the energy methods whose residuals carry twice the digits. The functions and the energies of their spaces
/// are those of the product, which belong to the method; equations, factors, steps of the multipliers, interpolation of what
/// these leave and sums are not.
namespace deform::test::dense_energy {

__extension__ typedef __float128 Quad;
using Extended = long double;
using Matrix = Eigen::Matrix<Extended, Eigen::Dynamic, Eigen::Dynamic>;
using Field = std::vector<std::array<Quad, 3>>;

inline const EnergyOptions& energy_options(const MethodOptions& method) {
  return std::visit(
      [](const auto& options) -> const EnergyOptions& {
        if constexpr (std::is_base_of_v<EnergyOptions, std::decay_t<decltype(options)>>) return options;
        throw std::logic_error("not an energy method");
      },
      method);
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
  /// R u, or B^T W u.
  Field right_side(Field u) const {
    for (std::size_t i = 0; i < u.size() && !model.eliminated; ++i) {
      for (Quad& value : u[i]) value *= Quad(weights[i]);
    }
    Field result(static_cast<std::size_t>(unknowns));
    add_transposed(u, result);
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

inline Quad largest(const Field& field) {
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
    A_ = Matrix(Eigen::MatrixXd(of.model.space.energy).cast<Extended>()).selfadjointView<Eigen::Lower>();
    if (!of.model.eliminated) {
      for (std::size_t i = 0; i < of.rows.size(); ++i) {
        for (const auto& [a, x] : of.rows[i]) {
          for (const auto& [b, y] : of.rows[i]) A_(a, b) += Extended(x) * y * of.weights[i];
        }
      }
    }
    lu_.compute(A_);
  }
  const Matrix& matrix() const { return A_; }
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

  /// b - (K + B^T W B) x, or b - K x
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

 private:
  const Equations& of_;
  Matrix A_;
  Eigen::PartialPivLU<Matrix> lu_;
};

/// The loads of the last step, with multipliers of several.
inline Field loads(const Equations& equations, const Factor& factor, bool multipliers) {
  Field u = equations.h;
  for (int step = 1; multipliers && step < EnergySolver::multiplier_steps; ++step) {
    const Field left = equations.misfit(factor.solve(equations.right_side(u)));
    for (std::size_t i = 0; i < u.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) u[i][k] += left[i][k];
    }
  }
  return u;
}

/// The coefficients of the solution.
inline Field solution(const Equations& equations, bool soft) {
  const Factor factor(equations);
  return factor.solve(equations.right_side(loads(equations, factor, !soft && !equations.model.eliminated)));
}

/// Values at places of the triharmonic interpolant, with a linear polynomial, of a misfit at centres.
inline Matrix interpolated(const std::vector<Vec3>& centres, const Matrix& misfit, const std::vector<Vec3>& places) {
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
/// The solutions of one setup.
class Oracle {
 public:
  Oracle(const Mesh& mesh, const MethodOptions& method, std::uint64_t seed, const std::vector<RegionIndex>& region_of)
      : mesh_(mesh), region_of_(region_of), soft_(energy_options(method).handles == HandleMode::soft) {
    make_model(method, seed);
    box_ = bounding_box(mesh.points);
  }
  Oracle(const Oracle&) = delete;
  Oracle& operator=(const Oracle&) = delete;

  std::size_t unknowns() const { return static_cast<std::size_t>(model_.space.energy.rows()); }
  /// Whether the solution has one linear system: not with multipliers, whose steps belong to the method.
  bool one_system() const { return soft_ || model_.eliminated; }
  bool soft() const { return soft_; }
  /// Whether no function reaches handle and fixed points.
  bool eliminated() const { return model_.eliminated; }
  /// Handle and fixed points that enter the system.
  const std::vector<PointId>& held() const { return model_.held; }
  const Box& box() const { return box_; }
  std::vector<std::pair<Eigen::Index, double>> functions_at(PointId id) const {
    std::vector<std::pair<Eigen::Index, double>> result;
    model_.space.functions().for_each(id, [&](std::int64_t j, double value) { result.emplace_back(j, value); });
    return result;
  }

  /// What is added at points (rows) for a misfit of one at a held point (columns).
  Matrix interpolation_at(const std::vector<PointId>& ids) const {
    std::vector<Vec3> held, centres, places;
    for (const PointId id : model_.held) held.push_back(unit(id));
    for (const PointId id : ids) places.push_back(unit(id));
    std::size_t following = 0;
    for (const RegionIndex region : region_of_) following += region == deformable_region ? 1 : 0;
    const ResidualCorrection correction(held, ResidualCorrection::centres_for(following), {}, {});
    const auto count = static_cast<Eigen::Index>(correction.centres().size());
    for (const std::uint32_t centre : correction.centres()) centres.push_back(held[centre]);
    const Matrix at = interpolated(centres, Matrix::Identity(count, count), places);
    Matrix result = Matrix::Zero(at.rows(), static_cast<Eigen::Index>(held.size()));
    for (Eigen::Index j = 0; j < count; ++j) result.col(correction.centres()[static_cast<std::size_t>(j)]) = at.col(j);
    return result;
  }

  /// The displacements of all points, from those that handle and fixed points are to have.
  std::vector<std::array<Extended, 3>> displacements(const MethodOptions& method,
                                                     const std::function<std::array<Quad, 3>(PointId)>& prescribed) const {
    return displacements(method, prescribed, [this](const Equations& equations) { return solution(equations, soft_); });
  }
  /// The same with the coefficients from `solve`.
  std::vector<std::array<Extended, 3>> displacements(const MethodOptions& method,
                                                     const std::function<std::array<Quad, 3>(PointId)>& prescribed,
                                                     const std::function<Field(const Equations&)>& solve) const {
    const Equations equations = equations_of(energy_options(method).fixing, prescribed);
    const Field w = solve(equations);
    std::vector<PointId> ids;
    std::vector<Vec3> places;
    std::vector<std::array<Extended, 3>> result(region_of_.size());
    for (std::size_t i = 0; i < region_of_.size(); ++i) {
      const auto id = static_cast<PointId>(i);
      if (!soft_ && region_of_[i] != deformable_region) {
        const std::array<Quad, 3> to = prescribed(id);
        for (std::size_t k = 0; k < 3; ++k) result[i][k] = static_cast<Extended>(to[k]);
        continue;
      }
      ids.push_back(id);
      places.push_back(unit(id));
    }
    const Matrix added = corrections(equations, w, places);
    const FunctionRows functions = model_.space.functions();
    for (std::size_t s = 0; s < ids.size(); ++s) {
      for (std::size_t k = 0; k < 3; ++k) {
        Quad u = Quad(added(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(k)));
        functions.for_each(ids[s], [&](std::int64_t j, double value) { u += Quad(value) * w[static_cast<std::size_t>(j)][k]; });
        result[ids[s]][k] = static_cast<Extended>(u);
      }
    }
    return result;
  }

 private:
  Vec3 unit(PointId id) const { return (1 / box_.diagonal()) * (mesh_.points[id] - box_.min); }

  void make_model(const MethodOptions& method, std::uint64_t seed) {
    if (const auto* shell = std::get_if<ShellOptions>(&method)) {
      EnergyModel made = shell_model(mesh_, region_of_, *shell, bounding_box(mesh_.points).diagonal());
      return swap(model_, made);
    }
    if (const auto* ffd = std::get_if<FfdOptions>(&method)) {
      EnergyModel made = lattice_model(mesh_, *ffd, region_of_, {});
      return swap(model_, made);
    }
    const auto* mls = std::get_if<MlsOptions>(&method);
    EnergyModel made{
        mls != nullptr ? mls_space(mesh_, *mls, seed) : shell_subspace(mesh_, std::get<SubspaceOptions>(method), seed),
        {},
        false,
        {}};
    for (std::size_t i = 0; i < region_of_.size(); ++i) {
      if (region_of_[i] != deformable_region) made.held.push_back(static_cast<PointId>(i));
    }
    swap(model_, made);
  }

  Equations equations_of(double fixing, const std::function<std::array<Quad, 3>(PointId)>& prescribed) const {
    Equations equations{model_, {}, {}, {}, model_.space.energy.rows()};
    std::map<RegionIndex, std::size_t> counts;
    for (const RegionIndex region : region_of_) ++counts[region];
    const FunctionRows functions = model_.space.functions();
    equations.rows.resize(model_.held.size());
    for (std::size_t i = 0; i < model_.held.size(); ++i) {
      const PointId id = model_.held[i];
      equations.h.push_back(prescribed(id));
      if (model_.eliminated) {
        for (SparseMatrix::InnerIterator it(model_.coupling, static_cast<std::int64_t>(i)); it; ++it) {
          equations.rows[i].emplace_back(it.row(), -it.value());
        }
      } else {
        functions.for_each(id, [&](std::int64_t j, double value) { equations.rows[i].emplace_back(j, value); });
      }
      equations.weights.push_back(soft_ ? fixing / static_cast<double>(counts[region_of_[id]]) : 0);
    }
    if (!soft_ && !model_.eliminated) {
      SparseMatrix transposed(equations.unknowns, static_cast<std::int64_t>(model_.held.size()));
      for (std::size_t i = 0; i < equations.rows.size(); ++i) {
        for (const auto& [j, value] : equations.rows[i]) transposed.insert(j, static_cast<std::int64_t>(i)) = value;
      }
      const Eigen::VectorXd shares = Eigen::VectorXd::Ones(static_cast<Eigen::Index>(model_.held.size()));
      const Eigen::VectorXd weights = multiplier_weights(model_.space.energy, transposed, shares);
      equations.weights.assign(weights.begin(), weights.end());
    }
    return equations;
  }

  /// What the multipliers leave at hard handles, interpolated.
  Matrix corrections(const Equations& equations, const Field& w, const std::vector<Vec3>& places) const {
    const auto rows = static_cast<Eigen::Index>(places.size());
    if (soft_ || model_.eliminated) return Matrix::Zero(rows, 3);
    std::vector<Vec3> held, centres;
    for (const PointId id : model_.held) held.push_back(unit(id));
    const ResidualCorrection correction(held, ResidualCorrection::centres_for(places.size()), {}, {});
    const Field left = equations.misfit(w);
    Matrix misfit(static_cast<Eigen::Index>(correction.centres().size()), 3);
    for (const std::uint32_t centre : correction.centres()) {
      for (Eigen::Index k = 0; k < 3; ++k) {
        misfit(static_cast<Eigen::Index>(centres.size()), k) = Extended(left[centre][static_cast<std::size_t>(k)]);
      }
      centres.push_back(held[centre]);
    }
    return interpolated(centres, misfit, places);
  }

  const Mesh& mesh_;
  const std::vector<RegionIndex> region_of_;
  const bool soft_;
  EnergyModel model_;
  Box box_;
};

}  // namespace deform::test::dense_energy
