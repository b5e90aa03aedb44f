// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/rbf/rbf_system.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/deformers/rbf/interpolated_basis.h"
#include "core/deformers/rbf/rbf_evaluation.h"
#include "core/numerics/fast_sums/fast_sums.h"
#include "core/numerics/interpolation/values_to_tolerance.h"

namespace deform {

namespace {

/// Points at which errors are estimated.
constexpr std::size_t checked_to_tolerance = 384, checked_of_exact = 256;

int degree(const RbfOptions& options) {
  return options.polynomial_degree >= 0 ? options.polynomial_degree : properties(*options.kernel).default_degree();
}

/// Bits of the planes across which a part is odd.
unsigned odd_planes(const PartPlan& plan, const Symmetry& symmetry) {
  const bool odd = plan.components.size() == 1 && plan.components.front() < symmetry.planes();
  return odd ? 1u << plan.components.front() : 0u;
}

/// One in how many constraint points is looked at before all are.
std::size_t stride_of(std::size_t points) {
  constexpr std::size_t sampled = 50000;
  return (points + sampled - 1) / sampled;
}

/// The distance to the nearest other place, over an evenly strided sample of the first `count` places: the median, and at
/// most 1.25 times the first decile for the densest.
double spacing(const std::vector<Vec3>& places, std::size_t count, ShapeRule rule) {
  constexpr std::size_t sample = 500;
  const std::size_t stride = count / sample + 1;
  std::vector<double> nearest;
  for (std::size_t i = 0; i < count; i += stride) {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < places.size(); ++j) {
      if (j != i) least = std::min(least, distance(places[i], places[j]));
    }
    nearest.push_back(least);
  }
  std::sort(nearest.begin(), nearest.end());
  const double median = nearest[nearest.size() / 2];
  return rule == ShapeRule::median ? median : std::min(median, 1.25 * nearest[nearest.size() / 10]);
}

}  // namespace

RbfSystem::RbfSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const RbfOptions& options, const RunContext& context,
                     std::size_t memory_budget)
    : HandleSystem(std::move(mesh), setup, HandleMode::hard, Unit::longest_edge, context), options_(options) {
  centres_ = choose_centres(*mesh_, points_, regions_.handles.size(), options_, context);
  merge_partners(regions_.symmetry, points_, centres_);
  const std::vector<Vec3> places = coordinates(following());
  deformable_ = TiledPoints(places);
  const bool exact = !to_tolerance(solver_for(options_, regions_.symmetry, centres_.ids.size()));
  checked_ = check_points(places, coordinates(centres_.ids), exact ? checked_of_exact : checked_to_tolerance);
  for (const std::uint32_t i : checked_) checked_places_.push_back(places[i]);
  end_stage("select");
  context.check();
  if (centres_.most > centres_.ids.size()) {
    refine_centres(context, memory_budget);
  } else {
    prepare_parts(context, memory_budget);
    if (centres_.reduced) measure_misfit(context);
  }
  end_stage("factor");
  prepare_basis(context);
  end_stage("basis");
  fill_info();
  add_notes();
}

std::vector<PointId> RbfSystem::candidates() const {
  std::vector<PointId> all;
  for (std::size_t i = 0; i < mesh_->point_count(); ++i) {
    const auto id = static_cast<PointId>(i);
    if (points_.region_of[i] != deformable_region && !regions_.symmetry.sector().is_second(id)) all.push_back(id);
  }
  return all;
}

void RbfSystem::measure_misfit(const RunContext& context) {
  const std::vector<PointId> all = candidates();
  std::vector<PointId> ids;
  for (std::size_t i = 0; i < all.size(); i += stride_of(all.size())) ids.push_back(all[i]);
  if (ids.empty()) return;
  const std::vector<double> missed = misfits(ids, context);
  misfit_ = *std::max_element(missed.begin(), missed.end());
}

void RbfSystem::refine_centres(const RunContext& context, std::size_t memory_budget) {
  const std::vector<PointId> all = candidates();
  if (!centres_.coarse.empty()) {
    std::swap(centres_.ids, centres_.coarse);
    add_missed(all, most_coarse, Look::at_some, context, memory_budget);
    std::swap(centres_.ids, centres_.coarse);
    join_coarse(points_, centres_);
  }
  add_missed(all, centres_.most, Look::at_all, context, memory_budget);
}

