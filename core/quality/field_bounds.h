// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/quality/displacement_fields.h"
#include "core/quality/motion_certificate.h"

namespace deform::quality {

/// Proves for most cells, without looking at any point, that a combination of known fields does not invert them.
///
/// In a cell, field f is g_f . x plus a constant, up to r_f at every node. So a motion with coefficients c_f has a gradient G
/// with |G| <= sum |c_f| |g_f| and leaves residuals of at most sum |c_f| r_f, to which the tolerance of the cell applies
/// (CellTolerance). For each cluster of neighbouring cells the largest |g_f|, the largest r_f relative to the radius of the cell,
/// and the tightest tolerance are stored in single precision, rounded to the safe side: a motion costs two multiplications per
/// field and cluster. Immutable; any thread may call.
class FieldBounds {
 public:
  static constexpr std::size_t cluster_size = 8;  ///< cells, in the order of the certificate
  static_assert(MotionCertificate::block_size % cluster_size == 0);

  /// The certificate is used by the constructor only. Throws cancelled, deadline_exceeded.
  FieldBounds(std::span<const Vec3> rest, const MotionCertificate& certificate, const DisplacementFields& fields,
              const RunContext& context);

  std::size_t fields() const { return largest_.size(); }
  std::size_t cluster_count() const { return tightest_.size(); }
  /// The clusters, ascending, that may have a cell that is inverted on the straight path from rest or that ends with a normalized
  /// determinant of at most `floor`. Throws Error(invalid_argument) for another number of fields.
  std::vector<std::uint32_t> open(const FieldMotion& motion, double floor) const;
  /// An upper bound of the displacement of any point; not finite if there is none.
  double reach(const FieldMotion& motion) const;

  /// Upper bounds of the memory in bytes, and of the peak of the construction.
  static std::size_t bytes_for(std::size_t cells, std::size_t fields);
  static std::size_t bytes_to_make(std::size_t cells, std::size_t points, std::size_t fields);

 private:
  /// Of the cells of a cluster; residuals are relative to the radius.
  struct Tightest {
    float inverse_radius = 0, inverse_condition = 0, determinant = 0, loss = 0, warp_loss = 0;
  };
  struct Batch;
  void check(const FieldMotion& motion) const;
  void take(std::span<const Vec3> rest, const MotionCertificate& certificate, const Batch& batch, std::size_t cluster);

  int distortion_;
  std::vector<Tightest> tightest_;  ///< one for each cluster
  /// fields x clusters.
  std::vector<float> gradients_, residuals_;
  std::vector<double> largest_, errors_;  ///< of the values of each field
};

}  // namespace deform::quality
