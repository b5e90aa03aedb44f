// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/methods/methods.h"

#include <algorithm>
#include <chrono>

#include "core/numerics/lattice/lattice_options.h"

namespace deform::bench {

namespace {

Region controls_where(const std::vector<Vec3>& places, const std::function<bool(const Vec3&)>& moves) {
  Region::ControlIds chosen;
  for (std::size_t p = 0; p < places.size(); ++p) {
    if (moves(places[p])) chosen.ids.push_back(static_cast<std::uint32_t>(p));
  }
  return {std::move(chosen)};
}

}  // namespace

const char* to_string(MethodKind kind) {
  switch (kind) {
    case MethodKind::ffd_controls:
      return "FFD";
    case MethodKind::ffd_mesh:
      return "DM-FFD";
    case MethodKind::ffd_energy:
      return "energy FFD";
    case MethodKind::cage_controls:
      return "cage";
    case MethodKind::cage_mesh:
      return "DM-cage";
    case MethodKind::rbf:
      return "RBF";
    case MethodKind::shell:
      return "shell";
    case MethodKind::subspace:
      return "subspace";
    case MethodKind::mls:
      return "MLS";
  }
  return "";
}

bool selects_controls(MethodKind kind) { return kind == MethodKind::ffd_controls || kind == MethodKind::cage_controls; }

Setup setup_of(const Task& task, MethodKind kind) {
  Setup setup;
  setup.handles = {{"handle", {Region::Ids{task.handle}}}};
  if (!task.fixed.empty()) setup.fixed = {{Region::Ids{task.fixed}}};
  const auto by_controls = [&](const std::vector<Vec3>& places) {
    setup.handles[0].region = controls_where(places, task.moves);
    setup.fixed.clear();
  };
  const auto ffd = [&](FfdControl control) {
    FfdOptions options;
    options.control = control;
    options.lattice.points = task.lattice;
    return options;
  };
  const auto cage = [&](CageControl control) {
    CageOptions options;
    options.control = control;
    options.vertices = task.cage.vertices;
    options.triangles = task.cage.triangles;
    return options;
  };
  switch (kind) {
    case MethodKind::ffd_controls:
      setup.method = ffd(FfdControl::controls);
      by_controls(lattice_around(ffd(FfdControl::controls).lattice, bounding_box(task.mesh->points)).control_points());
      break;
    case MethodKind::ffd_mesh:
      setup.method = ffd(FfdControl::mesh);
      break;
    case MethodKind::ffd_energy:
      setup.method = ffd(FfdControl::energy);
      break;
    case MethodKind::cage_controls:
      setup.method = cage(CageControl::controls);
      by_controls(task.cage.vertices);
      break;
    case MethodKind::cage_mesh:
      setup.method = cage(CageControl::mesh);
      break;
    case MethodKind::rbf: {
      RbfOptions options;
      options.reduction = CentreReduction::off;
      setup.method = options;
      break;
    }
    case MethodKind::shell:
      setup.method = ShellOptions{};
      break;
    case MethodKind::subspace: {
      SubspaceOptions options;
      options.centres = task.samples;
      setup.method = options;
      break;
    }
    case MethodKind::mls: {
      MlsOptions options;
      options.surface_samples = task.samples;
      setup.method = options;
      break;
    }
  }
  return setup;
}

Design design_of(const Task& task) {
  Design design;
  design.motions.push_back({0, task.motion});
  return design;
}

double seconds_of(const std::function<void()>& run, int runs) {
  double least = 1e300;
  for (int k = 0; k < runs; ++k) {
    const auto start = std::chrono::steady_clock::now();
    run();
    least = std::min(least, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return least;
}

}  // namespace deform::bench
