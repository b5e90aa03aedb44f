// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "core/deformers/energy/spaces/energy_space.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"
#include "core/numerics/sparse/sparse_cholesky.h"

namespace deform::test {

/// nx x ny points on [0, width] x [0, height], two triangles per square with alternating diagonals.
inline Mesh flat_grid(std::size_t nx, std::size_t ny, double width, double height) {
  Mesh mesh;
  for (std::size_t j = 0; j < ny; ++j) {
    for (std::size_t i = 0; i < nx; ++i) {
      mesh.points.push_back({width * static_cast<double>(i) / static_cast<double>(nx - 1),
                             height * static_cast<double>(j) / static_cast<double>(ny - 1), 0});
    }
  }
  for (std::size_t j = 0; j + 1 < ny; ++j) {
    for (std::size_t i = 0; i + 1 < nx; ++i) {
      const auto a = static_cast<PointId>(j * nx + i), b = a + 1, d = a + static_cast<PointId>(nx), c = d + 1;
      mesh.face_sizes.insert(mesh.face_sizes.end(), {3, 3});
      if ((i + j) % 2 == 0) {
        mesh.face_points.insert(mesh.face_points.end(), {a, b, c, a, c, d});
      } else {
        mesh.face_points.insert(mesh.face_points.end(), {a, b, d, b, c, d});
      }
    }
  }
  return mesh;
}

/// The plane of thesis figures 8.1 and 8.3: 1100 points, 44 x 25 of them evenly spaced, 1 wide.
inline Mesh thesis_plane() { return flat_grid(44, 25, 1, 24.0 / 43); }

/// n^3 hexahedra of the unit cube with its boundary as faces.
inline Mesh solid_cube(std::size_t n) {
  Mesh mesh;
  for (std::size_t k = 0; k <= n; ++k) {
    for (std::size_t j = 0; j <= n; ++j) {
      for (std::size_t i = 0; i <= n; ++i) {
        const auto m = static_cast<double>(n);
        mesh.points.push_back({static_cast<double>(i) / m, static_cast<double>(j) / m, static_cast<double>(k) / m});
      }
    }
  }
  auto elements = std::make_shared<Elements>();
  const auto at = [&](std::size_t i, std::size_t j, std::size_t k) {
    return static_cast<PointId>((k * (n + 1) + j) * (n + 1) + i);
  };
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t j = 0; j < n; ++j) {
      for (std::size_t i = 0; i < n; ++i) {
        const std::array<PointId, 8> nodes{at(i, j, k),     at(i + 1, j, k),     at(i + 1, j + 1, k),     at(i, j + 1, k),
                                           at(i, j, k + 1), at(i + 1, j, k + 1), at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)};
        elements->add(ElementType::hexahedron, nodes);
      }
    }
  }
  const BoundaryFaces boundary = boundary_faces(*elements);
  mesh.face_sizes = boundary.sizes;
  mesh.face_points = boundary.points;
  mesh.elements = std::move(elements);
  return mesh;
}

/// w^T K w from the lower triangle.
inline double energy(const EnergySpace& space, const Eigen::VectorXd& w) {
  return w.dot(space.energy.selfadjointView<Eigen::Lower>() * w);
}

/// Coefficients whose value at each sample is f(sample), in unit coordinates.
template <typename Function>
Eigen::VectorXd at_samples(const EnergySpace& space, const Function& f) {
  const Eigen::MatrixXd linear(space.linear);
  Eigen::VectorXd w(linear.rows());
  for (Eigen::Index j = 0; j < w.size(); ++j) w[j] = f(linear(j, 1), linear(j, 2), linear(j, 3));
  return w;
}

/// Values of one component at all points that hold `prescribed` at `held` by a penalty on the mean square misfit (thesis eq. 8.8)
/// and cost the least energy.
inline Eigen::VectorXd least_energy(const EnergySpace& space, const std::vector<PointId>& held, const Eigen::VectorXd& prescribed,
                                    double penalty = 1e7) {
  std::vector<Eigen::Triplet<double, std::int64_t>> entries;
  Eigen::VectorXd target(static_cast<Eigen::Index>(held.size()));
  for (std::size_t i = 0; i < held.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    target[row] = prescribed[row];
    for (SparseRows::InnerIterator it(space.values, held[i]); it; ++it) entries.emplace_back(row, it.col(), it.value());
  }
  SparseMatrix at_held(target.size(), space.values.cols());
  at_held.setFromTriplets(entries.begin(), entries.end());
  const double weight = penalty / static_cast<double>(held.size());
  const SparseMatrix misfit = SparseMatrix(weight * SparseMatrix(at_held.transpose() * at_held)).triangularView<Eigen::Lower>();
  const SparseCholesky factor(SparseMatrix(space.energy + misfit));
  return space.values * factor.solve(weight * (at_held.transpose() * target));
}

}  // namespace deform::test
