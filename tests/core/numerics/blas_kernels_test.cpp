// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/blas_kernels.h"

#include <gtest/gtest.h>

namespace deform::lapack::blas_kernels_test {
namespace {

TEST(BlasKernels, AreReplacedWhereTheProcessorCanDoMore) {
  const ProcessorFeatures old{false, false}, avx2{true, false}, avx512{true, true};
  for (const char* chosen : {"Prescott", "Nehalem", "Barcelona", "Sandybridge"}) {
    EXPECT_EQ(better_kernels(chosen, old), "") << chosen;
    EXPECT_EQ(better_kernels(chosen, avx2), "Haswell") << chosen;
    EXPECT_EQ(better_kernels(chosen, avx512), "SkylakeX") << chosen;
  }
}

TEST(BlasKernels, StayWhereOpenBlasKnowsTheProcessor) {
  for (const char* chosen : {"Haswell", "Zen", "Excavator", "SkylakeX", "Cooperlake", "SapphireRapids"}) {
    EXPECT_EQ(better_kernels(chosen, {true, true}), "") << chosen;
  }
}

}  // namespace
}  // namespace deform::lapack::blas_kernels_test
