// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/enclosed_pieces.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/mesh/face_triangles.h"

namespace deform {

namespace {

constexpr double most_cubes = 5e4;
constexpr double thinnest = 1e-3;       // of the longest side, of the box that is cut into cubes
constexpr double beside = 1e-6;         // of the diagonal: how far from a face its sides are looked at
constexpr double side_tolerance = 0.1;  // of the winding number
constexpr double enclosing_share = 0.9;
constexpr std::size_t checked_piece_points = 2000;
constexpr std::size_t enclosed_points_per_range = 64;
constexpr int most_tries = 16;

/// The cubes of a box, the first coordinate running fastest.
struct Grid {
  Vec3 least{};
  double size = 0;
  std::array<std::size_t, 3> counts{};

  explicit Grid(const Box& box) {
    Vec3 extent = box.max - box.min;
    const double longest = std::max({extent[0], extent[1], extent[2]});
    for (double& side : extent) side = std::max(side, thinnest * longest);
    size = std::cbrt(extent[0] * extent[1] * extent[2] / most_cubes);
    for (std::size_t k = 0; k < 3; ++k) {
      counts[k] = static_cast<std::size_t>(std::ceil(extent[k] / size)) + 1;
      least[k] = 0.5 * (box.min[k] + box.max[k]) - 0.5 * size * static_cast<double>(counts[k]);
    }
  }
  std::size_t cubes() const { return counts[0] * counts[1] * counts[2]; }
  Vec3 corner(std::size_t cube) const {
    const std::size_t i = cube % counts[0], j = cube / counts[0] % counts[1], k = cube / counts[0] / counts[1];
    return least + size * Vec3{static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)};
  }
  Vec3 middle(std::size_t cube) const { return corner(cube) + 0.5 * size * Vec3{1, 1, 1}; }
  std::size_t along(double x, std::size_t axis) const {
    const double at = std::floor((x - least[axis]) / size);
    return static_cast<std::size_t>(std::clamp(at, 0.0, static_cast<double>(counts[axis] - 1)));
  }
};

/// Blocks of a grid, `width` cubes wide. A block without faces is inside or outside as a whole.
class Blocks {
 public:
  explicit Blocks(const Grid& grid) : grid_(grid) {
    for (std::size_t k = 0; k < 3; ++k) counts_[k] = (grid.counts[k] + width - 1) / width;
  }
  std::size_t count() const { return counts_[0] * counts_[1] * counts_[2]; }
  std::vector<std::size_t> cubes(std::size_t block) const {
    const std::array<std::size_t, 3> at{block % counts_[0], block / counts_[0] % counts_[1], block / counts_[0] / counts_[1]};
    std::array<std::size_t, 3> end;
    for (std::size_t k = 0; k < 3; ++k) end[k] = std::min(grid_.counts[k], width * (at[k] + 1));
    std::vector<std::size_t> result;
    for (std::size_t z = width * at[2]; z < end[2]; ++z) {
      for (std::size_t y = width * at[1]; y < end[1]; ++y) {
        for (std::size_t x = width * at[0]; x < end[0]; ++x) result.push_back((z * grid_.counts[1] + y) * grid_.counts[0] + x);
      }
    }
    return result;
  }

 private:
  static constexpr std::size_t width = 4;
  const Grid& grid_;
  std::array<std::size_t, 3> counts_{};
};

/// The octants of a cube, with a random point in each. Deterministic.
struct Octants {
  std::array<Vec3, 8> corners, random;

  Octants(const Grid& grid, std::size_t cube, std::uint64_t seed) {
    std::mt19937_64 numbers(seed + cube);
    corners.fill(grid.corner(cube));
    for (std::size_t e = 0; e < 8; ++e) {
      for (std::size_t k = 0; k < 3; ++k) {
        if ((e >> k & 1U) != 0) corners[e][k] += 0.5 * grid.size;
        random[e][k] = corners[e][k] + 0.5 * grid.size * static_cast<double>(numbers() >> 11) * 0x1p-53;
      }
    }
  }
};

/// The cubes that the box of a triangle touches, each triangle cut into parts no longer than a cube first.
class TouchedCubes {
 public:
  explicit TouchedCubes(const Grid& grid) : touched(grid.cubes(), 0), grid_(grid) {}

  void add(const Vec3& a, const Vec3& b, const Vec3& c) {
    const double ab = squared_distance(a, b), bc = squared_distance(b, c), ca = squared_distance(c, a);
    const double longest = std::max({ab, bc, ca}), limit = grid_.size * grid_.size;
    if (longest <= limit) return mark(a, b, c);
    if (longest == ab) return halve(a, b, c);
    if (longest == bc) return halve(b, c, a);
    halve(c, a, b);
  }

  std::vector<char> touched;

 private:
  void halve(const Vec3& a, const Vec3& b, const Vec3& c) {
    const Vec3 middle = lerp(a, b, 0.5);
    add(a, middle, c);
    add(middle, b, c);
  }
  void mark(const Vec3& a, const Vec3& b, const Vec3& c) {
    std::array<std::size_t, 3> from, to;
    for (std::size_t k = 0; k < 3; ++k) {
      from[k] = grid_.along(std::min({a[k], b[k], c[k]}), k);
      to[k] = grid_.along(std::max({a[k], b[k], c[k]}), k);
    }
    for (std::size_t z = from[2]; z <= to[2]; ++z) {
      for (std::size_t y = from[1]; y <= to[1]; ++y) {
        for (std::size_t x = from[0]; x <= to[0]; ++x) touched[(z * grid_.counts[1] + y) * grid_.counts[0] + x] = 1;
      }
    }
  }