void RbfSystem::add_missed(const std::vector<PointId>& at, std::size_t limit, Look look, const RunContext& context,
                           std::size_t memory_budget) {
  constexpr int most_rounds = 8;
  // Check a subset as long as there is something to add, and all points in the end.
  std::size_t stride = stride_of(at.size());
  for (int round = 0;; ++round) {
    parts_.clear();
    factor_bytes_ = check_bytes_ = 0;
    prepare_parts(context, memory_budget);
    std::vector<PointId> more;
    for (bool again = true; again;) {
      std::vector<PointId> ids;
      for (std::size_t i = 0; i < at.size(); i += stride) ids.push_back(at[i]);
      if (ids.empty()) return;
      const std::vector<double> missed = misfits(ids, context);
      misfit_ = *std::max_element(missed.begin(), missed.end());
      const std::size_t m = centres_.ids.size();
      if (misfit_ > reduction_tolerance(options_) && round < most_rounds && m < limit) {
        const std::size_t most = std::min(limit - m, std::max<std::size_t>(200, m / 2));
        more = most_missed(*mesh_, centres_.ids, ids, missed, reduction_tolerance(options_), most);
      }
      again = more.empty() && stride > 1 && look == Look::at_all;
      if (again) stride = 1;
    }
    if (more.empty()) return;
    centres_.ids.insert(centres_.ids.end(), more.begin(), more.end());
    std::sort(centres_.ids.begin(), centres_.ids.end());
  }
}

std::vector<double> RbfSystem::misfits(const std::vector<PointId>& ids, const RunContext& context) const {
  std::vector<double> result(ids.size(), 0.0);
  const Eigen::MatrixXd at_centres = fields_at_centres();
  // The residual of the solver must not be mistaken for a lack of centres.
  const double solver_tolerance = std::min(options_.tolerance, 0.1 * reduction_tolerance(options_));
  for (const RbfPart& part : parts_) {
    const std::vector<double> weights = field_weights(part);
    const unsigned odd = odd_planes(part.plan, regions_.symmetry);
    const Interpolants interpolants = part.system->interpolate(part.plan.data(at_centres), solver_tolerance, context);
    for (std::size_t first = 0; first < ids.size(); first += points_looked_at) {
      const auto begin = ids.begin() + static_cast<std::ptrdiff_t>(first);
      const std::vector<PointId> some(begin, begin + static_cast<std::ptrdiff_t>(std::min(points_looked_at, ids.size() - first)));
      const std::vector<double> values = part.system->values(interpolants, coordinates(some), context);
      for (std::size_t i = 0; i < some.size(); ++i) {
        if ((regions_.symmetry.on(some[i]) & odd) != 0) continue;  // it is zero there
        if (part.plan.components.size() == 2 && regions_.symmetry.sector().on_axis(some[i])) continue;
        const RegionIndex region = points_.region_of[some[i]];
        std::array<double, 4> own{};
        if (region != fixed_region) own = handle_fields(region, some[i]);
        for (std::size_t f = 0; f < weights.size(); ++f) {
          const double target = f / 4 == region && !part.plan.turned ? own[f % 4] : 0.0;
          const double missed = weights[f] * std::abs(values[i * weights.size() + f] - target);
          double& largest = result[first + i];
          if (!(missed <= largest)) largest = std::isnan(missed) ? std::numeric_limits<double>::infinity() : missed;
        }
      }
    }
  }
  return result;
}

