#include "core/deformers/rbf/rbf_evaluation.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"

namespace deform {

namespace {

constexpr std::size_t most_samples = 256;  // centres at which a direct solution is checked

[[noreturn]] void invalid(std::size_t design, const std::string& message) {
  throw Error(ErrorCode::invalid_argument, "designs[" + std::to_string(design) + "]" + message);
}

double length(const Vec3& v) { return std::hypot(v[0], v[1], v[2]); }
Vec3 difference(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

}  // namespace

RbfEvaluation::RbfEvaluation(std::shared_ptr<const RbfSystem> system, std::span<const Design> designs, EvaluationPath path,
                             const RunContext& context)
    : system_(std::move(system)), held_(system_->held()), reports_(designs.size()), slot_(designs.size()) {
  designs_.reserve(designs.size());
  for (std::size_t i = 0; i < designs.size(); ++i) {
    context.check();
    designs_.push_back(held_.bound(designs[i], i));
    check_tolerance(i);
    held_.check_coincident(designs_.back(), i);
    check_sliding(i);
  }
  choose_paths(path);
  solve(context);
}

RbfEvaluation::RbfEvaluation(std::shared_ptr<const RbfSystem> system, const std::vector<Affine>& derivatives,
                             const RunContext& context)
    : system_(std::move(system)), held_(system_->held()), kind_(MotionKind::derivative), reports_(1), slot_(1) {
  designs_.push_back({derivatives, std::vector<std::vector<Vec3>>(derivatives.size()), 0});
  choose_paths(EvaluationPath::automatic);
  solve(context);
}

// The displacement of a constraint point, in the frame of the symmetry planes when there are any.
Vec3 RbfEvaluation::prescribed(const BoundDesign& design, PointId id) const {
  const Vec3 to = held_.place(design, id, kind_);
  const Vec3 u = kind_ == MotionKind::position ? difference(to, system_->mesh_->points[id]) : to;
  const Symmetry& symmetry = system_->regions_.symmetry;
  return symmetry.empty() ? u : system_->components(symmetry.to_frame(u), id);
}

void RbfEvaluation::check_sliding(std::size_t index) const {
  const Symmetry& symmetry = system_->regions_.symmetry;
  for (const PointId id : system_->sliding_) {
    const Vec3 u = symmetry.to_frame(difference(held_.told(designs_[index], id, kind_), system_->mesh_->points[id]));
    for (std::size_t k = 0; k < symmetry.planes(); ++k) {
      if ((symmetry.on(id) >> k & 1u) == 0 || std::abs(u[k]) <= symmetry.reach(k)) continue;
      std::ostringstream text;
      text << ": point " << id << " (handle \"" << system_->setup_.handles[system_->centres_.region_of[id]].name
           << "\") lies on symmetry[" << k << "] but is sent a distance of " << number_digits(u[k])
           << " out of it; points on a symmetry plane only slide in it: take them out of the handle with `difference`";
      invalid(index, text.str());
    }
  }
}

void RbfEvaluation::check_tolerance(std::size_t index) const {
  const double tolerance = designs_[index].tolerance;
  if (tolerance == 0) return;
  const SystemInfo& info = system_->info_;
  std::ostringstream text;
  text << ".tolerance: " << number_digits(tolerance);
  if (!to_tolerance(info.solver)) {
    text << ", but solver " << to_string(info.solver) << " has none";
    invalid(index, text.str());
  }
  const double least = info.solver == Solver::incremental_qr ? info.tolerance : least_tolerance;
  if (tolerance >= least && tolerance <= largest_tolerance) return;
  text << " is out of range " << number_digits(least) << ".." << number_digits(largest_tolerance);
  if (info.solver == Solver::incremental_qr) text << "; the system was prepared for " << number_digits(info.tolerance);
  invalid(index, text.str());
}

void RbfEvaluation::choose_paths(EvaluationPath path) {
  const bool has_basis = system_->has_basis();
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    const bool affine = designs_[i].is_affine();
    if (path == EvaluationPath::basis && !has_basis) invalid(i, ": path BASIS, but the system was prepared without a basis");
    if (path == EvaluationPath::basis && !affine) invalid(i, ": path BASIS, but a handle has displacements per point");
    const bool other_tolerance = designs_[i].tolerance != 0 && designs_[i].tolerance != system_->info_.tolerance;
    if (path == EvaluationPath::basis && other_tolerance) {
      invalid(i, ": path BASIS, but the basis was made with the tolerance of the setup");
    }
    const bool direct = path == EvaluationPath::direct || !has_basis || !affine || other_tolerance;
    slot_[i] = direct ? direct_designs_++ : basis_designs_++;
    reports_[i].path = direct ? EvaluationPath::direct : EvaluationPath::basis;
    if (kind_ == MotionKind::derivative) continue;
    reports_[i].prescribed_displacement = held_.largest_displacement(designs_[i]);
  }
}

void RbfEvaluation::solve(const RunContext& context) {
  coefficients_.resize(system_->parts_.size());
  if (basis_designs_ > 0) set_basis_coefficients();
  if (direct_designs_ > 0) solve_direct(context);
}

void RbfEvaluation::set_basis_coefficients() {
  const Symmetry& symmetry = system_->regions_.symmetry;
  const std::size_t handles = system_->frames_.size();
  for (std::size_t p = 0; p < coefficients_.size(); ++p) {
    coefficients_[p].basis.assign(4 * handles * basis_designs_ * system_->parts_[p].plan.components.size(), 0.0);
  }
  double block[12];
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    if (reports_[i].path != EvaluationPath::basis) continue;
    Vec3 bound{};
    for (std::size_t h = 0; h < handles; ++h) {
      field_coefficients(designs_[i].affine[h], kind_, system_->frames_[h], system_->box_, block);
      for (std::size_t f = 0; f < 4; ++f) {
        Vec3 row{block[3 * f], block[3 * f + 1], block[3 * f + 2]};
        if (!symmetry.empty()) row = symmetry.to_frame(row);
        for (std::size_t p = 0; p < coefficients_.size(); ++p) {
          const auto& components = system_->parts_[p].plan.components;
          const double residual = system_->parts_[p].basis->residuals()[4 * h + f];
          for (std::size_t c = 0; c < components.size(); ++c) {
            const std::size_t k = components[c];
            coefficients_[p].basis[((4 * h + f) * basis_designs_ + slot_[i]) * components.size() + c] = row[k];
            bound[k] += residual * std::abs(row[k]);
          }
        }
      }
    }
    reports_[i].interpolation_residual = length(bound);
  }
}

