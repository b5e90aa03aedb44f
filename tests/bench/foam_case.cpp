// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/foam_case.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <regex>
#include <utility>
#include <vector>

#include "core/quality/polyhedral_quality.h"

namespace deform::bench {

namespace {

namespace fs = std::filesystem;

double printed(const std::string& text, const std::string& label) {
  std::smatch match;
  if (!std::regex_search(text, match, std::regex(label + R"(\s*=?\s*([-+0-9.e]+[0-9]))"))) return std::nan("");
  return std::stod(match[1]);
}

}  // namespace

FoamMeasures FoamMeasures::of(std::span<const Vec3> points, const PolyhedralCells& cells) {
  const PolyhedralQuality quality = polyhedral_quality(points, cells);
  return {quality.largest_aspect_ratio.value, quality.largest_non_orthogonality.value, quality.average_non_orthogonality,
          quality.largest_skewness.value, quality.failed_checks()};
}

std::optional<FoamMeasures> check_mesh(const fs::path& folder, const std::string& time) {
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
  return FoamMeasures{printed(text, "Max aspect ratio"), printed(text, "Mesh non-orthogonality Max:"), printed(text, "average:"),
                      printed(text, "Max skewness"), std::isnan(failed) ? 0 : static_cast<std::size_t>(failed)};
}

void make_foam_case(const fs::path& source, const fs::path& folder) {
  fs::remove_all(folder);
  fs::create_directories(folder);
  for (const char* part : {"constant", "system"}) fs::create_directory_symlink(fs::absolute(source / part), folder / part);
}

void print_head() {
  std::printf(
      "| mesh | by | aspect ratio | non-orthogonality | average | skewness | failed checks |\n|---|---|---|---|---|---|---|\n");
}

void print_row(const std::string& mesh, const std::string& by, const FoamMeasures& m) {
  std::printf("| %s | %s | %.4g | %.5g | %.4g | %.4g | %zu |\n", mesh.c_str(), by.c_str(), m.aspect_ratio, m.non_orthogonality,
              m.average, m.skewness, m.failed);
  std::fflush(stdout);
}

Region roof_patch(const Mesh& mesh) {
  const Region body{Region::GroupName{"car_body"}};
  double top = 0;
  for (const PointId id : select(body, mesh, "body")) top = std::max(top, mesh.points[id][2]);
  return {Region::Intersection{{body, {Region::InHalfSpace{{0, 0, top - 0.1}, {0, 0, 1}}}}}};
}

Region three_roof_points(const Mesh& mesh) {
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

Setup roof_setup(Region roof) {
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

Design roof_raised_by(double metres) {
  Design design;
  design.motions.push_back({0, Affine{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, metres}});
  return design;
}

}  // namespace deform::bench
