#include "tests/bench/roof_lift.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <regex>
#include <string>

#include "core/deformers/system.h"
#include "core/io/mesh_file.h"
#include "core/quality/polyhedral_quality.h"

namespace deform::bench {

namespace {

namespace fs = std::filesystem;

constexpr std::array lifts{0.05, 0.15, 0.30};  // metres

/// What table 7.2 has.
struct Measures {
  double aspect_ratio = 0, non_orthogonality = 0, average = 0, skewness = 0;
  std::size_t failed = 0;
};

Measures ours(std::span<const Vec3> points, const PolyhedralCells& cells) {
  const PolyhedralQuality quality = polyhedral_quality(points, cells);
  return {quality.largest_aspect_ratio.value, quality.largest_non_orthogonality.value, quality.average_non_orthogonality,
          quality.largest_skewness.value, quality.failed_checks()};
}

double printed(const std::string& text, const std::string& label) {
  std::smatch match;
  if (!std::regex_search(text, match, std::regex(label + R"(\s*=?\s*([-+0-9.e]+[0-9]))"))) return std::nan("");
  return std::stod(match[1]);
}

/// What checkMesh prints about a time folder of a case; nothing where it is not installed.
std::optional<Measures> check_mesh(const fs::path& folder, const std::string& time) {
  const std::string command =
      "command -v checkMesh >/dev/null || exit 0; WM_PROJECT_DIR=${WM_PROJECT_DIR:-/usr/share/openfoam} "
      "checkMesh -time " +
      time + " -case '" + folder.string() + "' 2>&1";
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  std::string text;
  char buffer[4096];
  while (pipe && std::fgets(buffer, sizeof buffer, pipe.get())) text += buffer;
  if (text.empty()) return std::nullopt;
  const double failed = printed(text, "Failed");
  return Measures{printed(text, "Max aspect ratio"), printed(text, "Mesh non-orthogonality Max:"), printed(text, "average:"),
                  printed(text, "Max skewness"), std::isnan(failed) ? 0 : static_cast<std::size_t>(failed)};
}

void print(const char* what, const std::string& source, const Measures& m) {
  std::printf("| %s | %s | %.4g | %.5g | %.4g | %.4g | %zu |\n", what, source.c_str(), m.aspect_ratio, m.non_orthogonality,
              m.average, m.skewness, m.failed);
  std::fflush(stdout);
}

Setup with_handle(Region roof) {
  Setup setup;
  setup.handles = {{"roof", std::move(roof)}};
  for (const char* patch : {"inlet", "outlet", "lowerWall", "upperWall", "frontAndBack"}) {
    setup.fixed.push_back({Region::GroupName{patch}});
  }
  RbfOptions options;
  options.reduction = CentreReduction::off;
  setup.method = options;
  return setup;
}

/// The points of the body within 0.1 m of its top.
Region roof_patch(const Mesh& mesh) {
  const Region body{Region::GroupName{"car_body"}};
  double top = 0;
  for (const PointId id : select(body, mesh, "body")) top = std::max(top, mesh.points[id][2]);
  return {Region::Intersection{{body, {Region::InHalfSpace{{0, 0, top - 0.1}, {0, 0, 1}}}}}};
}

/// Front, middle and rear of the roof, in the plane of symmetry.
Region three_points(const Mesh& mesh) {
  const std::vector<PointId> roof = select(roof_patch(mesh), mesh, "roof");
  Box box;
  for (const PointId id : roof) box.add(mesh.points[id]);
  std::vector<PointId> ids;
  for (const double along : {0.25, 0.5, 0.75}) {
    const double x = box.min[0] + along * (box.max[0] - box.min[0]);
    const auto away = [&](PointId id) { return std::hypot(mesh.points[id][0] - x, mesh.points[id][1]); };
    ids.push_back(*std::min_element(roof.begin(), roof.end(), [&](PointId a, PointId b) { return away(a) < away(b); }));
  }
  return {Region::Ids{ids}};
}

/// A case folder with the mesh of another one, for the time folders.
void make_case(const fs::path& source, const fs::path& folder) {
  fs::remove_all(folder);
  fs::create_directories(folder);
  for (const char* part : {"constant", "system"}) fs::create_directory_symlink(fs::absolute(source / part), folder / part);
}

}  // namespace

void roof_lift(const std::filesystem::path& car_case, const std::filesystem::path& work, Report& report) {
  const auto file = io::read_mesh_file(car_case);
  const auto mesh = file->mesh();
  const Measures original = ours(mesh->points, *file->cells());
  make_case(car_case, work);
  std::printf("\nroof lift (thesis table 7.2): %zu points, %zu cells\n\n", mesh->point_count(), file->cells()->cell_count);
  std::printf(
      "| mesh | by | aspect ratio | non-orthogonality | average | skewness | failed checks |\n|---|---|---|---|---|---|---|\n");
  print("original", "ours", original);
  if (const auto theirs = check_mesh(work, "constant")) print("original", "checkMesh", *theirs);

  struct Worst {
    std::string name;
    double change = 0, most = 0, difference = 0;
    std::size_t failed = 0, compared = 0;
  };
  std::vector<Worst> worst;
  const std::pair<const char*, Region> arrangements[] = {{"patch", roof_patch(*mesh)}, {"three points", three_points(*mesh)}};
  std::vector<std::string> prepared;
  for (const auto& [name, roof] : arrangements) {
    const auto system = prepare(mesh, with_handle(roof));
    prepared.push_back(std::string(name) + ": " + std::to_string(system->info().handle_points) + " handle points, " +
                       std::to_string(system->info().centres) + " centres");
    Worst& most = worst.emplace_back(Worst{name});
    for (const double lift : lifts) {
      Design design;
      design.motions.push_back({0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, lift}});
      const Points points = system->evaluate(design);
      const Measures measured = ours(points, *file->cells());
      const std::string what = std::string(name) + ", " + Report::text(lift) + " m";
      print(what.c_str(), "ours", measured);
      most.change = std::max(most.change, std::abs(measured.non_orthogonality - original.non_orthogonality));
      most.most = std::max(most.most, measured.non_orthogonality);
      most.failed = std::max(most.failed, measured.failed);
      io::write_mesh_file(*file, points, work / "1");
      const auto theirs = check_mesh(work, "1");
      if (!theirs) continue;
      print(what.c_str(), "checkMesh", *theirs);
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
    const std::string name = "T28 roof lift, " + most.name + ": ";
    report.info(name + "prepared", prepared[i]);
    report.at_most(name + "change of the largest non-orthogonality", most.change, 5, " degrees");
    report.at_most(name + "largest non-orthogonality", most.most, 70, " degrees");
    report.at_most(name + "failed checks", static_cast<double>(most.failed), 0, "");
    if (most.compared > 0) report.at_most(name + "our measures against checkMesh's, relative", most.difference, 1e-3, "");
  }
}

}  // namespace deform::bench
