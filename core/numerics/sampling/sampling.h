// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"

namespace deform {

/// A domain that can be sampled uniformly, as pieces of known measure (triangles with areas, cells with volumes).
class Pieces {
 public:
  Pieces() = default;
  Pieces(const Pieces&) = delete;
  Pieces& operator=(const Pieces&) = delete;
  virtual ~Pieces() = default;

  virtual std::size_t count() const = 0;
  virtual double measure(std::size_t piece) const = 0;  ///< area or volume, >= 0; pieces of measure 0 get no point
  /// A point of a piece, uniformly distributed if the three random numbers are uniform in [0, 1).
  virtual Vec3 place(std::size_t piece, const Vec3& random) const = 0;
};

/// Stratified random points on the pieces (thesis 8.3: random points within each triangle), in the order of the pieces: one in
/// each of `count` equal parts of the total measure. Empty if the total measure is 0. The result depends on the seed only, not on
/// the number of threads.
struct UniformSamples {
  std::vector<Vec3> points;
  double measure = 0;  ///< total measure of the pieces
};
UniformSamples sample_uniformly(const Pieces& pieces, std::size_t count, std::uint64_t seed, const RunContext& context = {});

/// A uniformly distributed point in a tetrahedron, by folding the unit cube into it (Rocchini, Cignoni 2000).
Vec3 place_in_tetrahedron(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, Vec3 random);
/// A uniformly distributed point in a triangle, from the first two random numbers.
Vec3 place_in_triangle(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& random);

/// The farthest-point order of farthest_points.h, with searches in a k-d tree instead of passes over all points: O(n log(count))
/// for points evenly distributed on a surface or in a volume. Distances to the points in `taken` count too; if it is empty, the
/// order starts with the point farthest from the mean. Returns fewer than `count` points if all remaining ones coincide with
/// selected ones. Deterministic; runs on one thread.
std::vector<std::uint32_t> fast_farthest_points(std::span<const Vec3> points, std::size_t count, std::span<const Vec3> taken,
                                                const RunContext& context = {});

/// A dense point sampling of a surface and of the volume around it. Points represent equal shares of the area or of the volume.
struct DensePoints {
  std::vector<Vec3> points;  ///< points of the surface first
  std::size_t surface = 0;   ///< number of points on the surface
  double area = 0, volume = 0;
  bool uniform = true;    ///< whether made by sample_uniformly(), or else given points
  bool enclosed = false;  ///< whether the points of the volume are in the body that the faces enclose

  std::size_t in_volume() const { return points.size() - surface; }
};

struct SampleOptions {
  std::size_t surface = 0, volume = 0;  ///< numbers of samples that start on the surface and in the volume
  int relaxation_steps = 12;            ///< steps of Lloyd's method
  /// The weight of a dense point on the surface, relative to one in the volume. Keeps samples on the surface and attracts others
  /// to it.
  double surface_weight = 10;
};

/// Evenly distributed samples (thesis 8.3, 8.4, figure 8.2): farthest points of the surface, then of the volume with distances to
/// both, relaxed together by Lloyd's method (1982), which moves each sample to the weighted mean of the dense points nearest to
/// it. Samples are distinct, those of the surface come first. There are fewer than requested if there are fewer distinct dense
/// points. The result does not depend on the number of threads.
struct Samples {
  std::vector<Vec3> points;
  std::size_t surface = 0;
};
Samples spread_samples(const DensePoints& dense, const SampleOptions& options, const RunContext& context = {});

/// The volume of the Voronoi cell of each sample (thesis 8.4), or its area if `dense` has no points in the volume. They add up to
/// dense.volume or dense.area.
std::vector<double> voronoi_shares(std::span<const Vec3> samples, const DensePoints& dense, const RunContext& context = {});

}  // namespace deform
