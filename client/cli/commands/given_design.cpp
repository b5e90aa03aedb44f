// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/commands/given_design.h"

#include <limits>
#include <span>

#include "client/cli/setup/control_lattice.h"
#include "client/cli/setup/motions.h"
#include "client/cli/setup/region_points.h"
#include "client/cli/setup/setup_stages.h"
#include "client/design.h"

namespace deform::cli {

void GivenDesign::add_to(CLI::App& command) {
  command.add_option("--set", settings, "NAME=VALUE of a design variable; may be repeated")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command.add_option("--motions", motion_files, "CSV file of handle motions; may be repeated")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command
      .add_option("--match-tolerance", match_tolerance,
                  "How far a place in a motion file may be from its point, model units; 0: 1e-6 of the bounding-box diagonal")
      ->check(not_negative())
      ->capture_default_str();
}

v1::Design GivenDesign::design(const PreparedSetup& prepared) const {
  const v1::Setup& setup = prepared.system.setup();
  v1::Design design = client::variables_design(parse_settings(settings, setup));
  if (motion_files.empty()) return design;
  const Mesh& mesh = *source_of(prepared).mesh();
  const bool several = setup.then_size() > 0;
  const std::vector<Vec3> controls = selects_controls(setup) && !several ? control_places(setup, mesh) : std::vector<Vec3>();
  RestPlaces rest{controls.empty() ? std::span(mesh.points) : std::span(controls), match_tolerance};
  if (rest.tolerance == 0) rest.tolerance = std::max(1e-6 * prepared.system.diagonal(), std::numeric_limits<double>::min());
  for (const auto& file : motion_files) {
    const auto motions = read_motions(
        read_csv(file),
        [&](const std::string& handle) {
          const auto own = several ? setup_of_handle(setup, handle) : std::nullopt;
          if (own && selects_controls(*own)) {
            throw Error(ErrorCode::invalid_argument,
                        "handle \"" + handle +
                            "\" moves control points, and motion files of a setup with `then` name points of the mesh; give "
                            "design variables");
          }
          return handle_points(setup, handle, mesh);
        },
        rest);
    for (const auto& motion : motions) *design.add_motions() = motion;
  }
  return design;
}

}  // namespace deform::cli
