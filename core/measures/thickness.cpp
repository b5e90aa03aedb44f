// SPDX-License-Identifier: Apache-2.0
#include "core/measures/thickness.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/measures/smooth_least.h"
#include "core/mesh/triangle_tree.h"

namespace deform::measures {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// The thickness at a place, and how it depends on what it touches.
struct Contact {
  double thickness = infinity;
  PlaceOnTriangle place;  ///< where the ray or sphere touches the opposite side
  Vec3 by_place{};        ///< derivative of the thickness by that place; by the place itself its negative
  Vec3 by_direction{};    ///< by the unit inward normal
};

/// A design: triangles of the body with their normals and a tree around them.
struct Placed {
  std::span<const Vec3> points;
  const std::vector<Triangle>& triangles;
  TriangleTree tree;
  std::vector<Vec3> normals;  ///< unit, outwards; 0 of triangles without area
  NormalCones cones;          ///< of spheres: where there may be opposing triangles
  double diagonal;            ///< of the box of the points

  Vec3 corner(std::size_t triangle, std::size_t i) const { return points[triangles[triangle][i]]; }
  Vec3 centroid(std::size_t triangle) const { return (corner(triangle, 0) + corner(triangle, 1) + corner(triangle, 2)) / 3; }
};

Contact along_ray(const Placed& placed, std::uint32_t triangle) {
  const Vec3& outwards = placed.normals[triangle];
  const Vec3 inwards = -1.0 * outwards;
  Contact contact;
  contact.place = placed.tree.first(Ray(placed.centroid(triangle), inwards), [&](std::uint32_t other) {
    return other != triangle && dot(inwards, placed.normals[other]) > 0;
  });
  if (!contact.place.found()) return contact;
  contact.thickness = contact.place.distance;
  // The plane of the other side moves with the place that is hit; the ray cuts it at an angle.
  const Vec3& other = placed.normals[contact.place.triangle];
  contact.by_place = other / dot(inwards, other);
  contact.by_direction = -contact.thickness * contact.by_place;
  return contact;
}

/// The radius of the sphere through x, with its centre on the inward normal, and through y is |w|^2 / (2 w.u), w = y - x. The
/// least of all y is the root of min |x + r u - y|^2 - r^2, a concave function of r: Newton's method falls to it from above.
Contact by_sphere(const Placed& placed, std::uint32_t triangle, double opposing) {
  const Vec3& outwards = placed.normals[triangle];
  const Vec3 inwards = -1.0 * outwards, x = placed.centroid(triangle);
  const auto opposes = [&](std::uint32_t other) { return dot(inwards, placed.normals[other]) >= opposing; };
  Contact contact;
  contact.place = placed.tree.first(Ray(x, inwards), opposes);
  double radius = contact.place.found() ? contact.place.distance / 2 : placed.diagonal;
  constexpr int most_steps = 100;
  for (int step = 0; step < most_steps; ++step) {
    const PlaceOnTriangle place = placed.tree.nearest(x + radius * inwards, radius * radius, opposes,
                                                      [&](std::uint32_t node) { return placed.cones.may_hold(node, inwards); });
    if (!place.found()) break;
    const Vec3 w = place.point - x;
    const double next = dot(w, w) / (2 * dot(w, inwards));
    if (!(next > 0 && next < radius)) break;
    radius = next;
    contact.place = place;
  }
  if (!contact.place.found()) return contact;
  const Vec3 w = contact.place.point - x;
  const double depth = dot(w, inwards);
  contact.thickness = 2 * radius;
  contact.by_place = (2 / depth) * (w - radius * inwards);
  contact.by_direction = (-2 * radius / depth) * w;
  return contact;
}

class Thickness : public Measure {
 public:
  Thickness(const Mesh& mesh, const ThicknessOptions& options, const RunContext& context)
      : Measure(mesh.point_count()),
        body_(mesh, options.body, options.rims),
        method_(options.method),
        opposing_(std::cos(options.opposing_degrees * std::numbers::pi / 180)) {
    triangles_.assign(body_.triangles().begin(), body_.triangles().begin() + static_cast<std::ptrdiff_t>(body_.faces().size()));
    choose_samples(mesh, options);
    tree_ = TriangleTree(triangles_, mesh.points, context);
    tolerance_ = options.tolerance > 0 ? options.tolerance : default_tolerance(mesh, context);
  }

 private:
  void choose_samples(const Mesh& mesh, const ThicknessOptions& options) {
    std::vector<char> wanted;
    if (!options.at.empty()) {
      if (options.body.source == FaceSource::cells) {
        throw Error(ErrorCode::invalid_argument, "at: groups are of faces of the mesh, the body has those around cells");
      }
      wanted.resize(mesh.face_count());
      try {
        for (const FaceId face : chosen_triangles(mesh, {options.at, FaceSource::faces}).faces) wanted[face] = 1;
      } catch (const Error& error) {
        const std::string message = error.what(), groups = "groups";
        throw Error(error.code(), message.starts_with(groups) ? "at" + message.substr(groups.size()) : "at: " + message);
      }
    }
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      if (wanted.empty() || wanted[body_.faces()[t]] != 0) samples_.push_back(static_cast<std::uint32_t>(t));
    }
    if (samples_.empty()) throw Error(ErrorCode::invalid_argument, "at: none of these faces belongs to the body");
  }

