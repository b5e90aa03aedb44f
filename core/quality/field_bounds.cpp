// SPDX-License-Identifier: Apache-2.0
#include "core/quality/field_bounds.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/quality/infinity.h"
#include "core/quality/linear_fit.h"

namespace deform::quality {

namespace {

constexpr std::size_t batch_size = 8;  // fields whose values at a node are in one line of the cache
constexpr std::size_t clusters_grain = 128;
constexpr double node_rounding = 16 * 0x1p-53;  // of differences from the first node, and of their products
constexpr double most_share = 255;
constexpr double summed = 1 + 1e-12;  // for the rounding of short sums
// Single precision: what is compared with 1 or with a determinant is a dozen operations on numbers of at most about 1.
constexpr float nearly_one = 1 - 1e-5f;
constexpr float determinant_rounding = 1e-5f;
constexpr float largest_gradient = 0.7f;  // of the motion: the least singular value stays above 0.3, as in the certificate

constexpr float nothing = -std::numeric_limits<float>::infinity();  // is left of a determinant where nothing is proven

/// A float that is not below x.
float above(double x) { return std::nextafter(static_cast<float>(x), std::numeric_limits<float>::infinity()); }

/// What is not a number proves nothing.
double or_infinity(double x) { return std::isnan(x) ? infinity : x; }

/// The affine fit of a field in one cell.
struct CellFit {
  Vec3 gradient{};
  double residual = 0;
};

/// Values are relative to that of the first node, and so are the places. Any gradient is valid; that of least squares leaves
/// little.
CellFit fit_of(std::span<const double> values, std::span<const Vec3> x, std::span<const Vec3> weights, double reach) {
  CellFit fit;
  double size = 0, low = 0, high = 0;
  for (std::size_t n = 1; n < x.size(); ++n) {
    fit.gradient = fit.gradient + values[n] * weights[n];
    size = std::max(size, std::abs(values[n]));
  }
  for (std::size_t n = 1; n < x.size(); ++n) {
    const double left = values[n] - dot(fit.gradient, x[n]);
    low = std::min(low, left);
    high = std::max(high, left);
  }
  fit.residual = or_infinity(0.5 * (high - low) + node_rounding * (size + length(fit.gradient) * reach));
  if (!(size < infinity)) fit.residual = infinity;
  return fit;
}

}  // namespace

/// The values of some fields at all points.
struct FieldBounds::Batch {
  std::size_t first = 0, count = 0;
  std::vector<double> values;
};

FieldBounds::FieldBounds(std::span<const Vec3> rest, const MotionCertificate& certificate, const DisplacementFields& fields,
                         const RunContext& context)
    : certificate_(certificate), largest_(fields.count()) {
  set_tolerances();
  steepest_.resize(fields.count() * cluster_count());
  residuals_.resize(steepest_.size());
  in_clusters_.resize(steepest_.size());
  shares_.resize(steepest_.size() * cluster_size);
  Batch batch;
  for (; batch.first < fields.count(); batch.first += batch_size) {
    batch.count = std::min(batch_size, fields.count() - batch.first);
    batch.values.resize(rest.size() * batch.count);
    fields.values(batch.first, batch.count, batch.values, context);
    for (std::size_t i = 0; i < batch.values.size(); ++i) {
      double& largest = largest_[batch.first + i % batch.count];
      largest = std::max(largest, or_infinity(std::abs(batch.values[i])));
    }
    parallel_for(context, cluster_count(), clusters_grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) take(rest, batch, k);
    });
  }
  for (std::size_t f = 0; f < fields.count(); ++f) errors_.push_back(fields.error(f));
}

void FieldBounds::set_tolerances() {
  constexpr float none = std::numeric_limits<float>::infinity();
  const std::size_t cells = certificate_.order().size(), clusters = (cells + cluster_size - 1) / cluster_size;
  for (auto* values : {&tightest_.inverse_radius, &tightest_.inverse_condition, &tightest_.loss, &tightest_.warp_loss}) {
    values->assign(clusters, 0.0f);
  }
  tightest_.determinant.assign(clusters, none);
  tolerances_.resize(clusters);
  for (Tolerances& of_cluster : tolerances_) {
    for (auto* values : {&of_cluster.inverse_radius, &of_cluster.inverse_condition, &of_cluster.loss, &of_cluster.warp_loss}) {
      values->fill(none);
    }
    of_cluster.determinant.fill(0.0f);
  }
  for (std::size_t i = 0; i < cells; ++i) {
    const MotionCertificate::Tolerance& cell = certificate_.tolerance(i);
    const std::size_t k = i / cluster_size;
    const auto set = [i, k](std::vector<float>& most, std::array<float, cluster_size>& each, float x) {
      most[k] = std::max(most[k], x);
      each[i % cluster_size] = x;
    };
    set(tightest_.inverse_radius, tolerances_[k].inverse_radius, cell.inverse_radius);
    set(tightest_.inverse_condition, tolerances_[k].inverse_condition, cell.inverse_condition);
    set(tightest_.loss, tolerances_[k].loss, cell.loss);
    set(tightest_.warp_loss, tolerances_[k].warp_loss, cell.warp_loss);
    tightest_.determinant[k] = std::min(tightest_.determinant[k], cell.determinant);
    tolerances_[k].determinant[i % cluster_size] = cell.determinant;
  }
}

