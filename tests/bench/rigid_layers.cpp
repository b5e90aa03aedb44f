// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/rigid_layers.h"

#include <chrono>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/io/mesh_file.h"
#include "core/mesh/wall_columns.h"
#include "tests/bench/constraint_cases.h"
#include "tests/bench/foam_case.h"
#include "tests/bench/peak_memory.h"
#include "tests/support/thesis_options.h"

namespace deform::bench {

namespace {

namespace fs = std::filesystem;

constexpr double lift = 0.15;  // metres
constexpr int layers = 3;      // as the mesh was made

ConstraintCase lifted_roof(std::shared_ptr<const Mesh> mesh) {
  ConstraintCase car;
  car.mesh = std::move(mesh);
  car.setup.handles = {{"roof", roof_patch(*car.mesh)}};
  for (const char* patch : {"inlet", "outlet", "lowerWall", "upperWall", "frontAndBack"}) {
    car.setup.fixed.push_back({Region::GroupName{patch}});
  }
  Rigid columns;
  columns.layers = layers;
  car.setup.constraints = {{"boundary_layer", {{Region::GroupName{"car_body"}}}, columns}};
  car.design.motions.push_back({0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, lift}});
  return car;
}

}  // namespace

void rigid_layers(const fs::path& car_case, const fs::path& work, Report& report) {
  const auto file = io::read_mesh_file(car_case);
  const ConstraintCase car = lifted_roof(file->mesh());
  const WallColumns columns =
      wall_columns(*car.mesh, select({Region::GroupName{"car_body"}}, *car.mesh, "car_body"), layers, "car_body");
  make_foam_case(car_case, work);
  std::printf("\nroof lift by %g m with moving least squares: %zu points, %zu cells, %zu columns of %d cells (%zu shorter)\n\n",
              lift, car.mesh->point_count(), file->cells()->cell_count, columns.points.size(), layers, columns.shorter);
  print_head();
  print_row("original", "ours", FoamMeasures::of(car.mesh->points, *file->cells()));
  if (const auto theirs = check_mesh(work, "constant")) print_row("original", "checkMesh", *theirs);

  struct Lifted {
    FoamMeasures ours;
    std::optional<FoamMeasures> theirs;
    ShapeChange change;
    std::string text;
  };
  MlsOptions options = test::thesis_mls();
  options.surface_samples = 5000;
  options.volume_samples = 2000;
  const double diagonal = bounding_box(car.mesh->points).diagonal();
  const auto lifted = [&](const char* name, const Setup& setup, const WallColumns& measured) {
    reset_peak();
    const auto start = std::chrono::steady_clock::now();
    const auto system = prepare(car.mesh, setup);
    const double prepared = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const Outcome outcome = solved(*system, car.design);
    Lifted result;
    result.ours = FoamMeasures::of(outcome.points, *file->cells());
    print_row(name, "ours", result.ours);
    io::write_mesh_file(*file, outcome.points, work / "1");
    result.theirs = check_mesh(work, "1");
    if (result.theirs) print_row(name, "checkMesh", *result.theirs);
    result.change = shape_change(measured.points, car.mesh->points, outcome.points);
    result.text = "prepared in " + Report::text(prepared) + " s, one design " + Report::text(outcome.seconds) + " s, peak " +
                  Report::text(peak_mib()) + " MiB, " + std::to_string(system->info().cubature_points) + " cubature points, " +
                  std::to_string(outcome.report.iterations) + " iterations, " + std::to_string(outcome.report.newton_steps) +
                  " Newton steps" + (outcome.report.converged ? "" : ", NOT CONVERGED");
    return result;
  };
  Setup without = with_method(car, options);
  without.constraints.clear();
  // The whole body cannot be rigid while its roof is lifted; the layers of the roof can, and move with it.
  const WallColumns on_roof = wall_columns(*car.mesh, select(roof_patch(*car.mesh), *car.mesh, "roof"), layers, "roof");
  Setup with_roof = with_method(car, options);
  with_roof.constraints.push_back(with_roof.constraints[0]);
  with_roof.constraints[1].name = "roof_layer";
  with_roof.constraints[1].regions = {roof_patch(*car.mesh)};
  with_roof.constraints[1].exact = true;
  const Lifted loose = lifted("lifted", without, on_roof);
  const Lifted body = lifted("lifted, rigid columns", with_method(car, options), columns);
  const Lifted rigid = lifted("lifted, those of the roof exact", with_roof, on_roof);
  fs::remove_all(work);

  report.open();
  for (const auto& [name, result] : {std::pair{"without rigid columns", &loose},
                                     {"with rigid columns on the whole body", &body},
                                     {"and those of the roof exact", &rigid}}) {
    const std::string figure = std::string("Thesis 8.6.3, roof lift, ") + name + ": ";
    report.info(figure + "time and memory", result->text);
    report.at_most(figure + "failed checks (ours)", static_cast<double>(result->ours.failed), 0, "");
    if (result->theirs) report.at_most(figure + "failed checks (checkMesh)", static_cast<double>(result->theirs->failed), 0, "");
    report.info(figure + "shape change of the columns, largest / mean / largest distance over D",
                Report::text(result->change.largest) + " / " + Report::text(result->change.mean) + " / " +
                    Report::text(result->change.largest_distance / diagonal));
  }
  report.at_most("Thesis 8.6.3, roof lift: shape change inside the exactly rigid columns, over their size", rigid.change.largest,
                 1e-3, "");
  report.at_most("Thesis 8.6.3, roof lift: largest non-orthogonality with rigid columns less without",
                 body.ours.non_orthogonality - loose.ours.non_orthogonality, 0, " degrees");
  report.at_most("Thesis 8.6.3, roof lift: largest non-orthogonality with those of the roof exact less without",
                 rigid.ours.non_orthogonality - loose.ours.non_orthogonality, 0, " degrees");
}

}  // namespace deform::bench
