// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/lattice_space.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/model_lattice.h"
#include "core/deformers/energy/spaces/unit_points.h"
#include "core/numerics/dense/decompositions.h"
#include "core/numerics/sparse/row_gram.h"

namespace deform {

namespace {

constexpr std::size_t columns_per_range = 16;
constexpr double flat_extent = 1e-12;  // extent of the held points across a plane or line over that along it, squared
constexpr double unheld_cost = 1e-6;   // of the trace of the energy

/// Part of the energy: coefficient times, for each axis, the integral of the from[k]-th derivative of one function times the
/// to[k]-th of the other.
struct EnergyTerm {
  std::array<std::size_t, 3> from{}, to{};
  double coefficient = 0;
};

/// With the axes A, g = A^-1 A^-T and s = A^-1 S A^-T: grad d . S grad d = s^ac d_a d_c and |hessian d|^2 = g^ac g^be d_ab d_ce,
/// where indices are derivatives with respect to u. Equal products of derivatives are collected.
std::vector<EnergyTerm> energy_terms(const Eigen::Matrix3d& A, const Eigen::Matrix3d& S, double bending) {
  const double volume = std::abs(A.determinant());
  const Eigen::Matrix3d inverse = A.inverse();
  const Eigen::Matrix3d g = inverse * inverse.transpose(), s = inverse * S * inverse.transpose();
  std::map<std::pair<std::array<std::size_t, 3>, std::array<std::size_t, 3>>, double> sums;
  const auto at = [](const Eigen::Matrix3d& M, std::size_t a, std::size_t b) {
    return M(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b));
  };
  for (std::size_t a = 0; a < 3; ++a) {
    for (std::size_t c = 0; c < 3; ++c) {
      std::array<std::size_t, 3> from{}, to{};
      ++from[a];
      ++to[c];
      sums[{from, to}] += volume * at(s, a, c);
      for (std::size_t b = 0; b < 3; ++b) {
        for (std::size_t e = 0; e < 3; ++e) {
          auto from_two = from, to_two = to;
          ++from_two[b];
          ++to_two[e];
          sums[{from_two, to_two}] += bending * volume * at(g, a, c) * at(g, b, e);
        }
      }
    }
  }
  std::vector<EnergyTerm> terms;
  for (const auto& [derivatives, sum] : sums) {
    if (sum != 0) terms.push_back({derivatives.first, derivatives.second, sum});
  }
  return terms;
}

/// Gram matrices of the splines' derivatives along each axis, [axis][from][to].
using AxisGrams = std::array<std::array<std::array<Eigen::MatrixXd, 3>, 3>, 3>;

AxisGrams axis_grams(const Lattice& lattice) {
  AxisGrams grams;
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t p = 0; p < 3; ++p) {
      for (std::size_t q = 0; q < 3; ++q) grams[k][p][q] = lattice.axis(k).gram(p, q);
    }
  }
  return grams;
}

/// The trace of the matrix of the terms; the trace of a Kronecker product is the product of the traces along the axes.
double trace(const std::vector<EnergyTerm>& terms, const AxisGrams& grams) {
  double sum = 0;
  for (const EnergyTerm& term : terms) {
    double product = term.coefficient;
    for (std::size_t k = 0; k < 3; ++k) product *= grams[k][term.from[k]][term.to[k]].trace();
    sum += product;
  }
  return sum;
}

/// Projection on the directions in which the held points do not extend. Displacements that change along these, and not at the
/// held points, cost no bending energy.
Eigen::Matrix3d unheld_directions(const Mesh& mesh, const EnergyModel& model) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double count = 0;
  const auto for_each = [&](const auto& use) {
    for (const PointId id : model.held) {
      if (model.space.functions().count(id) == 0) continue;
      use(Eigen::Vector3d(mesh.points[id][0], mesh.points[id][1], mesh.points[id][2]));
    }
  };
  for_each([&](const Eigen::Vector3d& x) {
    mean += x;
    ++count;
  });
  mean /= std::max(count, 1.0);
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for_each([&](const Eigen::Vector3d& x) { covariance += (x - mean) * (x - mean).transpose(); });
  const SymmetricEigen<3> eigen = symmetric_eigen(covariance);
  Eigen::Matrix3d result = Eigen::Matrix3d::Zero();
  for (Eigen::Index k = 0; k < 3; ++k) {
    if (eigen.values[k] > flat_extent * eigen.values[2]) continue;
    result += eigen.vectors.col(k) * eigen.vectors.col(k).transpose();
  }
  return result;
}

