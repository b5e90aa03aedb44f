// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/io/mesh_file.h"
#include "core/quality/mesh_quality.h"

namespace deform::cli {

/// A mesh and all that was measured of it.
struct MeasuredMesh : MeshQuality {
  std::string path;
  std::unique_ptr<io::MeshFile> file;
  std::vector<FaceId> wall_faces;  ///< ascending

  const Mesh& mesh() const { return *mesh_; }
  MeasuredMesh(const std::string& file_path, const io::ReadOptions& reading);

 private:
  std::shared_ptr<const Mesh> mesh_;
};

/// Reads and measures, with the first layer on the walls, which are groups of faces. Left-handed are the cells that are so at the
/// points of `rest`, and one corner those that are at one place there; these are the points of the mesh itself when it is null or
/// another mesh. Throws Error(invalid_argument) when
/// there is no such group, or walls are asked of a surface.
MeasuredMesh measured_mesh(const std::string& path, const std::vector<std::string>& walls, const io::ReadOptions& reading = {},
                           const Mesh* rest = nullptr);

/// A mesh and, where it is asked for, what it was before.
struct Comparison {
  MeasuredMesh after;
  std::optional<MeasuredMesh> before;
  bool same_points = false;  ///< as many points and the same faces: every point has a displacement
  std::vector<std::string> notes;
};

struct ComparisonInput {
  std::string file, before;  ///< before: may be empty
  std::vector<std::string> walls;
  std::string setup;  ///< a setup file whose regions have borders, or empty
  io::ReadOptions reading{};
};

/// Measures, and adds displacement, flipped faces, faces that ran into others and the jumps at the borders of regions. The
/// regions are selected on the original where the points are the same: a box means what it holds before the deformation.
Comparison compare(const ComparisonInput& input);

}  // namespace deform::cli
