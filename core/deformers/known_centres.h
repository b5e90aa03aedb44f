#pragma once

#include <optional>
#include <vector>

#include "core/deformers/setup.h"

namespace deform {

/// The points that become centres of an RBF system, ascending. Nothing where they are chosen while preparing: by INCREMENTAL_QR
/// and by the other methods. Throws what validate() throws.
std::optional<std::vector<PointId>> known_centres(const Mesh& mesh, const Setup& setup);

}  // namespace deform
