// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include "core/deformers/system.h"

namespace deform::test {

/// What an estimate says of memory is no less than what was taken, and at most 2.5 times as much; its counts are those of the
/// system.
inline void expect_bounds(const Estimate& expected, const SystemInfo& info) {
  EXPECT_GE(expected.basis_bytes, info.basis_bytes);
  EXPECT_GE(expected.resident_bytes, info.bytes);
  EXPECT_LE(static_cast<double>(expected.resident_bytes), 2.5 * static_cast<double>(info.bytes));
  EXPECT_GE(expected.peak_bytes, expected.resident_bytes);
  EXPECT_EQ(expected.samples, info.samples);
  EXPECT_EQ(expected.constraint_points, info.constraint_points);
}

}  // namespace deform::test
