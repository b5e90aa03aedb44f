// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/sample_doubling.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <string>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "core/io/mesh_file.h"
#include "core/mesh/ahmed.h"
#include "tests/support/end_handles.h"

namespace deform::bench {

#ifdef DEFORM_SHARED_DATA

namespace {

/// By `degrees` about (1, 2, 3) through a point, a little shear if asked for, and a shift by a tenth of D along (1, 1, 1).
Affine turned(double degrees, double shear, const Vec3& through, double D) {
  const double angle = degrees * M_PI / 180, c = std::cos(angle), s = std::sin(angle), root = std::sqrt(14.0);
  const Vec3 n{1 / root, 2 / root, 3 / root};
  Affine map{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) map[4 * i + j] = (i == j ? c : 0) + (1 - c) * n[i] * n[j];
  }
  map[1] -= s * n[2] - shear;
  map[2] += s * n[1];
  map[4] += s * n[2];
  map[6] -= s * n[0];
  map[8] -= s * n[1];
  map[9] += s * n[0];
  for (std::size_t i = 0; i < 3; ++i) {
    map[4 * i + 3] = through[i] + 0.1 * D / std::sqrt(3.0);
    for (std::size_t j = 0; j < 3; ++j) map[4 * i + 3] -= map[4 * i + j] * through[j];
  }
  return map;
}

/// A handle at each end of the longest axis.
Setup with_ends(const Mesh& mesh, const MlsOptions& options) {
  Setup setup;
  setup.method = options;
  setup.handles = test::end_handles(mesh);
  return setup;
}

double largest_distance(const Points& a, const Points& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, distance(a[i], b[i]));
  return largest;
}

struct Prepared {
  std::shared_ptr<const System> system;
  double seconds = 0;
};

Prepared prepared(const std::shared_ptr<const Mesh>& mesh, const MlsOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  Prepared result{prepare(mesh, with_ends(*mesh, options)), 0};
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

void measure(const std::string& name, const std::shared_ptr<const Mesh>& mesh, Report& report) {
  const Box box = bounding_box(mesh->points);
  const double D = box.diagonal();
  const Vec3 middle = 0.5 * (box.min + box.max);
  MlsOptions options;
  const Prepared by_default = prepared(mesh, options);
  for (const std::string& note : by_default.system->info().notes) {
    if (note.find("do not enclose") == std::string::npos) continue;
    report.info(name, "not closed");
    return;
  }
  const Affine same = turned(30, 0.1, middle, D);
  const Points followed = by_default.system->evaluate({{}, {{0, same}, {1, same}}});
  Points expected = mesh->points;
  for (Vec3& x : expected) x = transformed(same, x);
  report.at_most(name + ": affine motion of all handles, missed by", largest_distance(followed, expected) / D, 1e-9, " D");

  // One end stays, the other turns and moves.
  const Design design{{}, {{0, identity_affine}, {1, turned(20, 0, middle, D)}}};
  const auto evaluation = by_default.system->bind({&design, 1}, EvaluationPath::automatic, {});
  const double prescribed = evaluation->report(0).prescribed_displacement;
  const Points before = by_default.system->evaluate(design);
  // The defaults where faces enclose a volume, which these do.
  options.surface_samples = 2 * 8000;
  options.volume_samples = 2 * 10000;
  const Prepared twice = prepared(mesh, options);
  report.at_most(name + " (" + std::to_string(mesh->point_count()) + " points): twice the samples move the shape by",
                 100 * largest_distance(before, twice.system->evaluate(design)) / prescribed, 1, " %");
  const auto told = [](const Prepared& of) {
    return Report::text(of.seconds) + " s, " + Report::text(static_cast<double>(of.system->info().bytes) / (1 << 20)) + " MiB, " +
           std::to_string(of.system->info().samples) + " samples";
  };
  report.info(name + ": prepared in", told(by_default) + "; with twice the samples " + told(twice));
}

}  // namespace

void measure_sample_doubling(std::span<const char* const> names, Report& report) {
  constexpr const char* all[] = {"bumpy-cube.obj.gz",         "rocker-arm.obj.gz",   "fandisk.off.gz",      "sphere_7800.off.gz",
                                 "joint_remeshed.off.gz",     "anchor_dense.off.gz", "car_fastback.stl.gz", "flange.stl.gz",
                                 "ChineseDragon-10kv.off.gz", "fandisk_dual.off.gz", "pinion.off",          "spool.off",
                                 "propellerTip.obj.gz"};
  const std::string folder = std::string(DEFORM_SHARED_DATA) + "/A_surface/";
  if (names.empty()) {
    measure("Ahmed body", std::make_shared<const Mesh>(ahmed_body({.target_points = 20000})), report);
    names = all;
  }
  for (const char* name : names) measure(name, io::read_mesh_file(folder + name)->mesh(), report);
}

#else

void measure_sample_doubling(std::span<const char* const> /*names*/, Report& report) {
  report.info("real closed surfaces", "no folder of real meshes");
}

#endif

}  // namespace deform::bench
