// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <functional>
#include <ostream>
#include <vector>

#include "core/deformers/setup.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/numerics/cages.h"

namespace deform::test {

/// A method whose designs come from a handle basis.
struct BasisCase {
  const char* name;
  decltype(deform::Setup::method) method;
  bool stored_exactly = true;
  std::function<void(deform::Setup&)> change = {};

  /// With four design variables, for bumpy_sheet().
  deform::Setup setup() const {
    deform::Setup setup = setup_with_variables();
    setup.method = method;
    if (change) change(setup);
    return setup;
  }
};

inline void PrintTo(const BasisCase& value, std::ostream* out) { *out << value.name; }

inline std::vector<BasisCase> basis_cases() {
  const auto soft = [](auto options) {
    options.handles = HandleMode::soft;
    return options;
  };
  FfdOptions energy, mesh, controls;
  energy.lattice.points = {11, 8, 5};
  mesh.lattice.points = controls.lattice.points = {8, 6, 4};
  mesh.control = FfdControl::mesh;
  controls.control = FfdControl::controls;
  RbfOptions always, iterative, compressed, biharmonic;
  always.basis = BasisMode::always;
  iterative.solver = Solver::iterative;
  iterative.kernel = Kernel::biharmonic;
  compressed.basis_tolerance = 1e-9;
  biharmonic.kernel = Kernel::biharmonic;
  CageOptions cage;
  const CageMesh box = prism({{1.1, 0.6, 0}, {1.1, 1.3, 0}, {-0.2, 1.3, 0}, {-0.2, -0.3, 0}, {2.4, -0.3, 0}, {2.4, 0.6, 0}}, 1);
  cage.vertices = box.vertices;
  for (Vec3& x : cage.vertices) x[2] -= 0.5;
  cage.triangles = box.triangles;
  const auto vertices = [](deform::Setup& setup) {
    setup.handles[0].region = {Region::ControlIds{{5, 4, 10, 11}}};
    setup.handles[1].region = {Region::ControlIds{{0, 7}}};
    setup.fixed = {{Region::ControlIds{{2, 3}}}};
  };
  const auto lattice = [](deform::Setup& setup) {
    std::vector<std::uint32_t> right, middle;
    for (std::uint32_t i = 0; i < 8 * 6 * 4; ++i) {
      if (i % 8 >= 6) right.push_back(i);
      if (i % 8 == 4) middle.push_back(i);
    }
    setup.handles[0].region = {Region::ControlIds{right}};
    setup.handles[1].region = {Region::ControlIds{middle}};
    setup.fixed.clear();
  };
  return {{"rbf", always},
          {"rbf_biharmonic", biharmonic},
          {"rbf_iterative", iterative},
          {"rbf_compressed", compressed, false},
          {"shell", ShellOptions{}},
          {"shell_soft", soft(ShellOptions{})},
          {"subspace", SubspaceOptions{}},
          {"mls", MlsOptions{}},
          {"mls_soft", soft(MlsOptions{})},
          {"ffd_energy", energy},
          {"ffd_mesh", mesh},
          {"ffd_controls", controls, true, lattice},
          {"cage", cage, true, vertices}};
}

}  // namespace deform::test
