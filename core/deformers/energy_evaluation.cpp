#include "core/deformers/energy_evaluation.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/error.h"
#include "core/base/parallel.h"

namespace deform {

namespace {

[[noreturn]] void invalid(std::size_t design, const std::string& message) {
  throw Error(ErrorCode::invalid_argument, "designs[" + std::to_string(design) + "]" + message);
}

double length(const Vec3& v) { return std::hypot(v[0], v[1], v[2]); }

}  // namespace

EnergyEvaluation::EnergyEvaluation(std::shared_ptr<const EnergySystem> system, std::span<const Design> designs,
                                   EvaluationPath path, const RunContext& context)
    : system_(std::move(system)), held_(system_->held()), reports_(designs.size()), slot_(designs.size()) {
  designs_.reserve(designs.size());
  for (std::size_t i = 0; i < designs.size(); ++i) {
    context.check();
    designs_.push_back(held_.bound(designs[i], i));
    held_.check_coincident(designs_.back(), i);
    reports_[i].max_displacement = held_.largest_displacement(designs_.back());
  }
  choose_paths(path);
  set_basis_coefficients();
  solve_direct(context);
}

EnergyEvaluation::EnergyEvaluation(std::shared_ptr<const EnergySystem> system, const std::vector<Affine>& derivatives,
                                   const RunContext& context)
    : system_(std::move(system)), held_(system_->held()), kind_(MotionKind::derivative), reports_(1), slot_(1) {
  designs_.push_back({derivatives, std::vector<std::vector<Vec3>>(derivatives.size())});
  choose_paths(EvaluationPath::automatic);
  set_basis_coefficients();
  solve_direct(context);
}

void EnergyEvaluation::choose_paths(EvaluationPath path) {
  const bool has_basis = system_->basis_ != nullptr;
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    const bool affine = designs_[i].is_affine();
    if (path == EvaluationPath::basis && !has_basis) invalid(i, ": path BASIS, but the system was prepared without a basis");
    if (path == EvaluationPath::basis && !affine) invalid(i, ": path BASIS, but a handle has displacements per point");
    const bool direct = path == EvaluationPath::direct || !has_basis || !affine;
    reports_[i].path = direct ? EvaluationPath::direct : EvaluationPath::basis;
    if (!direct) slot_[i] = basis_designs_++;
  }
}

void EnergyEvaluation::set_basis_coefficients() {
  const std::size_t handles = system_->frames_.size(), columns = 3 * basis_designs_;
  basis_.assign(4 * handles * columns, 0.0);
  double block[12];
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    if (reports_[i].path != EvaluationPath::basis) continue;
    Vec3 bound{};
    for (std::size_t h = 0; h < handles; ++h) {
      field_coefficients(designs_[i].affine[h], kind_, system_->frames_[h], system_->box_, block);
      for (std::size_t f = 0; f < 4; ++f) {
        for (std::size_t k = 0; k < 3; ++k) {
          basis_[(4 * h + f) * columns + 3 * slot_[i] + k] = block[3 * f + k];
          bound[k] += system_->basis_misfits_[4 * h + f] * std::abs(block[3 * f + k]);
        }
      }
    }
    reports_[i].interpolation_residual = length(bound);
  }
}

/// Displacements of the held points that count, m x 3.
Eigen::MatrixXd EnergyEvaluation::prescribed(const BoundDesign& design) const {
  const std::vector<PointId>& ids = system_->model_.held;
  Eigen::MatrixXd h(static_cast<Eigen::Index>(ids.size()), 3);
  for (std::size_t j = 0; j < ids.size(); ++j) {
    const Vec3 to = held_.place(design, ids[j], kind_);
    const Vec3& x = held_.mesh.points[ids[j]];
    for (std::size_t k = 0; k < 3; ++k) {
      h(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = kind_ == MotionKind::position ? to[k] - x[k] : to[k];
    }
  }
  return h;
}

void EnergyEvaluation::solve_direct(const RunContext& context) {
  solutions_.resize(designs_.size());
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    if (reports_[i].path != EvaluationPath::direct) continue;
    context.check();
    solutions_[i] = system_->solve(prescribed(designs_[i]), context);
    const auto& misfits = solutions_[i].misfits;
    reports_[i].interpolation_residual = length({misfits[0], misfits[1], misfits[2]});
  }
}

/// Displacements at a tile for designs on one path: [design][component][16].
void EnergyEvaluation::evaluate_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  if (reports_[first].path == EvaluationPath::basis) {
    std::fill_n(values, 3 * count * tile_size, 0.0);
    tile_product(system_->basis_->tile(tile), system_->basis_->fields(), basis_.data() + 3 * slot_[first], 3 * basis_designs_,
                 3 * count, values);
    return;
  }
  for (std::size_t k = 0; k < count; ++k) system_->fill_tile(solutions_[first + k], tile, values + 3 * k * tile_size);
}

void EnergyEvaluation::evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const {
  const bool exact = system_->exact();
  for (std::size_t i = begin; i < end && exact; ++i) {
    if (system_->region_of_[i] == deformable_region) continue;
    const auto id = static_cast<PointId>(i);
    for (std::size_t k = 0; k < out.size(); ++k) out[k][i - begin] = held_.place(designs_[first + k], id, kind_);
  }
  const std::vector<PointId>& ids = system_->following_;
  const auto position = [&](std::size_t id) {
    return static_cast<std::size_t>(std::lower_bound(ids.begin(), ids.end(), static_cast<std::uint64_t>(id)) - ids.begin());
  };
  const std::size_t low = position(begin), high = position(end);
  const double keep = kind_ == MotionKind::position ? 1.0 : 0.0;
  std::vector<double> values(3 * out.size() * tile_size);
  for (std::size_t t = low / tile_size; t * tile_size < high; ++t) {
    // Runs of designs on one path share a pass over the tile.
    for (std::size_t k = 0; k < out.size();) {
      std::size_t last = k + 1;
      while (last < out.size() && reports_[first + last].path == reports_[first + k].path) ++last;
      evaluate_tile(t, first + k, last - k, values.data() + 3 * k * tile_size);
      k = last;
    }
    for (std::size_t s = std::max(low, t * tile_size); s < std::min(high, (t + 1) * tile_size); ++s) {
      const Vec3& x = held_.mesh.points[ids[s]];
      for (std::size_t k = 0; k < out.size(); ++k) {
        Vec3& y = out[k][ids[s] - begin];
        for (std::size_t c = 0; c < 3; ++c) y[c] = keep * x[c] + values[(3 * k + c) * tile_size + s % tile_size];
      }
    }
  }
}

}  // namespace deform
