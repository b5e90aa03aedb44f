// SPDX-License-Identifier: GPL-3.0-or-later
// Cages of half models, for handles that hold their vertices.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/energy_cases.h"
#include "tests/core/deformers/mirrored_sheet.h"
#include "tests/core/numerics/cages.h"

namespace deform::test {

inline Region control_ids(std::vector<std::uint32_t> list) { return {Region::ControlIds{std::move(list)}}; }

inline CageOptions options_of(const CageMesh& mesh) {
  CageOptions options;
  options.control = CageControl::controls;
  options.vertices = mesh.vertices;
  options.triangles = mesh.triangles;
  return options;
}

/// A box whose sides have a vertex in the middle, so that it is its own image in three planes: corners 0 to 7, bit k at the far
/// end of axis k, then two middles for each axis, near and far.
inline CageMesh pyramids(const Vec3& low, const Vec3& high) {
  CageMesh mesh;
  for (unsigned c = 0; c < 8; ++c) {
    Vec3 x{};
    for (std::size_t k = 0; k < 3; ++k) x[k] = (c >> k & 1u) != 0 ? high[k] : low[k];
    mesh.vertices.push_back(x);
  }
  for (unsigned k = 0; k < 3; ++k) {
    const unsigned i = 1u << (k + 1) % 3, j = 1u << (k + 2) % 3;
    for (unsigned far = 0; far < 2; ++far) {
      const unsigned base = far << k;
      Vec3 middle = 0.5 * (low + high);
      middle[k] = far != 0 ? high[k] : low[k];
      const auto m = static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.vertices.push_back(middle);
      const std::array<std::uint32_t, 4> round{base, base | i, base | i | j, base | j};
      for (std::size_t e = 0; e < 4; ++e) {
        Cage::Triangle t{round[e], round[(e + 1) % 4], m};
        if (far == 0) std::swap(t[0], t[1]);
        mesh.triangles.push_back(t);
      }
    }
  }
  return mesh;
}

/// Around the whole of a bumpy sheet in the plane y = 0, and from this plane on.
inline constexpr Vec3 cage_low{-0.2, -1.3, -0.6}, cage_high{2.3, 1.3, 0.7}, cage_cut{-0.2, 0, -0.6};

/// "end" holds the far corners at high y, "middle" the middle of the side there; of a cage from `from` on.
inline deform::Setup cage_setup(const CageOptions& options, std::vector<std::uint32_t> end = {3, 7}) {
  deform::Setup setup = half_setup(options);
  setup.handles[0].region = control_ids(std::move(end));
  setup.handles[1].region = control_ids({11});
  setup.fixed = {control_ids({8})};
  return setup;
}

/// The displacement of each vertex that handles move, zero for the others.
inline std::vector<Vec3> own_displacements(const deform::Setup& setup, const Mesh& mesh, const CageOptions& cage,
                                           const Design& design) {
  const SelectedRegions regions = validate(setup, mesh);
  const std::vector<Affine> motions = handle_motions(setup, design.variables);
  std::vector<Vec3> moved(cage.vertices.size());
  for (std::size_t h = 0; h < motions.size(); ++h) {
    for (const PointId p : regions.handles[h]) moved[p] = transformed(motions[h], cage.vertices[p]) - cage.vertices[p];
  }
  return moved;
}

/// The points of a mesh in a cage of which every vertex has a displacement, without planes.
inline Points moved_in(const CageOptions& cage, const Mesh& mesh, const std::vector<Vec3>& displacements) {
  std::vector<std::uint32_t> all;
  for (std::uint32_t v = 0; v < cage.vertices.size(); ++v) all.push_back(v);
  deform::Setup setup;
  setup.method = cage;
  setup.handles = {{"all", control_ids(std::move(all))}};
  return prepare(shared(Mesh(mesh)), setup)->evaluate({{}, {{0, displacements}}});
}

}  // namespace deform::test
