// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "core/deformers/setup.h"

namespace deform::test {

/// Moving least squares as the thesis has them (8.4): samples and energies on the surface alone, which twelve of them cover.
inline MlsOptions thesis_mls() {
  MlsOptions options;
  options.domain = MlsDomain::surface;
  options.cover = 12;
  return options;
}

/// Subspaces as the thesis has them (8.3): nothing is added to the functions of the kernel.
inline SubspaceOptions thesis_subspace() {
  SubspaceOptions options;
  options.linear = SubspaceLinear::left_out;
  options.cover = 8;
  return options;
}

}  // namespace deform::test
