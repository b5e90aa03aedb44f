// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/deformers/constrained/constrained_points.h"
#include "core/deformers/handles/flat_case.h"
#include "core/deformers/handles/handle_motion.h"
#include "core/mesh/mesh.h"
#include "core/numerics/sampling/point_tree.h"

namespace deform {

/// The last step of a design with columns of cells (Rigid::layers): the layers are set up on the wall anew, with the heights that
/// they have at rest.
///
/// What functions and their correction make of thin layers is right to a fraction of the motion of the handles, which may be all
/// of a height. So each wall face c turns with the rotation R_c that fits its corners best (Kabsch 1976), and every edge between
/// two levels of the columns becomes the e that minimizes
///   sum_c (e . R_c n_c - e_0 . n_c)^2 + 1e-3 |e - R_c e_0|^2
/// over the wall faces with a column that has it, where e_0 is the edge and n_c the normal of the face at rest: it keeps the
/// heights over all faces around, where these fold too, and else its direction. For columns that move rigidly that is the edge
/// turned with them. The wall stays where it is. So do points of handles, fixed regions and exact constraints, and points that
/// stand on several walls, as in a corner between them; the layers above stand on these. In a two-dimensional case edges lose
/// what leads out of its planes.
///
/// Points around the columns take the step of the nearest corner of a column, times Wendland's C2 function of its distance at
/// rest over carried_heights times the height of that column. Nodes between two corners take the mean of their steps.
/// Immutable; any thread.
class LayerStep {
 public:
  static constexpr double carried_heights = 4;

  struct Input {
    const Mesh& mesh;
    const UnitBox& box;
    const std::vector<PointId>& following;   ///< points that follow the solution, ascending; must outlive the step
    const std::vector<ConstraintSet>& sets;  ///< those that are columns of cells are used
    const std::vector<char>& keeps;          ///< for each point of the mesh: whether it keeps its place
    const FlatCase& flat;                    ///< in its planes edges stay
  };
  LayerStep(const Input& input, const RunContext& context);

  /// The step of one design or derivative.
  struct Step {
    std::vector<Vec3> from;    ///< U: points before the step, unit coordinates
    std::vector<Vec3> values;  ///< U: resulting positions or their derivatives, model units
    std::vector<Vec3> moved;   ///< U: how far the step moves them, model units
  };
  /// `from` are the points ids(), unit coordinates.
  Step place(std::vector<Vec3> from, const RunContext& context) const;
  /// `change` is the derivative of the points ids() before the step at `at`.
  Step derivative(const std::vector<Vec3>& at, const std::vector<Vec3>& change, const RunContext& context) const;
  /// Replaces cotangents of the following points by those before the step, and returns those at ids() that do not follow.
  std::vector<Vec3> adjoint(const std::vector<Vec3>& at, std::vector<Vec3>& cotangents, const RunContext& context) const;

  /// What a step adds at a following point of the mesh, which is none of ids(), and at any place in unit coordinates; model
  /// units.
  Vec3 carried(std::size_t following, const Step& step) const { return sum(carries_[following], step); }
  Vec3 carried_at(const Vec3& place, const Step& step) const { return sum(carry_at(place), step); }
  /// The position of a point among the following ones.
  std::size_t slot(PointId id) const;

  /// U: the corners of all columns, ascending.
  const std::vector<PointId>& ids() const { return ids_; }
  bool follows(std::size_t u) const { return slots_[u] != none; }
  /// Whether the step moves no point, for any design.
  bool empty() const { return edges_.empty(); }
  std::size_t bytes() const { return bytes_for(set_points_, following_.size()); }
  /// The memory for sets with so many points and so many following ones, in bytes.
  static std::size_t bytes_for(std::size_t set_points, std::size_t following);

 private:
  static constexpr std::uint32_t none = ~std::uint32_t{0};

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
  };
  /// How a face has turned.
  struct Turn {
    Eigen::Matrix3d R;
    Eigen::Matrix3d response;  ///< (tr S - S)^-1 with S = R^T sum x x_0^T; zero for corners on a line
  };
  /// Shares of the steps of two points.
  struct Carry {
    std::array<std::uint32_t, 2> from{0, 0};
    std::array<double, 2> share{0, 0};
  };

  void add_columns(const Input& input);
  void add_nodes(const Input& input);
  Carry carry_at(const Vec3& place) const;
  std::vector<Turn> turns(const std::vector<Vec3>& at, const RunContext& context) const;
  Step moved(Step step, const std::vector<Vec3>& from) const;
  Vec3 sum(const Carry& carry, const Step& step) const;

  const std::vector<PointId>& following_;
  const double scale_;
  const Vec3 origin_;
  Eigen::Matrix3d along_ = Eigen::Matrix3d::Identity();  ///< of an edge: the part along the planes of a flat case
  std::size_t set_points_ = 0;
  std::vector<PointId> ids_;
  std::vector<std::uint32_t> slots_;  ///< U: positions among the following points, or none
  std::vector<Face> faces_;
  std::vector<Edge> edges_;                   ///< level by level
  std::vector<double> reach_;                 ///< U: how far a step is carried, unit coordinates
  std::unique_ptr<const PointTree> at_rest_;  ///< U
  std::vector<Carry> carries_;                ///< of each following point
};

}  // namespace deform
