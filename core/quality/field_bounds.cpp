// SPDX-License-Identifier: Apache-2.0
#include "core/quality/field_bounds.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/quality/linear_fit.h"

namespace deform::quality {

namespace {

constexpr std::size_t batch_size = 8;  // fields whose values at a node are in one line of the cache
constexpr std::size_t clusters_grain = 128;
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double node_rounding = 16 * 0x1p-53;  // of differences from the first node, and of their products
constexpr double summed = 1 + 1e-12;            // for the rounding of short sums
// Single precision: what is compared with 1 or with a determinant is a dozen operations on numbers of at most about 1.
constexpr float nearly_one = 1 - 1e-5f;
constexpr float determinant_rounding = 1e-5f;
constexpr float largest_gradient = 0.7f;  // of the motion: the least singular value stays above 0.3, as in the certificate

/// What is not a number proves nothing.
double or_infinity(double x) { return std::isnan(x) ? infinity : x; }

/// Of a field in one cell.
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
    : certificate_(certificate),
      tightest_((certificate.order().size() + cluster_size - 1) / cluster_size),
      steepest_(fields.count() * tightest_.size()),
      residuals_(steepest_.size()),
      in_clusters_(steepest_.size()),
      shares_(certificate.order().size()),
      largest_(fields.count()) {
  for (std::size_t k = 0; k < tightest_.size(); ++k) set_tightest(k);
  Batch batch;
  for (; batch.first < fields.count(); batch.first += batch_size) {
    batch.count = std::min(batch_size, fields.count() - batch.first);
    batch.values.resize(rest.size() * batch.count);
    fields.values(batch.first, batch.count, batch.values, context);
    for (std::size_t i = 0; i < batch.values.size(); ++i) {
      double& largest = largest_[batch.first + i % batch.count];
      largest = std::max(largest, or_infinity(std::abs(batch.values[i])));
    }
    parallel_for(context, tightest_.size(), clusters_grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) take(rest, batch, k);
    });
  }
  for (std::size_t f = 0; f < fields.count(); ++f) errors_.push_back(fields.error(f));
}

void FieldBounds::set_tightest(std::size_t cluster) {
  Tightest& tightest = tightest_[cluster];
  tightest.determinant = std::numeric_limits<float>::infinity();
  const std::size_t end = std::min(shares_.size(), (cluster + 1) * cluster_size);
  for (std::size_t i = cluster * cluster_size; i < end; ++i) {
    const MotionCertificate::Tolerance& cell = certificate_.tolerance(i);
    tightest.inverse_radius = std::max(tightest.inverse_radius, cell.inverse_radius);
    tightest.inverse_condition = std::max(tightest.inverse_condition, cell.inverse_condition);
    tightest.determinant = std::min(tightest.determinant, cell.determinant);
    tightest.loss = std::max(tightest.loss, cell.loss);
    tightest.warp_loss = std::max(tightest.warp_loss, cell.warp_loss);
  }
}

void FieldBounds::take(std::span<const Vec3> rest, const Batch& batch, std::size_t cluster) {
  const std::size_t begin = cluster * cluster_size, cells = std::min(shares_.size(), begin + cluster_size) - begin;
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
      shares_[begin + i] = std::max(shares_[begin + i], rounded_up(std::isnan(share) ? 1 : share));
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
  Common result{motion.rounding, std::vector<char>(fields())};
  for (std::size_t f = 0; f < fields(); ++f) {
    const double size = length(motion.coefficients[f]), uncertain = motion.uncertainties[f];
    result.moving[f] = !(size == 0 && uncertain == 0);
    if (result.moving[f]) result.residual += uncertain * largest_[f] + (size + uncertain) * errors_[f];
  }
  result.residual *= summed;
  return result;
}