  double default_tolerance(const Mesh& mesh, const RunContext& context) const {
    constexpr double share = 0.05;
    double least = infinity;
    for (const Contact& contact : contacts(place(mesh.points, context), context)) least = std::min(least, contact.thickness);
    if (!(std::isfinite(least) && least > 0)) {
      throw Error(ErrorCode::numerical_failure, least == 0 ? "faces: somewhere the body has the thickness 0; give the tolerance"
                                                           : "faces: the body has no thickness at any of its faces");
    }
    return share * least;
  }

  Placed place(std::span<const Vec3> points, const RunContext& context) const {
    Placed placed{points, triangles_, tree_.moved(points, context), {}, {}, bounding_box(points).diagonal()};
    placed.normals.resize(triangles_.size());
    parallel_for(context, triangles_.size(), std::size_t{1} << 14, [&](std::size_t begin, std::size_t end) {
      for (std::size_t t = begin; t < end; ++t) {
        const Vec3 a = placed.corner(t, 0), normal = cross(placed.corner(t, 1) - a, placed.corner(t, 2) - a);
        const double size = norm(normal);
        if (size > 0) placed.normals[t] = normal / size;
      }
    });
    if (method_ == ThicknessMethod::spheres) placed.cones = placed.tree.cones(placed.normals, opposing_, context);
    return placed;
  }

  std::vector<Contact> contacts(const Placed& placed, const RunContext& context) const {
    std::vector<Contact> found(samples_.size());
    parallel_for(context, samples_.size(), 256, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const std::uint32_t triangle = samples_[i];
        if (placed.normals[triangle] == Vec3{}) continue;
        found[i] = method_ == ThicknessMethod::rays ? along_ray(placed, triangle) : by_sphere(placed, triangle, opposing_);
      }
    });
    return found;
  }

  /// Adds the derivative of the thickness at a triangle, times weight.
  static void add(const Placed& placed, std::uint32_t triangle, const Contact& contact, double weight, Points& gradient) {
    const Triangle& opposite = placed.triangles[contact.place.triangle];
    for (std::size_t i = 0; i < 3; ++i) {
      gradient[opposite[i]] = gradient[opposite[i]] + (weight * contact.place.weights[i]) * contact.by_place;
    }
    // The inward normal is -n / |n| with n = (b - a) x (c - a).
    const Triangle& own = placed.triangles[triangle];
    const Vec3 ab = placed.corner(triangle, 1) - placed.corner(triangle, 0),
               ac = placed.corner(triangle, 2) - placed.corner(triangle, 0);
    const Vec3& outwards = placed.normals[triangle];
    const Vec3 across = contact.by_direction - dot(contact.by_direction, outwards) * outwards;
    const Vec3 by_normal = (-1 / length(cross(ab, ac))) * across;
    const Vec3 by_b = cross(ac, by_normal), by_c = cross(by_normal, ab);
    const std::array<Vec3, 3> turning{-1.0 * (by_b + by_c), by_b, by_c};
    for (std::size_t i = 0; i < 3; ++i) {
      gradient[own[i]] = gradient[own[i]] + weight * (turning[i] - contact.by_place / 3);
    }
  }

  Measurement measured(std::span<const Vec3> points, Gradients gradients, const RunContext& context) const override {
    const Placed placed = place(points, context);
    const std::vector<Contact> found = contacts(placed, context);
    std::vector<double> samples(found.size());
    std::size_t finite = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
      samples[i] = found[i].thickness;
      finite += std::isfinite(samples[i]) ? 1 : 0;
    }
    if (finite == 0) throw Error(ErrorCode::numerical_failure, "points: the body has no thickness at any of its faces");
    const SmoothLeast smooth = smooth_least(samples, tolerance_);
    const std::uint32_t thinnest = samples_[smooth.least];
    Measurement result{{smooth.value},
                       {},
                       Least{samples[smooth.least], placed.centroid(thinnest), body_.faces()[thinnest], tolerance_, finite, 0}};
    if (gradients == Gradients::wanted) {
      Points& gradient = result.gradients.emplace_back(points.size(), Vec3{});
      for (std::size_t i = 0; i < found.size(); ++i) {
        if (smooth.weights[i] > 0) add(placed, samples_[i], found[i], smooth.weights[i], gradient);
      }
    }
    return result;
  }

  Body body_;
  ThicknessMethod method_;
  double opposing_;  ///< least cosine between the inward normal and the outward one of the other side
  double tolerance_ = 0;
  std::vector<Triangle> triangles_;     ///< of faces
  std::vector<std::uint32_t> samples_;  ///< triangles at whose centroids it is measured
  TriangleTree tree_;
};

}  // namespace

std::unique_ptr<const Measure> make_thickness(const Mesh& mesh, const ThicknessOptions& options, const RunContext& context) {
  if (!std::isfinite(options.tolerance) || options.tolerance < 0) {
    throw Error(ErrorCode::invalid_argument,
                "tolerance: " + number_digits(options.tolerance) + ", expected a length over 0, or 0");
  }
  if (!(options.opposing_degrees >= 0 && options.opposing_degrees <= 90)) {
    throw Error(ErrorCode::invalid_argument,
                "opposing_degrees: " + number_digits(options.opposing_degrees) + ", expected 0 to 90");
  }
  return std::make_unique<Thickness>(mesh, options, context);
}

}  // namespace deform::measures
