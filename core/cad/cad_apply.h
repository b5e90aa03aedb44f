// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/cad/mesh_motion.h"

namespace deform::cad {

/// Where a deformation takes points, in their order: n x 3 to n x 3, in the unit of the mesh. It must be a function of the place
/// alone. Called from one thread, a few times, with many points at once.
using SpaceMap = std::function<Points(std::span<const Vec3> points)>;

/// Deforms a CAD model.
struct ApplyRequest {
  std::filesystem::path model;   ///< .step .stp .iges .igs .brep
  std::filesystem::path output;  ///< .step .stp .brep
  double scale = 1;              ///< from the unit of the model to that of the map; > 0
  double tolerance = 1e-6;       ///< largest distance of the new geometry from the deformed one, as a fraction of D; 1e-9..1e-2
  /// Faces and edges that move rigidly up to this distance, a fraction of D, keep their type; 0..1e-2, 0: a tenth of the
  /// tolerance.
  double rigid = 0;
  const MeshMotion* mesh = nullptr;  ///< of the model as the map moves it; its nodes hold faces
  /// Faces go as the nodes on them do, rigidly or to a surface of their type, where the map between the nodes differs from that
  /// by up to this distance, a fraction of D; 0..1e-2, 0: none.
  double hold = 1e-3;
  /// Look for faces that go through each other though they have no vertex in common, and did not at rest; as close as half a
  /// thousandth of D.
  enum class Crossings { ignored, looked_for } crossings = Crossings::ignored;
  std::size_t checks = 20000;  ///< random points of the faces at which the result is measured, each face has at least 20
  std::uint64_t seed = 1;      ///< of these points
};
/// Throws Error(invalid_argument) naming the field and its limits.
void check_request(const ApplyRequest& request);

/// What became of a face.
struct DeformedFace {
  enum class Became { kept, moved, reshaped, fitted };
  int number = 0;    ///< from 1, in the order of the file
  std::string type;  ///< before: "plane", "cylinder", ...
  Became became =
      Became::fitted;  ///< moved: rigidly, with its type; reshaped: with its type and other dimensions, or points slide in it
  std::array<int, 2> poles{};  ///< of the B-spline surface of a fitted face, along u and v
  double error = 0;            ///< largest distance at the random points on it, model units; of a held one 0
  bool held = false;           ///< it goes as the nodes of the mesh on it do
  double overlooked = 0;       ///< of a held face: how far the map is from that at the random points, model units
};

/// A CAD model that was deformed and written.
struct DeformedModel {
  std::vector<DeformedFace> faces;
  std::vector<std::string> notes;             ///< whole sentences
  double diagonal = 0;                        ///< D before, model units
  double error = 0;                           ///< largest distance at the random points, model units
  double rms = 0;                             ///< of these distances
  double overlooked = 0;                      ///< largest of the held faces
  double gap = 0;                             ///< largest distance of edges from their faces, model units
  std::size_t checks = 0;                     ///< random points
  std::size_t samples = 0;                    ///< points at which the map was asked for, besides these
  int rounds = 0;                             ///< calls of the map
  std::vector<int> coarse;                    ///< numbers of faces with an error above twice the tolerance
  std::vector<std::array<int, 2>> crossings;  ///< numbers of faces that go through each other, where that was looked for
  /// Elapsed seconds: "read", "map", "fit", "build", "check", "crossings", "write", "read again".
  std::vector<std::pair<std::string, double>> stages;
  std::size_t count(DeformedFace::Became became) const {
    std::size_t sum = 0;
    for (const DeformedFace& face : faces) sum += face.became == became ? 1 : 0;
    return sum;
  }
};

/// Applies a map of space to the exact geometry of a CAD model and writes it with the same topology, names and colours. Each
/// surface becomes a cubic B-spline surface in the same (u, v) that interpolates the map at nodes, of which there are as many as
/// the tolerance needs, with the kinks of the original; curves likewise. Faces that move rigidly, within a tenth of the
/// tolerance, keep their type and move; what does not move is kept. The result is written only if it is valid, before writing and
/// after reading it again. Deterministic. Any thread may call, one at a time: reading and writing set global options of
/// OpenCASCADE.
///
/// Throws Error(not_found, invalid_argument): a file that cannot be read or holds no face, an output of another format, a model
/// that does not lie at the mesh, a map that is not finite. Error(failed_precondition): the deformed model is not valid (naming
/// faces), turned inside out, or an edge of it shrinks to a point, nothing is written; no OpenCASCADE in this program.
/// Error(cancelled, deadline_exceeded) by the context; what the map throws.
DeformedModel apply_to_model(const ApplyRequest& request, const SpaceMap& map, const RunContext& context = {});

}  // namespace deform::cad
