// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/quality/element_quality.h"
#include "core/quality/face_intersections.h"
#include "core/quality/plane_quality.h"
#include "core/quality/polyhedral_quality.h"
#include "core/quality/region_jumps.h"
#include "core/quality/surface_quality.h"
#include "core/quality/wall_quality.h"

namespace deform {

/// The direction in which a measure improves.
enum class Better { neither, lower, higher };

/// A measure, shown as a row of the table.
struct QualityRow {
  std::string name;                 ///< machine-readable
  std::string label;                ///< human-readable
  double value = 0;                 ///< of the measure
  std::optional<std::size_t> id;    ///< id of the point, face, cell or element with this value
  Better better = Better::neither;  ///< how it improves
  bool in_table = true;             ///< otherwise only in machine-readable output
  bool counts = false;              ///< the value is a number of something, so it has no derivative
};

/// Numbers of values in bins of equal width.
struct QualityHistogram {
  std::string name;                 ///< machine-readable
  std::string title;                ///< human-readable
  double low = 0;                   ///< where the first bin begins
  double high = 0;                  ///< where the last bin ends
  std::vector<std::size_t> counts;  ///< of each bin
};

/// The worst entities of a kind, worst first.
struct WorstList {
  /// One of them.
  struct Entry {
    std::size_t id = 0;           ///< of the point, face, cell or element
    std::optional<double> value;  ///< its measure, if it has one
    Vec3 position{};              ///< mean of its points
  };
  std::string title;           ///< "Faces of least quality"
  std::string noun;            ///< "face"
  std::vector<Entry> entries;  ///< worst first
};

/// The quality of a mesh, to be shown as a table, JSON or a page.
struct QualityReport {
  std::vector<std::pair<std::string, std::size_t>> counts;              ///< numbers of points, faces and cells
  std::vector<QualityRow> rows;                                         ///< the measures
  std::vector<std::pair<std::string, std::vector<std::size_t>>> lists;  ///< ids
  std::vector<QualityHistogram> histograms;                             ///< of the measures that have one
  std::vector<WorstList> worst;                                         ///< of the measures that have one
  std::vector<std::string> failed = {};                                 ///< failed checks with their counts: "face pyramids: 19"
  std::string method;                                                   ///< a sentence on how the quality was measured

  /// The row with this name, or nullptr. inverted_cells, as commands that deform call it, finds inverted_elements as well.
  const QualityRow* find(const std::string& name) const;
  /// Says of a name that find() does not know what it needs, which was not given, or what it may have meant.
  std::string unknown(const std::string& name) const;
};

/// A name that a report of some mesh has.
struct QualityName {
  std::string name;     ///< as QualityRow::name
  bool counts = false;  ///< as QualityRow::counts
};
/// All of them, each once: of surfaces, plane meshes, elements of all types and polyhedral cells, and of what needs a group of
/// wall faces, the rest, or regions.
std::vector<QualityName> quality_names();

QualityReport quality_report(const PolyhedralQuality& quality, std::span<const Vec3> points, const PolyhedralCells& cells);
QualityReport quality_report(const ElementQuality& quality, std::span<const Vec3> points, const Elements& elements);
QualityReport quality_report(const SurfaceQuality& quality, const Mesh& mesh);

/// Adds the measures of a 2D mesh in a plane z = constant: `mesh` has its faces, `points` are their coordinates.
void add_to(QualityReport& report, const PlaneQuality& plane, std::span<const Vec3> points, const Mesh& mesh);
void add_to(QualityReport& report, const WallQuality& wall);
void add_to(QualityReport& report, const RegionJumps& jumps);
void add_to(QualityReport& report, const JumpGrowth& growth);

/// Adds the largest displacement of a point relative to `original`, which has the same size.
void add_displacement(QualityReport& report, std::span<const Vec3> points, std::span<const Vec3> original);
/// Adds the flipped faces, as listed by flipped_faces(): their number, and the worst with their positions.
void add_flipped(QualityReport& report, const Mesh& mesh, std::span<const Extreme> flipped);
/// Adds the faces that intersect others: their number, and the first with their positions.
void add_intersecting(QualityReport& report, const Mesh& mesh, std::span<const IntersectingFace> faces);
/// Adds the number of those that do so since a deformation, of IntersectionCheck::appeared(), and their ids.
void add_newly_intersecting(QualityReport& report, std::span<const IntersectingFace> faces);

}  // namespace deform
