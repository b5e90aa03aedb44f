// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>
#include <string_view>

namespace deform::lapack {

/// What a processor and its operating system offer.
struct ProcessorFeatures {
  bool avx2 = false;    ///< with FMA
  bool avx512 = false;  ///< foundation, BW, DQ and VL
};
ProcessorFeatures processor_features();

/// The kernels of OpenBLAS in use, by the names of OPENBLAS_CORETYPE.
std::string kernels();

/// The name of the kernels of OpenBLAS that such a processor should use instead of the `chosen` ones; empty if these are as
/// good.
std::string better_kernels(std::string_view chosen, const ProcessorFeatures& features);

/// OpenBLAS takes the kernels of the oldest processors where it does not know the model, that is on every processor younger than
/// itself: factorizations take four times as long. The choice is made while the library is loaded. If there are better kernels,
/// this starts the program again, in the same process, with OPENBLAS_CORETYPE set; it does nothing if the variable is set
/// already, or if that fails. To be called first in main(), before there are threads.
void use_kernels_of_processor(char** argv);

}  // namespace deform::lapack
