// SPDX-License-Identifier: GPL-3.0-or-later
// The half-edge mesh beside OpenMesh and CGAL (thesis appendix A, tables A.2 to A.4): six tests, numbers of points and faces as
// made and shuffled. A ratio is that of processor times within one round, in which all data structures run in turn.
//
// usage: surface_mesh_bench [--quick]
#include <malloc.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "core/mesh/ahmed.h"
#include "core/mesh/surface_mesh/one_rings.h"
#include "core/mesh/surface_mesh/surface_mesh.h"
#include "tests/bench/connectivity_tests.h"
#include "tests/bench/report.h"

namespace deform {
namespace {

using bench::ConnectivityTests;
using bench::Report;
using Maker = std::function<std::unique_ptr<ConnectivityTests>(const Mesh&)>;

struct Library {
  const char* name;
  Maker make;
};

std::vector<Library> libraries() {
  std::vector<Library> all{{"ours", bench::own_tests}, {"ours, circulators", bench::own_circulators}};
#ifdef DEFORM_HAS_OPENMESH
  all.push_back({"OpenMesh", bench::openmesh_tests});
#endif
#ifdef DEFORM_HAS_CGAL
  all.push_back({"CGAL", bench::cgal_tests});
#endif
  return all;
}

constexpr std::size_t first_other = 2;

double processor_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

std::size_t allocated() {
  const struct mallinfo2 info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

/// Faces become vertices, in their middles, and vertices faces.
Mesh dual(const Mesh& input) {
  const SurfaceMesh mesh(input);
  Mesh made;
  for (const FaceHandle f : mesh.faces()) {
    Vec3 sum{};
    for (const VertexHandle v : mesh.vertices(f)) sum = sum + mesh.point(v);
    made.points.push_back(sum / static_cast<double>(mesh.degree(f)));
  }
  for (const VertexHandle v : mesh.vertices()) {
    std::vector<PointId> corners;
    for (const FaceHandle f : mesh.faces(v)) corners.push_back(f.index());
    std::reverse(corners.begin(), corners.end());  // counter-clockwise
    made.face_sizes.push_back(static_cast<std::uint32_t>(corners.size()));
    made.face_points.insert(made.face_points.end(), corners.begin(), corners.end());
  }
  return made;
}

/// Points and faces in random order.
Mesh shuffled(const Mesh& input) {
  std::mt19937_64 random(1);
  std::vector<PointId> number(input.point_count());
  std::iota(number.begin(), number.end(), 0U);
  std::shuffle(number.begin(), number.end(), random);
  std::vector<FaceId> faces(input.face_count());
  std::iota(faces.begin(), faces.end(), 0U);
  std::shuffle(faces.begin(), faces.end(), random);
  Mesh mesh;
  mesh.points.resize(input.point_count());
  for (std::size_t i = 0; i < number.size(); ++i) mesh.points[number[i]] = input.points[i];
  const std::vector<std::uint64_t> offsets = input.face_offsets();
  for (const FaceId f : faces) {
    mesh.face_sizes.push_back(input.face_sizes[f]);
    for (std::uint64_t c = offsets[f]; c < offsets[f + 1]; ++c) mesh.face_points.push_back(number[input.face_points[c]]);
  }
  return mesh;
}

struct Test {
  const char* name;
  std::function<double(ConnectivityTests&)> run;
  bool changes_connectivity;
};

std::vector<Test> tests(bool triangles, int times) {
  std::vector<Test> all{{"circulators", [=](ConnectivityTests& t) { return t.circulators(times); }, false},
                        {"barycentre", [=](ConnectivityTests& t) { return t.barycentre(times); }, false},
                        {"normals", [=](ConnectivityTests& t) { return t.normals(times); }, false},
                        {"smoothing", [=](ConnectivityTests& t) { return t.smoothing(times); }, false}};
  if (triangles) all.push_back({"subdivision", [](ConnectivityTests& t) { return t.subdivide(); }, true});
  all.push_back({"collapse", [](ConnectivityTests& t) { return t.collapse(); }, true});
  return all;
}

/// Processor times [library][round] in seconds.
using Times = std::vector<std::vector<double>>;

Times measure(const Test& test, std::vector<std::unique_ptr<ConnectivityTests>>& all, int rounds, const std::string& where) {
  Times times(all.size());
  for (std::size_t round = 0; round < static_cast<std::size_t>(rounds); ++round) {
    std::vector<double> results(all.size());
    for (std::size_t k = 0; k < all.size(); ++k) {
      const std::size_t i = (k + round) % all.size();  // nobody always comes first
      if (test.changes_connectivity) all[i]->copy();
      const double start = processor_seconds();
      results[i] = test.run(*all[i]);
      times[i].push_back(processor_seconds() - start);
    }
    for (const double result : results) {
      if (std::abs(result - results[0]) <= 1e-9 * std::max(1e6, std::abs(results[0]))) continue;
      std::printf("%s, %s: the data structures disagree: %.17g and %.17g\n", where.c_str(), test.name, results[0], result);
    }
  }
  return times;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 == 1 ? values[middle] : (values[middle - 1] + values[middle]) / 2;
}

/// Per round our time over the best of the others.
std::vector<double> ratios(const Times& times, std::size_t own) {
  std::vector<double> found;
  for (std::size_t round = 0; round < times[own].size(); ++round) {
    double best = times[first_other][round];
    for (std::size_t i = first_other; i < times.size(); ++i) best = std::min(best, times[i][round]);
    found.push_back(times[own][round] / best);
  }
  return found;
}

struct Case {
  const char* name;
  Mesh mesh;
  int times;  ///< of one sweep in one round: one-rings are built once for as many
  int rounds;
};

void run_case(const Case& row, const char* order, const Mesh& mesh, Report& report) {
  const std::vector<Library> known = libraries();
  std::vector<std::unique_ptr<ConnectivityTests>> all;
  std::string bytes, header = "| test |", line = "|---|";
  double own_bytes = 0;
  for (const Library& library : known) {
    const std::size_t before = allocated();
    all.push_back(library.make(mesh));
    const double each = static_cast<double>(allocated() - before) / static_cast<double>(mesh.point_count());
    if (all.size() == 1) own_bytes = each;
    if (!bytes.empty()) bytes += ", ";
    bytes += std::string(library.name) + " " + Report::text(each);
    header += std::string(" ") + library.name + ", ms |";
    line += "---|";
  }
  const std::string where = std::string(row.name) + ", " + order;
  std::printf(
      "\n### %s: %zu points, %zu faces, %d sweeps\n\nBytes for each vertex: %s; one-rings %s more\n\n%s\n%s\n", where.c_str(),
      mesh.point_count(), mesh.face_count(), row.times, bytes.c_str(),
      Report::text(static_cast<double>(OneRings(SurfaceMesh(mesh)).bytes()) / static_cast<double>(mesh.point_count())).c_str(),
      header.c_str(), line.c_str());
  const bool triangles = mesh.face_points.size() == 3 * mesh.face_count();
  std::vector<std::pair<std::string, Times>> measured;
  for (const Test& test : tests(triangles, row.times)) {
    measured.emplace_back(test.name, measure(test, all, row.rounds, where));
    std::printf("| %s |", test.name);
    for (const auto& of_library : measured.back().second) std::printf(" %.1f |", 1000 * median(of_library));
    std::printf("\n");
    std::fflush(stdout);
  }
  report.open();
  if (triangles) report.at_most(where + ": bytes for each vertex", own_bytes, 200, "");
  if (known.size() == first_other) return;
  for (const auto& [name, times] : measured) {
    std::vector<double> own = ratios(times, 0);
    report.at_most(where + ": " + name + ", median of pairs", median(own), 1.0, " times");
    report.at_most(where + ": " + name + ", worst pair", *std::max_element(own.begin(), own.end()), 1.1, " times");
    report.info(where + ": " + name + ", by circulators alone", Report::text(median(ratios(times, 1))) + " times");
  }
}

int run(bool quick) {
  std::printf("\n## Half-edge mesh (tables A.2 to A.4)\n");
#ifndef DEFORM_HAS_OPENMESH
  std::printf("\nOpenMesh (libopenmesh-dev) was not there when this was configured: its figures are left out.\n");
#endif
#ifndef DEFORM_HAS_CGAL
  std::printf("\nCGAL (libcgal-dev) was not there when this was configured: its figures are left out.\n");
#endif
  // Memory stays with the process: no test pays for pages that another gave back.
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  std::vector<Case> cases;
  cases.push_back({"300k (as Imp)", ahmed_body({.target_points = quick ? 5000u : 300000u}), 10, quick ? 3 : 5});
  cases.push_back({"dual (as Dual Dragon)", dual(ahmed_body({.target_points = quick ? 3000u : 50000u})), 10, quick ? 3 : 9});
  if (!quick) cases.push_back({"1M", ahmed_body({.target_points = 1000000}), 5, 3});
  Report report;
  for (const Case& row : cases) {
    run_case(row, "ordered", row.mesh, report);
    run_case(row, "shuffled", shuffled(row.mesh), report);
  }
  return report.missed();
}

}  // namespace
}  // namespace deform

int main(int argc, char** argv) {
  const bool quick = argc > 1 && std::strcmp(argv[1], "--quick") == 0;
  return deform::run(quick) == 0 || quick ? 0 : 1;
}
