// SPDX-License-Identifier: GPL-3.0-or-later
// That of GoogleTest, with the kernels of OpenBLAS that the server computes with.
#include <gtest/gtest.h>

#include "core/numerics/dense/blas_kernels.h"

int main(int argc, char** argv) {
  deform::lapack::use_kernels_of_processor(argv);
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