std::vector<double> RbfSystem::field_weights(const RbfPart& part) const {
  constexpr double flat = 1e-6;  // of the size of a handle: there is no motion that is large in such a field alone
  const Symmetry& symmetry = regions_.symmetry;
  const unsigned odd = odd_planes(part.plan, symmetry);
  std::vector<double> weights;
  for (std::size_t h = 0; h < regions_.handles.size(); ++h) {
    std::array<double, 4> largest{};
    unsigned touched = 0;
    for (const PointId id : regions_.handles[h]) {
      const std::array<double, 4> values = handle_fields(h, id);
      for (std::size_t f = 0; f < 4; ++f) largest[f] = std::max(largest[f], std::abs(values[f]));
      touched |= symmetry.on(id);
    }
    const double size = *std::max_element(largest.begin() + 1, largest.end());
    for (std::size_t f = 0; f < 4; ++f) {
      const unsigned field_is_odd = f > 0 && f <= symmetry.planes() ? 1u << (f - 1) : 0u;
      const bool counts = (f == 0 || largest[f] > flat * size) && ((field_is_odd ^ odd) & touched) == 0;
      weights.push_back(counts ? 1 / largest[f] : 0);
    }
  }
  return weights;
}

std::vector<Vec3> RbfSystem::coordinates(const std::vector<PointId>& ids) const {
  if (regions_.symmetry.empty()) return unit_places(*mesh_, box_, ids);
  std::vector<Vec3> result;
  result.reserve(ids.size());
  // Partners have one place, to which the displacements of the second are turned back.
  for (const PointId id : ids) result.push_back(coordinates(mesh_->points[regions_.symmetry.sector().first_of(id)]));
  return result;
}

Vec3 RbfSystem::coordinates(const Vec3& place) const {
  return regions_.symmetry.empty() ? box_.to_unit(place) : regions_.symmetry.coordinates(place) / box_.scale;
}

/// Uses the centres and their images together: the shape is that of the whole model.
InterpolationOptions RbfSystem::interpolation_options(const std::vector<Vec3>& places) {
  const Symmetry& symmetry = regions_.symmetry;
  const auto images = static_cast<unsigned>(symmetry.images());
  Box extent;
  std::vector<Vec3> all = places;
  for (unsigned reflected = 0; reflected < images; ++reflected) {
    for (std::size_t j = 0; j < places.size(); ++j) {
      Vec3 x = mesh_->points[centres_.ids[j]], y = places[j];
      if (symmetry.is_sector()) {
        extent.add(box_.to_unit(symmetry.turned_point(x, reflected)));
        if (reflected != 0 && !symmetry.sector().on_axis(centres_.ids[j])) all.push_back(symmetry.sector().turned(y, reflected));
        continue;
      }
      for (std::size_t k = 0; k < symmetry.planes(); ++k) {
        if ((reflected >> k & 1u) == 0) continue;
        x = symmetry.reflected(x, k);
        y[k] = -y[k];
      }
      extent.add(box_.to_unit(x));
      if (reflected != 0 && (reflected & symmetry.on(centres_.ids[j])) == 0) all.push_back(y);
    }
  }
  const double size = extent.diagonal() > 0 ? extent.diagonal() : 1.0;
  InterpolationOptions interpolation;
  interpolation.kernel = {*options_.kernel, options_.shape * size};
  if (options_.shape == 0) {
    interpolation.kernel.shape = automatic_shape(*options_.kernel, spacing(all, places.size(), options_.shape_rule), size);
  }
  interpolation.polynomial_degree = degree(options_);
  relative_shape_ = interpolation.kernel.shape / size;
  const bool iterative = solver_for(options_, symmetry, places.size()) == Solver::iterative;
  interpolation.solver = iterative ? Solver::iterative : options_.solver;
  return interpolation;
}

void RbfSystem::prepare_parts(const RunContext& context, std::size_t memory_budget) {
  const std::vector<Vec3> places = coordinates(centres_.ids);
  InterpolationOptions interpolation = interpolation_options(places);
  std::size_t& used = factor_bytes_;
  for (PartPlan& plan : plan_parts(regions_.symmetry, centres_, interpolation.solver)) {
    RbfPart part{std::move(plan), nullptr, nullptr};
    if (!parts_.empty() && part.plan.shares(parts_.back().plan, interpolation.solver)) {
      part.system = parts_.back().system;
      part.check = parts_.back().check;
    } else {
      interpolation.kernel.parity = part.plan.parity;
      if (interpolation.solver == Solver::incremental_qr) set_samples(interpolation, part.plan);
      interpolation.memory_limit =
          memory_budget == 0 ? 0 : std::max<std::size_t>(1, memory_budget - std::min(memory_budget, used + check_bytes_));
      std::vector<Vec3> rows = part.plan.places(places, regions_.symmetry);
      if (part.plan.cyclic) {
        part.system = std::make_unique<CyclicInterpolator>(std::move(rows), *part.plan.cyclic, interpolation, context);
      } else {
        part.system = make_interpolator(std::move(rows), interpolation, context);
      }
      used += part.system->bytes();
      if (to_tolerance(part.system->solver())) {
        part.check = std::make_shared<const PointErrors>(*part.system, degree(options_), checked_places_, context);
        check_bytes_ += part.check->bytes();
      }
    }
    parts_.push_back(std::move(part));
  }
}

