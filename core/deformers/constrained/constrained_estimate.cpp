// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/constrained/constrained_estimate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/deformers/constrained/newton_form.h"

namespace deform {

namespace {

using Triplet = Eigen::Triplet<double, std::int64_t>;

constexpr std::size_t form_entry_bytes = sizeof(double) + sizeof(std::int64_t);
constexpr std::size_t grown = 3 * sizeof(Triplet);  // of a vector that grows: the old array beside one of twice the size
constexpr std::size_t small_assembly = std::size_t{64} << 20;
constexpr std::size_t shape_bytes = 64;  // of a point in a projection
constexpr std::size_t most_parameters = 7, few_set_points = 64;
constexpr double per_pair = 4e-9;        // seconds to assemble Phi^T Phi: for each pair of functions at a point
constexpr double per_product = 2.5e-11;  // seconds of an operation in products of dense matrices
constexpr double per_solution = 5e-10;   // seconds of an entry of a dense factor in a solution
// Seconds of a design: for a byte of the factor of the global step in a solution, an entry of Phi in a product, an entry of a
// dense matrix of forces or of Newton's factor in a solution, and an operation of a Newton matrix. Designs take one such matrix,
// so many iterations of conjugate gradients with it, and before these that share of the iterations that it is worth.
constexpr double per_step_byte = 3e-10, per_entry = 4e-9, per_force = 1.5e-9, per_factor_entry = 1e-9, per_newton = 4e-11;
constexpr double usual_gradients = 25, usual_share = 0.6, fewest_iterations = 3, further_iterations = 10;
constexpr std::size_t column_cover = 2;  // functions of a column, over those of a point

/// The counts that determine the memory.
struct Counts {
  std::size_t unknowns = 0;       ///< k
  std::size_t cover = 1;          ///< functions at a point
  std::size_t phi = 0;            ///< entries of Phi
  std::size_t squares = 0;        ///< of Phi^T Phi, lower triangle
  std::size_t energy = 0;         ///< of S, lower triangle
  std::size_t borders = 0;        ///< of the rows of the translations
  std::size_t full = 0;           ///< unknowns of Newton's full matrix
  std::size_t columns = 0;        ///< points of columns of cells
  std::size_t large = 0;          ///< sets whose parameters Newton's sparse matrix has last
  std::size_t newton_factor = 0;  ///< bytes of its factor but for these, with one unknown per function
  /// Bytes from which the matrix itself is made, at most.
  std::size_t most_assembly = std::numeric_limits<std::size_t>::max() / 2;
  NewtonSizes newton;                    ///< with r
  SparseCholesky::Estimate reduced;      ///< S, its factor and the Schur complement
  SparseCholesky::Estimate global_step;  ///< factor
};

Counts counts_of(const std::vector<ConstraintSet>& sets) {
  Counts counts;
  for (const ConstraintSet& set : sets) {
    counts.newton.add(set.solved_projection(), set.solved_rest());
    if (set.column) counts.columns += set.ids.size();
    counts.large += set.ids.size() > few_set_points ? 1 : 0;
  }
  return counts;
}

/// A Newton step.
std::size_t newton_bytes(const Counts& counts, NewtonForm form) {
  const NewtonSizes& sizes = counts.newton;
  const std::size_t rows = sizes.rows, q = sizes.parameters, r = sizes.functions;
  const std::size_t linear = rows * (2 * sizeof(Vec3) + sizeof(double) + sizeof(std::uint32_t)) + sizes.jacobian * sizeof(double);
  switch (form) {
    case NewtonForm::none:
      return 0;
    case NewtonForm::forces:
      // The matrix; the parameters twice and what is left of them; two points with their normals per row.
      return linear + sizeof(double) * (rows * rows + 2 * rows * q + 3 * q * q + 8 * rows) + rows * 2 * (sizeof(Vec3) + 16);
    case NewtonForm::full:
      return linear + sizeof(double) * counts.full * (counts.full + 8);
    case NewtonForm::sparse:
      break;
  }
  // J in a vector, itself and its transpose; J^T J, unsorted and sorted, or its lower triangle, the energy and their sum, or
  // permuted copies and the factor.
  const std::size_t J = 3 * sizes.touched * counts.cover + sizes.jacobian;
  const std::size_t crossing = std::min(3 * counts.cover * sizes.jacobian, 3 * r * q);
  const std::size_t H =
      std::min(9 * counts.squares + 3 * counts.energy, counts.newton_factor * 10 / sizeof(double)) + crossing + sizes.jacobian;
  const std::size_t factor = 10 * counts.newton_factor + sizeof(double) * most_parameters * counts.large * 3 * r;
  const std::size_t assembled = 3 * counts.energy * grown + H * 3 * form_entry_bytes + std::max(2 * H * form_entry_bytes, factor);
  return linear + J * (grown + 3 * form_entry_bytes) + std::min(assembled, factor + counts.most_assembly);
}

/// The seconds of one design.
double design_seconds(const Counts& counts, NewtonForm form, double operations) {
  const auto step_bytes = static_cast<double>(counts.global_step.factor_bytes), entries = static_cast<double>(counts.phi);
  const auto rows = static_cast<double>(counts.newton.rows), full = static_cast<double>(counts.full);
  const double iteration = per_step_byte * step_bytes + per_entry * entries;
  const auto patience = static_cast<double>(newton_patience(form, operations, counts.global_step.factor_bytes, counts.phi));
  const double first = std::max(fewest_iterations, usual_share * patience) * iteration;
  switch (form) {
    case NewtonForm::none:
      return first;
    case NewtonForm::forces:
      return first + per_newton * operations + usual_gradients * (iteration + per_force * rows * rows);
    case NewtonForm::full:
      return first + per_newton * operations + usual_gradients * (iteration + per_factor_entry * full * full);
    case NewtonForm::sparse:
      break;
  }
  return first + further_iterations * iteration;  // mostly it converges before
}

ConstrainedBytes total(const Counts& counts, NewtonForm form) {
  const NewtonSizes& sizes = counts.newton;
  const std::size_t N = sizes.points, r = sizes.functions;
  const std::size_t points = N * (sizeof(Vec3) + sizeof(PointId)) + counts.columns * StretchedColumn::point_bytes;
  const std::size_t rows = 2 * (counts.phi * form_entry_bytes + (N + 1) * sizeof(std::int64_t));  // Phi and its transpose
  const std::size_t compliance = form == NewtonForm::forces ? N * N * sizeof(double) : 0;
  const std::size_t lower = std::min(counts.energy + counts.squares, r * (r + 1) / 2) + counts.borders;

  ConstrainedBytes bytes;
  bytes.resident = points + rows + counts.reduced.factor_bytes + counts.global_step.factor_bytes + compliance;
  const std::size_t making_rows = rows + counts.phi * grown;
  const std::size_t factoring = rows + lower * form_entry_bytes + counts.global_step.peak_bytes;
  const std::size_t columns = static_cast<std::size_t>(thread_count({})) * 5 * (r + counts.unknowns) * sizeof(double);
  bytes.preparing = points + N * shape_bytes + counts.unknowns * 2 * sizeof(std::int64_t) +
                    std::max({counts.reduced.peak_bytes, counts.reduced.factor_bytes + std::max(making_rows, factoring),
                              bytes.resident - points + columns});
  // States, targets and the window of the alternation; right-hand sides and solutions.
  bytes.working = sizeof(Vec3) * (40 * N + 34 * r + 12 * counts.unknowns) + newton_bytes(counts, form);
  bytes.operations = counts.reduced.flops + counts.global_step.flops;
  bytes.seconds = per_pair * static_cast<double>(counts.phi) * static_cast<double>(counts.cover);
  bytes.design_seconds = design_seconds(counts, form, cheapest_newton(counts.newton, 0).operations);
  return bytes;
}

/// Bounds of both, and the shorter time of a design, as solvers choose what is cheaper.
ConstrainedBytes larger(const ConstrainedBytes& a, const ConstrainedBytes& b) {
  double design = std::min(a.design_seconds, b.design_seconds);
  if (design == 0) design = std::max(a.design_seconds, b.design_seconds);  // one is not known
  return {std::max(a.resident, b.resident),     std::max(a.preparing, b.preparing), std::max(a.working, b.working),
          std::max(a.operations, b.operations), std::max(a.seconds, b.seconds),     design};
}

/// The numbers of points that follow dense rows.
struct DenseCounts {
  std::size_t points = 0, reaching = 0, functions = 0;  ///< u, functions that are nonzero at points of sets or held points, k
  SparseCholesky::Estimate factor;                      ///< of all functions
  SparseCholesky::Estimate reduced{};                   ///< of the Schur complement, if there is one
};

/// V, its rows interpolated, and what is computed from these: the basis, or the energy of the chosen functions; the global step
/// and Newton's matrix are dense.
ConstrainedBytes dense_total(const Counts& sets, const DenseCounts& of, DeliveredRows::Form form) {
  const std::size_t u = of.points, k = of.functions, N = sets.newton.points, word = sizeof(double);
  const bool basis = form == DeliveredRows::Form::basis, schur = ReducedEnergy::is_dense(of.reaching, k);
  const std::size_t r = basis ? std::min({u, k, of.reaching}) : schur ? of.reaching : k;
  const std::size_t with_translations = r + N;  // at most, of which there are few more than sets
  const std::size_t borders = std::min(with_translations - r, sets.newton.parameters);
  const std::size_t V = u * r * word, all = basis ? u * k * word : 0, interpolated = u * std::min(k, of.reaching) * word;
  const std::size_t step = ReducedEnergy::dense_bytes(r + borders);
  const std::size_t energy = basis ? ReducedEnergy::dense_bytes(r) + k * r * word : of.reduced.factor_bytes;
  const std::size_t points = N * (sizeof(Vec3) + sizeof(PointId) + 6 * form_entry_bytes) + u * sets.cover * form_entry_bytes +
                             sets.columns * StretchedColumn::point_bytes;
  NewtonSizes sizes = sets.newton;
  sizes.functions = r;
  sizes.dense = basis || schur;
  sizes.dense_points = std::max<std::size_t>(1, u);
  sizes.factor_bytes = step;
  const NewtonChoice newton = cheapest_newton(sizes, 0);
  const std::size_t compliance = newton.form == NewtonForm::forces ? N * N * word : 0;

  ConstrainedBytes bytes;
  bytes.resident = points + V + all + energy + step + compliance;
  const std::size_t making_basis = basis ? 2 * u * k * word + u * u * word + k * r * word : of.reduced.peak_bytes;
  const std::size_t stepping = V + 3 * r * r * word + ReducedEnergy::dense_peak_bytes(r + borders);
  const std::size_t compliances = newton.form == NewtonForm::forces ? 2 * V + u * u * word + 2 * N * u * word : 0;
  bytes.preparing =
      points + N * shape_bytes + interpolated +
      std::max({making_basis, all + energy + V + std::max(stepping, step + compliance + compliances), bytes.resident});
  Counts counts = sets;
  counts.newton = sizes;
  counts.full = 3 * r + sizes.parameters;
  counts.unknowns = k;
  const std::size_t assembled =
      newton.form == NewtonForm::full ? V + 3 * r * r * word + 9 * sizes.touched * grown + 6 * u * form_entry_bytes : 0;
  bytes.working = sizeof(Vec3) * (40 * N + 34 * r + 12 * k + 4 * u) + newton_bytes(counts, newton.form) + assembled;
  counts.phi = u * r;
  counts.global_step.factor_bytes = step;
  bytes.design_seconds = design_seconds(counts, newton.form, newton.operations);
  const auto du = static_cast<double>(u), dr = static_cast<double>(r), dk = static_cast<double>(k);
  bytes.operations = of.reduced.flops + dr * dr * dr / 3;
  if (newton.form == NewtonForm::forces) bytes.seconds = du * dr * (dr * per_solution / thread_count({}) + 2 * du * per_product);
  bytes.seconds += per_product * (2 * du * dr * dr + (basis ? du * 4 * static_cast<double>(of.factor.factor_bytes) / word +
                                                                  2 * du * du * dk + 2 * du * dk * dr + 2 * dk * dr * dr
                                                            : 0));
  return bytes;
}

/// The functions at the points of a set, ascending. Points of one set have most of them in common.
std::vector<std::int64_t> functions_of(const ConstraintSet& set, const FunctionRows& values) {
  std::vector<std::int64_t> reached;
  for (const PointId id : set.ids) {
    values.for_each(id, [&](std::int64_t column, double) { reached.push_back(column); });
  }
  std::sort(reached.begin(), reached.end());
  reached.erase(std::unique(reached.begin(), reached.end()), reached.end());
  return reached;
}

/// The lower triangle of a matrix with further couplings: of all functions of each group.
SparseMatrix coupled(const SparseMatrix& matrix, const std::vector<std::vector<std::int64_t>>& groups) {
  const auto size = static_cast<std::size_t>(matrix.cols());
  std::vector<std::vector<std::uint32_t>> groups_of(size);  // of a function
  for (std::size_t g = 0; g < groups.size(); ++g) {
    for (const std::int64_t column : groups[g]) {
      groups_of[static_cast<std::size_t>(column)].push_back(static_cast<std::uint32_t>(g));
    }
  }
  SparseMatrix pattern(matrix.rows(), matrix.cols());
  pattern.reserve(matrix.nonZeros());
  std::vector<std::int64_t> seen_in(size, -1), rows;
  for (std::int64_t j = 0; j < matrix.cols(); ++j) {
    rows.clear();
    const auto meet = [&](std::int64_t i) {
      if (std::exchange(seen_in[static_cast<std::size_t>(i)], j) != j) rows.push_back(i);
    };
    for (SparseMatrix::InnerIterator it(matrix, j); it; ++it) meet(it.row());
    for (const std::uint32_t group : groups_of[static_cast<std::size_t>(j)]) {
      std::for_each(std::lower_bound(groups[group].begin(), groups[group].end(), j), groups[group].end(), meet);
    }
    std::sort(rows.begin(), rows.end());
    pattern.startVec(j);
    for (const std::int64_t i : rows) pattern.insertBack(i, j) = 1.0;
  }
  pattern.finalize();
  return pattern;
}

/// The pattern of the matrix of the global step: S, which contains that of Phi^T Phi if each point has one function, and the rows
/// of the translations.
SparseMatrix pattern(const SparseMatrix& matrix, const FunctionRows& values, const std::vector<std::int64_t>& chosen, bool dense,
                     const std::vector<ConstraintSet>& sets) {
  std::vector<Triplet> entries;
  auto size = static_cast<std::int64_t>(chosen.size());
  std::vector<std::int64_t> place(static_cast<std::size_t>(matrix.cols()));
  if (dense) {
    for (std::size_t i = 0; i < chosen.size(); ++i) place[static_cast<std::size_t>(chosen[i])] = static_cast<std::int64_t>(i);
    for (std::int64_t j = 0; j < size; ++j) {
      for (std::int64_t i = j; i < size; ++i) entries.emplace_back(i, j, 1.0);
    }
  } else {
    size = matrix.cols();
    for (std::int64_t j = 0; j < size; ++j) {
      place[static_cast<std::size_t>(j)] = j;
      for (SparseMatrix::InnerIterator it(matrix, j); it; ++it) entries.emplace_back(it.row(), j, 1.0);
    }
  }
  for (const ConstraintSet& set : sets) {
    if (!set.projection->moves_with_its_points()) continue;
    entries.emplace_back(size, size, 1.0);
    for (const PointId id : set.ids) {
      values.for_each(
          id, [&](std::int64_t column, double) { entries.emplace_back(size, place[static_cast<std::size_t>(column)], 1.0); });
    }
    ++size;
  }
  SparseMatrix result(size, size);
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

/// Newton's sparse matrix eliminates the parameters of small sets first, so that all functions at their points meet.
std::size_t newton_factor_bytes(const SparseMatrix& matrix, const FunctionRows& values, const std::vector<ConstraintSet>& sets) {
  std::vector<std::vector<std::int64_t>> reached;  // by the small sets
  for (const ConstraintSet& set : sets) {
    if (set.ids.size() <= few_set_points) reached.push_back(functions_of(set, values));
  }
  return SparseCholesky::estimate(coupled(matrix, reached), SparseCholesky::fill_reducing_order(matrix)).factor_bytes;
}

}  // namespace

ConstrainedBytes constrained_bytes(const SparseMatrix& matrix, const FunctionRows& values, const std::vector<ConstraintSet>& sets,
                                   const DeliveredRows* delivered, const RunContext& context) {
  if (sets.empty()) return {};
  Counts counts = counts_of(sets);
  const std::vector<std::int64_t> chosen = functions_reaching(values, sets, delivered);
  if (delivered != nullptr) {
    const auto k = static_cast<std::size_t>(matrix.rows());
    for (std::size_t u = 0; u < delivered->points(); ++u)
      counts.cover = std::max(counts.cover, values.count(delivered->point(u)));
    DenseCounts dense{delivered->points(), chosen.size(), k, SparseCholesky::estimate(matrix)};
    const DeliveredRows::Form form =
        DeliveredRows::form(dense.points, dense.reaching, k, dense.factor.factor_bytes / sizeof(double));
    const bool schur = form == DeliveredRows::Form::functions && ReducedEnergy::is_dense(chosen.size(), k);
    if (schur) dense.reduced = ReducedEnergy::estimate(matrix, chosen);
    if (form != DeliveredRows::Form::none) return dense_total(counts, dense, form);
    return constrained_bytes(matrix, values, sets, nullptr, context);
  }
  counts.unknowns = static_cast<std::size_t>(matrix.rows());
  const bool dense = ReducedEnergy::is_dense(chosen.size(), counts.unknowns);
  const std::size_t r = dense ? chosen.size() : counts.unknowns;
  std::vector<std::vector<std::int64_t>> columns;  // functions of those
  for (const ConstraintSet& set : sets) {
    std::size_t reached = 0;
    if (set.column) {
      columns.push_back(functions_of(set, values));
      counts.cover = std::max(counts.cover, columns.back().size());
      reached = set.ids.size() * columns.back().size();
    }
    for (const PointId id : set.ids) {
      if (set.column) break;
      const std::size_t count = values.count(id);
      counts.cover = std::max(counts.cover, count);
      reached += count;
    }
    counts.phi += reached;
    counts.borders += set.projection->moves_with_its_points() ? reached + 1 : 0;
  }
  // Functions that meet at a point meet in the energy, too; those that meet in a column need not.
  const SparseMatrix met = columns.empty() ? SparseMatrix() : coupled(matrix, columns);
  const SparseMatrix& meeting = columns.empty() ? matrix : met;
  const auto couplings = static_cast<std::size_t>(meeting.nonZeros());
  counts.squares = counts.cover == 1 ? chosen.size() : std::min(couplings, chosen.size() * (chosen.size() + 1) / 2);
  counts.energy = dense ? r * (r + 1) / 2 : static_cast<std::size_t>(matrix.nonZeros());
  context.check();
  counts.reduced = ReducedEnergy::estimate(matrix, chosen);
  context.check();
  counts.global_step = SparseCholesky::estimate(pattern(meeting, values, chosen, dense, sets));
  counts.newton.functions = r;
  counts.full = 3 * r + counts.newton.parameters;
  counts.newton.dense = dense;
  counts.newton.factor_bytes = counts.global_step.factor_bytes;
  counts.newton.factor_operations = counts.global_step.flops;
  const NewtonForm form = cheapest_newton(counts.newton, 0).form;
  context.check();
  if (form == NewtonForm::sparse) counts.newton_factor = newton_factor_bytes(meeting, values, sets);
  return total(counts, form);
}

ConstrainedBytes constrained_bytes(const SpaceCounts& space, const std::vector<ConstraintSet>& sets) {
  if (sets.empty()) return {};
  const Counts common = counts_of(sets);
  const std::size_t N = common.newton.points, k = space.functions;
  // The rows of a column have the functions of several points.
  const std::size_t cover = std::min(k, common.columns > 0 ? column_cover * space.cover : space.cover);
  const std::size_t reached = std::min({k, N * cover, space.reaching});
  const auto counts_for = [&](std::size_t r, bool dense) {
    Counts counts = common;
    counts.unknowns = k;
    counts.cover = cover;
    counts.phi = N * cover;
    counts.squares = std::min(r * (r + 1) / 2, N * cover * (cover + 1) / 2);
    counts.energy = dense ? r * (r + 1) / 2 : space.energy_entries;
    for (const ConstraintSet& set : sets) counts.borders += 1 + std::min(r, set.ids.size() * cover);
    const std::size_t entries = (dense ? r * r : space.factor_entries) + counts.borders;
    counts.global_step.factor_bytes = sizeof(double) * (entries + 8 * (r + sets.size() + 1));
    counts.global_step.peak_bytes = 2 * counts.global_step.factor_bytes + 2 * (counts.energy + counts.borders) * form_entry_bytes;
    counts.global_step.flops = static_cast<double>(entries) * static_cast<double>(entries) / static_cast<double>(r + 1);
    if (dense) {
      // The chosen functions are eliminated last. Each of them meets at most as many of the others as a separator has: a
      // separator is a full triangle of the factor.
      const auto separator = static_cast<std::size_t>(std::sqrt(2 * static_cast<double>(space.factor_entries)));
      const std::size_t chosen = r * std::min(k, separator + r / 2);
      const std::size_t whole = sizeof(double) * std::min(k * (k + 1) / 2, space.factor_entries + chosen);
      counts.reduced = {ReducedEnergy::dense_bytes(r), std::max(2 * whole, ReducedEnergy::dense_peak_bytes(r)), 0};
      counts.reduced.flops = static_cast<double>(whole) / 8 * static_cast<double>(whole) / 8 / static_cast<double>(k + 1);
    }
    counts.newton.functions = r;
    counts.newton.dense = dense;
    counts.full = std::min({3 * r + counts.newton.parameters, most_full, counts.newton.rows});  // else in forces
    return counts;
  };
  ConstrainedBytes result;
  const auto consider = [&](Counts counts) {
    const NewtonSizes& sizes = counts.newton;
    // The form in forces is chosen only if it takes fewer operations than any other form can.
    const std::size_t others = 3 * sizes.functions + (sizes.dense ? sizes.parameters : 3 * (sets.size() + 1));
    const bool few = sizes.rows <= std::min(most_forces, others);
    if (few) result = larger(result, total(counts, NewtonForm::forces));
    if (sizes.dense) {
      result = larger(result, total(counts, NewtonForm::full));
      return;
    }
    // The sparse form takes fewer operations than that in forces, or than can be afforded; so its factor has not many entries.
    const auto rows = static_cast<double>(sizes.rows), functions = static_cast<double>(k + sets.size());
    const double solution = solution_cost * static_cast<double>(space.factor_entries + counts.borders);
    double operations = affordable_newton;
    if (few && static_cast<double>(N) * solution <= affordable_compliance) {
      operations = std::min(operations, rows * rows * rows / 3);
    }
    operations /= sparse_newton_cost;
    const ConstrainedBytes plain = total(counts, NewtonForm::none);
    result = larger(result, plain);
    const double entries = std::min(static_cast<double>(space.factor_entries), std::sqrt(operations * functions));
    counts.newton_factor = static_cast<std::size_t>(sizeof(double) * (entries + 8 * functions));
    // A factor has twice the entries of its matrix or more, and functions that meet at a point meet in the energy too.
    counts.energy = std::min(counts.energy, static_cast<std::size_t>(entries / 2));
    counts.squares = std::min(counts.squares, counts.energy);
    // For large spaces these two bounds are not attained together: the measured factors have at most a third of `entries`, and 5
    // to 12 times the entries of their matrix.
    counts.most_assembly = std::max(small_assembly, 16 * counts.newton_factor);
    const std::size_t working = operations < functions ? 0 : newton_bytes(counts, NewtonForm::sparse);
    result.working = std::max(result.working, plain.working + working);
  };
  if (space.delivered > 0) {
    // The functions that reach held points are not known: any number up to all, and rows need not be dense in the end.
    Counts counts = common;
    counts.cover = space.cover;
    for (const std::size_t reaching : {std::min({ReducedEnergy::most_dense, (k - 1) / 2}), k}) {
      DenseCounts dense{space.delivered, reaching, k, {space.factor_entries * sizeof(double), 0, 0}};
      const DeliveredRows::Form form = DeliveredRows::form(dense.points, reaching, k, space.factor_entries);
      if (form == DeliveredRows::Form::none) continue;
      if (ReducedEnergy::is_dense(reaching, k) && form == DeliveredRows::Form::functions) {
        dense.reduced = counts_for(reaching, true).reduced;
      }
      ConstrainedBytes bytes = dense_total(counts, dense, form);
      if (reaching < k && reached == k) bytes.design_seconds = 0;  // if not all reach, then as many as can
      result = larger(result, bytes);
    }
  }
  const double known = result.design_seconds;
  if (k > 2) consider(counts_for(std::min({reached, ReducedEnergy::most_dense, (k - 1) / 2}), true));
  if (!ReducedEnergy::is_dense(reached, k)) consider(counts_for(k, false));
  if (reached == k && known > 0) result.design_seconds = known;
  return result;
}

}  // namespace deform
