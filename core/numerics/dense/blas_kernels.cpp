// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/blas_kernels.h"

#include <cblas.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <system_error>

namespace deform::lapack {

ProcessorFeatures processor_features() {
  ProcessorFeatures features;
#if defined(__x86_64__)
  __builtin_cpu_init();
  features.avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  features.avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                    __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
#endif
  return features;
}

std::string kernels() { return openblas_get_corename(); }

std::string better_kernels(std::string_view chosen, const ProcessorFeatures& features) {
  // Kernels that use AVX2 at least. OpenBLAS knows the processors that have AVX-512 but for which it takes AVX2.
  constexpr std::string_view good[] = {"Haswell", "Zen", "Excavator", "SkylakeX", "Cooperlake", "SapphireRapids"};
  if (!features.avx2 || std::find(std::begin(good), std::end(good), chosen) != std::end(good)) return {};
  return features.avx512 ? "SkylakeX" : "Haswell";
}

void use_kernels_of_processor(char** argv) {
  constexpr const char* variable = "OPENBLAS_CORETYPE";
  if (std::getenv(variable) != nullptr) return;  // NOLINT(concurrency-mt-unsafe): there are no threads yet
  const std::string better = better_kernels(kernels(), processor_features());
  if (better.empty() || setenv(variable, better.c_str(), 0) != 0) return;  // NOLINT(concurrency-mt-unsafe)
  // By its path: the name of the process is that of the file.
  std::error_code none;
  execv(std::filesystem::read_symlink("/proc/self/exe", none).c_str(), argv);
}

}  // namespace deform::lapack