/// Displacements of the centres: rows of the part x its components.
Eigen::MatrixXd RbfEvaluation::part_data(const BoundDesign& design, const RbfPart& part) const {
  const auto& ids = system_->centres_.ids;
  const auto& components = part.plan.components;
  Eigen::MatrixXd F(ids.size(), components.size());
  for (std::size_t j = 0; j < ids.size(); ++j) {
    const Vec3 u = prescribed(design, ids[j]);
    for (std::size_t c = 0; c < components.size(); ++c) {
      F(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(c)) = u[components[c]];
    }
  }
  return part.plan.data(F);
}

/// One design after the other: each uses all cores, and its search directions take memory.
void RbfEvaluation::solve_to_tolerance(const RunContext& context) {
  std::vector<Vec3> points;
  points.reserve(system_->centres_.deformable.size());
  for (const PointId id : system_->centres_.deformable) points.push_back(system_->coordinates(id));
  for (auto& part : coefficients_) part.values.resize(designs_.size());
  for (std::size_t i = 0; i < designs_.size(); ++i) {
    if (reports_[i].path != EvaluationPath::direct) continue;
    const double tolerance = designs_[i].tolerance > 0 ? designs_[i].tolerance : system_->info_.tolerance;
    double squares = 0;
    for (std::size_t p = 0; p < coefficients_.size(); ++p) {
      const RbfPart& part = system_->parts_[p];
      const Eigen::MatrixXd F = part_data(designs_[i], part);
      // A derivative has no length to compare with but its own.
      const double unit = kind_ == MotionKind::position ? system_->info_.diagonal : F.cwiseAbs().maxCoeff();
      const Interpolants interpolants = part.system->interpolate(F, tolerance * unit, context);
      coefficients_[p].values[i] = part.system->values(interpolants, points, context);
      // The iterative solver's is the largest of single components, that of incremental QR of rows.
      const double width = system_->info_.solver == Solver::iterative ? static_cast<double>(F.cols()) : 1.0;
      squares += width * interpolants.residual * interpolants.residual;
    }
    reports_[i].interpolation_residual = std::sqrt(squares);
  }
}

void RbfEvaluation::solve_direct(const RunContext& context) {
  if (to_tolerance(system_->info_.solver)) return solve_to_tolerance(context);
  for (std::size_t p = 0; p < coefficients_.size(); ++p) {
    const RbfPart& part = system_->parts_[p];
    const std::size_t rows = part.system->size() + part.system->polynomials().terms();
    const std::size_t width = part.plan.components.size();
    std::vector<double>& direct = coefficients_[p].direct;
    direct.resize(rows * direct_designs_ * width);
    // Always one design at a time: BLAS sums in another order for another number of columns, and a design must not depend on the
    // others bit for bit.
    parallel_for(context, designs_.size(), 1, [&](std::size_t i, std::size_t) {
      if (reports_[i].path != EvaluationPath::direct) return;
      const Eigen::MatrixXd solution = part.system->interpolate(part_data(designs_[i], part), 0, context).coefficients;
      for (std::size_t r = 0; r < rows; ++r) {
        for (std::size_t c = 0; c < width; ++c) {
          direct[(r * direct_designs_ + slot_[i]) * width + c] =
              solution(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c));
        }
      }
    });
    context.check();
  }
  measure_direct();
}

