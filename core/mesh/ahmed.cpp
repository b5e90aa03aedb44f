// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/ahmed.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_map>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/mesh/ahmed_lattice.h"

namespace deform {

namespace {

using namespace ahmed;

enum Part { nose, roof, sides, slant, base, underbody, stilts, part_count };
constexpr const char* part_names[part_count] = {"nose", "roof", "sides", "slant", "base", "underbody", "stilts"};

/// Cosine of the smallest angle of a triangle.
double sharpest_cosine(const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3* corners[3] = {&a, &b, &c};
  double largest = -1;
  for (int k = 0; k < 3; ++k) {
    const Vec3 u = *corners[(k + 1) % 3] - *corners[k], v = *corners[(k + 2) % 3] - *corners[k];
    largest = std::max(largest, dot(u, v) / (norm(u) * norm(v)));
  }
  return largest;
}

/// The half of the body with y >= 0, patch by patch; neighbouring patches share the points of their common edge.
class HalfBody {
 public:
  HalfBody(const AhmedDivisions& divisions, double slant_degrees) : d_(divisions), lattice_(divisions, slant_degrees) {}

  void build() {
    const int nx = d_.x_count(), ny = d_.y_count(), nz = d_.z;
    const int front_end = lattice_.station_after(0), roof_end = lattice_.station_after(5);
    for (int i = 0; i < nx; ++i) {
      const Part top = i < front_end ? nose : i < roof_end ? roof : slant;
      for (int j = 0; j < ny; ++j) add_quad(at(i, j, nz), at(i + 1, j, nz), at(i + 1, j + 1, nz), at(i, j + 1, nz), top);
      const Part side = i < front_end ? nose : sides;
      for (int k = 0; k < nz; ++k) add_quad(at(i, ny, k), at(i, ny, k + 1), at(i + 1, ny, k + 1), at(i + 1, ny, k), side);
      const Part bottom = i < front_end ? nose : underbody;
      for (int j = 0; j < ny; ++j) {
        if (!in_stilt_block(i, j)) add_quad(at(i, j, 0), at(i, j + 1, 0), at(i + 1, j + 1, 0), at(i + 1, j, 0), bottom);
      }
    }
    for (int j = 0; j < ny; ++j) {
      for (int k = 0; k < nz; ++k) {
        add_quad(at(0, j, k), at(0, j, k + 1), at(0, j + 1, k + 1), at(0, j + 1, k), nose);
        add_quad(at(nx, j, k), at(nx, j + 1, k), at(nx, j + 1, k + 1), at(nx, j, k + 1), base);
      }
    }
    for (int s = 0; s < 2; ++s) add_stilt(lattice_.station_after(s == 0 ? 1 : 3), stilt_x[s]);
  }

  /// The half and its mirror image; points of the symmetry plane are shared.
  Mesh mirrored() const {
    Mesh mesh;
    mesh.points = points_;
    std::vector<PointId> image(points_.size());
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const Vec3& p = points_[i];
      image[i] = static_cast<PointId>(p[1] == 0 ? i : mesh.points.size());
      if (p[1] != 0) mesh.points.push_back({p[0], -p[1], p[2]});
    }
    for (const char* name : part_names) mesh.groups.push_back({name, {}, {}});
    for (const auto& half : {false, true}) {
      for (std::size_t f = 0; f < parts_.size(); ++f) {
        const auto& [a, b, c] = triangles_[f];
        mesh.groups[parts_[f]].faces.push_back(static_cast<FaceId>(mesh.face_sizes.size()));
        mesh.face_sizes.push_back(3);
        if (half) {
          mesh.face_points.insert(mesh.face_points.end(), {image[a], image[c], image[b]});
        } else {
          mesh.face_points.insert(mesh.face_points.end(), {a, b, c});
        }
      }
    }
    return mesh;
  }

 private:
  PointId add_point(const Vec3& p) {
    points_.push_back(p);
    return static_cast<PointId>(points_.size() - 1);
  }

