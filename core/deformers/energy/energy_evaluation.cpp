#include "core/deformers/energy/energy_evaluation.h"

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

constexpr double exact_limit = 1e-9;  // of D: ConstraintReport::missed

double length(const Vec3& v) { return std::hypot(v[0], v[1], v[2]); }
double distance(const Vec3& a, const Vec3& b) { return length({a[0] - b[0], a[1] - b[1], a[2] - b[2]}); }

}  // namespace

EnergyEvaluation::EnergyEvaluation(std::shared_ptr<const EnergySystem> system, std::span<const Design> designs,
                                   EvaluationPath path, WarmStart* warm, const RunContext& context)
    : system_(std::move(system)), held_(system_->held()), reports_(designs.size()), slot_(designs.size()) {
  designs_.reserve(designs.size());
  for (std::size_t i = 0; i < designs.size(); ++i) {
    context.check();
    designs_.push_back(held_.bound(designs[i], i));
    if (designs[i].tolerance != 0) {
      throw Error(ErrorCode::invalid_argument,
                  "designs[" + std::to_string(i) + "].tolerance: method.rbf only; this method has none");
    }
    held_.check_coincident(designs_.back(), i);
    reports_[i].prescribed_displacement = held_.largest_displacement(designs_.back());
  }
  choose_paths(path);
  set_basis_coefficients();
  solve_direct(warm, context);
}

