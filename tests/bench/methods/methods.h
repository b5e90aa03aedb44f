// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/deformers/system.h"
#include "tests/bench/methods/shapes.h"

namespace deform::bench {

/// One handle that moves and points that stay, by every method.
struct Task {
  std::shared_ptr<const Mesh> mesh;
  std::vector<PointId> handle, fixed;  ///< ascending
  Affine motion = identity_affine;     ///< of the handle
  /// Where handles select control points: whether one at x moves with the handle.
  std::function<bool(const Vec3& x)> moves;
  CageShape cage;
  std::array<std::size_t, 3> lattice{8, 8, 8};  ///< control points
  std::size_t samples = 800;                    ///< of the functions of energies in space
};

enum class MethodKind { ffd_controls, ffd_mesh, ffd_energy, cage_controls, cage_mesh, rbf, shell, subspace, mls };
inline constexpr std::array all_methods{MethodKind::ffd_controls,  MethodKind::ffd_mesh,  MethodKind::ffd_energy,
                                        MethodKind::cage_controls, MethodKind::cage_mesh, MethodKind::rbf,
                                        MethodKind::shell,         MethodKind::subspace,  MethodKind::mls};
/// "DM-FFD"
const char* to_string(MethodKind kind);
/// Whether handles select control points, so that where the handle's points go follows from that.
bool selects_controls(MethodKind kind);

/// All constraint points are centres of an RBF. Everything else is as a user gets it who names nothing but the lattice, the cage
/// or the number of samples.
Setup setup_of(const Task& task, MethodKind kind);
Design design_of(const Task& task);

/// Least of some runs, seconds.
double seconds_of(const std::function<void()>& run, int runs = 3);

using Json = nlohmann::ordered_json;

// The sections of thesis chapter 4, each as a JSON object. `quick` takes smaller meshes.
Json performance(bool quick);         // 4.2, figure 4.1
Json robustness(bool quick);          // 4.3, figure 4.2
Json smoothness(bool quick);          // 4.4, figure 4.4
Json lattice_resolution(bool quick);  // 4.4, figures 4.5 and 4.6
Json adaptivity(bool quick);          // 4.5, figure 4.7
Json precision(bool quick);           // 4.6, table 4.1
Json pipe(bool quick);                // 7.3.1, figures 7.6 and 7.7
/// 7.3.2, table 7.2. The OpenFOAM case of car_fastback; `work` is a folder for checkMesh, which goes away again.
Json car(const std::filesystem::path& car_case, const std::filesystem::path& work);

}  // namespace deform::bench
