// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/shell.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

#include "core/base/error.h"
#include "core/mesh/adjacency.h"
#include "core/mesh/operators/shell_operators.h"

namespace deform {

namespace {

using Entry = Eigen::Triplet<double, std::int64_t>;
constexpr std::int64_t none = -1;

/// Which column of the unknowns or of the prescribed displacements a point has.
struct Columns {
  std::vector<std::int64_t> unknown, held;  ///< n, or none
  std::int64_t unknowns = 0, held_count = 0;
};

std::vector<char> faces_at(const Mesh& mesh, const std::vector<char>& points) {
  std::vector<char> mask(mesh.face_count());
  std::size_t corner = 0;
  for (std::size_t f = 0; f < mask.size(); ++f) {
    for (std::uint32_t i = 0; i < mesh.face_sizes[f]; ++i) mask[f] = mask[f] | points[mesh.face_points[corner++]];
  }
  return mask;
}

/// Components without a held point are not determined.
void check_held(const SparseMatrix& L, const Eigen::VectorXd& areas, const std::vector<RegionIndex>& region_of) {
  const std::size_t n = region_of.size();
  std::size_t loose = 0, first_loose = 0, floating = 0, first_floating = 0;
  std::vector<char> reached(n);
  std::vector<std::int64_t> front;
  for (std::size_t i = n; i-- > 0;) {
    if (region_of[i] != deformable_region) {
      reached[i] = 1;
      front.push_back(static_cast<std::int64_t>(i));
    } else if (areas[static_cast<Eigen::Index>(i)] <= 0) {
      ++loose;
      first_loose = i;
    }
  }
  if (loose > 0) {
    throw Error(ErrorCode::invalid_argument, "method.shell: no face holds " + std::to_string(loose) +
                                                 " of the deformable points, the first is point " + std::to_string(first_loose) +
                                                 "; fix them, or use method mls or rbf, which need no faces");
  }
  while (!front.empty()) {
    const std::int64_t i = front.back();
    front.pop_back();
    for (SparseMatrix::InnerIterator it(L, i); it; ++it) {
      char& mark = reached[static_cast<std::size_t>(it.row())];
      if (mark == 0) front.push_back(it.row());
      mark = 1;
    }
  }
  for (std::size_t i = n; i-- > 0;) {
    if (reached[i] != 0) continue;
    ++floating;
    first_floating = i;
  }
  if (floating == 0) return;
  throw Error(ErrorCode::invalid_argument, "method.shell: nothing holds the parts of the surface with " +
                                               std::to_string(floating) + " points, the first is point " +
                                               std::to_string(first_floating) +
                                               "; fix a point of every part (or weld the mesh if the parts belong together)");
}

/// Held points that share a row of L with an unknown, which reaches two rings of edges.
void find_held(const SparseMatrix& L, Columns& columns, std::vector<PointId>& held) {
  std::vector<char> mark(columns.held.size());
  for (std::int64_t r = 0; r < L.cols(); ++r) {
    bool counts = false;
    for (SparseMatrix::InnerIterator it(L, r); it; ++it) {
      counts = counts || columns.unknown[static_cast<std::size_t>(it.row())] != none;
    }
    for (SparseMatrix::InnerIterator it(L, r); it && counts; ++it) mark[static_cast<std::size_t>(it.row())] = 1;
  }
  for (std::size_t i = 0; i < mark.size(); ++i) {
    if (mark[i] == 0 || columns.unknown[i] != none) continue;
    columns.held[i] = columns.held_count++;
    held.push_back(static_cast<PointId>(i));
  }
}

/// Square roots of the two parts of the bending energy: M^-1/2 L_s in the columns of the unknowns, and of the held points.
struct Bending {
  SparseMatrix unknown, held;
};

Bending bending_roots(const ShellOperators& operators, const Columns& columns, const RunContext& context) {
  std::vector<Entry> unknown, held;
  unknown.reserve(static_cast<std::size_t>(operators.laplacian.nonZeros()));
  for (std::int64_t r = 0; r < operators.laplacian.cols(); ++r) {
    if (operators.areas[r] <= 0) continue;
    const double root = 1 / std::sqrt(operators.areas[r]);
    for (SparseMatrix::InnerIterator it(operators.laplacian, r); it; ++it) {
      const auto i = static_cast<std::size_t>(it.row());
      if (columns.unknown[i] != none) unknown.emplace_back(r, columns.unknown[i], root * it.value());
      if (columns.held[i] != none) held.emplace_back(r, columns.held[i], root * it.value());
    }
  }
  Bending bending{SparseMatrix(operators.laplacian.rows(), columns.unknowns),
                  SparseMatrix(operators.laplacian.rows(), columns.held_count)};
  context.check();
  bending.unknown.setFromTriplets(unknown.begin(), unknown.end());
  context.check();
  bending.held.setFromTriplets(held.begin(), held.end());
  return bending;
}

/// The lower triangle of A^T A.
SparseMatrix lower_square(const SparseMatrix& A, const SparseMatrix& transposed, const RunContext& context) {
  constexpr std::int64_t columns_at_once = 16384;
  SparseMatrix result(A.cols(), A.cols());
  for (std::int64_t first = 0; first < A.cols(); first += columns_at_once) {
    context.check();
    const std::int64_t count = std::min(columns_at_once, A.cols() - first);
    const SparseMatrix block = transposed * A.middleCols(first, count);
    std::int64_t entries = 0;
    for (std::int64_t c = 0; c < count; ++c) {
      for (SparseMatrix::InnerIterator it(block, c); it; ++it) entries += it.row() >= first + c ? 1 : 0;
    }
    // The first block tells about how many there will be.
    if (first == 0) result.reserve(entries / count * A.cols() + A.cols());
    for (std::int64_t c = 0; c < count; ++c) {
      result.startVec(first + c);
      for (SparseMatrix::InnerIterator it(block, c); it; ++it) {
        if (it.row() >= first + c) result.insertBack(it.row(), first + c) = it.value();
      }
    }
  }
  result.finalize();
  return result;
}

void assemble(const ShellOperators& operators, const Columns& columns, const ShellOptions& options, EnergyModel& model,
              const RunContext& context) {
  SparseMatrix K(columns.unknowns, columns.unknowns), C(columns.unknowns, columns.held_count);
  if (options.bending > 0) {
    const Bending roots = bending_roots(operators, columns, context);
    const SparseMatrix transposed = roots.unknown.transpose();
    K = options.bending * lower_square(roots.unknown, transposed, context);
    context.check();
    C = options.bending * SparseMatrix(transposed * roots.held);
  }
  if (options.stretching > 0) {
    context.check();
    std::vector<Entry> unknown, held;
    for (std::int64_t c = 0; c < operators.laplacian.cols(); ++c) {
      for (SparseMatrix::InnerIterator it(operators.laplacian, c); it; ++it) {
        const std::int64_t row = columns.unknown[static_cast<std::size_t>(it.row())];
        if (row == none) continue;
        const std::int64_t column = columns.unknown[static_cast<std::size_t>(c)];
        const std::int64_t at_held = columns.held[static_cast<std::size_t>(c)];
        if (column != none && column <= row) unknown.emplace_back(row, column, -options.stretching * it.value());
        if (at_held != none) held.emplace_back(row, at_held, -options.stretching * it.value());
      }
    }
    SparseMatrix K_s(K.rows(), K.cols()), C_s(C.rows(), C.cols());
    K_s.setFromTriplets(unknown.begin(), unknown.end());
    C_s.setFromTriplets(held.begin(), held.end());
    K += K_s;
    C += C_s;
  }
  K.makeCompressed();
  C.makeCompressed();
  model.space.energy.swap(K);
  if (model.eliminated) model.coupling.swap(C);
}

}  // namespace

EnergyModel shell_model(const Mesh& mesh, const std::vector<RegionIndex>& region_of, const ShellOptions& options, double diagonal,
                        const RunContext& context) {
  const std::size_t n = mesh.point_count();
  EnergyModel model;
  model.eliminated = options.handles == HandleMode::hard;
  model.may_crack = true;
  std::vector<char> faces;
  if (model.eliminated) {
    std::vector<char> deformable(n);
    for (std::size_t i = 0; i < n; ++i) deformable[i] = region_of[i] == deformable_region ? 1 : 0;
    // The rows of L within one ring are whole when all faces at their points are there.
    faces = faces_at(mesh, Adjacency(mesh).grow(deformable, 1));
  }
  const ShellOperators operators = shell_operators(mesh, diagonal > 0 ? diagonal : 1, faces, context);
  check_held(operators.laplacian, operators.areas, region_of);
  context.check();

  Columns columns{std::vector<std::int64_t>(n, none), std::vector<std::int64_t>(n, none)};
  for (std::size_t i = 0; i < n; ++i) {
    if (!model.eliminated || region_of[i] == deformable_region) columns.unknown[i] = columns.unknowns++;
  }
  if (model.eliminated) {
    find_held(operators.laplacian, columns, model.held);
  } else {
    for (std::size_t i = 0; i < n; ++i) {
      if (region_of[i] != deformable_region) model.held.push_back(static_cast<PointId>(i));
    }
  }
  context.check();
  assemble(operators, columns, options, model, context);
  context.check();

  std::vector<Entry> ones;
  for (std::size_t i = 0; i < n; ++i) {
    if (columns.unknown[i] != none) ones.emplace_back(static_cast<std::int64_t>(i), columns.unknown[i], 1.0);
  }
  model.space.values.resize(static_cast<std::int64_t>(n), columns.unknowns);
  model.space.values.setFromTriplets(ones.begin(), ones.end());
  model.space.samples = static_cast<std::size_t>(columns.unknowns);
  if (operators.flat_triangles > 0) {
    model.space.notes.push_back(std::to_string(operators.flat_triangles) +
                                " triangles are flat and count as higher than they are, the first is of face " +
                                std::to_string(operators.first_flat) + ".");
  }
  constexpr double much = 0.1;
  if (operators.stretched_area > much) {
    model.space.notes.push_back(
        std::to_string(std::lround(100 * operators.stretched_area)) +
        " % of the surface that follows has triangles whose longest side is more than 5 times their height. "
        "What the shell makes of them depends on how they lie, and can change much when the mesh is "
        "refined: compare with rbf or mls (deform compare), or make the triangles more even.");
  }
  model.space.only_on_mesh =
      "the shell deforms the faces of its geometry, and there is nothing between them; use rbf, mls, ffd or a cage";
  return model;
}

}  // namespace deform
