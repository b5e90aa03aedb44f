// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>

#include "core/base/vectors.h"
#include "core/mesh/mesh.h"

namespace deform::bench {

/// The six tests of thesis A.5.2 (algorithms 1 to 6) on one mesh in one data structure, with double points and normals of
/// vertices and faces. Every test gives a number that does not depend on the data structure, but for rounding. Vertices and faces
/// keep the numbers of the mesh.
class ConnectivityTests {
 public:
  virtual ~ConnectivityTests() = default;

  /// The faces around all vertices and the vertices of all faces, `times` times.
  virtual double circulators(int times) = 0;
  virtual double barycentre(int times) = 0;
  virtual double normals(int times) = 0;
  virtual double smoothing(int times) = 0;

  /// A copy that the tests after it change.
  virtual void copy() = 0;
  virtual double subdivide() = 0;  ///< sqrt(3) subdivision
  virtual double collapse() = 0;   ///< of what splitting all faces adds
};

/// Where one-rings as compressed rows serve a test, it builds them once. With circulators everywhere: own_circulators().
std::unique_ptr<ConnectivityTests> own_tests(const Mesh& mesh);
std::unique_ptr<ConnectivityTests> own_circulators(const Mesh& mesh);
#ifdef DEFORM_HAS_OPENMESH
std::unique_ptr<ConnectivityTests> openmesh_tests(const Mesh& mesh);
#endif
#ifdef DEFORM_HAS_CGAL
std::unique_ptr<ConnectivityTests> cgal_tests(const Mesh& mesh);
#endif

/// How far the old vertices move in sqrt(3) subdivision (L. Kobbelt, 2000).
inline double sqrt3_weight(std::size_t valence) {
  return (4 - 2 * std::cos(2 * 3.14159265358979323846 / static_cast<double>(valence))) / 9;
}

}  // namespace deform::bench
