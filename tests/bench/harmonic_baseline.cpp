// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/harmonic_baseline.h"

#include <Eigen/LU>
#include <cmath>
#include <string>

#include "core/base/error.h"

namespace deform::bench {

namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Gradients = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 8>;
using Stiffness = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 8, 8>;

/// Derivatives of the linear shape functions, the same everywhere.
Gradients tetrahedron_gradients() {
  Gradients G(3, 4);
  G << -1, 1, 0, 0, -1, 0, 1, 0, -1, 0, 0, 1;
  return G;
}

/// The trilinear ones on the cube [-1, 1]^3.
Gradients hexahedron_gradients(const Vec3& at) {
  constexpr double corner[8][3] = {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1},
                                   {-1, -1, 1},  {1, -1, 1},  {1, 1, 1},  {-1, 1, 1}};
  Gradients G(3, 8);
  for (Index i = 0; i < 8; ++i) {
    const double* c = corner[i];
    const double f[3] = {1 + c[0] * at[0], 1 + c[1] * at[1], 1 + c[2] * at[2]};
    G.col(i) << c[0] * f[1] * f[2] / 8, f[0] * c[1] * f[2] / 8, f[0] * f[1] * c[2] / 8;
  }
  return G;
}

/// Adds weight * integral of grad N_i . grad N_j at one Gauss point.
void add_point(const Gradients& reference, const Gradients& corners, double weight, Stiffness& K) {
  const Matrix3d J = reference * corners.transpose();
  const double determinant = J.determinant();
  const Matrix3d inverse = J.inverse();
  if (determinant == 0 || !inverse.allFinite()) {
    throw Error(ErrorCode::numerical_failure, "harmonic baseline: an element has no volume");
  }
  const Gradients G = inverse * reference;
  K += weight * determinant * G.transpose() * G;
}

Stiffness stiffness(std::span<const Vec3> points, std::span<const PointId> nodes, ElementType type) {
  Gradients corners(3, static_cast<Index>(nodes.size()));
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i] >= points.size()) {
      throw Error(ErrorCode::invalid_argument, "harmonic baseline: an element names point " + std::to_string(nodes[i]) + " of " +
                                                   std::to_string(points.size()));
    }
    for (Index k = 0; k < 3; ++k) corners(k, static_cast<Index>(i)) = points[nodes[i]][static_cast<std::size_t>(k)];
  }
  Stiffness K = Stiffness::Zero(corners.cols(), corners.cols());
  if (type == ElementType::tetrahedron) {
    add_point(tetrahedron_gradients(), corners, 1.0 / 6, K);
  } else if (type == ElementType::hexahedron) {
    const double g = 1 / std::sqrt(3.0);
    for (const double x : {-g, g}) {
      for (const double y : {-g, g}) {
        for (const double z : {-g, g}) add_point(hexahedron_gradients({x, y, z}), corners, 1, K);
      }
    }
  } else {
    throw Error(ErrorCode::invalid_argument, std::string("harmonic baseline: knows no ") + shape(type).name);
  }
  return K;
}

}  // namespace

HarmonicBaseline::HarmonicBaseline(std::span<const Vec3> points, const Elements& elements, std::span<const PointId> boundary)
    : points_(points.begin(), points.end()), boundary_(boundary.begin(), boundary.end()) {
  constexpr Index nowhere = -1;
  std::vector<Index> boundary_rank(points.size(), nowhere), inside_rank(points.size(), nowhere);
  for (std::size_t i = 0; i < boundary_.size(); ++i) {
    if (boundary_[i] >= points.size()) {
      throw Error(ErrorCode::invalid_argument, "harmonic baseline: boundary[" + std::to_string(i) +
                                                   "]: " + std::to_string(boundary_[i]) + " is out of range 0.." +
                                                   std::to_string(points.size() - 1));
    }
    boundary_rank[boundary_[i]] = static_cast<Index>(i);
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (boundary_rank[i] != nowhere) continue;
    inside_rank[i] = static_cast<Index>(inside_.size());
    inside_.push_back(static_cast<PointId>(i));
  }
  std::vector<Eigen::Triplet<double>> inside, coupling;
  for (std::size_t e = 0; e < elements.size(); ++e) {
    const auto nodes = elements.nodes(e);
    const Stiffness K = stiffness(points, nodes, elements.types[e]);
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      const Index row = inside_rank[nodes[i]];
      if (row == nowhere) continue;
      for (std::size_t j = 0; j < nodes.size(); ++j) {
        const double value = K(static_cast<Index>(i), static_cast<Index>(j));
        const Index column = inside_rank[nodes[j]];
        if (column != nowhere) {
          inside.emplace_back(row, column, value);
        } else {
          coupling.emplace_back(row, boundary_rank[nodes[j]], value);
        }
      }
    }
  }
  const auto count = static_cast<Index>(inside_.size());
  Sparse K(count, count);
  K.setFromTriplets(inside.begin(), inside.end());
  coupling_.resize(count, static_cast<Index>(boundary_.size()));
  coupling_.setFromTriplets(coupling.begin(), coupling.end());
  factor_.compute(K);
  if (factor_.info() != Eigen::Success) {
    throw Error(ErrorCode::numerical_failure, "harmonic baseline: the matrix cannot be factored");
  }
}

Points HarmonicBaseline::deformed(std::span<const Vec3> displacements) const {
  Eigen::MatrixXd B(static_cast<Index>(boundary_.size()), 3);
  Points result = points_;
  for (std::size_t i = 0; i < boundary_.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      B(static_cast<Index>(i), static_cast<Index>(k)) = displacements[i][k];
      result[boundary_[i]][k] += displacements[i][k];
    }
  }
  const Eigen::MatrixXd U = factor_.solve(-(coupling_ * B));
  for (std::size_t i = 0; i < inside_.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) result[inside_[i]][k] += U(static_cast<Index>(i), static_cast<Index>(k));
  }
  return result;
}

}  // namespace deform::bench
