// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/rbf_parts.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

namespace deform {

namespace {

/// Every image of every centre once.
std::vector<PartPlan::Row> all_images(const Symmetry& symmetry, const RbfCentres& centres) {
  std::vector<PartPlan::Row> rows;
  for (std::size_t j = 0; j < centres.ids.size(); ++j) {
    const unsigned on = symmetry.on(centres.ids[j]);
    for (unsigned reflected = 0; reflected < 1u << symmetry.planes(); ++reflected) {
      if ((reflected & on) == 0) rows.push_back({static_cast<std::uint32_t>(j), reflected, 1});
    }
  }
  return rows;
}

/// The rows of a sector: the images of each centre, or one for a centre on the axis.
PartPlan sector_part(const Sector& sector, const RbfCentres& centres, Solver solver, int harmonic, bool turned) {
  PartPlan part;
  CyclicRows cyclic{sector.count(), harmonic, {0}};
  if (harmonic == 0) part.components = {0};
  if (harmonic != 0) part.components = {1, 2};
  part.turned = turned;
  for (std::size_t j = 0; j < centres.ids.size(); ++j) {
    const bool on_axis = sector.on_axis(centres.ids[j]);
    for (unsigned k = 0; k < (on_axis ? 1 : sector.count()); ++k) {
      const double of_vector = on_axis ? 0 : turned ? sector.sine(k) : sector.cosine(k);
      part.rows.push_back({static_cast<std::uint32_t>(j), k, harmonic == 0 ? 1 : of_vector});
    }
    cyclic.first.push_back(static_cast<std::uint32_t>(part.rows.size()));
  }
  part.size = part.rows.size();
  if (solver != Solver::iterative) part.cyclic = std::move(cyclic);
  return part;
}

/// With two sectors all sines are zero, and without a centre off the axis nothing moves across it.
std::vector<PartPlan> sector_parts(const Sector& sector, const RbfCentres& centres, Solver solver) {
  std::vector<PartPlan> parts;
  parts.push_back(sector_part(sector, centres, solver, 0, false));
  const bool across = std::any_of(centres.ids.begin(), centres.ids.end(), [&](PointId id) { return !sector.on_axis(id); });
  if (across) parts.push_back(sector_part(sector, centres, solver, 1, false));
  if (across && sector.count() > 2) parts.push_back(sector_part(sector, centres, solver, 1, true));
  return parts;
}

PartPlan even_part(const Symmetry& symmetry, const RbfCentres& centres, Solver solver) {
  PartPlan part;
  for (std::size_t k = symmetry.planes(); k < 3; ++k) part.components.push_back(k);
  part.size = centres.ids.size();
  if (solver == Solver::iterative) {
    part.rows = all_images(symmetry, centres);
    part.size = part.rows.size();
  } else {
    for (std::size_t k = 0; k < symmetry.planes(); ++k) part.parity.sign[k] = 1;
  }
  return part;
}

PartPlan odd_part(const Symmetry& symmetry, std::size_t plane, const RbfCentres& centres, Solver solver) {
  PartPlan part;
  part.components = {plane};
  const unsigned bit = 1u << plane;
  if (solver == Solver::iterative) {
    part.rows = all_images(symmetry, centres);
    for (auto& row : part.rows) {
      const bool on = (symmetry.on(centres.ids[row.centre]) & bit) != 0;
      row.sign = on ? 0 : (row.image & bit) != 0 ? -1 : 1;
    }
  } else {
    for (std::size_t k = 0; k < symmetry.planes(); ++k) part.parity.sign[k] = 1;
    part.parity.sign[plane] = -1;
    for (std::size_t j = 0; j < centres.ids.size(); ++j) {
      if ((symmetry.on(centres.ids[j]) & bit) == 0) part.rows.push_back({static_cast<std::uint32_t>(j), 0, 1});
    }
  }
  part.size = part.rows.size();
  return part;
}

}  // namespace

Eigen::MatrixXd PartPlan::data(const Eigen::MatrixXd& values) const {
  if (rows.empty()) return values;
  Eigen::MatrixXd result(static_cast<Eigen::Index>(rows.size()), values.cols());
  for (std::size_t r = 0; r < rows.size(); ++r) {
    result.row(static_cast<Eigen::Index>(r)) = rows[r].sign * values.row(static_cast<Eigen::Index>(rows[r].centre));
  }
  return result;
}

bool PartPlan::shares(const PartPlan& other, Solver solver) const {
  if (solver == Solver::iterative) return true;
  return cyclic && other.cyclic && cyclic->harmonic == other.cyclic->harmonic;
}

std::size_t PartPlan::system_bytes(Solver solver) const {
  return cyclic ? CyclicInterpolator::bytes_for(cyclic->orbits(), size, *cyclic) : interpolator_bytes(size, solver);
}

std::size_t PartPlan::system_peak_bytes(Solver solver) const {
  return cyclic ? CyclicInterpolator::peak_bytes(cyclic->orbits(), size, *cyclic) : interpolator_peak_bytes(size, solver);
}

Solver solver_for(const RbfOptions& options, const Symmetry& symmetry, std::size_t centres) {
  const Solver solver = chosen_solver(options.solver, *options.kernel, symmetry.is_sector() ? 2 * centres : centres);
  return symmetry.is_sector() && !to_tolerance(solver) ? Solver::ldlt : solver;
}

void merge_partners(const Symmetry& symmetry, const ConstraintPoints& points, RbfCentres& centres) {
  if (!symmetry.is_sector()) return;
  const bool open = centres.most > centres.ids.size();
  std::unordered_map<PointId, PointId> representative;
  for (const auto& cluster : points.coincident) {
    for (const PointId id : cluster) representative[id] = symmetry.sector().first_of(cluster[0]);
  }
  for (std::vector<PointId>* ids : {&centres.ids, &centres.coarse}) {
    for (PointId& id : *ids) {
      id = symmetry.sector().first_of(id);
      if (const auto found = representative.find(id); found != representative.end()) id = found->second;
    }
    std::sort(ids->begin(), ids->end());
    ids->erase(std::unique(ids->begin(), ids->end()), ids->end());
  }
  if (!open) centres.most = centres.ids.size();
}

std::vector<Vec3> PartPlan::places(const std::vector<Vec3>& centres, const Symmetry& symmetry) const {
  if (rows.empty()) return centres;
  std::vector<Vec3> result;
  result.reserve(rows.size());
  for (const Row& row : rows) {
    Vec3 x = centres[row.centre];
    if (symmetry.is_sector()) x = symmetry.sector().turned(x, row.image);
    for (std::size_t k = 0; k < symmetry.planes(); ++k) {
      if ((row.image >> k & 1u) != 0) x[k] = -x[k];
    }
    result.push_back(x);
  }
  return result;
}

std::vector<PartPlan> plan_parts(const Symmetry& symmetry, const RbfCentres& centres, Solver solver) {
  if (symmetry.empty()) {
    PartPlan all;
    all.components = {0, 1, 2};
    all.size = centres.ids.size();
    return {all};
  }
  if (symmetry.is_sector()) return sector_parts(symmetry.sector(), centres, solver);
  std::vector<PartPlan> parts;
  if (symmetry.planes() < 3) parts.push_back(even_part(symmetry, centres, solver));
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    parts.push_back(odd_part(symmetry, k, centres, solver));
    const bool nothing =
        std::none_of(centres.ids.begin(), centres.ids.end(), [&](PointId id) { return (symmetry.on(id) & 1u << k) == 0; });
    if (nothing) parts.pop_back();
  }
  return parts;
}

std::vector<std::string> symmetry_notes(const Symmetry& symmetry, const RbfCentres& centres) {
  std::vector<std::string> notes;
  if (symmetry.is_sector()) notes.push_back(symmetry.sector().note());
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    const auto held =
        std::count_if(centres.ids.begin(), centres.ids.end(), [&](PointId id) { return (symmetry.on(id) & 1u << k) != 0; });
    notes.push_back("Symmetry: plane " + std::to_string(k + 1) + " holds " + std::to_string(symmetry.held(k)) + " points, " +
                    std::to_string(held) + " of them centres.");
  }
  return notes;
}

}  // namespace deform
