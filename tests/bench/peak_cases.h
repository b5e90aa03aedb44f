// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"

namespace deform::test {

/// A mesh and a setup whose preparation takes at least 64 MiB.
struct PeakCase {
  const char* name;
  std::shared_ptr<const Mesh> (*mesh)();
  Setup (*setup)();
};

const std::vector<PeakCase>& peak_cases();

}  // namespace deform::test
