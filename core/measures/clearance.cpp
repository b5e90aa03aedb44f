// SPDX-License-Identifier: Apache-2.0
#include "core/measures/clearance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "core/base/checks.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/measures/smooth_least.h"
#include "core/mesh/triangle_tree.h"
#include "core/mesh/winding_number.h"

namespace deform::measures {

namespace {

/// A signed distance, and its derivative by the place, a unit vector.
struct SignedDistance {
  double value = 0;
  Vec3 slope{};
};

SignedDistance distance_to(const Box& box, const Vec3& x) {
  Vec3 outside{}, sign{};  // beyond the nearer face of each axis, negative inside
  for (std::size_t k = 0; k < 3; ++k) {
    const double below = box.min[k] - x[k], above = x[k] - box.max[k];
    outside[k] = std::max(below, above);
    sign[k] = above >= below ? 1 : -1;
  }
  const auto k = static_cast<std::size_t>(std::max_element(outside.begin(), outside.end()) - outside.begin());
  SignedDistance found;
  if (outside[k] <= 0) {
    found.value = outside[k];
    found.slope[k] = sign[k];
    return found;
  }
  Vec3 away = outside;
  for (double& distance : away) distance = std::max(distance, 0.0);
  found.value = norm(away);
  for (std::size_t i = 0; i < 3; ++i) found.slope[i] = sign[i] * away[i] / found.value;
  return found;
}

Mesh mesh_of(const Body& body, const Mesh& mesh) {
  Mesh triangles;
  triangles.points = mesh.points;
  triangles.face_sizes.assign(body.triangles().size(), 3);
  for (const Triangle& triangle : body.triangles())
    triangles.face_points.insert(triangles.face_points.end(), triangle.begin(), triangle.end());
  return triangles;
}

/// The inside of a closed mesh.
class Inside {
 public:
  explicit Inside(const Mesh& mesh) : Inside(Body(mesh, {}, Rims::refuse), mesh) {}

  SignedDistance distance(const Vec3& x) const {
    const PlaceOnTriangle place = tree_.nearest(x, std::numeric_limits<double>::infinity(), [](std::uint32_t) { return true; });
    const double sign = std::abs(winding_.at(x)) > 0.5 ? -1 : 1;
    const Vec3 away = x - place.point;
    const double size = norm(away);
    // On the surface rounding decides where `away` points to.
    if (size <= 1e-12 * diagonal_) return {sign * size, normals_[place.triangle]};
    return {sign * size, sign * (away / size)};
  }

 private:
  Inside(const Body& body, const Mesh& mesh)
      : tree_(body.triangles(), mesh.points),
        winding_(mesh_of(body, mesh), mesh.points),
        diagonal_(bounding_box(mesh.points).diagonal()) {
    for (const Triangle& triangle : body.triangles()) {
      const Vec3& a = mesh.points[triangle[0]];
      const Vec3 normal = cross(mesh.points[triangle[1]] - a, mesh.points[triangle[2]] - a);
      const double size = norm(normal);
      normals_.push_back(size > 0 ? normal / size : Vec3{});
    }
  }

  TriangleTree tree_;
  WindingNumber winding_;
  std::vector<Vec3> normals_;
  double diagonal_;
};

class Clearance : public Measure {
 public:
  Clearance(const Mesh& mesh, const FaceChoice& choice, std::variant<Box, Inside> keep_out, double tolerance)
      : Measure(mesh.point_count()),
        triangles_(chosen_triangles(mesh, choice).triangles),
        keep_out_(std::move(keep_out)),
        tolerance_(tolerance > 0 ? tolerance : 1e-3 * bounding_box(mesh.points).diagonal()) {
    if (!(tolerance_ > 0)) throw Error(ErrorCode::invalid_argument, "tolerance: missing; all points of the mesh are the same");
    std::vector<char> used(mesh.point_count());
    for (const Triangle& triangle : triangles_) {
      for (const PointId corner : triangle) used[corner] = 1;
    }
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (used[i] != 0) samples_.push_back(static_cast<PointId>(i));
    }
  }

 private:
  SignedDistance distance(const Vec3& x) const {
    if (const Box* const box = std::get_if<Box>(&keep_out_)) return distance_to(*box, x);
    return std::get<Inside>(keep_out_).distance(x);
  }

  double covering(std::span<const Vec3> points) const {
    double longest = 0;
    for (const Triangle& triangle : triangles_) {
      for (std::size_t i = 0; i < 3; ++i) {
        longest = std::max(longest, squared_distance(points[triangle[i]], points[triangle[(i + 1) % 3]]));
      }
    }
    return std::sqrt(longest) / std::numbers::sqrt3;
  }

  Measurement measured(std::span<const Vec3> points, Gradients gradients, const RunContext& context) const override {
    std::vector<double> distances(samples_.size());
    std::vector<Vec3> slopes(samples_.size());
    parallel_for(context, samples_.size(), 512, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const SignedDistance found = distance(points[samples_[i]]);
        distances[i] = found.value;
        slopes[i] = found.slope;
      }
    });
    const SmoothLeast smooth = smooth_least(distances, tolerance_);
    const PointId nearest = samples_[smooth.least];
    Measurement result{{smooth.value},
                       {},
                       Least{distances[smooth.least], points[nearest], nearest, tolerance_, samples_.size(), covering(points)}};
    if (gradients == Gradients::wanted) {
      Points& gradient = result.gradients.emplace_back(points.size(), Vec3{});
      for (std::size_t i = 0; i < samples_.size(); ++i) gradient[samples_[i]] = smooth.weights[i] * slopes[i];
    }
    return result;
  }

  std::vector<Triangle> triangles_;
  std::vector<PointId> samples_;  ///< the points of the faces, ascending
  std::variant<Box, Inside> keep_out_;
  double tolerance_;
};

std::variant<Box, Inside> prepared(const KeepOut& keep_out) {
  if (const Box* const box = std::get_if<Box>(&keep_out)) {
    check_finite(box->min, "keep_out.min");
    check_finite(box->max, "keep_out.max");
    for (std::size_t k = 0; k < 3; ++k) {
      if (box->min[k] > box->max[k]) {
        throw Error(ErrorCode::invalid_argument, std::string("keep_out: ") + "xyz"[k] + " of min, " + number_digits(box->min[k]) +
                                                     ", is above that of max, " + number_digits(box->max[k]));
      }
    }
    return *box;
  }
  try {
    return Inside(std::get<Mesh>(keep_out));
  } catch (const Error& error) {
    throw Error(error.code(), std::string("keep_out: ") + error.what());
  }
}

}  // namespace

std::unique_ptr<const Measure> make_clearance(const Mesh& mesh, const FaceChoice& choice, const KeepOut& keep_out,
                                              double tolerance) {
  if (!std::isfinite(tolerance) || tolerance < 0) {
    throw Error(ErrorCode::invalid_argument, "tolerance: " + number_digits(tolerance) + ", expected a length over 0, or 0");
  }
  return std::make_unique<Clearance>(mesh, choice, prepared(keep_out), tolerance);
}

}  // namespace deform::measures