  /// The point of the lattice, created on first use.
  PointId at(int i, int j, int k) {
    const std::uint64_t key =
        (static_cast<std::uint64_t>(i) << 42) | (static_cast<std::uint64_t>(j) << 21) | static_cast<std::uint64_t>(k);
    const auto [entry, added] = ids_.try_emplace(key, 0);
    if (added) entry->second = add_point(lattice_.point(i, j, k));
    return entry->second;
  }

  void add_triangle(PointId a, PointId b, PointId c, Part part) {
    triangles_.push_back({a, b, c});
    parts_.push_back(part);
  }

  /// Counter-clockwise seen from outside; divided by the diagonal that keeps the smallest angle larger.
  void add_quad(PointId a, PointId b, PointId c, PointId d, Part part) {
    const Vec3 &pa = points_[a], &pb = points_[b], &pc = points_[c], &pd = points_[d];
    const double by_ac = std::max(sharpest_cosine(pa, pb, pc), sharpest_cosine(pa, pc, pd));
    const double by_bd = std::max(sharpest_cosine(pa, pb, pd), sharpest_cosine(pb, pc, pd));
    constexpr double tie = 1e-9;  // rectangles: rounding must not decide
    if (by_ac <= by_bd + tie) {
      add_triangle(a, b, c, part);
      add_triangle(a, c, d, part);
    } else {
      add_triangle(a, b, d, part);
      add_triangle(b, c, d, part);
    }
  }

  bool in_stilt_block(int i, int j) const {
    if (j < d_.y[0]) return false;
    return (i >= lattice_.station_after(1) && i < lattice_.station_after(2)) ||
           (i >= lattice_.station_after(3) && i < lattice_.station_after(4));
  }

  /// Strip between two closed rows of equally many points; `outer` runs counter-clockwise seen from outside the body
  /// around `inner`.
  void add_ring(const std::vector<PointId>& outer, const std::vector<PointId>& inner, Part part) {
    for (std::size_t m = 0; m < outer.size(); ++m) {
      const std::size_t next = (m + 1) % outer.size();
      add_quad(outer[m], outer[next], inner[next], inner[m], part);
    }
  }

  /// The boundary of a square of n x n cells as n, n, n, n steps around it, counter-clockwise seen from below.
  template <typename Function>
  std::vector<PointId> around_square(Function id) const {
    const int n = d_.block();
    std::vector<PointId> row;
    for (int m = 0; m < n; ++m) row.push_back(id(0, m));
    for (int m = 0; m < n; ++m) row.push_back(id(m, n));
    for (int m = 0; m < n; ++m) row.push_back(id(n, n - m));
    for (int m = 0; m < n; ++m) row.push_back(id(n - m, 0));
    return row;
  }

  /// Underbody around the stilt, the stilt, and the disc on the ground. `first` is the first x station of the block.
  void add_stilt(int first, double centre_x) {
    std::vector<PointId> row = around_square([&](int i, int j) { return at(first + i, d_.y[0] + j, 0); });
    const std::size_t around = row.size();
    std::vector<Vec3> square(around), circle(around);
    for (std::size_t m = 0; m < around; ++m) {
      // From the corner with the smallest x and y, turning towards larger y.
      const double angle = -std::numbers::pi * (0.75 + 2.0 * static_cast<double>(m) / static_cast<double>(around));
      square[m] = points_[row[m]];
      circle[m] = {centre_x + stilt_radius * std::cos(angle), stilt_y + stilt_radius * std::sin(angle), clearance};
    }
    const double growth = 2 * block_half / (stilt_radius * std::numbers::pi / 2);  // ratio of the last step to the first
    for (int l = d_.ring - 1; l >= 0; --l) {
      const double t = growing(l, d_.ring, growth);
      add_row(row, circle, square, t, underbody);
    }
    std::vector<Vec3> ground = circle;
    for (Vec3& p : ground) p[2] = 0;
    for (int l = 1; l <= d_.stilt; ++l) add_row(row, circle, ground, static_cast<double>(l) / d_.stilt, stilts);
    add_disc(row, ground, centre_x);
  }

