// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "core/deformers/system.h"
#include "core/mesh/cells.h"
#include "core/mesh/mesh.h"
#include "core/mesh/region.h"

namespace deform::bench {

/// What thesis table 7.2 and section 8.6.3 have of a polyhedral mesh. Angles in degrees.
struct FoamMeasures {
  double aspect_ratio = 0, non_orthogonality = 0, average = 0, skewness = 0;
  std::size_t failed = 0;  ///< checks

  /// By our measures.
  static FoamMeasures of(std::span<const Vec3> points, const PolyhedralCells& cells);
};

/// What checkMesh prints about a time folder of a case; nothing where it is not installed.
std::optional<FoamMeasures> check_mesh(const std::filesystem::path& folder, const std::string& time);

/// A case folder with the mesh of another one, for time folders. What is there goes away.
void make_foam_case(const std::filesystem::path& source, const std::filesystem::path& folder);

/// The table "mesh | by | ..." of such measures on standard output.
void print_head();
void print_row(const std::string& mesh, const std::string& by, const FoamMeasures& measures);

/// car_fastback in its box: the points of the body within 0.1 m of its top.
Region roof_patch(const Mesh& mesh);

/// car_fastback: front, middle and rear of its roof, in the plane of symmetry (thesis 7.3.2).
Region three_roof_points(const Mesh& mesh);

/// car_fastback: a handle "roof", the outer box fixed. RBF with all centres.
Setup roof_setup(Region roof);
Design roof_raised_by(double metres);

}  // namespace deform::bench
