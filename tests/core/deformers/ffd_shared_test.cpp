// SPDX-License-Identifier: GPL-3.0-or-later
// Direct manipulation on the model of thesis 4.3, figure 4.3: what the clamp does.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>

#include "core/io/mesh_file.h"
#include "tests/core/deformers/energy_cases.h"

namespace deform::ffd_shared_test {
namespace {

const std::filesystem::path folder = std::filesystem::path(DEFORM_SHARED_DATA) / "A_surface";

/// Both ends of Fandisk, one of which is turned and shifted.
deform::Setup fandisk_setup(std::size_t points, FfdControl control, double clamp) {
  deform::Setup setup;
  setup.handles = {{"end", test::box({-9, -9, 0.35}, {9, 9, 9})}};
  setup.fixed = {test::box({-9, -9, -9}, {9, 9, -0.35})};
  FfdOptions options;
  options.lattice.points = {points, points, points};
  options.control = control;
  options.clamp = clamp;
  setup.method = options;
  return setup;
}

struct Result {
  double misfit = 0, motion = 0, roughness = 0;
  std::string notes;
};

Result result_of(const std::shared_ptr<const Mesh>& mesh, std::size_t points, FfdControl control, double clamp) {
  const auto system = prepare(mesh, fandisk_setup(points, control, clamp));
  const Design design{{}, {{0, test::turn_and_shift()}}};
  const auto report = system->bind({&design, 1}, EvaluationPath::direct, {})->report(0);
  const double D = system->info().diagonal;
  Result result{report.interpolation_residual / D, report.control_displacement / D, 0, ""};
  for (const std::string& note : system->info().notes) result.notes += note + "\n";
  std::printf("%zu^3, clamp %.0e: misfit %.2e D, control points move %.2e D\n%s", points, clamp, result.misfit, result.motion,
              result.notes.c_str());
  return result;
}

TEST(FfdOnFandisk, SmallClampsThrowControlPointsFar) {
  const std::shared_ptr<const Mesh> mesh = io::read_mesh_file(folder / "fandisk.off.gz")->mesh();
  for (const std::size_t points : {5u, 6u, 7u, 8u, 9u, 10u, 11u}) {
    std::map<double, Result> by;
    for (const double clamp : {0.0, 1e-4, 1e-6, 1e-12}) by[clamp] = result_of(mesh, points, FfdControl::mesh, clamp);
    EXPECT_GE(by[1e-4].misfit, by[1e-12].misfit);
    if (points < 11 && points != 8 && points != 10) {  // these meet the handles, and nothing is left to move far for
      EXPECT_GE(by[1e-12].motion, 10 * by[1e-6].motion);
    }
    double best = by[0].misfit;  // without control points far away
    for (const auto& [clamp, result] : by) {
      if (result.motion <= 3) best = std::min(best, result.misfit);
    }
    EXPECT_LT(by[0].misfit, std::max(3 * best, 1e-6)) << points;  // the latter is what clamps may cost
    EXPECT_LT(by[0].motion, 3) << points;
  }
}

}  // namespace
}  // namespace deform::ffd_shared_test