System::SpaceBytes RbfSystem::space_bytes(std::size_t points) const {
  constexpr int last_order = 16;  // of fast sums
  SpaceBytes bytes = HandleSystem::space_bytes(points);
  bytes.call += 3 * points * sizeof(Vec3);  // places, in tiles and not, and values
  if (!to_tolerance(info_.solver)) return bytes;
  const std::size_t rows = parts_.front().system->size();
  bytes.map += 12 * (rows + 10) * sizeof(double) + 2 * following().size() * sizeof(Vec3);
  if (info_.solver == Solver::iterative) bytes.call += FastSums::bytes_for(points, rows, last_order);
  return bytes;
}

Eigen::MatrixXd RbfSystem::fields_at_centres() const {
  Eigen::MatrixXd result =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(centres_.ids.size()), static_cast<Eigen::Index>(fields()));
  for (std::size_t j = 0; j < centres_.ids.size(); ++j) {
    const RegionIndex region = points_.region_of[centres_.ids[j]];
    if (region == fixed_region) continue;
    const std::array<double, 4> values = handle_fields(region, centres_.ids[j]);
    for (std::size_t f = 0; f < 4; ++f) {
      result(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(4 * region + f)) = values[f];
    }
  }
  return result;
}

Eigen::MatrixXd RbfSystem::sample_fields() const {
  const auto& samples = options_.samples;
  Eigen::MatrixXd fields =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(centres_.ids.size()), static_cast<Eigen::Index>(3 * samples.size()));
  for (std::size_t s = 0; s < samples.size(); ++s) {
    const std::vector<Affine> motions = handle_motions(setup_, samples[s]);
    for (std::size_t j = 0; j < centres_.ids.size(); ++j) {
      const PointId id = centres_.ids[j];
      const RegionIndex region = points_.region_of[id];
      if (region == fixed_region) continue;
      const Vec3& x = mesh_->points[id];
      Vec3 u = transformed(motions[region], x) - x;
      if (!regions_.symmetry.empty()) u = components(regions_.symmetry.to_frame(u), id);
      for (std::size_t k = 0; k < 3; ++k) {
        fields(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(3 * s + k)) = u[k] / info_.diagonal;
      }
    }
  }
  return fields;
}

/// Sets the samples for which the centres of incremental QR are chosen: those of the options, or by default the fields of
/// affine motions.
void RbfSystem::set_samples(InterpolationOptions& interpolation, const PartPlan& plan) const {
  interpolation.sample_tolerance = options_.tolerance;
  interpolation.order = options_.centre_order;
  if (options_.samples.empty()) {
    interpolation.samples = plan.data(fields_at_centres());
    interpolation.columns_per_field = 4;
    return;
  }
  const Eigen::MatrixXd all = sample_fields();
  const auto width = static_cast<Eigen::Index>(plan.components.size());
  Eigen::MatrixXd chosen(all.rows(), all.cols() / 3 * width);
  for (Eigen::Index s = 0; s < all.cols() / 3; ++s) {
    for (Eigen::Index c = 0; c < width; ++c) {
      chosen.col(s * width + c) = all.col(3 * s + static_cast<Eigen::Index>(plan.components[static_cast<std::size_t>(c)]));
    }
  }
  interpolation.samples = plan.data(chosen);
  interpolation.columns_per_field = plan.components.size();
}