EnergyEvaluation::EnergyEvaluation(std::shared_ptr<const EnergySystem> system, const std::vector<Affine>& derivatives,
                                   const EnergySystem::Constrained& at, const RunContext& context)
    : system_(std::move(system)), held_(system_->held()), kind_(MotionKind::derivative), reports_(1), slot_(1) {
  designs_.push_back({derivatives, std::vector<std::vector<Vec3>>(derivatives.size())});
  choose_paths(EvaluationPath::automatic);
  set_basis_coefficients();
  if (system_->constrained_ == nullptr) {
    solve_direct(nullptr, context);
    return;
  }
  const auto told = system_->prescribed(designs_[0], kind_);
  const Eigen::MatrixXd w = system_->constrained_->derivative(at.result, told.h, told.offsets, context);
  solutions_.push_back(system_->completed(told.h * system_->box_.scale, w * system_->box_.scale, context));
  if (system_->placement_) system_->derive_exactly(at.exact, designs_[0], solutions_[0], context);
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

EnergySystem::Prescribed EnergySystem::prescribed(const BoundDesign& design, MotionKind kind) const {
  const HeldPoints points = held();
  const auto displacement = [&](PointId id) {
    const Vec3 to = points.place(design, id, kind);
    const Vec3 from = kind == MotionKind::position ? mesh_->points[id] : Vec3{};
    return Vec3{(to[0] - from[0]) / box_.scale, (to[1] - from[1]) / box_.scale, (to[2] - from[2]) / box_.scale};
  };
  Prescribed result{Eigen::MatrixXd(static_cast<Eigen::Index>(model_.held.size()), 3), {}};
  for (std::size_t j = 0; j < model_.held.size(); ++j) {
    const Vec3 u = displacement(model_.held[j]);
    for (std::size_t k = 0; k < 3; ++k) result.h(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = u[k];
  }
  if (!constrained_) return result;
  for (const ConstraintSet& set : constrained_->sets()) {
    for (const PointId id : set.ids) {
      const bool told = model_.eliminated && region_of_[id] != deformable_region;
      result.offsets.push_back(told ? displacement(id) : Vec3{});
    }
  }
  return result;
}

void EnergyEvaluation::solve_direct(WarmStart* warm, const RunContext& context) {
  solutions_.resize(designs_.size());
  const bool sequence = warm != nullptr && system_->constrained_;
  const auto solve_one = [&](std::size_t i, std::size_t) {
    if (reports_[i].path != EvaluationPath::direct) return;
    if (system_->constrained_) {
      solve_constrained(i, warm, context);
    } else {
      solutions_[i] = system_->solve(system_->prescribed(designs_[i], kind_).h * system_->box_.scale, context);
    }
    const auto& misfits = solutions_[i].misfits;
    reports_[i].interpolation_residual = length({misfits[0], misfits[1], misfits[2]});
  };
  if (!sequence) return parallel_for(context, designs_.size(), 1, solve_one);
  for (std::size_t i = 0; i < designs_.size(); ++i) solve_one(i, i + 1);
}

void EnergyEvaluation::solve_constrained(std::size_t design, WarmStart* warm, const RunContext& context) {
  const double D = system_->box_.scale;
  const auto told = system_->prescribed(designs_[design], kind_);
  const auto* start = warm != nullptr ? static_cast<const ConstrainedStart*>(warm->state.get()) : nullptr;
  const ConstrainedResult result = system_->constrained_->solve(told.h, told.offsets, context, start);
  if (warm != nullptr) warm->state = std::make_shared<const ConstrainedStart>(result.start());
  solutions_[design] = system_->completed(told.h * D, result.w * D, context);
  if (system_->placement_) system_->place_exactly(designs_[design], solutions_[design], context);
  DesignReport& report = reports_[design];
  report.iterations = result.iterations;
  report.newton_steps = result.newton_steps;
  report.converged = result.converged;
  report.energy = result.after.objective;
  report.convergence_error = result.error * D;
  measure_constraints(design, result);
}

/// Where the points of the sets really go, unit coordinates.
std::vector<Vec3> EnergyEvaluation::final_points(std::size_t design, std::vector<Vec3> points) const {
  const EnergySystem::Solution& solution = solutions_[design];
  std::vector<double> values(3 * tile_size);
  for (std::size_t t = 0; t < system_->set_places_.tiles(); ++t) {
    const double* tile = system_->set_places_.tile(t);
    std::fill(values.begin(), values.end(), 0.0);
    if (system_->correction_) system_->correction_->add_values(tile, solution.correction.data(), 3, values.data());
    if (solution.placement.size() > 0)
      system_->placement_correction_->add_values(tile, solution.placement.data(), 3, values.data());
    for (std::size_t i = t * tile_size; i < std::min(points.size(), (t + 1) * tile_size); ++i) {
      for (std::size_t k = 0; k < 3; ++k) points[i][k] += values[k * tile_size + i % tile_size] / system_->box_.scale;
    }
  }
  std::size_t i = 0;
  for (const ConstraintSet& set : system_->constrained_->sets()) {
    for (const PointId id : set.ids) {
      if (system_->exact() && system_->region_of_[id] != deformable_region) {
        points[i] = system_->box_.to_unit(held_.place(designs_[design], id, kind_));
      } else if (!solution.exact_values.empty()) {
        const std::vector<PointId>& ids = system_->placement_->ids();
        const auto found = std::lower_bound(ids.begin(), ids.end(), id);
        if (found != ids.end() && *found == id) points[i] = solution.exact.points[static_cast<std::size_t>(found - ids.begin())];
      }
      ++i;
    }
  }
  return points;
}

void EnergyEvaluation::measure_constraints(std::size_t design, const ConstrainedResult& result) {
  const double D = system_->box_.scale;
  const std::vector<Vec3> points = final_points(design, result.after.points);
  std::vector<ConstraintReport>& reports = reports_[design].constraints;
  reports.resize(system_->setup_.constraints.size());
  std::vector<std::size_t> counts(reports.size(), 0);
  std::size_t first = 0;
  for (std::size_t t = 0; t < system_->constrained_->sets().size(); ++t) {
    const ConstraintSet& set = system_->constrained_->sets()[t];
    const std::size_t count = set.ids.size();
    std::vector<Vec3> projected(count);
    ShapeParameters shape = result.after.shapes[t];
    ConstraintReport& report = reports[system_->constraint_of_[t]];
    report.rms += set.projection->project({points.data() + first, count}, projected, shape);
    report.rms_before += result.before.squares[t];
    for (std::size_t i = 0; i < count; ++i) {
      report.max = std::max(report.max, D * distance(points[first + i], projected[i]));
      report.max_before =
          std::max(report.max_before, D * distance(result.before.points[first + i], result.before.targets[first + i]));
    }
    counts[system_->constraint_of_[t]] += count;
    first += count;
  }
  const std::vector<bool>& given_up = solutions_[design].exact.given_up;
  for (std::size_t t = 0; t < given_up.size(); ++t) {
    ConstraintReport& report = reports[system_->exact_constraint_of_[t]];
    report.given_up = report.given_up || given_up[t];
  }
  for (std::size_t i = 0; i < reports.size(); ++i) {
    reports[i].rms = D * std::sqrt(reports[i].rms / static_cast<double>(counts[i]));
    reports[i].rms_before = D * std::sqrt(reports[i].rms_before / static_cast<double>(counts[i]));
    reports[i].missed = system_->setup_.constraints[i].exact && reports[i].max > exact_limit * D;
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
  evaluate_following(begin, end, first, out);
  if (!system_->placement_) return;
  const std::vector<PointId>& ids = system_->placement_->ids();
  const auto start = std::lower_bound(ids.begin(), ids.end(), static_cast<std::uint64_t>(begin)) - ids.begin();
  for (auto u = static_cast<std::size_t>(start); u < ids.size() && ids[u] < end; ++u) {
    if (!system_->placement_->moves(u)) continue;
    for (std::size_t k = 0; k < out.size(); ++k) {
      const std::vector<Vec3>& values = solutions_[first + k].exact_values;
      if (!values.empty()) out[k][ids[u] - begin] = values[u];
    }
  }
}

void EnergyEvaluation::evaluate_following(std::size_t begin, std::size_t end, std::size_t first,
                                          std::span<Vec3* const> out) const {
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
