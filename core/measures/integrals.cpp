// SPDX-License-Identifier: Apache-2.0
#include "core/measures/integrals.h"

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"

namespace deform::measures {

namespace {

constexpr std::size_t triangle_grain = 4096;

/// Sums over triangles, and the derivatives of such sums at the points, in a fixed order.
class TriangleSums {
 public:
  TriangleSums(std::vector<Triangle> triangles, std::size_t points) : triangles_(std::move(triangles)), starts_(points + 1) {
    for (const Triangle& triangle : triangles_) {
      for (const PointId corner : triangle) ++starts_[corner + 1];
    }
    for (std::size_t i = 0; i < points; ++i) starts_[i + 1] += starts_[i];
    uses_.resize(3 * triangles_.size());
    std::vector<std::uint64_t> next(starts_.begin(), starts_.end() - 1);
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      for (std::size_t i = 0; i < 3; ++i) uses_[next[triangles_[t][i]]++] = 3 * t + i;
    }
  }

  /// The sum of integrand.value(a, b, c), K numbers.
  template <typename Integrand>
  std::array<double, Integrand::count> sum(const Points& points, const Integrand& integrand, const RunContext& context) const {
    using Numbers = std::array<double, Integrand::count>;
    std::vector<Numbers> parts((triangles_.size() + triangle_grain - 1) / triangle_grain, Numbers{});
    parallel_for(context, triangles_.size(), triangle_grain, [&](std::size_t begin, std::size_t end) {
      Numbers& part = parts[begin / triangle_grain];
      for (std::size_t t = begin; t < end; ++t) {
        const Triangle& triangle = triangles_[t];
        const Numbers numbers = integrand.value(points[triangle[0]], points[triangle[1]], points[triangle[2]]);
        for (std::size_t k = 0; k < numbers.size(); ++k) part[k] += numbers[k];
      }
    });
    Numbers sum{};
    for (const Numbers& part : parts) {
      for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += part[k];
    }
    return sum;
  }

  /// Its derivatives at all points: K fields. integrand.slope(a, b, c) is the derivative by a; integrands do not depend on which
  /// corner is the first.
  template <typename Integrand>
  std::array<Points, Integrand::count> slopes(const Points& points, const Integrand& integrand, const RunContext& context) const {
    std::array<Points, Integrand::count> fields;
    for (Points& field : fields) field.assign(points.size(), Vec3{});
    parallel_for(context, points.size(), triangle_grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t point = begin; point < end; ++point) {
        for (std::uint64_t use = starts_[point]; use < starts_[point + 1]; ++use) {
          const Triangle& triangle = triangles_[uses_[use] / 3];
          const std::size_t i = uses_[use] % 3;
          const auto slope = integrand.slope(points[point], points[triangle[(i + 1) % 3]], points[triangle[(i + 2) % 3]]);
          for (std::size_t k = 0; k < slope.size(); ++k) fields[k][point] = fields[k][point] + slope[k];
        }
      }
    });
    return fields;
  }

 private:
  std::vector<Triangle> triangles_;
  std::vector<std::uint64_t> starts_;  ///< points + 1
  std::vector<std::uint64_t> uses_;    ///< 3 * triangle + corner, those of a point ascending
};

struct VolumeIntegrand {
  static constexpr std::size_t count = 1;
  Vec3 middle;

  std::array<double, 1> value(const Vec3& a, const Vec3& b, const Vec3& c) const {
    return {dot(a - middle, cross(b - middle, c - middle)) / 6};
  }
  std::array<Vec3, 1> slope(const Vec3&, const Vec3& b, const Vec3& c) const { return {cross(b - middle, c - middle) / 6}; }
};

/// The volume and its first moments about `middle`.
struct MomentsIntegrand {
  static constexpr std::size_t count = 4;
  Vec3 middle;

  std::array<double, 4> value(const Vec3& p, const Vec3& q, const Vec3& r) const {
    const Vec3 a = p - middle, b = q - middle, c = r - middle, sum = a + b + c;
    const double size = dot(a, cross(b, c));
    return {size / 6, size * sum[0] / 24, size * sum[1] / 24, size * sum[2] / 24};
  }
  std::array<Vec3, 4> slope(const Vec3& p, const Vec3& q, const Vec3& r) const {
    const Vec3 a = p - middle, b = q - middle, c = r - middle, sum = a + b + c, across = cross(b, c);
    const double size = dot(a, across);
    std::array<Vec3, 4> slope{across / 6};
    for (std::size_t k = 0; k < 3; ++k) {
      slope[k + 1] = (sum[k] / 24) * across;
      slope[k + 1][k] += size / 24;
    }
    return slope;
  }
};

struct AreaIntegrand {
  static constexpr std::size_t count = 1;

  std::array<double, 1> value(const Vec3& a, const Vec3& b, const Vec3& c) const { return {length(cross(b - a, c - a)) / 2}; }
  std::array<Vec3, 1> slope(const Vec3& a, const Vec3& b, const Vec3& c) const {
    const Vec3 normal = cross(b - a, c - a);
    const double size = length(normal);
    if (size == 0) return {Vec3{}};  // the area has a kink there
    return {cross(b - c, normal / size) / 2};
  }
};

