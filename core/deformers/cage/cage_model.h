// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/handles/control_functions.h"
#include "core/deformers/handles/control_system.h"
#include "core/deformers/handles/space_functions.h"
#include "core/deformers/setup.h"
#include "core/mesh/mesh.h"
#include "core/numerics/cage/cage.h"
#include "core/numerics/cage/mean_value.h"

namespace deform {

/// The cage of a setup. Throws Error(invalid_argument) as Cage does, naming the field "method.cage.vertices"
/// or "method.cage.triangles".
Cage cage_of(const CageOptions& options);

/// A cage with the coordinates of a mesh in it. The coordinates are not stored: every use computes them from the point, in time
/// proportional to the number of triangles of the cage.
ControlModel cage_model(const CageOptions& options, const std::shared_ptr<const Mesh>& mesh);

/// The mean value coordinates of the points of a mesh. Those of some points are stored, the others are computed on demand.
class CageRows : public ControlFunctions, public SpaceFunctions {
 public:
  CageRows(Cage cage, std::shared_ptr<const Mesh> mesh);
  /// Stores the coordinates of the points `kept` (ascending).
  CageRows(Cage cage, std::shared_ptr<const Mesh> mesh, std::vector<PointId> kept, const RunContext& context);
  CageRows(const CageRows&) = delete;
  CageRows& operator=(const CageRows&) = delete;

  std::int64_t rows() const override { return static_cast<std::int64_t>(mesh_->point_count()); }
  std::int64_t cols() const override { return static_cast<std::int64_t>(cage_.size()); }
  std::size_t count(std::int64_t) const override { return cage_.size(); }
  void for_each(std::int64_t row, const std::function<void(std::int64_t, double)>& use) const override;
  Outside rows(std::span<const Vec3> places, std::uint64_t first, const Use& use) const override;
  using ControlFunctions::sums;
  using SpaceFunctions::sums;
  std::size_t bytes() const override { return bytes_for(cage_, kept_.size()); }
  static std::size_t bytes_for(const Cage& cage, std::size_t kept);

  const Cage& cage() const { return cage_; }

 private:
  std::vector<double> values_at(PointId id) const;

  const Cage cage_;
  const MeanValue coordinates_;
  const std::shared_ptr<const Mesh> mesh_;
  const std::vector<PointId> kept_;
  std::vector<double> values_;  ///< kept points x vertices
};

/// "A cage of 8 vertices and 12 triangles, of diagonal 2.5, its own mirror image in y = 0." Of cages that are none it says
/// nothing.
std::string size_note(const Cage& cage);
/// "point 3", "points 3, 7, 8 and 12 more": the first ten, ascending, of `count`.
std::string points_text(std::span<const PointId> ids, std::size_t count);

/// How many points of a mesh are outside of a cage, where its winding number is 0.
struct OutsidePoints {
  std::size_t count = 0;
  std::size_t looked_at = 0;
  std::vector<PointId> ids;  ///< the first ten of them, ascending
  /// What estimates look at, in hundredths of a second.
  static constexpr std::size_t few = 20000;
};
/// At most `most` points are looked at, evenly distributed over their ids; 0: all of them.
OutsidePoints points_outside(const Cage& cage, const Mesh& mesh, std::size_t most, const RunContext& context);

/// Adds a note where sizes suggest other units than the mesh has, and one on the points outside the cage, if there are any, or if
/// it is beside the mesh. `most` is that of points_outside(). `model`: the mesh is a model of so many points with its mirror
/// images; 0: there are none.
void add_outside_note(const Cage& cage, const Mesh& mesh, std::size_t most, std::size_t model, const RunContext& context,
                      std::vector<std::string>& notes);
/// The approximate time to compute the coordinates of a point, in seconds.
double seconds_per_row(const Cage& cage);

}  // namespace deform
