#include "core/deformers/rbf_evaluation.h"

#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "core/base/parallel.h"

namespace deform {

namespace {

constexpr double agreement = 1e-10;        // of D: how far apart coincident points may be sent
constexpr std::size_t most_samples = 256;  // centres at which a direct solution is checked

[[noreturn]] void invalid(std::size_t design, const std::string& message) {
  throw Error(ErrorCode::invalid_argument, "designs[" + std::to_string(design) + "]" + message);
}

double length(const Vec3& v) { return std::hypot(v[0], v[1], v[2]); }
Vec3 difference(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

}  // namespace

bool BoundDesign::is_affine() const {
  return std::all_of(displacement.begin(), displacement.end(), [](const auto& d) { return d.empty(); });
}

RbfEvaluation::RbfEvaluation(std::shared_ptr<const RbfSystem> system, std::span<const Design> designs, EvaluationPath path,
                             const RunContext& context)
    : system_(std::move(system)), reports_(designs.size()), column_(designs.size()) {
  designs_.reserve(designs.size());
  for (std::size_t i = 0; i < designs.size(); ++i) {
    context.check();
    designs_.push_back(bound(designs[i], i));
    check_coincident(i);
  }
  choose_paths(path);
  solve(context);
}

RbfEvaluation::RbfEvaluation(std::shared_ptr<const RbfSystem> system, const std::vector<Affine>& derivatives,
                             const RunContext& context)
    : system_(std::move(system)), kind_(MotionKind::derivative), reports_(1), column_(1) {
  designs_.push_back({derivatives, std::vector<std::vector<Vec3>>(derivatives.size())});
  choose_paths(EvaluationPath::automatic);
  solve(context);
}

BoundDesign RbfEvaluation::bound(const Design& design, std::size_t index) const {
  const Setup& setup = system_->setup_;
  const std::size_t handles = setup.handles.size();
  BoundDesign result{std::vector<Affine>(handles, identity_affine), std::vector<std::vector<Vec3>>(handles)};
  if (!design.variables.empty()) {
    try {
      result.affine = handle_motions(setup, design.variables);
    } catch (const Error& error) {
      invalid(index, std::string(".") + error.what());
    }
  }
  std::vector<char> moved(handles);
  for (std::size_t k = 0; k < design.motions.size(); ++k) {
    const Motion& motion = design.motions[k];
    const std::string field = ".motions[" + std::to_string(k) + "]";
    if (motion.handle >= handles) {
      invalid(index, field + ".handle: " + std::to_string(motion.handle) + " is out of range, the setup has " +
                         std::to_string(handles) + " handles");
    }
    const std::string name = " (handle \"" + setup.handles[motion.handle].name + "\")";
    if (moved[motion.handle]++) invalid(index, field + name + ": the handle has two motions");
    if (result.affine[motion.handle] != identity_affine) {
      invalid(index, field + name + ": the handle is moved by design variables as well; set those to 0");
    }
    if (const auto* affine = std::get_if<Affine>(&motion.value)) {
      for (std::size_t j = 0; j < affine->size(); ++j) {
        if (!std::isfinite((*affine)[j]))
          invalid(index, field + ".affine[" + std::to_string(j) + "]" + name + ": must be finite");
      }
      result.affine[motion.handle] = *affine;
      continue;
    }
    const auto& displacement = std::get<std::vector<Vec3>>(motion.value);
    const std::size_t expected = system_->regions_.handles[motion.handle].size();
    if (displacement.size() != expected) {
      invalid(index, field + ".displacements" + name + ": expected " + std::to_string(expected) +
                         " vectors, one per point, got " + std::to_string(displacement.size()));
    }
    for (std::size_t j = 0; j < displacement.size(); ++j) {
      if (!std::isfinite(displacement[j][0] + displacement[j][1] + displacement[j][2])) {
        invalid(index, field + ".displacements[" + std::to_string(j) + "]" + name + ": must be finite");
      }
    }
    result.displacement[motion.handle] = displacement;
  }
  return result;
}

// Where a constraint point goes, or its derivative.
Vec3 RbfEvaluation::constrained(const BoundDesign& design, PointId id) const {
  const RegionIndex region = system_->centres_.region_of[id];
  const Vec3& x = system_->mesh_->points[id];
  if (region == fixed_region) return kind_ == MotionKind::position ? x : Vec3{};
  const auto& displacement = design.displacement[region];
  if (displacement.empty()) {
    // At rest exactly, not up to the rounding of 1 x + 0 y + 0 z + 0 with huge coordinates.
    return design.affine[region] == identity_affine ? x : transformed(design.affine[region], x);
  }
  const Vec3& u = displacement[system_->rank_of_[id]];
  return {x[0] + u[0], x[1] + u[1], x[2] + u[2]};
}

void RbfEvaluation::check_coincident(std::size_t index) const {
  const BoundDesign& design = designs_[index];
  const auto name = [&](PointId id) {
    const RegionIndex region = system_->centres_.region_of[id];
    return std::to_string(id) +
           (region == fixed_region ? " (fixed)" : " (handle \"" + system_->setup_.handles[region].name + "\")");
  };
  for (const auto& cluster : system_->centres_.coincident) {
    const Vec3 first = constrained(design, cluster[0]);
    for (std::size_t k = 1; k < cluster.size(); ++k) {
      const double apart = length(difference(constrained(design, cluster[k]), first));
      if (apart <= agreement * system_->info_.diagonal) continue;
      invalid(index, ": points " + name(cluster[0]) + " and " + name(cluster[k]) +
                         " coincide but are sent to places a distance of " + std::to_string(apart) + " apart");
    }
  }
}

void RbfEvaluation::choose_paths(EvaluationPath path) {
  const bool has_basis = system_->basis_ != nullptr;
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    const bool affine = designs_[i].is_affine();
    if (path == EvaluationPath::basis && !has_basis) invalid(i, ": path BASIS, but the system was prepared without a basis");
    if (path == EvaluationPath::basis && !affine) invalid(i, ": path BASIS, but a handle has displacements per point");
    const bool direct = path == EvaluationPath::direct || !has_basis || !affine;
    std::size_t& columns = direct ? direct_columns_ : basis_columns_;
    column_[i] = columns;
    columns += 3;
    reports_[i].path = direct ? EvaluationPath::direct : EvaluationPath::basis;
    if (kind_ == MotionKind::derivative) continue;
    for (std::size_t h = 0; h < system_->regions_.handles.size(); ++h) {
      if (designs_[i].displacement[h].empty() && designs_[i].affine[h] == identity_affine) continue;
      for (const PointId id : system_->regions_.handles[h]) {
        reports_[i].max_displacement =
            std::max(reports_[i].max_displacement, length(difference(constrained(designs_[i], id), system_->mesh_->points[id])));
      }
    }
  }
}

void RbfEvaluation::solve(const RunContext& context) {
  if (basis_columns_ > 0) set_basis_coefficients();
  if (direct_columns_ > 0) solve_direct(context);
}

void RbfEvaluation::set_basis_coefficients() {
  const std::size_t handles = system_->frames_.size();
  basis_coefficients_.assign(4 * handles * basis_columns_, 0.0);
  const std::vector<double>& residuals = system_->basis_->residuals();
  double block[12];
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    if (reports_[i].path != EvaluationPath::basis) continue;
    Vec3 bound{};
    for (std::size_t h = 0; h < handles; ++h) {
      field_coefficients(designs_[i].affine[h], kind_, system_->frames_[h], system_->box_, block);
      for (std::size_t f = 0; f < 4; ++f) {
        for (std::size_t k = 0; k < 3; ++k) {
          basis_coefficients_[(4 * h + f) * basis_columns_ + column_[i] + k] = block[3 * f + k];
          bound[k] += residuals[4 * h + f] * std::abs(block[3 * f + k]);
        }
      }
    }
    reports_[i].interpolation_residual = length(bound);
  }
}

