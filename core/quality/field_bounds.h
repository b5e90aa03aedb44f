// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
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
/// In a cell, field f is g_f . x plus a constant, up to r_f at every node. So a motion with coefficients c_f has the gradient G =
/// sum c_f g_f^T and leaves residuals of at most sum |c_f| r_f, to which the tolerance of the cell applies (CellTolerance).
/// Cells are cleared in clusters of neighbours, first by the norms alone: |G| <= sum |c_f| max |g_f|, which costs two
/// multiplications per field. Otherwise by the stretch of the sum of c_f m_f^T, where m_f is the middle of the g_f, as the fields
/// are smooth, with |g_f - m_f| added, and each cell by its own tolerance and share of the residuals. The numbers are stored in
/// single precision, rounded to the safe side. Immutable; any thread may call.
class FieldBounds {
 public:
  static constexpr std::size_t cluster_size = 16;  ///< cells, in the order of the certificate

  /// The certificate must outlive this object. Throws Error(cancelled), Error(deadline_exceeded).
  FieldBounds(std::span<const Vec3> rest, const MotionCertificate& certificate, const DisplacementFields& fields,
              const RunContext& context);

  std::size_t fields() const { return largest_.size(); }
  std::size_t cluster_count() const { return tightest_.determinant.size(); }
  /// Cells in the order of the certificate.
  struct Doubtful {
    std::vector<std::uint32_t> unproven;  ///< may be inverted on the way, as far as the bounds can tell
    std::vector<std::uint32_t> low;       ///< never inverted, but their determinants at the end may not be above the floor
    std::size_t size() const { return unproven.size() + low.size(); }
  };
  /// Appends the cells of a range of clusters for which the bounds do not prove that they are never inverted on the straight path
  /// from rest and end with a normalized determinant above `floor`. Throws Error(invalid_argument) for another number of fields.
  void doubtful(const FieldMotion& motion, double floor, std::size_t begin_cluster, std::size_t end_cluster,
                Doubtful& cells) const;
  /// An upper bound of the displacement of any point; not finite if there is none.
  double reach(const FieldMotion& motion) const;

  /// Upper bounds of the memory in bytes, and of the peak of the construction.
  static std::size_t bytes_for(std::size_t cells, std::size_t fields);
  static std::size_t bytes_to_make(std::size_t cells, std::size_t points, std::size_t fields);

 private:
  /// The tightest tolerances of the cells of each cluster.
  struct Tightest {
    std::vector<float> inverse_radius, inverse_condition, determinant, loss, warp_loss;
  };
  /// The tolerances of the cells of a cluster, side by side; infinite where there is no cell.
  struct Tolerances {
    std::array<float, cluster_size> inverse_radius, inverse_condition, determinant, loss, warp_loss;
  };
  /// A field in the cells of a cluster.
  struct Field {
    std::array<float, 3> middle{};  ///< m_f
    float deviation = 0;            ///< largest |g_f - m_f|
    float residual = 0;             ///< largest r_f
  };
  /// A motion as all clusters need it.
  struct Common {
    double residual = 0;                ///< what errors of coefficients, values and points add to that of every cell
    std::vector<std::uint32_t> moving;  ///< the fields whose coefficient may differ from 0
    std::vector<double> sizes;          ///< the norms of their coefficients
  };
  struct Batch;
  void check(const FieldMotion& motion) const;
  void set_tolerances();
  void take(std::span<const Vec3> rest, const Batch& batch, std::size_t cluster);
  Common common(const FieldMotion& motion) const;
  void open_cells(const FieldMotion& motion, const Common& common, float least, std::size_t cluster, Doubtful& cells) const;

  const MotionCertificate& certificate_;
  Tightest tightest_;
  std::vector<Tolerances> tolerances_;       ///< one per cluster
  std::vector<float> steepest_, residuals_;  ///< largest |g_f|, and r_f relative to the radius of the cell: fields x clusters
  std::vector<Field> in_clusters_;           ///< clusters x fields
  /// The r_f of the cells as fractions of those of their clusters, in 255ths: clusters x fields x cluster_size.
  std::vector<std::uint8_t> shares_;
  std::vector<double> largest_, errors_;  ///< of the values of each field
};

}  // namespace deform::quality
