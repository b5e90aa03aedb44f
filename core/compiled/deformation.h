// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "core/base/model_size.h"
#include "core/base/plane_sides.h"
#include "core/compiled/content.h"

namespace deform::compiled {

/// What is known of a design without its mesh: as the server reports it.
struct Report {
  double prescribed_displacement = 0;  ///< largest displacement that a handle prescribes, model units
  double interpolation_residual = 0;   ///< bound of the error at handle and fixed points, model units
  double error = 0;                    ///< estimated largest error at the points, model units
  bool converged = true;               ///< the basis, and where the setup sets a tolerance, the design, reached it
  /// Handles that the design mirrors or flattens, a sentence each, see shape_doubt(): the points are right, and perhaps not
  /// meant. Last, of a model of which points have strayed, ModelSize::stray.
  std::vector<std::string> doubts{};
};

/// A compiled deformation, ready to evaluate: x = rest + basis * coefficients(variables) at the points that follow, and the
/// motions of the handles at the points that these hold (thesis 4.2).
///
///   const compiled::Deformation car = compiled::Deformation::load("car.deformation");
///   std::vector<double> points(3 * car.points());
///   car.evaluate(std::vector<double>{0.03, 0.1}, points);
///
/// Immutable; any thread. Designs and arrays are row-major: k variables per design in the order of content().variables, x, y, z
/// per point in registered order. `threads` are started for the call (1: none; 0: all cores); results have the same bits for any
/// number of them, for any grouping of designs, and on every machine with IEEE arithmetic whose sin() and cos() agree. Throws
/// Error(invalid_argument) naming the array, the index and the limit: wrong sizes, numbers that are not finite, values outside
/// their bounds, designs that send coincident points to different places or points of a symmetry plane out of it.
class Deformation {
 public:
  /// Takes a content that read_content() gave, or that keeps its rules.
  explicit Deformation(Content content);
  /// Reads a file, see read_content().
  static Deformation load(const std::filesystem::path& file);

  /// All that is in the file.
  const Content& content() const { return content_; }
  std::size_t points() const { return content_.points(); }             ///< n
  std::size_t variables() const { return content_.variables.size(); }  ///< k

  /// m x k values to m x n x 3 coordinates, model units. The designs share one pass over the basis. In floats each coordinate is
  /// rounded once.
  void evaluate(std::span<const double> designs, std::span<double> points, int threads = 1) const;
  /// The same in floats.
  void evaluate(std::span<const double> designs, std::span<float> points, int threads = 1) const;

  /// d(points)/d(variables) at `variables` (k) times `direction` (k): n x 3 (thesis 4.2, eq. 4.2).
  void jacobian_vector(std::span<const double> variables, std::span<const double> direction, std::span<double> vectors,
                       int threads = 1) const;
  /// The same in floats.
  void jacobian_vector(std::span<const double> variables, std::span<const double> direction, std::span<float> vectors,
                       int threads = 1) const;

  /// d(points)/d(variables)^T at `variables` (k) times a cotangent field (n x 3): k.
  void vector_jacobian(std::span<const double> variables, std::span<const double> cotangent, std::span<double> gradient,
                       int threads = 1) const;
  /// The same of floats.
  void vector_jacobian(std::span<const double> variables, std::span<const float> cotangent, std::span<double> gradient,
                       int threads = 1) const;

  /// Checks a design and says how wrong its points may be.
  Report report(std::span<const double> variables) const;

  /// By which errors and motions are judged; of the rest points.
  const ModelSize& size() const { return size_; }

  /// On which side of the symmetry planes points stay; planes on which no point lies are left out.
  const PlaneSides& sides() const { return sides_; }

  /// The largest distance of a handle or fixed point from where the variables send it, model units; 0 where handles select
  /// control points. points: x y z of all points, as evaluate() gives them. Throws what evaluate() throws, and
  /// Error(invalid_argument) for a wrong number of points.
  double largest_misfit(std::span<const double> variables, std::span<const double> points) const;

 private:
  struct Bound;
  struct Pass;
  /// A motion of a handle by a variable.
  struct Drive {
    std::size_t variable;
    VariableMotion motion;
  };
  using Maps = std::vector<Affine>;  ///< per handle

  std::vector<double> checked_values(std::span<const double> variables, const std::string& what) const;
  Maps motions(std::span<const double> values) const;
  Affine handle_derivative(std::span<const double> values, std::size_t variable, std::uint32_t handle) const;
  Maps motion_derivative(std::span<const double> values, std::size_t variable) const;
  void check_design(const Maps& motions, const std::string& what) const;
  void check_sliding(const Maps& derivative, const std::string& what) const;
  Vec3 place(const Maps& motions, std::uint32_t id, double keep) const;
  Bound bound(std::vector<Maps> motions, double keep) const;
  Vec3 to_frame(const Vec3& vector) const;
  Vec3 from_frame(const Vec3& components) const;
  Vec3 slid(const Vec3& x, const Vec3& to, unsigned mask) const;
  FieldFrame frame(std::size_t handle) const;
  template <typename T>
  void evaluate_designs(std::span<const double> designs, std::span<T> points, int threads) const;
  template <typename T>
  void fill(const Bound& bound, T* out, int threads) const;
  template <typename T>
  void fill_held(const Bound& bound, std::size_t begin, std::size_t end, T* out) const;
  template <typename T>
  void fill_following(const Bound& bound, std::size_t begin, std::size_t end, T* out) const;
  template <typename T>
  void derive(std::span<const double> variables, std::span<const double> direction, std::span<T> vectors, int threads) const;
  template <typename T>
  void pull_back(std::span<const double> variables, std::span<const T> cotangent, std::span<double> gradient, int threads) const;
  template <typename T>
  std::vector<double> field_moments(std::span<const T> cotangent, int threads) const;
  double largest_displacement(const Maps& motions) const;
  std::vector<std::string> doubts(const Maps& motions, std::span<const double> values) const;

  Content content_;
  std::vector<std::uint32_t> following_;              ///< ids of the points that follow, ascending
  std::vector<std::uint32_t> held_;                   ///< of the others
  std::vector<std::uint32_t> sliding_;                ///< handle points on symmetry planes
  std::vector<std::vector<Drive>> drives_;            ///< of each handle, in the order of the variables
  std::vector<std::vector<std::size_t>> components_;  ///< of each basis
  std::vector<bool> turned_;                          ///< of each basis, see turned_components
  PlaneSides sides_;
  ModelSize size_;
};

}  // namespace deform::compiled