  const Grid& grid_;
};

bool inside(const WindingNumber& winding, const Vec3& x) { return std::abs(winding.at(x)) > 0.5; }

/// The share of points on faces that have inside and outside within reach, in one direction or its opposite of three.
double share_between(const WindingNumber& winding, std::span<const Vec3> on_faces, double reach, const RunContext& context) {
  const std::size_t count = std::min(checked_piece_points, on_faces.size());
  if (count == 0) return 0;
  std::vector<char> between(count, 0);
  parallel_for(context, count, enclosed_points_per_range, [&](std::size_t begin, std::size_t end) {
    for (std::size_t s = begin; s < end; ++s) {
      const Vec3& x = on_faces[s * on_faces.size() / count];
      for (std::size_t k = 0; k < 3 && between[s] == 0; ++k) {
        Vec3 step{};
        step[k] = reach;
        const double one = std::abs(winding.at(x + step)), other = std::abs(winding.at(x - step));
        between[s] = std::max(one, other) > 1 - side_tolerance && std::min(one, other) < side_tolerance ? 1 : 0;
      }
    }
  });
  return static_cast<double>(std::count(between.begin(), between.end(), 1)) / static_cast<double>(count);
}

}  // namespace

EnclosedPieces::EnclosedPieces(const Mesh& mesh, std::span<const Vec3> points, std::span<const Vec3> on_faces, std::uint64_t seed,
                               const RunContext& context)
    : winding_(mesh, points) {
  Box box;
  for (const Vec3& x : on_faces) box.add(x);
  if (on_faces.empty()) return;
  enclosing_area_ = share_between(winding_, on_faces, beside * box.diagonal(), context);
  if (enclosing_area_ < enclosing_share) return;
  box = Box();
  for (const PointId corner : mesh.face_points) box.add(points[corner]);
  const Grid grid(box);
  size_ = grid.size;
  TouchedCubes faces(grid);
  for_each_triangle(mesh, points, [&](const Vec3& a, const Vec3& b, const Vec3& c) { faces.add(a, b, c); });

  // The octants of untouched cubes are all inside or all outside.
  std::vector<unsigned char> inside_octants(grid.cubes(), 0);
  const Blocks blocks(grid);
  parallel_for(context, blocks.count(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t b = begin; b < end; ++b) {
      const std::vector<std::size_t> cubes = blocks.cubes(b);
      const bool touched = std::any_of(cubes.begin(), cubes.end(), [&](std::size_t i) { return faces.touched[i] != 0; });
      const bool all = !touched && inside(winding_, grid.middle(cubes[cubes.size() / 2]));
      for (const std::size_t i : cubes) {
        if (faces.touched[i] == 0) {
          inside_octants[i] = (touched ? inside(winding_, grid.middle(i)) : all) ? 0xff : 0;
          continue;
        }
        const Octants octants(grid, i, seed);
        for (std::size_t e = 0; e < 8; ++e) {
          if (inside(winding_, octants.random[e])) inside_octants[i] |= static_cast<unsigned char>(1U << e);
        }
      }
    }
  });
  for (std::size_t i = 0; i < grid.cubes(); ++i) {
    if (inside_octants[i] == 0) continue;
    if (faces.touched[i] == 0) {
      pieces_.push_back({grid.middle(i), grid.corner(i), true});
      continue;
    }
    const Octants octants(grid, i, seed);
    for (std::size_t e = 0; e < 8; ++e) {
      if ((inside_octants[i] >> e & 1U) != 0) pieces_.push_back({octants.random[e], octants.corners[e], false});
    }
  }
}

double EnclosedPieces::measure(std::size_t piece) const {
  const double size = pieces_[piece].whole ? size_ : 0.5 * size_;
  return size * size * size;
}

Vec3 EnclosedPieces::place(std::size_t piece, const Vec3& random) const {
  const Piece& of = pieces_[piece];
  if (of.whole) return of.least + size_ * random;
  Vec3 at = random;
  for (int i = 0; i < most_tries; ++i) {
    const Vec3 x = of.least + 0.5 * size_ * at;
    if (inside(winding_, x)) return x;
    // The next of a sequence that fills the cube evenly (Roberts 2018, from powers of the root of x^4 = x + 1).
    const Vec3 step{0.8191725133961645, 0.6710436067037893, 0.5497004779019703};
    for (std::size_t k = 0; k < 3; ++k) {
      at[k] += step[k];
      if (at[k] >= 1) at[k] -= 1;
    }
  }
  return of.inside;
}

std::size_t enclosed_pieces_bytes(const Mesh& mesh) {
  const std::size_t triangles = mesh.face_points.size() - std::min(mesh.face_points.size(), 2 * mesh.face_count());
  // Twice the box of the points, where sides are rounded up.
  const auto cubes = static_cast<std::size_t>(2 * most_cubes);
  return 2 * WindingNumber::bytes_for(triangles) + cubes * 64;
}

}  // namespace deform
