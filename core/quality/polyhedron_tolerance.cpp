// SPDX-License-Identifier: Apache-2.0
// Names as in the comments: A area vector of a face, C its centre, c a triangle's centre, a their sizes |n| (twice the areas).
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/vectors.h"
#include "core/quality/cell_tolerance.h"
#include "core/quality/infinity.h"

namespace deform::quality {

namespace {

constexpr double least_cosine = 1e-4;    // below which nothing is said
constexpr double cell_rounding = 1e-12;  // of the cell: far more than coordinates lose when they are taken from its first point
constexpr double most_of_product = 0.9;  // of a pyramid, that it may lose
constexpr double most_of_volume = 0.5;
constexpr double most_of_sizes = 0.5;  // of a face's triangles

/// The data of a face for the bounds.
struct Face {
  Vec3 centre{}, normal{};  ///< C, A out of the cell
  double corners = 0;
  double sizes = 1;  ///< sum of a
  /// Sums over the triangles of 1, of their perimeters and of a times the angle between n and A, or n and -A.
  struct Sums {
    double count = 0, around = 0, warp = 0;
  };
  Sums all;            ///< as they are
  Sums by_reach;       ///< each times |c - C|
  Sums by_height;      ///< each times |(c - C) . A| / |A|
  double swing = 0;    ///< half the sum of the lengths from the corner before to the one after each
  double area = 0;     ///< |A|
  Vec3 way{};          ///< from the mean of the centres to C
  double length = 0;   ///< of way
  double pyramid = 0;  ///< A . way
  double to_face = 0;  ///< length of the way from the cell's centre to C
  double product = 0;  ///< A . that
};

/// The common data of the faces of a cell.
struct Cell {
  std::vector<Face> faces;
  double extent = 0, volume = 0, moment = 0;  ///< volume: sum of the pyramids; moment: |sum of pyramid way|
  double closure = 0;                         ///< |sum of A|, 0 where faces close
  double skew = 0;                            ///< |3/4 (sum of way A^T) / volume - 1/4|, 0 where they close and are flat
};

struct Triangle {
  Vec3 normal, centre;
  double size, around;
};

/// The fan around the mean of the corners, with which the centre of a face is defined.
void fan(std::span<const Vec3> corners, std::vector<Triangle>& triangles, Face& face) {
  Vec3 mean{};
  for (const Vec3& p : corners) mean = mean + p;
  mean = (1 / face.corners) * mean;
  Vec3 twice{}, weighted{};
  face.sizes = 0;
  triangles.clear();
  for (std::size_t c = 0; c < corners.size(); ++c) {
    const Vec3 &p = corners[c], &next = corners[(c + 1) % corners.size()];
    const Vec3 normal = cross(next - p, mean - p);
    const Triangle& t = triangles.emplace_back(Triangle{normal, (1.0 / 3) * (p + next + mean), length(normal),
                                                        length(next - p) + length(mean - p) + length(mean - next)});
    face.sizes += t.size;
    twice = twice + normal;
    weighted = weighted + t.size * t.centre;
  }
  face.centre = (1 / face.sizes) * weighted;
  face.normal = 0.5 * twice;
  const Vec3 unit = (1 / length(face.normal)) * face.normal;
  for (const Triangle& t : triangles) {
    const double off = std::min(length(t.normal - t.size * unit), length(t.normal + t.size * unit));
    const double warp = t.size > 0 ? t.size * 2 * std::asin(std::min(1.0, 0.5 * off / t.size)) : 0.0;
    const auto add = [&](Face::Sums& to, double times) {
      to.count += times;
      to.around += times * t.around;
      to.warp += times * warp;
    };
    add(face.all, 1);
    add(face.by_reach, length(t.centre - face.centre));
    add(face.by_height, std::abs(dot(t.centre - face.centre, unit)));
  }
}

Face measured(std::span<const Vec3> corners, double sign, std::vector<Triangle>& triangles) {
  const std::size_t n = corners.size();
  Face face;
  face.corners = static_cast<double>(n);
  for (std::size_t c = 0; c < n; ++c) face.swing += 0.5 * length(corners[(c + 1) % n] - corners[(c + n - 1) % n]);
  if (n == 3) {  // its centre is linear in the corners
    face.normal = 0.5 * cross(corners[1] - corners[0], corners[2] - corners[0]);
    face.centre = (1.0 / 3) * (corners[0] + corners[1] + corners[2]);
  } else {
    fan(corners, triangles, face);
  }
  face.normal = sign * face.normal;
  face.area = length(face.normal);
  return face;
}

/// Measures a cell; returns false if it is collapsed or nearly so.
bool measure(std::span<const Vec3> rest, std::span<const SignedFace> faces, Cell& cell) {
  if (faces.empty()) return false;
  std::vector<Vec3> corners;
  std::vector<Triangle> triangles;
  Vec3 mean{};
  for (const SignedFace& face : faces) {
    if (face.corners.size() < 3) return false;
    const Vec3& base = rest[faces[0].corners[0]];
    corners.clear();
    for (const PointId p : face.corners) {
      corners.push_back(rest[p] - base);
      cell.extent = std::max(cell.extent, length(corners.back()));
    }
    cell.faces.push_back(measured(corners, face.sign, triangles));
    mean = mean + cell.faces.back().centre;
  }
  mean = (1 / static_cast<double>(faces.size())) * mean;
  Vec3 moment{}, closure{};
  std::array<Vec3, 3> spread{};
  double sizes = 0, longest = 0;
  for (Face& face : cell.faces) {
    face.way = face.centre - mean;
    face.length = length(face.way);
    face.pyramid = dot(face.normal, face.way);
    cell.volume += face.pyramid;
    moment = moment + face.pyramid * face.way;
    closure = closure + face.normal;
    for (std::size_t i = 0; i < 3; ++i) spread[i] = spread[i] + face.way[i] * face.normal;
    sizes += face.area * face.length;
    longest = std::max(longest, face.length);
  }
  if (!(cell.volume > least_cosine * sizes)) return false;
  cell.moment = length(moment);
  cell.closure = length(closure);
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double off = 0.75 * spread[i][k] / cell.volume - (i == k ? 0.25 : 0.0);
      cell.skew += off * off;
    }
  }
  cell.skew = std::sqrt(cell.skew);
  const Vec3 centre = (0.75 / cell.volume) * moment;
  for (Face& face : cell.faces) {
    const Vec3 to_face = face.way - centre;
    face.to_face = length(to_face);
    face.product = dot(face.normal, to_face);
    if (!(face.product > least_cosine * face.area * std::max(longest, face.to_face))) return false;
  }
  return true;
}

