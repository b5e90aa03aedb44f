// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/core/deformers/dense_energy.h"

#include <Eigen/Core>
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

namespace deform::test::dense_energy {

const EnergyOptions& energy_options(const MethodOptions& method) {
  return std::visit(
      [](const auto& options) -> const EnergyOptions& {
        if constexpr (std::is_base_of_v<EnergyOptions, std::decay_t<decltype(options)>>) return options;
        throw std::logic_error("not an energy method");
      },
      method);
}

Field Equations::energy(const Field& w) const {
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

Field Equations::misfit(const Field& w) const {
  Field result = h;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (const auto& [j, value] : rows[i]) {
      for (std::size_t k = 0; k < 3; ++k) result[i][k] -= Quad(value) * w[static_cast<std::size_t>(j)][k];
    }
  }
  return result;
}

Field Equations::right_side(Field u) const {
  for (std::size_t i = 0; i < u.size() && !model.eliminated; ++i) {
    for (Quad& value : u[i]) value *= Quad(weights[i]);
  }
  Field result(static_cast<std::size_t>(unknowns));
  add_transposed(u, result);
  return result;
}

void Equations::add_transposed(const Field& x, Field& to) const {
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (const auto& [j, value] : rows[i]) {
      for (std::size_t k = 0; k < 3; ++k) to[static_cast<std::size_t>(j)][k] += Quad(value) * x[i][k];
    }
  }
}

Quad largest(const Field& field) {
  Quad result = 0;
  for (const auto& row : field) {
    for (const Quad x : row) result = std::max(result, x < 0 ? -x : x);
  }
  return result;
}

Factor::Factor(const Equations& of) : of_(of) {
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

Field Factor::solve(const Field& b) const {
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

Field Factor::residual(const Field& b, const Field& x) const {
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

Field loads(const Equations& equations, const Factor& factor, bool multipliers) {
  Field u = equations.h;
  for (int step = 1; multipliers && step < EnergySolver::multiplier_steps; ++step) {
    const Field left = equations.misfit(factor.solve(equations.right_side(u)));
    for (std::size_t i = 0; i < u.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) u[i][k] += left[i][k];
    }
  }
  return u;
}

Field solution(const Equations& equations, bool soft) {
  const Factor factor(equations);
  return factor.solve(equations.right_side(loads(equations, factor, !soft && !equations.model.eliminated)));
}

namespace {

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
  const Matrix X = lu_solution(A, F);
  Matrix values(static_cast<Eigen::Index>(places.size()), misfit.cols());
  for (Eigen::Index s = 0; s < values.rows(); ++s) {
    const Vec3& x = places[static_cast<std::size_t>(s)];
    values.row(s) = X.row(m);
    for (Eigen::Index k = 0; k < 3; ++k) values.row(s) += x[static_cast<std::size_t>(k)] * X.row(m + 1 + k);
    for (Eigen::Index j = 0; j < m; ++j) values.row(s) += between(x, centres[static_cast<std::size_t>(j)]) * X.row(j);
  }
  return values;
}

}  // namespace

Oracle::Oracle(const Mesh& mesh, const MethodOptions& method, std::uint64_t seed, const std::vector<RegionIndex>& region_of)
    : mesh_(mesh), region_of_(region_of), soft_(energy_options(method).handles == HandleMode::soft) {
  make_model(method, seed);
  box_ = bounding_box(mesh.points);
}

std::vector<std::pair<Eigen::Index, double>> Oracle::functions_at(PointId id) const {
  std::vector<std::pair<Eigen::Index, double>> result;
  model_.space.functions().for_each(id, [&](std::int64_t j, double value) { result.emplace_back(j, value); });
  return result;
}

Matrix Oracle::interpolation_at(const std::vector<PointId>& ids) const {
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

std::vector<std::array<Extended, 3>> Oracle::displacements(const MethodOptions& method,
                                                           const std::function<std::array<Quad, 3>(PointId)>& prescribed) const {
  return displacements(method, prescribed, [this](const Equations& equations) { return solution(equations, soft_); });
}

std::vector<std::array<Extended, 3>> Oracle::displacements(const MethodOptions& method,
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

void Oracle::make_model(const MethodOptions& method, std::uint64_t seed) {
  if (const auto* shell = std::get_if<ShellOptions>(&method)) {
    EnergyModel made = shell_model(mesh_, region_of_, *shell, bounding_box(mesh_.points).diagonal());
    return swap(model_, made);
  }
  if (const auto* ffd = std::get_if<FfdOptions>(&method)) {
    EnergyModel made = lattice_model(mesh_, *ffd, region_of_, {});
    return swap(model_, made);
  }
  const auto* mls = std::get_if<MlsOptions>(&method);
  EnergyModel made{mls != nullptr ? mls_space(mesh_, *mls, seed) : shell_subspace(mesh_, std::get<SubspaceOptions>(method), seed),
                   {},
                   false,
                   {}};
  for (std::size_t i = 0; i < region_of_.size(); ++i) {
    if (region_of_[i] != deformable_region) made.held.push_back(static_cast<PointId>(i));
  }
  swap(model_, made);
}

Equations Oracle::equations_of(double fixing, const std::function<std::array<Quad, 3>(PointId)>& prescribed) const {
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

Matrix Oracle::corrections(const Equations& equations, const Field& w, const std::vector<Vec3>& places) const {
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

}  // namespace deform::test::dense_energy
