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
constexpr std::size_t clusters_grain = 256;
constexpr double node_rounding = 16 * 0x1p-53;  // of differences from the first node, and of their products
// Single precision: what is compared with 1 or with a determinant is a dozen operations of numbers of at most about 1.
constexpr float nearly_one = 1 - 1e-5f;
constexpr float determinant_rounding = 1e-5f;
constexpr float largest_gradient = 0.7f;  // of the motion: the least singular value stays above 0.3, as in the certificate

/// What is not a number proves nothing.
double or_infinity(double x) { return std::isnan(x) ? std::numeric_limits<double>::infinity() : x; }

}  // namespace

/// The values of some fields at all points.
struct FieldBounds::Batch {
  std::size_t first = 0, count = 0;
  std::vector<double> values;
};

FieldBounds::FieldBounds(std::span<const Vec3> rest, const MotionCertificate& certificate, const DisplacementFields& fields,
                         const RunContext& context)
    : distortion_(certificate.distortion()),
      tightest_((certificate.order().size() + cluster_size - 1) / cluster_size),
      gradients_(fields.count() * tightest_.size()),
      residuals_(gradients_.size()),
      largest_(fields.count()) {
  for (std::size_t k = 0; k < tightest_.size(); ++k) {
    Tightest& tightest = tightest_[k];
    tightest.determinant = std::numeric_limits<float>::infinity();
    const std::size_t end = std::min(certificate.order().size(), (k + 1) * cluster_size);
    for (std::size_t i = k * cluster_size; i < end; ++i) {
      const MotionCertificate::Tolerance& cell = certificate.tolerance(i);
      tightest.inverse_radius = std::max(tightest.inverse_radius, cell.inverse_radius);
      tightest.inverse_condition = std::max(tightest.inverse_condition, cell.inverse_condition);
      tightest.determinant = std::min(tightest.determinant, cell.determinant);
      tightest.loss = std::max(tightest.loss, cell.loss);
      tightest.warp_loss = std::max(tightest.warp_loss, cell.warp_loss);
    }
  }
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
      for (std::size_t k = begin; k < end; ++k) take(rest, certificate, batch, k);
    });
  }
  for (std::size_t f = 0; f < fields.count(); ++f) errors_.push_back(fields.error(f));
}

/// The weights of a least-squares fit are those of all fields.
void FieldBounds::take(std::span<const Vec3> rest, const MotionCertificate& certificate, const Batch& batch,
                       std::size_t cluster) {
  std::vector<Vec3> x, weights;
  const std::size_t end = std::min(certificate.order().size(), (cluster + 1) * cluster_size);
  for (std::size_t i = cluster * cluster_size; i < end; ++i) {
    const auto nodes = certificate.nodes(certificate.order()[i]);
    if (nodes.empty()) continue;
    const double inverse_radius = static_cast<double>(certificate.tolerance(i).inverse_radius);
    x.clear();
    for (const PointId p : nodes) x.push_back(rest[p] - rest[nodes[0]]);
    fit_weights(x, weights);
    double reach = 0;
    for (const Vec3& place : x) reach = std::max(reach, length(place));
    for (std::size_t k = 0; k < batch.count; ++k) {
      const auto value = [&](std::size_t n) {
        return batch.values[nodes[n] * batch.count + k] - batch.values[nodes[0] * batch.count + k];
      };
      Vec3 gradient{};
      double size = 0;
      for (std::size_t n = 1; n < nodes.size(); ++n) {
        gradient = gradient + value(n) * weights[n];
        size = std::max(size, std::abs(value(n)));
      }
      double low = 0, high = 0;
      for (std::size_t n = 1; n < nodes.size(); ++n) {
        const double left = value(n) - dot(gradient, x[n]);
        low = std::min(low, left);
        high = std::max(high, left);
      }
      const double steep = length(gradient);
      const double residual = (0.5 * (high - low) + node_rounding * (size + steep * reach)) * inverse_radius;
      const std::size_t at = (batch.first + k) * cluster_count() + cluster;
      gradients_[at] = std::max(gradients_[at], rounded_up(or_infinity(steep)));
      residuals_[at] = std::max(residuals_[at], rounded_up(or_infinity(residual)));
    }
  }
}

void FieldBounds::check(const FieldMotion& motion) const {
  if (motion.coefficients.size() != fields() || motion.uncertainties.size() != fields()) {
    throw Error(ErrorCode::invalid_argument, "motion: has " + std::to_string(motion.coefficients.size()) +
                                                 " coefficients, the check was made for " + std::to_string(fields()) + " fields");
  }
}

double FieldBounds::reach(const FieldMotion& motion) const {
  check(motion);
  double sum = motion.rounding;
  for (std::size_t f = 0; f < fields(); ++f) {
    sum += (length(motion.coefficients[f]) + motion.uncertainties[f]) * (largest_[f] + errors_[f]);
  }
  return sum;
}

std::vector<std::uint32_t> FieldBounds::open(const FieldMotion& motion, double floor) const {
  check(motion);
  const std::size_t clusters = cluster_count();
  // What is the same for all cells is a length, to be compared with their radii.
  double common = motion.rounding;
  std::vector<float> gradient(clusters), residual(clusters);
  const double sums = 1 + 1e-6 + 0x1p-23 * static_cast<double>(fields() + 8);
  for (std::size_t f = 0; f < fields(); ++f) {
    const double size = length(motion.coefficients[f]), uncertain = motion.uncertainties[f];
    if (size == 0 && uncertain == 0) continue;
    common += uncertain * largest_[f] + (size + uncertain) * errors_[f];
    const float c = rounded_up((size + uncertain) * sums);
    const float* of_gradient = gradients_.data() + f * clusters;
    const float* of_residual = residuals_.data() + f * clusters;
    for (std::size_t k = 0; k < clusters; ++k) {
      gradient[k] += c * of_gradient[k];
      residual[k] += c * of_residual[k];
    }
  }
  const float shared = rounded_up(common * sums);
  const float least = rounded_up(std::max(0.0, floor)) + determinant_rounding;
  std::vector<std::uint32_t> result;
  for (std::size_t k = 0; k < clusters; ++k) {
    const Tightest& cell = tightest_[k];
    // As MotionCertificate::bound() with singular values from 1 - gradient to 1 + gradient; not a number proves nothing.
    const float g = gradient[k], shorter = 1 - g;
    const float r = (residual[k] + shared * cell.inverse_radius) / shorter, x = 2 * g / shorter * cell.inverse_condition;
    const float lost = std::min(cell.loss * std::max(x, r), cell.warp_loss + (cell.loss - cell.warp_loss) * r);
    const float falling = distortion_ == 2 ? shorter / (1 + g) * (shorter / (1 + g)) : shorter / (1 + g);
    const bool sound = g <= largest_gradient && r <= nearly_one && x <= nearly_one;
    if (!(sound && (cell.determinant - lost) * falling > least)) result.push_back(static_cast<std::uint32_t>(k));
  }
  return result;
}

std::size_t FieldBounds::bytes_for(std::size_t cells, std::size_t fields) {
  const std::size_t clusters = cells / cluster_size + 1;
  constexpr std::size_t opening = 2 * sizeof(float) + 2 * sizeof(std::uint32_t);  // in a call
  return clusters * (sizeof(Tightest) + 2 * fields * sizeof(float) + opening) + 2 * fields * sizeof(double);
}

std::size_t FieldBounds::bytes_to_make(std::size_t cells, std::size_t points, std::size_t fields) {
  return bytes_for(cells, fields) + points * std::min(batch_size, fields) * sizeof(double);
}

}  // namespace deform::quality
