// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/quality/element_quality.h"
#include "core/quality/plane_quality.h"
#include "core/quality/polyhedral_quality.h"
#include "core/quality/region_jumps.h"
#include "core/quality/surface_quality.h"
#include "core/quality/wall_quality.h"

namespace deform {

/// Which way a measure gets better.
enum class Better { neither, lower, higher };

/// A measure: a row of the table.
struct QualityRow {
  std::string name;   ///< for machines
  std::string label;  ///< for people
  double value = 0;
  std::optional<std::size_t> id;  ///< of the point, face, cell or element where it was found
  Better better = Better::neither;
  bool in_table = true;  ///< otherwise for machines only
};

struct QualityHistogram {
  std::string name, title;
  double low = 0, high = 0;
  std::vector<std::size_t> counts;
};

/// The worst of a kind, worst first.
struct WorstList {
  struct Entry {
    std::size_t id = 0;
    std::optional<double> value;
    Vec3 position{};  ///< mean of its points
  };
  std::string title, noun;  ///< "Faces of least quality", "face"
  std::vector<Entry> entries;
};

/// What can be said about the quality of a mesh, for a table, JSON or a page.
struct QualityReport {
  std::vector<std::pair<std::string, std::size_t>> counts;
  std::vector<QualityRow> rows;
  std::vector<std::pair<std::string, std::vector<std::size_t>>> lists;  ///< ids
  std::vector<QualityHistogram> histograms;
  std::vector<WorstList> worst;
  std::vector<std::string> failed = {};  ///< the checks that failed, with their counts: "face pyramids: 19"
  std::string method;                    ///< a sentence about how it was measured

  const QualityRow* find(const std::string& name) const;
};

QualityReport quality_report(const PolyhedralQuality& quality, std::span<const Vec3> points, const PolyhedralCells& cells);
QualityReport quality_report(const ElementQuality& quality, std::span<const Vec3> points, const Elements& elements);
QualityReport quality_report(const SurfaceQuality& quality, const Mesh& mesh);

/// Of a surface in a plane z = constant: its faces as elements. mesh: its faces, points: where they are.
void add_to(QualityReport& report, const PlaneQuality& plane, std::span<const Vec3> points, const Mesh& mesh);
void add_to(QualityReport& report, const WallQuality& wall);
void add_to(QualityReport& report, const RegionJumps& jumps);
void add_to(QualityReport& report, const JumpGrowth& growth);

/// Largest displacement of a point since `original`, which has as many points.
void add_displacement(QualityReport& report, std::span<const Vec3> points, std::span<const Vec3> original);
/// Faces that flipped, as flipped_faces() lists them: their number, the worst of them, where they are.
void add_flipped(QualityReport& report, const Mesh& mesh, std::span<const Extreme> flipped);

}  // namespace deform
