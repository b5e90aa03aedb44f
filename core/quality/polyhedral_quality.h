// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/mesh/cells.h"
#include "core/quality/extreme.h"

namespace deform {

/// OpenFOAM's limits (checkMesh and snappyHexMesh defaults): beyond them a check fails.
struct PolyhedralLimits {
  double non_orthogonality = 70;   ///< degrees; checkMesh calls faces beyond it severely non-orthogonal
  double skewness = 4;             ///< of a face
  double aspect_ratio = 1000;      ///< of a cell
  double openness = 1e-6;          ///< of a cell: its face areas should cancel
  double pyramid_volume = -1e-15;  ///< of a face and a cell: below it the face looks the wrong way
  double volume = 1e-300;          ///< of a cell
  double face_area = 1e-300;
  /// Not a limit of checkMesh's: left-handed cells, as left_handed_cells() has them (one entry each, or none at all), are not
  /// inverted by that. All other numbers stay those of checkMesh, which calls their volumes negative.
  std::vector<char> left_handed = {};
};

/// The measures that OpenFOAM's checkMesh prints, by the same formulas (primitiveMeshTools, v1912), so that the numbers agree.
struct PolyhedralQuality {
  static constexpr std::size_t bins = 18, skewness_bins = 20;

  std::size_t points = 0, faces = 0, internal_faces = 0, cells = 0;
  int geometric_dimensions = 3;
  Extreme least_volume, largest_volume;  ///< cell
  double total_volume = 0;
  Extreme least_area, largest_area;          ///< face
  Extreme largest_non_orthogonality;         ///< internal face, degrees
  double average_non_orthogonality = 0;      ///< degrees; arc cosine of the mean cosine
  Extreme largest_skewness;                  ///< face
  Extreme largest_aspect_ratio;              ///< cell
  Extreme largest_openness;                  ///< cell
  Extreme least_flatness{1, 0};              ///< face: |area vector| / sum of its triangles; 1 = flat
  std::size_t non_orthogonal_faces = 0;      ///< severe: beyond the limit, but not beyond 90 degrees
  std::size_t non_orthogonality_errors = 0;  ///< faces from 90 degrees
  std::size_t skew_faces = 0, small_faces = 0;
  std::size_t wrong_pyramids = 0;    ///< as checkMesh counts "incorrectly oriented" faces: an internal face counts for each side
  std::size_t negative_volumes = 0;  ///< cells whose volume is zero or negative
  std::size_t slender_cells = 0, open_cells = 0;
  /// Cells whose volume or a pyramid is not positive, as InversionCheck has it; checkMesh has no such number.
  std::size_t inverted_cells = 0;
  std::size_t left_handed = 0;                ///< cells
  std::vector<std::size_t> inverted;          ///< the first of the inverted cells, at most 100
  std::vector<std::size_t> wrong_faces;       ///< the first of the faces with wrong pyramids, at most 100
  std::vector<std::size_t> worst;             ///< the internal faces of largest non-orthogonality, worst first, at most 100
  std::array<std::size_t, bins> histogram{};  ///< of the non-orthogonality, from 0 to 90 degrees and beyond
  std::array<std::size_t, skewness_bins> skewness_histogram{};  ///< from 0 to 4 and beyond
  std::vector<double> cell_volume;                              ///< signed
  std::vector<double> cell_non_orthogonality;                   ///< degrees, largest of the cell's internal faces; 0 without any
  std::vector<double> face_non_orthogonality;                   ///< degrees, of the internal faces

  /// A check that fails: its name, and of how many faces or cells.
  struct Failure {
    std::string check;
    std::size_t count = 0;
  };
  /// The checks of cells and faces that fail, in the order of checkMesh (severe non-orthogonality alone is a warning there; open
  /// and slender cells fail one check).
  std::vector<Failure> failures() const;
  std::size_t failed_checks() const;
};

/// points: n x 3. Parallel over faces and cells; the result does not depend on the number of threads. Throws
/// Error(invalid_argument) when the cells name points beyond n, cancelled, deadline_exceeded.
PolyhedralQuality polyhedral_quality(std::span<const Vec3> points, const PolyhedralCells& cells,
                                     const PolyhedralLimits& limits = {}, const RunContext& context = {});

}  // namespace deform