struct ProjectedAreaIntegrand {
  static constexpr std::size_t count = 1;
  Vec3 direction;

  std::array<double, 1> value(const Vec3& a, const Vec3& b, const Vec3& c) const {
    return {std::abs(dot(cross(b - a, c - a), direction)) / 4};
  }
  std::array<Vec3, 1> slope(const Vec3& a, const Vec3& b, const Vec3& c) const {
    const double size = dot(cross(b - a, c - a), direction);
    const double sign = size > 0 ? 1 : size < 0 ? -1 : 0;
    return {(sign / 4) * cross(b - c, direction)};
  }
};

Vec3 middle_of(const Mesh& mesh, const FaceChoice& choice) {
  const Box box = chosen_triangles(mesh, choice).box(mesh.points);
  return 0.5 * (box.min + box.max);
}

class Volume : public Measure {
 public:
  Volume(const Mesh& mesh, const FaceChoice& choice, Rims rims)
      : Measure(mesh.point_count()),
        body_(mesh, choice, rims),
        sums_(body_.triangles(), mesh.point_count() + body_.rim_count()),
        integrand_{middle_of(mesh, choice)} {}

 private:
  Measurement measured(std::span<const Vec3> points, Gradients gradients, const RunContext& context) const override {
    const Points placed = body_.with_centres(points);
    Measurement found{{sums_.sum(placed, integrand_, context)[0]}, {}, {}};
    if (gradients == Gradients::wanted) {
      found.gradients.push_back(std::move(sums_.slopes(placed, integrand_, context)[0]));
      body_.carry_centres(found.gradients[0]);
    }
    return found;
  }

  Body body_;
  TriangleSums sums_;
  VolumeIntegrand integrand_;
};

class CentreOfGravity : public Measure {
 public:
  CentreOfGravity(const Mesh& mesh, const FaceChoice& choice, Rims rims)
      : Measure(mesh.point_count()),
        body_(mesh, choice, rims),
        sums_(body_.triangles(), mesh.point_count() + body_.rim_count()),
        integrand_{middle_of(mesh, choice)} {}

  std::size_t value_count() const override { return 3; }

 private:
  Measurement measured(std::span<const Vec3> points, Gradients gradients, const RunContext& context) const override {
    const Points placed = body_.with_centres(points);
    const auto [volume, x, y, z] = sums_.sum(placed, integrand_, context);
    if (!(volume > 0))
      throw Error(ErrorCode::numerical_failure, "points: the faces enclose no volume, so there is no centre of gravity");
    const Vec3 offset = Vec3{x, y, z} / volume, centre = integrand_.middle + offset;
    Measurement found{{centre.begin(), centre.end()}, {}, {}};
    if (gradients == Gradients::wanted) {
      auto slopes = sums_.slopes(placed, integrand_, context);
      for (std::size_t k = 0; k < 3; ++k) {
        Points& field = slopes[k + 1];
        for (std::size_t i = 0; i < field.size(); ++i) field[i] = (field[i] - offset[k] * slopes[0][i]) / volume;
        body_.carry_centres(field);
        found.gradients.push_back(std::move(field));
      }
    }
    return found;
  }

  Body body_;
  TriangleSums sums_;
  MomentsIntegrand integrand_;
};

/// An integral over faces that need not be closed.
template <typename Integrand>
class FaceIntegral : public Measure {
 public:
  FaceIntegral(const Mesh& mesh, const FaceChoice& choice, const Integrand& integrand)
      : Measure(mesh.point_count()), sums_(chosen_triangles(mesh, choice).triangles, mesh.point_count()), integrand_(integrand) {}

 private:
  Measurement measured(std::span<const Vec3> points, Gradients gradients, const RunContext& context) const override {
    const Points placed(points.begin(), points.end());
    Measurement found{{sums_.sum(placed, integrand_, context)[0]}, {}, {}};
    if (gradients == Gradients::wanted) found.gradients.push_back(std::move(sums_.slopes(placed, integrand_, context)[0]));
    return found;
  }

  TriangleSums sums_;
  Integrand integrand_;
};

}  // namespace

std::unique_ptr<const Measure> make_volume(const Mesh& mesh, const FaceChoice& choice, Rims rims) {
  return std::make_unique<Volume>(mesh, choice, rims);
}

std::unique_ptr<const Measure> make_centre_of_gravity(const Mesh& mesh, const FaceChoice& choice, Rims rims) {
  return std::make_unique<CentreOfGravity>(mesh, choice, rims);
}

std::unique_ptr<const Measure> make_area(const Mesh& mesh, const FaceChoice& choice) {
  return std::make_unique<FaceIntegral<AreaIntegrand>>(mesh, choice, AreaIntegrand{});
}

std::unique_ptr<const Measure> make_projected_area(const Mesh& mesh, const FaceChoice& choice, const Vec3& direction) {
  const double size = norm(direction);
  if (!std::isfinite(size) || !(size > 0)) {
    throw Error(ErrorCode::invalid_argument, "direction: expected three finite numbers that are not all 0");
  }
  return std::make_unique<FaceIntegral<ProjectedAreaIntegrand>>(mesh, choice, ProjectedAreaIntegrand{direction / size});
}

}  // namespace deform::measures