void FieldBounds::take(std::span<const Vec3> rest, const Batch& batch, std::size_t cluster) {
  const std::size_t begin = cluster * cluster_size, cells = std::min(certificate_.order().size(), begin + cluster_size) - begin;
  std::vector<Vec3> x, weights;
  std::vector<double> values;
  std::vector<CellFit> fits(cells * batch.count);
  for (std::size_t i = 0; i < cells; ++i) {
    const auto nodes = certificate_.nodes(certificate_.order()[begin + i]);
    x.clear();
    double reach = 0;
    for (const PointId p : nodes) {
      x.push_back(rest[p] - rest[nodes[0]]);
      reach = std::max(reach, length(x.back()));
    }
    fit_weights(x, weights);
    for (std::size_t k = 0; k < batch.count; ++k) {
      values.clear();
      for (const PointId p : nodes) {
        values.push_back(batch.values[p * batch.count + k] - batch.values[nodes[0] * batch.count + k]);
      }
      fits[k * cells + i] = fit_of(values, x, weights, reach);
    }
  }
  for (std::size_t k = 0; k < batch.count; ++k) {
    const std::span<const CellFit> of_field = std::span(fits).subspan(k * cells, cells);
    Box box;
    double steepest = 0, relative = 0, residual = 0, deviation = 0;
    for (std::size_t i = 0; i < cells; ++i) {
      box.add(of_field[i].gradient);
      steepest = std::max(steepest, or_infinity(length(of_field[i].gradient)));
      residual = std::max(residual, of_field[i].residual);
      const auto inverse_radius = static_cast<double>(certificate_.tolerance(begin + i).inverse_radius);
      relative = std::max(relative, or_infinity(of_field[i].residual * inverse_radius));
    }
    Field& field = in_clusters_[cluster * fields() + batch.first + k];
    Vec3 middle{};
    for (std::size_t a = 0; a < 3; ++a) middle[a] = field.middle[a] = static_cast<float>(0.5 * (box.min[a] + box.max[a]));
    for (std::size_t i = 0; i < cells; ++i) {
      deviation = std::max(deviation, or_infinity(length(of_field[i].gradient - middle)));
      const double share = residual > 0 ? of_field[i].residual / residual : 0;
      std::uint8_t& code = shares_[(cluster * fields() + batch.first + k) * cluster_size + i];
      code = static_cast<std::uint8_t>(share < 1 ? std::min(std::ceil(share * most_share * summed), most_share) : most_share);
    }
    field.deviation = rounded_up(deviation);
    field.residual = rounded_up(residual);
    const std::size_t at = (batch.first + k) * cluster_count() + cluster;
    steepest_[at] = rounded_up(steepest);
    residuals_[at] = rounded_up(relative);
  }
}

void FieldBounds::check(const FieldMotion& motion) const {
  if (motion.coefficients.size() == fields() && motion.uncertainties.size() == fields()) return;
  throw Error(ErrorCode::invalid_argument, "motion: has " + std::to_string(motion.coefficients.size()) +
                                               " coefficients, the check was made for " + std::to_string(fields()) + " fields");
}

double FieldBounds::reach(const FieldMotion& motion) const {
  check(motion);
  double sum = motion.rounding;
  for (std::size_t f = 0; f < fields(); ++f) {
    sum += (length(motion.coefficients[f]) + motion.uncertainties[f]) * (largest_[f] + errors_[f]);
  }
  return sum;
}

FieldBounds::Common FieldBounds::common(const FieldMotion& motion) const {
  Common result{motion.rounding, {}, {}};
  for (std::size_t f = 0; f < fields(); ++f) {
    const double size = length(motion.coefficients[f]), uncertain = motion.uncertainties[f];
    if (size == 0 && uncertain == 0) continue;
    result.moving.push_back(static_cast<std::uint32_t>(f));
    result.sizes.push_back(size);
    result.residual += uncertain * largest_[f] + (size + uncertain) * errors_[f];
  }
  result.residual *= summed;
  return result;
}