void RbfSystem::prepare_basis(const RunContext& context) {
  std::size_t factor_bytes = 0;
  const Interpolator* last = nullptr;
  for (const RbfPart& part : parts_) {
    if (part.system.get() != last) factor_bytes += part.plan.system_bytes(part.system->solver());
    last = part.system.get();
  }
  const std::size_t bytes = HandleBasis::bytes_for(deformable_.count(), fields(), options_.basis_tolerance);
  if (!wants_basis(options_.basis, parts_.size() * bytes, factor_bytes)) return;
  std::vector<HandleBasis> bases;
  for (const RbfPart& part : parts_) {
    HandleBasis basis =
        interpolated_basis(part, part.plan.data(fields_at_centres()), deformable_, checked_, options_.tolerance, context);
    basis.turned = part.plan.turned;
    if (regions_.symmetry.is_sector()) {
      bases.push_back(std::move(basis));
    } else {
      add_basis(std::move(basis), options_.basis_tolerance, context);
    }
  }
  turn_partners(bases);
  for (HandleBasis& basis : bases) add_basis(std::move(basis), options_.basis_tolerance, context);
}

/// The bases have the values of the first of two partners for both: turned by one sector they are those of the second. On the
/// axis nothing moves across it.
void RbfSystem::turn_partners(std::vector<HandleBasis>& bases) const {
  const Sector& sector = regions_.symmetry.sector();
  HandleBasis* along = nullptr;
  HandleBasis* turned = nullptr;
  for (HandleBasis& basis : bases) {
    if (basis.components.size() == 2) (basis.turned ? turned : along) = &basis;
  }
  if (along == nullptr) return;
  for (std::size_t s = 0; s < following().size(); ++s) {
    const PointId id = following()[s];
    const bool on_axis = sector.on_axis(id);
    if (!on_axis && !sector.is_second(id)) continue;
    const double c = on_axis ? 0 : sector.cosine(1), sine = on_axis ? 0 : sector.sine(1);
    for (std::size_t f = 0; f < fields(); ++f) {
      double none = 0;
      double &a = along->tiles.at(s, f), &b = turned == nullptr ? none : turned->tiles.at(s, f);
      const double before = a;
      a = c * before - sine * b;
      b = sine * before + c * b;
    }
  }
}

void RbfSystem::fill_info() {
  info_.centres = centres_.ids.size();
  info_.merged_duplicates = centres_.merged;
  info_.affine_hull_dimension = 0;
  std::size_t weighted = 0;  // of incremental QR, the most of any part
  for (const RbfPart& part : parts_) {
    const bool shared = &part != &parts_.front() && part.system == (&part - 1)->system;
    if (!shared) info_.polynomial_terms += part.system->polynomials().terms();
    info_.affine_hull_dimension = std::max(info_.affine_hull_dimension, part.system->polynomials().hull_dimension());
    info_.condition = std::max(info_.condition, part.system->condition());
    if (part.system->solver() == Solver::incremental_qr) weighted = std::max(weighted, part.system->weighted());
  }
  if (weighted > 0) info_.centres = weighted;
  // If any part fell back to another solver, that is the solver shown.
  if (!parts_.empty()) info_.solver = parts_.front().system->solver();
  for (const RbfPart& part : parts_) {
    if (part.system->solver() == Solver::ldlt) info_.solver = Solver::ldlt;
  }
  info_.tolerance = to_tolerance(info_.solver) ? options_.tolerance : 0;
  info_.reduced = centres_.reduced;
  if (centres_.reduced) {
    if (options_.reduction == CentreReduction::tolerance) info_.reduction_tolerance = reduction_tolerance(options_);
    info_.reduction_misfit = misfit_;
    info_.reduction_error = reduction_error(options_, misfit_);
  }
  for (const HandleBasis& basis : basis_) check_bytes_ += (basis.errors.size() + basis.more.size()) * sizeof(double);
  set_bytes(factor_bytes_, check_bytes_);
}

