// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/plane_variables.h"

#include <cmath>
#include <string>
#include <vector>

#include "client/cli/setup/control_lattice.h"
#include "client/cli/setup/prescribed_places.h"
#include "client/cli/setup/reading.h"
#include "client/cli/setup/region_points.h"
#include "client/cli/setup/setup_stages.h"
#include "core/base/vectors.h"

namespace deform::cli {

namespace {

/// Throws for the first point of the handle that variable k takes out of its plane, having this value.
void check_handle(const v1::Setup& setup, const Mesh& mesh, int k, double value, const std::string& handle) {
  const auto method = setup_of_handle(setup, handle);
  if (!method || selects_controls(*method)) return;
  std::vector<double> values(static_cast<std::size_t>(setup.variables_size()), 0.0);
  values[static_cast<std::size_t>(k)] = value;
  const Affine motion = handle_motion(setup, handle, values);
  if (motion == identity_affine) return;
  const double limit = 1e-12 * bounding_box(mesh.points).diagonal();
  for (const PointId id : handle_points(setup, handle, mesh)) {
    const Vec3& x = mesh.points[id];
    if (std::abs(transformed(motion, x)[2] - x[2]) <= limit) continue;
    refuse("variables[" + std::to_string(k) + "] (\"" + setup.variables(k).name() + "\"): point " + std::to_string(id) +
           " of handle \"" + handle +
           "\" leaves its plane, but the mesh file is two-dimensional; translate and scale along the plane, and rotate about its "
           "normal [0, 0, 1]");
  }
}

}  // namespace

void check_plane_variables(const v1::Setup& setup, const Mesh& mesh, Problems& problems) {
  for (int k = 0; k < setup.variables_size(); ++k) {
    const v1::DesignVariable& variable = setup.variables(k);
    problems.check("variables[" + std::to_string(k) + "]", [&] {
      for (const double value : {variable.has_upper() ? variable.upper() : 1.0, variable.has_lower() ? variable.lower() : -1.0}) {
        check_handle(setup, mesh, k, value, variable.handle());
        for (const v1::DrivenHandle& also : variable.also()) check_handle(setup, mesh, k, value, also.handle());
      }
    });
  }
}

}  // namespace deform::cli
