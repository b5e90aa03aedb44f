// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "core/base/types.h"
#include "core/measures/faces.h"
#include "core/measures/measure.h"
#include "core/mesh/mesh.h"

namespace deform::measures {

/// The enclosed volume, model units cubed: the sum over all triangles of a . (b x c) / 6, with their corners relative to a fixed
/// point. Positive for the mesh as it is; a design that is inside out has a negative one. Faces with more than three corners are
/// fans around their first one, so that warped ones depend on it. Throws as Body().
std::unique_ptr<const Measure> make_volume(const Mesh& mesh, const FaceChoice& choice, Rims rims);

/// The centre of gravity of the enclosed body, of uniform density: three values, x, y and z in model units. The first moments,
/// the sums of a . (b x c) (a + b + c) / 24, over the volume. Throws as Body(); evaluate() throws Error(numerical_failure) where
/// the volume of a design is not above 0.
std::unique_ptr<const Measure> make_centre_of_gravity(const Mesh& mesh, const FaceChoice& choice, Rims rims);

/// The area of the faces, which need not be closed, model units squared. Throws as chosen_triangles().
std::unique_ptr<const Measure> make_area(const Mesh& mesh, const FaceChoice& choice);

/// Half the sum of the areas of all faces projected along `direction` (any length but 0): sum |n . d| / 2 with the area vectors
/// n. That is the area of the shadow of a convex body; of others it counts what is hidden as well, and of an open sheet it is
/// half of its shadow. Model units squared. Throws as chosen_triangles(), and Error(invalid_argument) naming `direction`.
std::unique_ptr<const Measure> make_projected_area(const Mesh& mesh, const FaceChoice& choice, const Vec3& direction);

}  // namespace deform::measures