void FieldBounds::doubtful(const FieldMotion& motion, double floor, std::size_t begin_cluster, std::size_t end_cluster,
                           Doubtful& cells) const {
  check(motion);
  const std::size_t clusters = end_cluster - begin_cluster;
  std::vector<float> steepness(clusters), residuals(clusters);
  const Common shared = common(motion);
  const double sums = 1 + 0x1p-22 * static_cast<double>(fields() + 8);  // rounding of single precision
  for (std::size_t m = 0; m < shared.moving.size(); ++m) {
    const std::size_t f = shared.moving[m];
    const float c = rounded_up((shared.sizes[m] + motion.uncertainties[f]) * sums);
    const float* of_steepness = steepest_.data() + f * cluster_count() + begin_cluster;
    const float* of_residuals = residuals_.data() + f * cluster_count() + begin_cluster;
    for (std::size_t k = 0; k < clusters; ++k) {
      steepness[k] += c * of_steepness[k];
      residuals[k] += c * of_residuals[k];
    }
  }
  // What is left of the determinants, into `residuals`; below 0 where nothing is proven.
  const float everywhere = rounded_up(shared.residual * sums);
  const bool squared = certificate_.distortion() == 2;
  for (std::size_t k = 0; k < clusters; ++k) {
    const std::size_t at = begin_cluster + k;
    // As MotionCertificate::bound() with singular values from 1 - g to 1 + g.
    const float g = steepness[k], shorter = 1 - g, inverse = 1 / shorter, ratio = shorter / (1 + g);
    const float r = (residuals[k] + everywhere * tightest_.inverse_radius[at]) * inverse;
    const float x = 2 * g * inverse * tightest_.inverse_condition[at];
    const float loss = tightest_.loss[at], warp = tightest_.warp_loss[at], worse = x > r ? x : r;
    const float by_both = loss * worse, by_warp = warp + (loss - warp) * r, lost = by_both < by_warp ? by_both : by_warp;
    const float left = (tightest_.determinant[at] - lost) * (squared ? ratio * ratio : ratio);
    residuals[k] = (g <= largest_gradient) & (r <= nearly_one) & (x <= nearly_one) ? left : -1.0f;
  }
  const float least = above(floor) + determinant_rounding, positive = std::max(least, determinant_rounding);
  for (std::size_t k = 0; k < clusters; ++k) {
    if (!(residuals[k] > positive)) open_cells(motion, shared, least, begin_cluster + k, cells);  // not a number proves nothing
  }
}

/// Cell by cell, with the gradient of the motion at the middle of the cluster. `least` is what a determinant must exceed.
void FieldBounds::open_cells(const FieldMotion& motion, const Common& common, float least, std::size_t cluster,
                             Doubtful& cells) const {
  const double sums = 1 + 0x1p-22 * static_cast<double>(fields() + 8);  // rounding of single precision
  Matrix gradient{};
  double deviation = 0;
  std::array<float, cluster_size> left;
  left.fill(rounded_up(common.residual * sums));
  for (std::size_t m = 0; m < common.moving.size(); ++m) {
    const std::size_t f = common.moving[m];
    const Field& field = in_clusters_[cluster * fields() + f];
    const Vec3 middle{field.middle[0], field.middle[1], field.middle[2]};
    add_product(gradient, motion.coefficients[f], middle);
    const double c = common.sizes[m], uncertain = motion.uncertainties[f];
    const double steep = std::abs(middle[0]) + std::abs(middle[1]) + std::abs(middle[2]);
    const auto from_middle = static_cast<double>(field.deviation);
    deviation += c * from_middle + uncertain * (steep + from_middle) + 1e-14 * c * steep;
    const float unit = rounded_up((c + uncertain) * static_cast<double>(field.residual) * (sums / most_share));
    const std::uint8_t* shares = shares_.data() + (cluster * fields() + f) * cluster_size;
    for (std::size_t i = 0; i < cluster_size; ++i) left[i] += unit * static_cast<float>(shares[i]);
  }
  const MotionCertificate::Affinity affinity =
      certificate_.affinity(MotionCertificate::Stretch::about(gradient, deviation * summed));
  // As MotionCertificate::bound(), for all cells at once: from residuals to what is left of the determinants.
  const float inverse = rounded_up(affinity.inverse_least), excess = rounded_up(affinity.excess);
  const float falling = rounded_down(affinity.inverse_falling);
  const Tolerances& cell = tolerances_[cluster];
  for (std::size_t i = 0; i < cluster_size; ++i) {
    const float r = left[i] * inverse * cell.inverse_radius[i], x = excess * cell.inverse_condition[i];
    const float loss = cell.loss[i], warp = cell.warp_loss[i], worse = x > r ? x : r;
    const float by_both = loss * worse, by_warp = warp + (loss - warp) * r, lost = by_both < by_warp ? by_both : by_warp;
    const float rest = cell.determinant[i] - lost, fallen = rest * falling, lower = rest < fallen ? rest : fallen;
    left[i] = (r <= nearly_one) & (x <= nearly_one) ? lower : nothing;
  }
  const std::size_t begin = cluster * cluster_size, count = std::min(certificate_.order().size() - begin, cluster_size);
  for (std::size_t i = 0; i < count; ++i) {
    if (left[i] > least) continue;
    (left[i] > nothing ? cells.low : cells.unproven).push_back(certificate_.order()[begin + i]);
  }
}

std::size_t FieldBounds::bytes_for(std::size_t cells, std::size_t fields) {
  const std::size_t clusters = cells / cluster_size + 1;
  const std::size_t each =
      7 * sizeof(float) + sizeof(Tolerances) + fields * (2 * sizeof(float) + sizeof(Field) + cluster_size);  // two in a call
  return clusters * each + fields * 4 * sizeof(double);
}

std::size_t FieldBounds::bytes_to_make(std::size_t cells, std::size_t points, std::size_t fields) {
  return bytes_for(cells, fields) + points * std::min(batch_size, fields) * sizeof(double);
}

}  // namespace deform::quality
