// SPDX-License-Identifier: GPL-3.0-or-later
// Thesis 7.3.2: the roof of a car lifted by three of its points, in the polyhedral mesh around it.
#include <algorithm>
#include <filesystem>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/io/mesh_file.h"
#include "tests/bench/foam_case.h"
#include "tests/bench/methods/methods.h"

namespace deform::bench {

namespace {

Json row_of(const FoamMeasures& measures) {
  Json row;
  row["aspect_ratio"] = measures.aspect_ratio;
  row["non_orthogonality"] = measures.non_orthogonality;
  row["average_non_orthogonality"] = measures.average;
  row["skewness"] = measures.skewness;
  row["failed_checks"] = measures.failed;
  return row;
}

}  // namespace

Json car(const std::filesystem::path& car_case, const std::filesystem::path& work) {
  constexpr std::array lifts{0.15, 0.3};  // metres
  const auto file = io::read_mesh_file(car_case);
  const auto mesh = file->mesh();
  const double D = bounding_box(mesh->points).diagonal();
  make_foam_case(car_case, work);
  Json result;
  result["points"] = mesh->point_count();
  result["cells"] = file->cells()->cell_count;
  result["D"] = D;
  const auto measure = [&](const Points& points, const std::string& time) {
    Json both;
    both["ours"] = row_of(FoamMeasures::of(points, *file->cells()));
    if (time != "constant") io::write_mesh_file(*file, points, work / time);
    if (const auto theirs = check_mesh(work, time)) both["checkMesh"] = row_of(*theirs);
    return both;
  };
  result["at_rest"] = measure(mesh->points, "constant");
  Setup setup = roof_setup(three_roof_points(*mesh));
  std::vector<PointId> prescribed = select(setup.handles[0].region, *mesh, "roof");
  const std::size_t raised = prescribed.size();
  for (const Region& region : setup.fixed) {
    const std::vector<PointId> more = select(region, *mesh, "fixed");
    prescribed.insert(prescribed.end(), more.begin(), more.end());
  }
  result["prescribed"] = prescribed.size();
  const auto lift_by = [&](const std::string& name) {
    Json row;
    row["method"] = name;
    try {
      std::shared_ptr<const System> system;
      row["prepare"] = seconds_of([&] { system = prepare(mesh, setup); }, 1);
      for (const double lift : lifts) {
        const Points points = system->evaluate(roof_raised_by(lift));
        double missed = 0;
        for (std::size_t k = 0; k < prescribed.size(); ++k) {
          const Vec3 up{0, 0, k < raised ? lift : 0};
          missed = std::max(missed, distance(points[prescribed[k]], mesh->points[prescribed[k]] + up));
        }
        Json step = measure(points, "1");
        step["lift"] = lift;
        step["missed"] = missed;
        row["lifts"].push_back(std::move(step));
      }
    } catch (const Error& error) {
      row["refused"] = error.what();
    }
    result["rows"].push_back(std::move(row));
  };
  lift_by("RBF");
  for (const std::size_t n : {5, 10, 15, 25}) {
    FfdOptions options;
    options.control = FfdControl::mesh;
    options.lattice.points = {n, n, n};
    setup.method = options;
    lift_by("DM-FFD-" + std::to_string(n));
  }
  std::filesystem::remove_all(work);
  return result;
}

}  // namespace deform::bench
