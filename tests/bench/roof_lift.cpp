// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/roof_lift.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>

#include "core/deformers/system.h"
#include "core/io/mesh_file.h"
#include "tests/bench/foam_case.h"

namespace deform::bench {

namespace {

namespace fs = std::filesystem;

constexpr std::array lifts{0.05, 0.15, 0.30};  // metres

}  // namespace

void roof_lift(const std::filesystem::path& car_case, const std::filesystem::path& work, Report& report) {
  const auto file = io::read_mesh_file(car_case);
  const auto mesh = file->mesh();
  const FoamMeasures original = FoamMeasures::of(mesh->points, *file->cells());
  make_foam_case(car_case, work);
  std::printf("\nroof lift (thesis table 7.2): %zu points, %zu cells\n\n", mesh->point_count(), file->cells()->cell_count);
  print_head();
  print_row("original", "ours", original);
  if (const auto theirs = check_mesh(work, "constant")) print_row("original", "checkMesh", *theirs);

  struct Worst {
    std::string name;
    double change = 0, most = 0, difference = 0;
    std::size_t failed = 0, compared = 0;
  };
  std::vector<Worst> worst;
  const std::pair<const char*, Region> arrangements[] = {{"patch", roof_patch(*mesh)},
                                                         {"three points", three_roof_points(*mesh)}};
  std::vector<std::string> prepared;
  for (const auto& [name, roof] : arrangements) {
    const auto system = prepare(mesh, roof_setup(roof));
    prepared.push_back(std::string(name) + ": " + std::to_string(system->info().handle_points) + " handle points, " +
                       std::to_string(system->info().centres) + " centres");
    Worst& most = worst.emplace_back(Worst{name});
    for (const double lift : lifts) {
      const Points points = system->evaluate(roof_raised_by(lift));
      const FoamMeasures measured = FoamMeasures::of(points, *file->cells());
      const std::string what = std::string(name) + ", " + Report::text(lift) + " m";
      print_row(what, "ours", measured);
      most.change = std::max(most.change, std::abs(measured.non_orthogonality - original.non_orthogonality));
      most.most = std::max(most.most, measured.non_orthogonality);
      most.failed = std::max(most.failed, measured.failed);
      io::write_mesh_file(*file, points, work / "1");
      const auto theirs = check_mesh(work, "1");
      if (!theirs) continue;
      print_row(what, "checkMesh", *theirs);
      ++most.compared;
      const std::pair<double, double> both[] = {{measured.aspect_ratio, theirs->aspect_ratio},
                                                {measured.non_orthogonality, theirs->non_orthogonality},
                                                {measured.average, theirs->average},
                                                {measured.skewness, theirs->skewness}};
      for (const auto& [a, b] : both) most.difference = std::max(most.difference, std::abs(a - b) / b);
    }
  }
  fs::remove_all(work);

  report.open();
  for (std::size_t i = 0; i < worst.size(); ++i) {
    const Worst& most = worst[i];
    const std::string name = "Thesis 7.3.2, roof lift, " + most.name + ": ";
    report.info(name + "prepared", prepared[i]);
    report.at_most(name + "change of the largest non-orthogonality", most.change, 5, " degrees");
    report.at_most(name + "largest non-orthogonality", most.most, 70, " degrees");
    report.at_most(name + "failed checks", static_cast<double>(most.failed), 0, "");
    if (most.compared > 0) report.at_most(name + "our measures against checkMesh's, relative", most.difference, 1e-3, "");
  }
}

}  // namespace deform::bench