void RbfEvaluation::measure_direct() {
  const auto& ids = system_->centres_.ids;
  const std::size_t count = std::min(most_samples, ids.size());
  std::vector<PointId> samples(count);
  std::vector<Vec3> places(count);
  for (std::size_t s = 0; s < count; ++s) {
    samples[s] = ids[s * ids.size() / count];
    places[s] = system_->coordinates(samples[s]);
  }
  const TiledPoints tiled(places);
  std::vector<double> values(3 * direct_designs_ * tile_size);
  for (std::size_t t = 0; t < tiled.tiles(); ++t) {
    // [component][design][point]
    std::vector<double> at_samples(3 * direct_designs_ * tile_size, 0.0);
    for (std::size_t p = 0; p < coefficients_.size(); ++p) {
      const auto& components = system_->parts_[p].plan.components;
      const std::size_t width = components.size();
      interpolate_tile(*system_->parts_[p].system, tiled.tile(t), coefficients_[p].direct.data(), width * direct_designs_,
                       values.data());
      for (std::size_t i = 0; i < direct_designs_; ++i) {
        for (std::size_t c = 0; c < width; ++c) {
          std::copy_n(values.data() + (i * width + c) * tile_size, tile_size,
                      at_samples.data() + (components[c] * direct_designs_ + i) * tile_size);
        }
      }
    }
    for (std::size_t s = t * tile_size; s < std::min((t + 1) * tile_size, count); ++s) {
      for (std::size_t i = 0; i < designs_.size(); ++i) {
        if (reports_[i].path != EvaluationPath::direct) continue;
        Vec3 error = prescribed(designs_[i], samples[s]);
        for (std::size_t k = 0; k < 3; ++k) {
          error[k] -= at_samples[(k * direct_designs_ + slot_[i]) * tile_size + s % tile_size];
        }
        error = system_->components(error, samples[s]);
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
    for (std::size_t k = 0; k < out.size(); ++k)
      out[k][i - begin] = held_.place(designs_[first + k], static_cast<PointId>(i), kind_);
  }
}

/// Values of one part at a tile for designs on one path: [design][component of the part][16].
void RbfEvaluation::part_tile(std::size_t p, std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  const RbfPart& part = system_->parts_[p];
  const Coefficients& coefficients = coefficients_[p];
  const std::size_t width = part.plan.components.size(), columns = width * count;
  std::fill_n(values, columns * tile_size, 0.0);
  if (reports_[first].path == EvaluationPath::basis) {
    tile_product(part.basis->tile(tile), part.basis->fields(), coefficients.basis.data() + width * slot_[first],
                 width * basis_designs_, columns, values);
  } else if (!coefficients.values.empty()) {
    const std::size_t end = std::min((tile + 1) * tile_size, system_->centres_.deformable.size());
    for (std::size_t s = tile * tile_size; s < end; ++s) {
      for (std::size_t c = 0; c < columns; ++c) {
        values[c * tile_size + s % tile_size] = coefficients.values[first + c / width][width * s + c % width];
      }
    }
  } else {
    interpolate_tile_columns(*part.system, system_->deformable_.tile(tile), coefficients.direct.data() + width * slot_[first],
                             width * direct_designs_, columns, values);
  }
}

/// Displacements (in the frame of the planes) at a tile for designs: [design][component][16].
void RbfEvaluation::fill_tile(std::size_t tile, std::size_t first, std::size_t count, double* values) const {
  const auto& parts = system_->parts_;
  if (system_->regions_.symmetry.empty()) return part_tile(0, tile, first, count, values);
  std::fill_n(values, 3 * count * tile_size, 0.0);
  std::vector<double> part_values(3 * count * tile_size);
  for (std::size_t p = 0; p < parts.size(); ++p) {
    const auto& components = parts[p].plan.components;
    part_tile(p, tile, first, count, part_values.data());
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t c = 0; c < components.size(); ++c) {
        std::copy_n(part_values.data() + (i * components.size() + c) * tile_size, tile_size,
                    values + (3 * i + components[c]) * tile_size);
      }
    }
  }
}

void RbfEvaluation::evaluate_deformable(std::size_t begin, std::size_t end, std::size_t first, std::span<Vec3* const> out) const {
  const auto& ids = system_->centres_.deformable;
  const Symmetry& symmetry = system_->regions_.symmetry;
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
      fill_tile(t, first + k, last - k, values.data() + 3 * k * tile_size);
      k = last;
    }
    const std::size_t start = std::max(low, t * tile_size);
    const std::size_t stop = std::min(high, (t + 1) * tile_size);
    for (std::size_t s = start; s < stop; ++s) {
      const Vec3& x = rest[ids[s]];
      const double* value = values.data() + s % tile_size;
      for (std::size_t k = 0; k < out.size(); ++k) {
        Vec3 u;
        for (std::size_t c = 0; c < 3; ++c) u[c] = value[(3 * k + c) * tile_size];
        if (!symmetry.empty()) u = symmetry.from_frame(system_->components(u, ids[s]));
        Vec3& y = out[k][ids[s] - begin];
        for (std::size_t c = 0; c < 3; ++c) y[c] = keep * x[c] + u[c];
      }
    }
  }
}

}  // namespace deform