void FieldBounds::doubtful(const FieldMotion& motion, double floor, std::size_t begin_cluster, std::size_t end_cluster,
                           std::vector<std::uint32_t>& cells) const {
  check(motion);
  const std::size_t clusters = end_cluster - begin_cluster;
  std::vector<float> steepness(clusters), residuals(clusters);
  const Common shared = common(motion);
  const double sums = 1 + 0x1p-22 * static_cast<double>(fields() + 8);  // rounding of single precision
  for (std::size_t f = 0; f < fields(); ++f) {
    if (!shared.moving[f]) continue;
    const float c = rounded_up((length(motion.coefficients[f]) + motion.uncertainties[f]) * sums);
    const float* of_steepness = steepest_.data() + f * cluster_count() + begin_cluster;
    const float* of_residuals = residuals_.data() + f * cluster_count() + begin_cluster;
    for (std::size_t k = 0; k < clusters; ++k) {
      steepness[k] += c * of_steepness[k];
      residuals[k] += c * of_residuals[k];
    }
  }
  const float everywhere = rounded_up(shared.residual * sums);
  const float least = rounded_up(std::max(0.0, floor)) + determinant_rounding;
  for (std::size_t k = 0; k < clusters; ++k) {
    const Tightest& cell = tightest_[begin_cluster + k];
    // As MotionCertificate::bound() with singular values from 1 - g to 1 + g; not a number proves nothing.
    const float g = steepness[k], shorter = 1 - g, falling = shorter / (1 + g);
    const float r = (residuals[k] + everywhere * cell.inverse_radius) / shorter, x = 2 * g / shorter * cell.inverse_condition;
    const float lost = std::min(cell.loss * std::max(x, r), cell.warp_loss + (cell.loss - cell.warp_loss) * r);
    const float left = (cell.determinant - lost) * (certificate_.distortion() == 2 ? falling * falling : falling);
    if (g <= largest_gradient && r <= nearly_one && x <= nearly_one && left > least) continue;
    open_cells(motion, shared, floor, begin_cluster + k, cells);
  }
}

/// Cell by cell, with the gradient of the motion at the middle of the cluster.
void FieldBounds::open_cells(const FieldMotion& motion, const Common& common, double floor, std::size_t cluster,
                             std::vector<std::uint32_t>& cells) const {
  const Field* of_fields = in_clusters_.data() + cluster * fields();
  Matrix gradient{};
  double deviation = 0, residual = 0;
  for (std::size_t f = 0; f < fields(); ++f) {
    if (!common.moving[f]) continue;
    const Field& field = of_fields[f];
    const Vec3 middle{field.middle[0], field.middle[1], field.middle[2]};
    add_product(gradient, motion.coefficients[f], middle);
    const double c = length(motion.coefficients[f]), uncertain = motion.uncertainties[f];
    const auto from_middle = static_cast<double>(field.deviation);
    deviation += c * from_middle + uncertain * (length(middle) + from_middle) + 1e-14 * c * length(middle);
    residual += (c + uncertain) * static_cast<double>(field.residual);
  }
  MotionCertificate::Stretch stretch = MotionCertificate::Stretch::of(gradient, 0);
  stretch.least -= deviation * summed;
  stretch.largest += deviation * summed;
  stretch.gradient += deviation * summed;
  const MotionCertificate::Affinity affinity = certificate_.affinity(stretch);
  const std::size_t begin = cluster * cluster_size, end = std::min(shares_.size(), begin + cluster_size);
  for (std::size_t i = begin; i < end; ++i) {
    const double own = residual * summed * static_cast<double>(shares_[i]) + common.residual;
    const auto bound = MotionCertificate::bound(certificate_.tolerance(i), affinity, own);
    if (!(bound.sound && bound.determinant > floor)) cells.push_back(certificate_.order()[i]);
  }
}

std::size_t FieldBounds::bytes_for(std::size_t cells, std::size_t fields) {
  const std::size_t clusters = cells / cluster_size + 1;
  const std::size_t each = sizeof(Tightest) + fields * (2 * sizeof(float) + sizeof(Field)) + 2 * sizeof(float);
  return clusters * each + cells * sizeof(float) + fields * (2 * sizeof(double) + 1);
}

std::size_t FieldBounds::bytes_to_make(std::size_t cells, std::size_t points, std::size_t fields) {
  return bytes_for(cells, fields) + points * std::min(batch_size, fields) * sizeof(double);
}

}  // namespace deform::quality