  /// The next row at from + t (to - from), joined to `row`, which it becomes.
  void add_row(std::vector<PointId>& row, const std::vector<Vec3>& from, const std::vector<Vec3>& to, double t, Part part) {
    std::vector<PointId> next;
    next.reserve(row.size());
    for (std::size_t m = 0; m < row.size(); ++m) next.push_back(add_point(lerp(from[m], to[m], t)));
    add_ring(row, next, part);
    row = std::move(next);
  }

  /// Rows from the circle to a square with bulging sides, and the cells of that square.
  void add_disc(std::vector<PointId> row, const std::vector<Vec3>& circle, double centre_x) {
    const int n = d_.block();
    constexpr double corner = 0.60, bulge = 0.35;
    const auto inner = [&](int i, int j) {
      const double u = 2.0 * i / n - 1, v = 2.0 * j / n - 1;  // -1..1
      const double half = corner * stilt_radius / std::numbers::sqrt2;
      return Vec3{centre_x + half * u * (1 + bulge * (1 - v * v) * std::abs(u)),
                  stilt_y + half * v * (1 + bulge * (1 - u * u) * std::abs(v)), 0};
    };
    std::vector<std::vector<PointId>> ids(n + 1, std::vector<PointId>(n + 1));
    for (int i = 0; i <= n; ++i) {
      for (int j = 0; j <= n; ++j) ids[i][j] = add_point(inner(i, j));
    }
    const std::vector<PointId> edge = around_square([&](int i, int j) { return ids[i][j]; });
    std::vector<Vec3> square;
    square.reserve(edge.size());
    for (const PointId id : edge) square.push_back(points_[id]);
    for (int l = 1; l < d_.disc; ++l) add_row(row, circle, square, static_cast<double>(l) / d_.disc, stilts);
    add_ring(row, edge, stilts);
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < n; ++j) add_quad(ids[i][j], ids[i][j + 1], ids[i + 1][j + 1], ids[i + 1][j], stilts);
    }
  }

  /// Position 0..1 of step l of n when steps grow by `growth` from the first to the last.
  static double growing(int l, int n, double growth) {
    if (n < 2) return static_cast<double>(l) / n;
    const double factor = std::pow(growth, 1.0 / n);
    return (std::pow(factor, l) - 1) / (std::pow(factor, n) - 1);
  }

  const AhmedDivisions d_;
  const AhmedLattice lattice_;
  Points points_;
  std::unordered_map<std::uint64_t, PointId> ids_;
  std::vector<std::array<PointId, 3>> triangles_;
  std::vector<Part> parts_;
};

/// The spacing whose number of points is closest to the target. The number is a step function, so all steps are tried.
AhmedDivisions divisions_for(const AhmedOptions& options) {
  const auto target = static_cast<double>(options.target_points);
  constexpr double surface = 1.7;  // m^2, rounded up
  const double estimate = std::sqrt(surface / target);
  AhmedDivisions best;
  double best_difference = -1;
  for (int step = -600; step <= 600; ++step) {
    const auto d = AhmedDivisions::for_spacing(estimate * std::exp(0.002 * step), options.slant_degrees);
    const double difference = std::abs(static_cast<double>(d.point_count()) - target);
    if (best_difference >= 0 && difference >= best_difference) continue;
    best = d;
    best_difference = difference;
  }
  return best;
}

}  // namespace

Mesh ahmed_body(const AhmedOptions& options) {
  if (!(options.slant_degrees >= 0 && options.slant_degrees <= 40)) {
    throw Error(ErrorCode::invalid_argument, "slant_degrees: " + number_digits(options.slant_degrees) + " is outside 0..40");
  }
  constexpr std::size_t fewest = 2000, most = 2000000;
  if (options.target_points < fewest || options.target_points > most) {
    throw Error(ErrorCode::invalid_argument, "target_points: " + std::to_string(options.target_points) + " is outside " +
                                                 std::to_string(fewest) + ".." + std::to_string(most));
  }
  HalfBody half(divisions_for(options), options.slant_degrees);
  half.build();
  return half.mirrored();
}

}  // namespace deform
