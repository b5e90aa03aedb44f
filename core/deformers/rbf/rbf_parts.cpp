// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/rbf_parts.h"

#include <algorithm>
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
      row.sign = on ? 0 : (row.reflected & bit) != 0 ? -1 : 1;
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

std::vector<Vec3> PartPlan::places(const std::vector<Vec3>& centres) const {
  if (rows.empty()) return centres;
  std::vector<Vec3> result;
  result.reserve(rows.size());
  for (const Row& row : rows) {
    Vec3 x = centres[row.centre];
    for (std::size_t k = 0; k < 3; ++k) {
      if ((row.reflected >> k & 1u) != 0) x[k] = -x[k];
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
  for (std::size_t k = 0; k < symmetry.planes(); ++k) {
    const auto held =
        std::count_if(centres.ids.begin(), centres.ids.end(), [&](PointId id) { return (symmetry.on(id) & 1u << k) != 0; });
    notes.push_back("Symmetry: plane " + std::to_string(k + 1) + " holds " + std::to_string(symmetry.held(k)) + " points, " +
                    std::to_string(held) + " of them centres.");
  }
  return notes;
}

}  // namespace deform
