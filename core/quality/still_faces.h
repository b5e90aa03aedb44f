// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/quality/face_pairs.h"

namespace deform::quality {

/// Proves cheaply for most faces that their normals hardly turned, from the differences of the displacements of their corners.
///
/// Let the corners of a face move by d_i relative to its first one, by m at most, and E_i be its edges from that corner. Its
/// vector area a, the sum of the E_i x E_i+1, then changes by at most m S + (c - 2) m^2, where S is the sum of the |E_i| +
/// |E_i+1| and c the number of corners. With m = k |a| / S that is less than |a| (k + k^2 (c - 2) / 4), because |a| <= S^2 / 4;
/// the factor of |a| is an upper bound of the sine of the angle by which the normal turned. Immutable; any thread may call.
class StillFaces {
 public:
  /// `normals` are those of the faces at rest; faces with a zero normal never count as moved. `sharp` are the pairs with
  /// sharp edges.
  StillFaces(const FaceCorners& corners, std::span<const Vec3> rest, std::span<const Vec3> normals,
             std::span<const FacePair> sharp, const RunContext& context);

  /// Sets moved[f] to 0 for faces that are proved to be still, to 1 for all others. The normals of still faces turned by at most
  /// 30 degrees; those of triangles with a sharp edge by at most 15, and each of their edges by at most 30.
  void find_moved(const FaceCorners& corners, std::span<const Vec3> rest, std::span<const Vec3> points, std::vector<char>& moved,
                  const RunContext& context) const;

 private:
  std::vector<float> limits_;  ///< f; limits of the components of d_i
};

}  // namespace deform::quality
