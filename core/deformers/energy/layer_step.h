// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/deformers/constrained/constrained_points.h"
#include "core/deformers/energy/exact_step.h"

namespace deform {

/// The last step of a design with columns of cells (Rigid::layers): the layers are set up on the wall anew, with the heights that
/// they have at rest.
///
/// What functions and their correction make of thin layers is right to a fraction of the motion of the handles, which may be all
/// of a height. So each wall face c turns with the rotation R_c that fits its corners best (Kabsch 1976), and every edge between
/// two levels of the columns becomes
///   e = a s / (s . m),  s = sum R_c e_0,  m = sum R_c n_c,  a = sum e_0 . n_c
/// over the wall faces with a column that has it, where e_0 is the edge and n_c the normal of the face at rest: the mean
/// direction, and as long as the mean of the heights over these faces requires. For columns that move rigidly that is the edge
/// turned with them. The wall stays where it is, and points of handles, fixed regions and exact constraints as well, which end
/// the columns below. Points that stand on two walls, as in a corner between them, stay too. The steps of the points are carried
/// to those around them as those of ExactStep are. Immutable; any thread.
class LayerStep {
 public:
  /// Uses the sets that are columns of cells; `keeps` tells which points of the mesh stay. The objects that `before` refers to
  /// must outlive this object.
  LayerStep(const DeformationBefore& before, const std::vector<ConstraintSet>& sets, const std::vector<char>& keeps,
            const RunContext& context);

  /// The step of one design or derivative.
  struct Step {
    std::vector<Vec3> from;    ///< U points before the step, unit coordinates; empty if the step is omitted
    RowMajorMatrix carried;    ///< coefficients of the added field, rows x 3, or empty
    std::vector<Vec3> values;  ///< resulting positions or their derivatives, model units; empty if the step is omitted
  };
  /// `from` are the points ids(), unit coordinates. The step is omitted if points around would be carried farther than three
  /// times as far as those of the columns.
  Step place(std::vector<Vec3> from, const RunContext& context) const;
  /// `change` is the derivative of the points ids() before the step at `at`, which has not been omitted.
  Step derivative(const std::vector<Vec3>& at, const std::vector<Vec3>& change, const RunContext& context) const;
  /// Replaces cotangents of the following points by those before the step, and returns the cotangents at ids() that do not move.
  std::vector<Vec3> adjoint(const std::vector<Vec3>& at, std::vector<Vec3>& cotangents, const RunContext& context) const;

  /// Adds the field of a step at a tile of points: out[component][16].
  void add_values(const double* tile, const Step& step, double* out) const;
  /// U: the points of all columns, ascending, and whether one follows the design by the functions: the step moves it or keeps it
  /// in its place.
  const std::vector<PointId>& ids() const { return ids_; }
  bool follows(std::size_t u) const { return follows_[u] != 0; }
  std::size_t bytes() const;

  /// Bytes of a LayerStep without its carrier, for sets with so many points.
  static std::size_t own_bytes(std::size_t set_points);
  /// The points that the step moves or keeps in their place, ascending.
  static std::vector<PointId> carried_points(const std::vector<ConstraintSet>& sets, const std::vector<char>& following);

 private:
  /// A wall face with its column.
  struct Face {
    std::vector<std::uint32_t> corners;  ///< among ids()
    std::vector<Eigen::Vector3d> rest;   ///< about their mean
    Eigen::Vector3d normal;
  };
  /// An edge that leads up to a point from that below.
  struct Edge {
    std::uint32_t point = 0, below = 0;  ///< among ids()
    std::size_t level = 0;
    std::vector<std::uint32_t> faces;
    Eigen::Vector3d rest;
    double height = 0;  ///< a
  };
  /// How a face has turned.
  struct Turn {
    Eigen::Matrix3d R;
    Eigen::Matrix3d response;  ///< (tr S - S)^-1 with S = R^T sum x x_0^T, or zero for points without a rotation
  };

  void add_faces(const std::vector<ConstraintSet>& sets, const Mesh& mesh, const UnitBox& box);
  std::vector<Turn> turns(const std::vector<Vec3>& at, const RunContext& context) const;
  RowMajorMatrix carried(const std::vector<Vec3>& from, const std::vector<Vec3>& to, const RunContext& context) const;
  bool carries_far(const Step& step, double most, const RunContext& context) const;

  const DeformationBefore before_;
  std::vector<PointId> ids_;
  std::vector<char> follows_;
  std::vector<std::uint32_t> moving_;  ///< those among ids() that follow
  std::vector<Face> faces_;
  std::vector<Edge> edges_;  ///< level by level
  std::unique_ptr<const ResidualCorrection> carrier_;
  std::size_t carried_from_ = 0;  ///< number of places of the carrier
};

}  // namespace deform
