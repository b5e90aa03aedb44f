// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/elements.h"
#include "core/mesh/mesh.h"

namespace deform::bench {

/// A volume mesh and the way of its boundary points from the initial design to the final one (thesis 7.2: Bore and Pipe).
struct ParamCase {
  static constexpr std::size_t steps = 20;

  std::string name;
  std::shared_ptr<const Mesh> mesh;
  std::shared_ptr<const Elements> elements;
  std::vector<PointId> boundary;  ///< ascending
  std::vector<Points> places;     ///< steps + 1: of the boundary points, in their order; places[0] is the mesh at rest
  double diagonal = 0;            ///< of the mesh at rest
};

/// NAME of bore_hex, bore_tet, pipe_hex, pipe_tet in a folder of B_volume/param. Throws what read_mesh_file() throws,
/// Error(invalid_argument) when the table of the boundary does not fit the mesh.
ParamCase read_param_case(const std::filesystem::path& folder, const std::string& name);

/// All boundary points as one handle that moves point by point, all of them centres, nothing fixed.
Setup boundary_setup(const ParamCase& param, Kernel kernel);

/// From one place of the boundary to another.
Design boundary_motion(const Points& from, const Points& to);

/// How the steps of a case are taken.
enum class Walk {
  absolute,  ///< each from the mesh at rest, one system for all
  relative,  ///< each from the step before, a system for every one
};

enum class Method { biharmonic, triharmonic, quintic, harmonic };
const char* to_string(Method method);

/// The mesh after every step, by its scaled Jacobians; [0] is at rest.
struct Series {
  std::vector<double> least;          ///< NaN from where the method broke down
  std::vector<std::size_t> inverted;  ///< elements; all of them from where the method broke down
  double seconds = 0;
  double condition = 0;  ///< largest of the systems
  double residual = 0;   ///< largest |interpolant - place| over the boundary points, over D
  double boundary = 0;   ///< largest |deformed point - place| over the boundary points, over D
  std::string failure;
  Points last;  ///< the mesh at full change
};

/// The steps 1 .. steps, `stride` at a time.
Series walk(const ParamCase& param, Method method, Walk mode, std::size_t stride = 1);

/// In how many steps one is at least as good as the other, up to 1e-9 (elements with all points on the boundary are the same).
struct Comparison {
  std::size_t steps = 0, at_least = 0;
  std::size_t last_below = 0;  ///< the last of the others, as an index into Series; 0 = none
  double shortfall = 0;        ///< largest over the others
};
Comparison compare(const Series& ours, const Series& theirs);

/// A ball of tetrahedra whose inside moves (thesis 8.6.2, figure 8.12): the points within 0.35 of its radius are the handle, the
/// surface is fixed.
struct InnerSphere {
  std::shared_ptr<const Mesh> mesh;
  std::shared_ptr<const Elements> elements;
  Setup setup;    ///< triharmonic
  Design design;  ///< the handle shifted along x
};

/// shift: in radii of the ball.
InnerSphere read_inner_sphere(const std::filesystem::path& file, double shift);

}  // namespace deform::bench
