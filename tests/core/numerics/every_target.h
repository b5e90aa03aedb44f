// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <string>
#include <vector>

#include "core/numerics/kernels/tiles.h"

namespace deform::test {

/// Runs the body once per instruction set that this machine has.
template <typename Body>
void on_every_target(const Body& body) {
  std::vector<std::string> names;
  const std::int64_t all = hwy::SupportedTargets();
  for (std::int64_t left = all; left != 0; left &= left - 1) {
    const std::int64_t target = left & -left;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().DeInit();
    SCOPED_TRACE(vector_target());
    names.emplace_back(vector_target());
    body();
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().DeInit();
  EXPECT_GE(names.size(), 2u);
}

}  // namespace deform::test