void RbfSystem::add_notes() {
  info_.notes = centres_.notes;
  if (centres_.reduced) {
    const bool met = info_.reduction_tolerance == 0 || info_.reduction_misfit <= info_.reduction_tolerance;
    info_.notes.push_back(
        std::to_string(centres_.ids.size()) + " of " + std::to_string(points_.count) +
        " constraint points are centres: motions of the handles are missed at the others by at most " + scientific(misfit_) +
        " of their largest displacement, and points may be " + scientific(info_.reduction_error) +
        " of it from where they would be if all were centres" +
        (met ? "."
             : "; that is above the reduction tolerance of " + scientific(reduction_tolerance(options_)) +
                   ", which takes more centres (regions that touch each other and move apart need all of them)."));
  }
  const auto symmetry_notes = deform::symmetry_notes(regions_.symmetry, centres_);
  info_.notes.insert(info_.notes.end(), symmetry_notes.begin(), symmetry_notes.end());
  std::size_t dropped = 0;
  bool converged = true;
  double residual = 0;
  const Interpolator* last = nullptr;
  for (const HandleBasis& basis : basis_) {
    converged = converged && basis.converged;
    residual = std::max(residual, *std::max_element(basis.residuals.begin(), basis.residuals.end()));
  }
  for (const RbfPart& part : parts_) {
    if (part.system.get() == last) continue;
    last = part.system.get();
    dropped += last->polynomials().dropped();
    const auto& solver_notes = last->notes();
    info_.notes.insert(info_.notes.end(), solver_notes.begin(), solver_notes.end());
  }
  static const char* const hulls[] = {"in one point", "on a line", "in a plane"};
  if (degree(options_) > 0 && info_.affine_hull_dimension < 3) {
    info_.notes.push_back(std::string("The centres lie ") + hulls[info_.affine_hull_dimension] +
                          ": the polynomial part is constant across it.");
  }
  if (dropped > 0) {
    info_.notes.push_back(std::to_string(dropped) + " monomials depend on the others at the centres and were left out.");
  }
  if (info_.solver == Solver::iterative) {
    info_.notes.push_back("The systems are solved iteratively, to " + scientific(info_.tolerance) + " of the diagonal.");
  }
  if (info_.solver == Solver::incremental_qr) {
    info_.notes.push_back("Least squares: " + std::to_string(info_.centres) + " of the " + std::to_string(centres_.ids.size()) +
                          " constraint points are centres, for an RMS error of " + scientific(info_.tolerance) +
                          " of the diagonal.");
  }
  if (to_tolerance(info_.solver) && has_basis() && !converged) {
    info_.notes.push_back("The solver did not reach its tolerance for the handle basis: the largest residual is " +
                          scientific(residual) + ".");
  }
  if (info_.condition > 1e13) {
    info_.notes.push_back(
        "The system is ill-conditioned (handle and fixed points nearly coincide): the estimated error of every "
        "design says how many digits that costs; derivatives lose about as many.");
  }
  if (!has_basis()) info_.notes.push_back("No handle basis is stored: every design is solved for and summed directly.");
  if (properties(*options_.kernel).has_shape && options_.shape == 0) {
    info_.notes.push_back("The shape is " + number_digits(relative_shape_) + " of the diagonal of the centres (automatic).");
  }
}

std::unique_ptr<const Evaluation> RbfSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                  const RunContext& context) const {
  return std::make_unique<RbfEvaluation>(std::static_pointer_cast<const RbfSystem>(shared_from_this()), designs, path, context);
}

std::unique_ptr<const Evaluation> RbfSystem::derivative(std::span<const double>, const std::vector<Affine>& maps,
                                                        const RunContext& context) const {
  return std::make_unique<RbfEvaluation>(std::static_pointer_cast<const RbfSystem>(shared_from_this()), maps, context);
}

/// The same as part_adjoint() from the values of the fields, as a basis would have it: a system with few centres can be so badly
/// conditioned that its transpose, which starts from sums of all points, loses all digits.
Eigen::MatrixXd RbfSystem::adjoint_by_fields(const RbfPart& part, Cotangents at_deformable, const RunContext& context) const {
  const std::vector<Vec3> points = coordinates(following());
  const Eigen::MatrixXd F = part.plan.data(fields_at_centres());
  const std::size_t columns = 3 * at_deformable.size();
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(F.cols(), static_cast<Eigen::Index>(columns));
  for (Eigen::Index first = 0; first < F.cols(); first += 4) {
    const Eigen::MatrixXd data = F.middleCols(first, 4);
    const double tolerance = derivative_tolerance * data.cwiseAbs().maxCoeff();
    const std::vector<double> values =
        values_to_tolerance(*part.system, *part.check, checked_, data, tolerance, points, context).values;
    for (std::size_t i = 0; i < points.size(); ++i) {
      for (Eigen::Index f = 0; f < 4; ++f) {
        for (std::size_t k = 0; k < columns; ++k) {
          G(first + f, static_cast<Eigen::Index>(k)) +=
              values[4 * i + static_cast<std::size_t>(f)] * at_deformable[k / 3][i][k % 3];
        }
      }
    }
  }
  return G;
}