/// Upper bounds of the changes of a face: lengths and areas.
struct Change {
  double centre = 0;  ///< |C' - C|
  double across = 0;  ///< the same along A
  double area = 0;    ///< |A' - A|
};

/// Bounds for a motion with |q| <= r and B of condition chi. A: the sum over corners of half of q x (after - before), and of q x
/// q. C: within r of the mean of the old centres c with new weights. Up to a common factor these differ from a by e, at most chi
/// |n' - n| + (chi - 1) a angle(n, A): the length of the image of a unit vector changes with its angle by no more than the
/// largest singular value less the least. |n' - n| <= r perimeter + (3 sqrt 3 / 2) r^2 (the largest triangle in a circle). As the
/// sum of a (c - C) is 0, that mean is off by at most the sum of e |c - C| over what sizes there are. Infinite where e takes too
/// much of them.
Change change(const Face& face, double chi, double r) {
  Change result{r, r, r * face.swing + 0.5 * face.corners * r * r};
  if (face.corners < 4) return result;
  const auto e = [&](const Face::Sums& s) { return chi * r * (s.around + 2.6 * s.count * r) + (chi - 1) * s.warp; };
  const double lost = e(face.all);
  if (!(lost < most_of_sizes * face.sizes)) return {infinity, infinity, infinity};
  result.centre += e(face.by_reach) / (face.sizes - lost);
  result.across += e(face.by_height) / (face.sizes - lost);
  return result;
}

/// The largest loss of a normalized determinant where its parts change by no more than these bounds; infinity where a volume or
/// a pyramid may be lost. Before B, under which all products of A and ways are multiplied by its determinant. Convex along rays
/// from chi = 1, r = 0, where it is 0: so it is at most theta times the value at theta = 1.
double loss(const Cell& cell, double chi, double r, std::vector<Change>& changes) {
  r += cell_rounding * cell.extent;
  changes.clear();
  double mean = 0;
  for (const Face& face : cell.faces) mean += changes.emplace_back(change(face, chi, r)).centre;
  mean /= static_cast<double>(cell.faces.size());
  if (!(mean < infinity)) return infinity;
  // What all centres move alike, up to `mean`, cancels from the ways to the cell's centre, up to `skew` and what volumes change.
  double volume = cell.closure * mean, moment = 0;
  for (std::size_t f = 0; f < cell.faces.size(); ++f) {
    const Face& face = cell.faces[f];
    const Change& by = changes[f];
    const double way = by.centre + mean;
    const double pyramid = by.area * face.length + face.area * by.across + by.area * way;
    volume += pyramid;
    moment += std::abs(face.pyramid) * by.centre + pyramid * face.length + (pyramid + face.area * mean) * way;
  }
  if (!(volume < most_of_volume * cell.volume)) return infinity;
  const double left = cell.volume - volume;
  const double centre =
      0.75 * (moment + cell.moment * volume / cell.volume) / left + cell.skew * mean + volume / left * (1 + cell.skew) * mean;
  double most = 0;
  for (std::size_t f = 0; f < cell.faces.size(); ++f) {
    const Face& face = cell.faces[f];
    const Change& by = changes[f];
    const double way = by.centre + centre;
    const double product = by.area * face.to_face + face.area * (by.across + centre) + by.area * way;
    if (!(product < most_of_product * face.product)) return infinity;
    const double longer = way / face.to_face, larger = by.area / face.area;
    most =
        std::max(most, face.product / (face.area * face.to_face) * (product / face.product + longer + larger + longer * larger));
  }
  return most;
}

/// About the largest radius that goes with a condition; 0: none.
double radius(const Cell& cell, double chi, std::vector<Change>& changes) {
  double r = infinity;
  for (const Face& face : cell.faces) r = std::min(r, 0.1 * face.product / face.area);
  const double least = 1e-3 * r;
  for (; r > least; r *= 0.8) {
    if (loss(cell, chi, r, changes) < infinity) return r;
  }
  return 0;
}

}  // namespace

CellTolerance polyhedron_tolerance(std::span<const Vec3> rest, std::span<const SignedFace> faces, double determinant) {
  // The stronger the warp of faces, the more a condition costs.
  constexpr std::array conditions{3.0, 2.0, 1.5, 1.3, 1.1};
  Cell cell;
  CellTolerance result;
  if (!measure(rest, faces, cell)) return result;
  std::vector<Change> changes;
  const double at_rest = loss(cell, 1, 0, changes);  // by rounding
  for (const double condition : conditions) {
    const double r = radius(cell, condition, changes);
    if (r <= 3 * std::max(0.0, result.radius)) continue;
    const bool first = condition == conditions[0];
    result = {r, condition, determinant - at_rest, loss(cell, condition, r, changes), loss(cell, condition, 0, changes)};
    if (first && result.warp_loss < 0.1 * result.loss) break;
  }
  return result;
}

}  // namespace deform::quality
