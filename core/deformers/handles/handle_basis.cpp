// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/handle_basis.h"

#include <algorithm>

namespace deform {

bool wants_basis(BasisMode mode, std::size_t basis_bytes, std::size_t factor_bytes) {
  constexpr std::size_t always_fits = std::size_t{1} << 30;
  if (mode != BasisMode::automatic) return mode == BasisMode::always;
  return basis_bytes <= std::max(4 * factor_bytes, always_fits);
}

}  // namespace deform