/// K: two functions have a common energy where their supports meet, along each axis within the order of its splines.
SparseMatrix lattice_energy(const Lattice& lattice, const AxisGrams& grams, const std::vector<EnergyTerm>& terms,
                            const RunContext& context) {
  const std::array<std::size_t, 3> size{lattice.axis(0).size(), lattice.axis(1).size(), lattice.axis(2).size()};
  const auto last = [&](std::size_t k, std::size_t i) { return std::min(size[k], i + lattice.axis(k).order()); };
  const auto first = [&](std::size_t k, std::size_t i) { return i + 1 - std::min(i + 1, lattice.axis(k).order()); };
  std::vector<LowerColumn> columns(lattice.size());
  parallel_for(context, columns.size(), columns_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t j = begin; j < end; ++j) {
      const std::array<std::size_t, 3> at{j % size[0], j / size[0] % size[1], j / size[0] / size[1]};
      const auto value = [&](const std::array<std::size_t, 3>& row) {
        double sum = 0;
        for (const EnergyTerm& term : terms) {
          double product = term.coefficient;
          for (std::size_t k = 0; k < 3; ++k) {
            product *= grams[k][term.from[k]][term.to[k]](static_cast<Eigen::Index>(row[k]), static_cast<Eigen::Index>(at[k]));
          }
          sum += product;
        }
        return sum;
      };
      for (std::size_t c = at[2]; c < last(2, at[2]); ++c) {
        for (std::size_t b = first(1, at[1]); b < last(1, at[1]); ++b) {
          for (std::size_t a = first(0, at[0]); a < last(0, at[0]); ++a) {
            const std::size_t i = lattice.number(a, b, c);
            if (i < j) continue;
            columns[j].rows.push_back(static_cast<std::int64_t>(i));
            columns[j].values.push_back(value({a, b, c}));
          }
        }
      }
    }
  });
  return lower_matrix(columns);
}

}  // namespace

EnergyModel lattice_model(const Mesh& mesh, const FfdOptions& options, const std::vector<RegionIndex>& region_of,
                          const RunContext& context) {
  ModelLattice made = model_lattice(mesh, options.lattice, region_of, context);
  const Lattice& lattice = made.lattice;
  const double diagonal = bounding_box(mesh.points).diagonal();
  Eigen::Matrix3d A;  // unit coordinates
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t c = 0; c < 3; ++c) {
      A(static_cast<Eigen::Index>(c), static_cast<Eigen::Index>(k)) = lattice.frame().axes[k][c] / diagonal;
    }
  }
  EnergyModel model;
  for (std::size_t i = 0; i < region_of.size(); ++i) {
    if (region_of[i] != deformable_region) model.held.push_back(static_cast<PointId>(i));
  }
  EnergySpace& space = model.space;
  space.notes = std::move(made.notes);
  space.computed = std::move(made.rows);
  space.in_space = std::move(made.in_space);
  context.progress("assemble", 0);
  const AxisGrams grams = axis_grams(lattice);
  const Eigen::Matrix3d all = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d S = options.stretching * all;
  const Eigen::Matrix3d unheld = unheld_directions(mesh, model);
  if (options.stretching == 0 && !unheld.isZero()) {
    S += unheld_cost * trace(energy_terms(A, S, options.bending), grams) / trace(energy_terms(A, all, 0), grams) * unheld;
    space.notes.push_back(
        "Handle and fixed points lie in a plane or on a line: across it, displacements change as little as may be.");
  }
  space.energy = lattice_energy(lattice, grams, energy_terms(A, S, options.bending), context);
  std::vector<Vec3> control = lattice.control_points();
  const UnitBox unit = unit_box(mesh);
  for (Vec3& c : control) c = unit.to_unit(c);
  space.linear = linear_coefficients(control);
  space.samples = lattice.size();
  context.progress("assemble", 1);
  return model;
}

}  // namespace deform
