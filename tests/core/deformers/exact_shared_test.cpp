// SPDX-License-Identifier: GPL-3.0-or-later
// Exact constraints on sets that detect() finds on real meshes.
#include <gtest/gtest.h>

#include <filesystem>

#include "core/io/mesh_file.h"
#include "tests/core/deformers/detected_cases.h"
#include "tests/support/long_tests.h"

namespace deform::exact_shared_test {
namespace {

TEST(ExactConstraints, NoPointOfRealMeshesIsThrownAway) {
  const std::filesystem::path folder = std::filesystem::path(DEFORM_SHARED_DATA) / "A_surface";
  const bool many = test::long_tests();
  test::ExactCases cases;
  for (const char* name :
       {"joint.off", "spool.off", "pipe.off", "joint_remeshed.off.gz", "fandisk.off.gz", "anchor_dense.off.gz"}) {
    if (!many && cases.cases >= 4) break;
    cases.check(name, io::read_mesh_file(folder / name)->mesh(), many ? 20 : 2);
  }
  EXPECT_GE(cases.cases, many ? 60u : 3u);
}

}  // namespace
}  // namespace deform::exact_shared_test
