// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/base/problems.h"
#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// Checks a setup that the server accepted, and the mesh of a two-dimensional file (io::MeshFile::two_dimensional()): adds a
/// problem "variables[k]" for each variable that moves a point of a handle out of its plane z = constant by more than 1e-12 of
/// the diagonal of the mesh: alone, at one of its bounds, or at 1 without them. Its designs cannot be written. Handles that
/// select control points are not checked.
void check_plane_variables(const v1::Setup& setup, const Mesh& mesh, Problems& problems);

}  // namespace deform::cli
