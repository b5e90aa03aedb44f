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

/// The limits beyond which a check fails (defaults of OpenFOAM's checkMesh and snappyHexMesh).
struct PolyhedralLimits {
  double non_orthogonality = 70;   ///< degrees; checkMesh calls faces beyond it severely non-orthogonal
  double skewness = 4;             ///< of a face
  double aspect_ratio = 1000;      ///< of a cell
  double openness = 1e-6;          ///< of a cell: its face areas should cancel
  double pyramid_volume = -1e-15;  ///< of a face and a cell: below it the face has the wrong orientation
  double volume = 1e-300;          ///< of a cell
  double face_area = 1e-300;       ///< of a face
  /// Left-handed cells, as found by left_handed_cells() (one entry for each cell, or empty), which do not count as inverted for
  /// that reason. checkMesh does not know them: all other numbers agree with it, including their negative volumes.
  std::vector<char> left_handed = {};
};

/// The measures of OpenFOAM's checkMesh by the same formulas (primitiveMeshTools, v1912), so that the numbers agree.
struct PolyhedralQuality {
  static constexpr std::size_t bins = 18;           ///< of the histogram of non-orthogonality
  static constexpr std::size_t skewness_bins = 20;  ///< of the histogram of skewness

  std::size_t points = 0;                    ///< number of points
  std::size_t faces = 0;                     ///< number of faces
  std::size_t internal_faces = 0;            ///< number of internal faces
  std::size_t cells = 0;                     ///< number of cells
  int geometric_dimensions = 3;              ///< 2 with patches of type "empty"
  Extreme least_volume;                      ///< cell
  Extreme largest_volume;                    ///< cell
  double total_volume = 0;                   ///< of all cells
  Extreme least_area;                        ///< face
  Extreme largest_area;                      ///< face
  Extreme largest_non_orthogonality;         ///< internal face, degrees
  double average_non_orthogonality = 0;      ///< degrees; arc cosine of the mean cosine
  Extreme largest_skewness;                  ///< face
  Extreme largest_aspect_ratio;              ///< cell
  Extreme largest_openness;                  ///< cell
  Extreme least_flatness{1, 0};              ///< face: |area vector| / sum of its triangles; 1 = flat
  std::size_t non_orthogonal_faces = 0;      ///< severe: beyond the limit, but not beyond 90 degrees
  std::size_t non_orthogonality_errors = 0;  ///< faces from 90 degrees
  std::size_t skew_faces = 0;                ///< faces with a skewness beyond the limit
  std::size_t small_faces = 0;               ///< faces with an area below the limit
  std::size_t wrong_pyramids = 0;    ///< "incorrectly oriented" faces as in checkMesh; an internal face counts for each side
  std::size_t negative_volumes = 0;  ///< cells whose volume is zero or negative
  std::size_t slender_cells = 0;     ///< cells with an aspect ratio beyond the limit
  std::size_t open_cells = 0;        ///< cells with an openness beyond the limit
  /// Cells whose volume or a pyramid is not positive, as in InversionCheck; checkMesh has no such number.
  std::size_t inverted_cells = 0;
  std::size_t left_handed = 0;                ///< number of left-handed cells
  std::vector<std::size_t> inverted;          ///< the first inverted cells, at most 100
  std::vector<std::size_t> wrong_faces;       ///< the first faces with wrong pyramids, at most 100
  std::vector<std::size_t> worst;             ///< the internal faces of largest non-orthogonality, worst first, at most 100
  std::array<std::size_t, bins> histogram{};  ///< non-orthogonality from 0 to 90 degrees and beyond
  std::array<std::size_t, skewness_bins> skewness_histogram{};  ///< from 0 to 4 and beyond
  std::vector<double> cell_volume;                              ///< signed
  std::vector<double> cell_non_orthogonality;                   ///< degrees, largest of the cell's internal faces; 0 without any
  std::vector<double> face_non_orthogonality;                   ///< degrees, of the internal faces

  /// A failed check: its name and the number of faces or cells that fail.
  struct Failure {
    std::string check;      ///< its name
    std::size_t count = 0;  ///< faces or cells that fail
  };
  /// The failed checks of cells and faces, in the order of checkMesh. (Severe non-orthogonality alone is only a warning there;
  /// open and slender cells belong to one check.)
  std::vector<Failure> failures() const;
  std::size_t failed_checks() const;  ///< how many checks failed
};

/// Measures all cells over `points` (n x 3), in parallel over faces and cells. The result does not depend on the number of
/// threads. Throws Error(invalid_argument) if the cells refer to points beyond n, cancelled, deadline_exceeded.
PolyhedralQuality polyhedral_quality(std::span<const Vec3> points, const PolyhedralCells& cells,
                                     const PolyhedralLimits& limits = {}, const RunContext& context = {});

}  // namespace deform
