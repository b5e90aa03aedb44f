// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/subspace.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/local_functions.h"
#include "core/deformers/energy/spaces/mesh_pieces.h"
#include "core/deformers/energy/spaces/unit_points.h"
#include "core/mesh/operators/shell_operators.h"
#include "core/numerics/kernels/kernel_rows.h"
#include "core/numerics/sampling/mls_basis.h"
#include "core/numerics/sampling/sampling.h"
#include "core/numerics/sampling/subspace.h"

namespace deform {

namespace {

double cover_of(const SubspaceOptions& options) { return options.cover != 0 ? options.cover : default_cover(options.kernel); }

constexpr double dependence_ridge = 1e-13;  // of the mean of the diagonal
constexpr double linear_cost = 1e-11;       // likewise

using Eigen::Index;
using Eigen::MatrixXd;

constexpr std::size_t dense_per_centre = 20;

bool is_global(const SubspaceOptions& options) { return options.kernel && !properties(*options.kernel).has_shape; }

/// n x n, both triangles. Points without a triangle have no energy.
SparseMatrix shell_energy(const Mesh& mesh, double diagonal, double stretching, double bending, const RunContext& context) {
  const ShellOperators shell = shell_operators(mesh, diagonal, {}, context);
  SparseMatrix energy = -stretching * shell.laplacian;
  if (bending == 0) return energy;
  SparseMatrix scaled = shell.laplacian;  // symmetric: its columns are its rows
  for (Index j = 0; j < scaled.outerSize(); ++j) {
    const double inverse = shell.areas[j] > 0 ? bending / shell.areas[j] : 0;
    for (SparseMatrix::InnerIterator it(scaled, j); it; ++it) it.valueRef() *= inverse;
  }
  context.check();
  energy += SparseMatrix(scaled * shell.laplacian);
  return energy;
}

/// Columns of full_kernel_rows() made orthonormal.
MatrixXd orthonormal_functions(Kernel kernel, const std::vector<Vec3>& centres, const std::vector<Vec3>& points,
                               const RunContext& context) {
  return orthonormal_columns(full_kernel_rows({kernel, 1}, centres, points, context), context);
}

SparseRows as_rows(const MatrixXd& full) {
  SparseRows rows(full.rows(), full.cols());
  rows.resizeNonZeros(full.size());
  for (Index i = 0; i <= full.rows(); ++i) rows.outerIndexPtr()[i] = i * full.cols();
  for (Index i = 0; i < full.rows(); ++i) {
    for (Index j = 0; j < full.cols(); ++j) {
      rows.innerIndexPtr()[i * full.cols() + j] = j;
      rows.valuePtr()[i * full.cols() + j] = full(i, j);
    }
  }
  return rows;
}

std::vector<Vec3> spread_centres(const Mesh& mesh, const std::vector<Vec3>& points, std::size_t count, std::uint64_t seed,
                                 const RunContext& context) {
  SampleOptions options;
  options.surface = count;
  DensePoints dense = dense_points(mesh, points, {dense_per_centre * count, 0}, seed, context);
  if (dense.surface == 0) {  // cells without faces: the energy is 0, but the functions are there
    dense.points = points;
    dense.surface = points.size();
    dense.area = 1;
  }
  return spread_samples(dense, options, context).points;
}

bool adds_linear(const SubspaceOptions& options) {
  return options.linear == SubspaceLinear::added && options.kernel && !is_global(options);
}

Vec3 mean_of(const std::vector<Vec3>& points) {
  Vec3 mean{};
  for (const Vec3& x : points) mean = mean + x;
  return mean / static_cast<double>(points.size());
}

/// 1, x, y and z about the mean of the points as the last four functions, so that space.linear is there.
void add_linear(const std::vector<Vec3>& points, EnergySpace& space) {
  const Vec3 mean = mean_of(points);
  const Index n = space.values.rows(), k = space.values.cols();
  SparseRows values(n, k + 4);
  values.resizeNonZeros(space.values.nonZeros() + 4 * n);
  Index next = 0;
  for (Index i = 0; i < n; ++i) {
    values.outerIndexPtr()[i] = next;
    const auto put = [&](Index column, double value) {
      values.innerIndexPtr()[next] = column;
      values.valuePtr()[next++] = value;
    };
    for (SparseRows::InnerIterator it(space.values, i); it; ++it) put(it.col(), it.value());
    const Vec3 x = points[static_cast<std::size_t>(i)] - mean;
    put(k, 1);
    for (int c = 0; c < 3; ++c) put(k + 1 + c, x[static_cast<std::size_t>(c)]);
  }
  values.outerIndexPtr()[n] = next;
  space.values.swap(values);
  // Held points in a plane or on a line do not tell all of them apart, so that these must cost something.
  const double cost = linear_cost * space.energy.diagonal().mean();
  space.energy.conservativeResize(k + 4, k + 4);
  for (Index j = k; j < k + 4; ++j) space.energy.coeffRef(j, j) = cost;
  space.energy.makeCompressed();
  Eigen::MatrixXd linear = Eigen::MatrixXd::Zero(k + 4, 4);
  linear.bottomRows(4).setIdentity();
  for (int c = 0; c < 3; ++c) linear(k, 1 + c) = mean[static_cast<std::size_t>(c)];
  space.linear = linear.sparseView();
}

}  // namespace

EnergySpace shell_subspace(const Mesh& mesh, const SubspaceOptions& options, std::uint64_t seed, const RunContext& context) {
  const std::vector<Vec3> points = unit_points(mesh);
  context.progress("sample", 0);
  const std::vector<Vec3> centres = spread_centres(mesh, points, std::min(options.centres, points.size()), seed, context);
  context.progress("sample", 1);
  const double diagonal = bounding_box(mesh.points).diagonal();
  const SparseMatrix energy = shell_energy(mesh, diagonal, options.stretching, options.bending, context);
  EnergySpace space;
  space.linear = SparseMatrix(static_cast<Index>(centres.size()), 0);
  context.progress("basis", 0);
  if (is_global(options)) {
    const MatrixXd Q = orthonormal_functions(*options.kernel, centres, points, context);
    context.progress("assemble", 0);
    space.energy = projected_lower(energy, Q, context);
    space.values = as_rows(Q);
    space.linear = SparseMatrix(Q.cols(), 0);
    space.only_on_mesh =
        "the functions of a subspace whose kernel has no shape are combinations that are orthonormal at the points of its "
        "geometry, "
        "and elsewhere they have lost their digits; use a kernel with a shape or none, or mls";
    if (static_cast<std::size_t>(Q.cols()) < centres.size()) {
      space.notes.push_back(std::to_string(Q.cols()) + " of " + std::to_string(centres.size()) +
                            " functions, the others depend on them");
    }
  } else {
    CoverOptions cover;
    cover.cover = static_cast<std::size_t>(std::ceil(cover_of(options)));
    const double radius = covering_radius(PointTree(centres), points, cover, context);
    if (options.kernel) {
      const double shape = properties(*options.kernel).local_shape * radius;
      space.values = kernel_rows({*options.kernel, shape}, radius, centres, points, context);
      space.in_space =
          std::make_shared<const LocalKernelFunctions>(RadialKernel{*options.kernel, shape}, radius, centres, unit_box(mesh),
                                                       adds_linear(options) ? std::optional(mean_of(points)) : std::nullopt);
    } else {
      MlsBasis::Options basis;
      basis.cover = cover;
      space.values = MlsBasis(centres, radius, basis).values(points, context);
      space.in_space = std::make_shared<const MlsFunctions>(centres, radius, basis, unit_box(mesh));
      space.linear = linear_coefficients(centres);
    }
    context.progress("assemble", 0);
    space.energy = projected_lower(energy, space.values, context);
    // Nearly as many functions as points depend on each other; far below what the others cost, far above rounding.
    const double ridge = dependence_ridge * space.energy.diagonal().mean();
    for (Index j = 0; j < space.energy.cols(); ++j) space.energy.coeffRef(j, j) += ridge;
    space.energy.makeCompressed();
    if (adds_linear(options)) add_linear(points, space);
  }
  space.samples = static_cast<std::size_t>(space.values.cols());
  context.progress("assemble", 1);
  return space;
}

SpaceBytes estimate_shell_subspace(const Mesh& mesh, const SubspaceOptions& options) {
  const auto n = static_cast<double>(mesh.point_count());
  const double k = std::min(static_cast<double>(options.centres), n);
  constexpr double entry = sizeof(double) + sizeof(std::int64_t);
  const double factor = CoverOptions().factor;
  const bool full = is_global(options);
  const double linear = adds_linear(options) ? 4 : 0;
  const double cover = linear + (full ? k : std::min(k, 4 * factor * factor * cover_of(options))),
               couplings = std::min(k, 4 * cover);
  const double values = n * (cover * entry + sizeof(std::int64_t)), energy = 0.5 * k * couplings * entry;
  // The functions, their factorization and Q; or E Phi, with two rings of the mesh per column, and both triangles.
  const double scratch = full ? (3 * n * k + 3 * k * k) * sizeof(double) : 4 * values + 4 * energy;
  SpaceBytes bytes;
  bytes.samples = static_cast<std::size_t>(k + linear);
  bytes.cover = static_cast<std::size_t>(std::ceil(cover));
  bytes.energy_entries = static_cast<std::size_t>(0.5 * k * (couplings + 1));
  bytes.resident = static_cast<std::size_t>(values + energy + 4 * k * entry) + local_function_bytes(bytes.samples);
  bytes.peak = bytes.resident + static_cast<std::size_t>(scratch + n * 40 * entry);
  return bytes;
}

}  // namespace deform
