// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/measures/faces.h"
#include "core/measures/measure.h"
#include "core/mesh/mesh.h"

namespace deform::measures {

/// How thick the body is at a place of its surface.
enum class ThicknessMethod {
  /// The way that a ray along the inward normal goes until it leaves the body.
  rays,
  /// The diameter of the largest sphere that touches the place from inside and into which no opposing face reaches (shrinking
  /// ball: J. Ma, S. W. Bae, S. Choi, 3D medial axis point approximation using nearest neighbors and the normal field, Visual
  /// Computer 28, 2012; here Newton's method on triangles). Not above that of the ray where the face at its end opposes.
  spheres,
};

/// What is measured, and how.
struct ThicknessOptions {
  FaceChoice body;              ///< the faces of the body
  Rims rims = Rims::refuse;     ///< what closes rims only tells inside from outside: rays through it have no thickness
  std::vector<std::string> at;  ///< groups of faces where the thickness is measured; empty: all of the body
  ThicknessMethod method = ThicknessMethod::rays;  ///< how thickness is measured
  /// Tolerance of the aggregation, model units: the value lies at most this below the least thickness. 0: 5 % of the least
  /// thickness of the mesh as it is.
  double tolerance = 0;
  /// For spheres: a face opposes a place when its outward normal is at most this many degrees from the inward normal there, so
  /// that the faces next to a convex edge, between which spheres get as small as they are near to it, do not count. 0 to 90.
  double opposing_degrees = 60;
};

/// The least thickness of a body over the centroids of its triangles, as SmoothLeast: one value, model units. Measurement::least
/// has the true minimum, its face and place; places without thickness (rays that leave through a rim, spheres that nothing
/// opposes, faces without area) do not count. Thickness varies between centroids: it is as fine as the mesh.
///
/// Throws as Body(), Error(invalid_argument) naming at[i], `at` (faces that are not of the body), `tolerance` and
/// `opposing_degrees`, Error(numerical_failure) where there is no thickness at any place, as does evaluate().
std::unique_ptr<const Measure> make_thickness(const Mesh& mesh, const ThicknessOptions& options, const RunContext& context = {});

}  // namespace deform::measures