/// m x 3 displacements of the centres.
Eigen::MatrixXd RbfEvaluation::prescribed(const BoundDesign& design) const {
  const auto& ids = system_->centres_.ids;
  Eigen::MatrixXd F(ids.size(), 3);
  for (std::size_t j = 0; j < ids.size(); ++j) {
    const Vec3 to = constrained(design, ids[j]);
    const Vec3 u = kind_ == MotionKind::position ? difference(to, system_->mesh_->points[ids[j]]) : to;
    for (Eigen::Index k = 0; k < 3; ++k) F(static_cast<Eigen::Index>(j), k) = u[static_cast<std::size_t>(k)];
  }
  return F;
}

/// One design after the other: each uses all cores, and its search directions take memory.
void RbfEvaluation::solve_to_tolerance(const RunContext& context) {
  std::vector<Vec3> points;
  points.reserve(system_->centres_.deformable.size());
  for (const PointId id : system_->centres_.deformable) points.push_back(system_->box_.to_unit(system_->mesh_->points[id]));
  direct_values_.resize(designs_.size());
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    if (reports_[i].path != EvaluationPath::direct) continue;
    const Eigen::MatrixXd F = prescribed(designs_[i]);
    // A derivative has no length to compare with but its own.
    const double unit = kind_ == MotionKind::position ? system_->info_.diagonal : F.cwiseAbs().maxCoeff();
    const Interpolants interpolants = system_->system_->interpolate(F, system_->info_.tolerance * unit, context);
    direct_values_[i] = system_->system_->values(interpolants, points, context);
    // The iterative solver's is of components.
    const double components = system_->info_.solver == Solver::iterative ? std::sqrt(3.0) : 1.0;
    reports_[i].interpolation_residual = components * interpolants.residual;
  }
}

