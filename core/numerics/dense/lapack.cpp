// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/dense/lapack.h"

#include <mutex>

namespace deform::lapack {

void use_one_thread() {
  static std::once_flag once;
  std::call_once(once, [] { openblas_set_num_threads(1); });
}

}  // namespace deform::lapack