/// Transpose of "fields of the handles to deformable points" for one part: 4H x 3 for each cotangent, side by side, of which the
/// columns of its components count.
Eigen::MatrixXd RbfSystem::part_adjoint(const RbfPart& part, Cotangents at_deformable, const RunContext& context) const {
  // u = [Phi P] S [fields; 0] with the symmetric S, so the adjoint is fields^T times the first rows of S [Phi^T; P^T].
  const std::vector<Vec3> unit = coordinates(following());
  const std::size_t m = part.system->size(), columns = 3 * at_deformable.size();
  const auto q = static_cast<Eigen::Index>(part.system->polynomials().terms());
  std::vector<double> weights(columns * unit.size());
  for (std::size_t i = 0; i < unit.size(); ++i) {
    for (std::size_t k = 0; k < columns; ++k) weights[columns * i + k] = at_deformable[k / 3][i][k % 3];
  }
  const std::vector<double> sums = part.system->sums_at_centres(unit, weights, columns, context);
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(m) + q, static_cast<Eigen::Index>(columns));
  for (std::size_t j = 0; j < m; ++j) {
    for (std::size_t k = 0; k < columns; ++k) {
      B(static_cast<Eigen::Index>(j), static_cast<Eigen::Index>(k)) = sums[columns * j + k];
    }
  }
  std::vector<double> terms(static_cast<std::size_t>(q));
  for (std::size_t i = 0; i < unit.size(); ++i) {
    part.system->polynomials().values(unit[i], terms.data());
    for (Eigen::Index t = 0; t < q; ++t) {
      for (std::size_t k = 0; k < columns; ++k) {
        B(static_cast<Eigen::Index>(m) + t, static_cast<Eigen::Index>(k)) +=
            terms[static_cast<std::size_t>(t)] * weights[columns * i + k];
      }
    }
  }
  return part.plan.data(fields_at_centres()).transpose() * part.system->adjoint(std::move(B), context);
}

HandleSystem::Fields RbfSystem::adjoint(std::span<const double>, Cotangents given, const RunContext& context) const {
  Fields result(given.size(), std::vector<double>(3 * fields(), 0.0));
  std::vector<std::vector<Vec3>> turned_back;
  for (std::size_t j = 0; j < given.size() && regions_.symmetry.is_sector(); ++j) {
    turned_back.push_back(given[j]);
    for (std::size_t s = 0; s < following().size(); ++s) {
      Vec3& vector = turned_back[j][s];
      const Sector& sector = regions_.symmetry.sector();
      if (sector.is_second(following()[s])) vector = sector.turned(vector, sector.count() - 1);
      if (sector.on_axis(following()[s])) vector = {vector[0], 0, 0};
    }
  }
  const Cotangents at_following = turned_back.empty() ? given : Cotangents(turned_back);
  for (const RbfPart& part : parts_) {
    const bool by_fields = info_.solver == Solver::iterative && part.check->complete();
    const Eigen::MatrixXd G =
        by_fields ? adjoint_by_fields(part, at_following, context) : part_adjoint(part, at_following, context);
    for (std::size_t j = 0; j < result.size(); ++j) {
      for (std::size_t f = 0; f < fields(); ++f) {
        Vec3 sum{};
        for (const std::size_t k : part.plan.components) {
          sum[k] = G(static_cast<Eigen::Index>(f), static_cast<Eigen::Index>(3 * j + k));
        }
        sum = part.plan.given_back(sum);
        for (const std::size_t k : part.plan.components) result[j][3 * f + k] += sum[k];
      }
    }
  }
  return result;
}

}  // namespace deform
