// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <span>

#include "core/compiled/deformation.h"
#include "core/mesh/mesh.h"
#include "deform/v1/deformation.pb.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// Which faces and cells of a result are looked at.
enum class CompiledCheck { none, inversions, intersections };  // each with those before it

/// What the server would say about a design, without its warnings that come from the method. points: n x 3, as they were
/// evaluated. setup: that was compiled.
v1::DesignResult compiled_result(const compiled::Deformation& deformation, const v1::Setup& setup,
                                 std::span<const double> variables, const Mesh& mesh, const Points& points, CompiledCheck check);

}  // namespace deform::cli
