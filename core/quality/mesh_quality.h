// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/mesh/mesh.h"
#include "core/quality/element_quality.h"
#include "core/quality/face_intersections.h"
#include "core/quality/flipped_faces.h"
#include "core/quality/plane_quality.h"
#include "core/quality/polyhedral_quality.h"
#include "core/quality/report.h"
#include "core/quality/surface_quality.h"

namespace deform {

/// All that is measured of a mesh; exactly one of surface, elements and cells is there.
struct MeshQuality {
  std::optional<SurfaceQuality> surface;   ///< of a mesh without cells
  std::optional<ElementQuality> elements;  ///< of cells by their nodes
  std::optional<PolyhedralQuality> cells;  ///< of cells by their faces
  std::optional<PlaneQuality> plane;       ///< beside `surface`, of triangles and quads in a plane z = constant
  QualityReport report;                    ///< the same, as rows
};

/// Measures a mesh. `left_handed` are its left-handed cells: the result of left_handed_cells() at rest, or empty. Parallel; the
/// result does not depend on the number of threads. Throws Error(invalid_argument) for a mesh without faces and cells, cancelled,
/// deadline_exceeded.
MeshQuality mesh_quality(const Mesh& mesh, const std::vector<char>& left_handed, const RunContext& context = {});

/// The left-handed cells of a mesh at other points (n x 3), or none of a surface.
std::vector<char> left_handed_of(const Mesh& mesh, std::span<const Vec3> points, const RunContext& context = {});

/// Measures the designs of a mesh by the names of `deform quality`: what mesh_quality() reports of the deformed mesh, with
/// flipped_faces, faces that intersect others, and displacement, which compare with the rest, and the first layer on the walls.
/// Cells are left-handed that are so at rest. Immutable; any thread may call.
///
///     const QualityCheck check(mesh);
///     const std::vector<double> values = check.values(points, {"scaled_jacobian", "flipped_faces"});
class QualityCheck {
 public:
  /// A name that this mesh has.
  struct Name {
    std::string name;                 ///< as QualityRow::name
    std::string label;                ///< for people
    bool counts = false;              ///< the value is a number of something, so it has no derivative
    Better better = Better::neither;  ///< the direction in which it improves
  };

  /// `rest` has the points at rest; `walls` are names of groups of boundary faces of a volume mesh. Throws
  /// Error(invalid_argument) where it has neither faces nor cells, there is no such group, it has no faces or the mesh is a
  /// surface; cancelled, deadline_exceeded.
  explicit QualityCheck(std::shared_ptr<const Mesh> rest, const std::vector<std::string>& walls = {},
                        const RunContext& context = {});
  ~QualityCheck();

  /// In the order of the report.
  const std::vector<Name>& names() const { return names_; }
  /// The number of points of the mesh.
  std::size_t point_count() const { return rest_->point_count(); }

  /// Throws Error(invalid_argument) for a name that this mesh does not have, with those it has or what it needs.
  void check(const std::string& name) const;

  /// The values of `wanted`, in that order, for deformed points (n x 3); counts as numbers. Others are not computed where
  /// they take time of their own. NaN and infinity are possible: the aspect ratio of an inverted element is infinite. Throws as
  /// check(), and for another number of points; cancelled, deadline_exceeded.
  std::vector<double> values(std::span<const Vec3> points, const std::vector<std::string>& wanted,
                             const RunContext& context = {}) const;

  /// All of it. Throws as values().
  QualityReport report(std::span<const Vec3> points, const RunContext& context = {}) const;

 private:
  enum class Part { all, without_comparison };
  QualityReport measured(std::span<const Vec3> points, Part part, const RunContext& context) const;
  void add_intersections(QualityReport& report, const Mesh& moved, const RunContext& context) const;
  void check_points(std::span<const Vec3> points) const;

  std::shared_ptr<const Mesh> rest_;
  std::vector<char> left_handed_;
  std::vector<FaceId> walls_;
  // Nothing for a mesh without faces.
  std::unique_ptr<const FlipCheck> flips_;
  std::unique_ptr<const IntersectionCheck> intersections_;
  std::vector<Name> names_;
};

/// The faces of groups of boundary faces, each once, ascending. Throws Error(invalid_argument) for a group that `mesh` does not
/// have, with suggestions, or that has no faces.
std::vector<FaceId> wall_faces(const Mesh& mesh, const std::vector<std::string>& groups);

}  // namespace deform