void RbfEvaluation::solve_direct(const RunContext& context) {
  if (to_tolerance(system_->info_.solver)) return solve_to_tolerance(context);
  const auto& ids = system_->centres_.ids;
  const std::size_t rows = ids.size() + system_->system_->polynomials().terms();
  direct_coefficients_.resize(rows * direct_columns_);
  // Always three columns at a time: BLAS sums in another order for another number of columns, and a design must not depend on
  // the others bit for bit.
  parallel_for(context, designs_.size(), 1, [&](std::size_t i, std::size_t) {
    if (reports_[i].path != EvaluationPath::direct) return;
    const Eigen::MatrixXd solution = system_->system_->solve(prescribed(designs_[i]), context);
    for (std::size_t r = 0; r < rows; ++r) {
      for (std::size_t k = 0; k < 3; ++k) {
        direct_coefficients_[r * direct_columns_ + column_[i] + k] =
            solution(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(k));
      }
    }
  });
  context.check();
  measure_direct();
}

void RbfEvaluation::measure_direct() {
  const auto& centres = system_->system_->centres();
  const std::size_t count = std::min(most_samples, centres.size());
  std::vector<std::size_t> samples(count);
  std::vector<Vec3> places(count);
  for (std::size_t s = 0; s < count; ++s) {
    samples[s] = s * centres.size() / count;
    places[s] = centres[samples[s]];
  }
  const TiledPoints tiled(places);
  std::vector<double> values(direct_columns_ * tile_size);
  for (std::size_t t = 0; t < tiled.tiles(); ++t) {
    interpolate_tile(*system_->system_, tiled.tile(t), direct_coefficients_.data(), direct_columns_, values.data());
    for (std::size_t s = t * tile_size; s < std::min((t + 1) * tile_size, count); ++s) {
      const PointId id = system_->centres_.ids[samples[s]];
      for (std::size_t i = 0; i < designs_.size(); ++i) {
        if (reports_[i].path != EvaluationPath::direct) continue;
        const Vec3 to = constrained(designs_[i], id);
        Vec3 error = kind_ == MotionKind::position ? difference(to, system_->mesh_->points[id]) : to;
        for (std::size_t k = 0; k < 3; ++k) error[k] -= values[(column_[i] + k) * tile_size + s % tile_size];
        reports_[i].interpolation_residual = std::max(reports_[i].interpolation_residual, length(error));
      }
    }
  }
}

void RbfEvaluation::evaluate(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const {
  evaluate_constrained(begin, end, first, out);
  evaluate_deformable(begin, end, first, out);
}

void RbfEvaluation::evaluate_constrained(std::size_t begin, std::size_t end, std::size_t first,
                                         std::span<Vec3* const> out) const {
  const RegionIndex* region = system_->centres_.region_of.data();
  for (std::size_t i = begin; i < end; ++i) {
    if (region[i] == deformable_region) continue;
    for (std::size_t k = 0; k < out.size(); ++k) out[k][i - begin] = constrained(designs_[first + k], static_cast<PointId>(i));
  }
}

void RbfEvaluation::evaluate_deformable(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const {
  const auto& ids = system_->centres_.deformable;
  const auto position = [&](std::size_t id) {
    return static_cast<std::size_t>(std::lower_bound(ids.begin(), ids.end(), static_cast<std::uint64_t>(id)) - ids.begin());
  };
  const std::size_t low = position(begin);
  const std::size_t high = position(end);
  if (low == high) return;
  const Points& rest = system_->mesh_->points;
  const double keep = kind_ == MotionKind::position ? 1.0 : 0.0;
  std::vector<double> values(3 * out.size() * tile_size);
  for (std::size_t t = low / tile_size; t * tile_size < high; ++t) {
    // Runs of designs on one path share a pass over the tile.
    for (std::size_t k = 0; k < out.size();) {
      const EvaluationPath path = reports_[first + k].path;
      std::size_t last = k + 1;
      while (last < out.size() && reports_[first + last].path == path) ++last;
      const std::size_t columns = 3 * (last - k);
      double* to = values.data() + 3 * k * tile_size;
      std::fill_n(to, columns * tile_size, 0.0);
      if (path == EvaluationPath::basis) {
        tile_product(system_->basis_->tile(t), system_->basis_->fields(), basis_coefficients_.data() + column_[first + k],
                     basis_columns_, columns, to);
      } else if (!direct_values_.empty()) {
        for (std::size_t s = t * tile_size; s < std::min((t + 1) * tile_size, ids.size()); ++s) {
          for (std::size_t c = 0; c < columns; ++c) {
            to[c * tile_size + s % tile_size] = direct_values_[first + k + c / 3][3 * s + c % 3];
          }
        }
      } else {
        interpolate_tile_columns(*system_->system_, system_->deformable_.tile(t),
                                 direct_coefficients_.data() + column_[first + k], direct_columns_, columns, to);
      }
      k = last;
    }
    const std::size_t start = std::max(low, t * tile_size);
    const std::size_t stop = std::min(high, (t + 1) * tile_size);
    for (std::size_t s = start; s < stop; ++s) {
      const Vec3& x = rest[ids[s]];
      const double* value = values.data() + s % tile_size;
      for (std::size_t k = 0; k < out.size(); ++k) {
        Vec3& y = out[k][ids[s] - begin];
        for (std::size_t c = 0; c < 3; ++c) y[c] = keep * x[c] + value[(3 * k + c) * tile_size];
      }
    }
  }
}

}  // namespace deform
