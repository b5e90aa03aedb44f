// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"

namespace deform {

/// Something that can be sampled uniformly: pieces of known measure (triangles and their area, cells and their volume).
class Pieces {
 public:
  Pieces() = default;
  Pieces(const Pieces&) = delete;
  Pieces& operator=(const Pieces&) = delete;
  virtual ~Pieces() = default;

  virtual std::size_t count() const = 0;
  virtual double measure(std::size_t piece) const = 0;  ///< >= 0; pieces of measure 0 get no point
  /// A point of a piece, evenly distributed when the three numbers are, in [0, 1).
  virtual Vec3 place(std::size_t piece, const Vec3& random) const = 0;
};

/// Points evenly distributed over pieces (thesis 8.3: random points within each triangle), in the order of the pieces: one in
/// each of `count` equal parts of the total measure. The same for a seed, whatever the number of threads. Empty when the total is
/// 0.
struct UniformSamples {
  std::vector<Vec3> points;
  double measure = 0;  ///< of all pieces
};
UniformSamples sample_uniformly(const Pieces& pieces, std::size_t count, std::uint64_t seed, const RunContext& context = {});

/// Evenly distributed in a tetrahedron: folds the cube of three even numbers into it (Rocchini, Cignoni 2000).
Vec3 place_in_tetrahedron(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d, Vec3 random);
/// Evenly distributed in a triangle, from the first two numbers.
Vec3 place_in_triangle(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& random);

/// The farthest-point order of farthest_points.h, with searches in a k-d tree instead of passes over all points: about
/// n log(count) steps where the points fill a surface or a volume evenly. `taken` are points already there: the order keeps away
/// from them too; without any it starts with the point farthest from the mean. Fewer than `count` when only points are left that
/// coincide with those taken. For one thread, deterministic.
std::vector<std::uint32_t> fast_farthest_points(std::span<const Vec3> points, std::size_t count, std::span<const Vec3> taken,
                                                const RunContext& context = {});

/// A surface and the space it is in as many points, which stand for equal shares of the area and of the volume.
struct DensePoints {
  std::vector<Vec3> points;  ///< those of the surface first
  std::size_t surface = 0;   ///< how many
  double area = 0, volume = 0;
  bool uniform = true;  ///< by sample_uniformly(); false: points as they came

  std::size_t in_volume() const { return points.size() - surface; }
};

struct SampleOptions {
  std::size_t surface = 0, volume = 0;  ///< how many samples start on the surface and in the volume
  int relaxation_steps = 12;            ///< of Lloyd's method
  /// What a dense point of the surface weighs, one of the volume weighs 1: keeps samples on the surface, where it pulls some
  /// more.
  double surface_weight = 10;
};

/// Evenly spread samples (thesis 8.3, 8.4, figure 8.2): farthest points of the surface, then of the volume keeping away from
/// them, relaxed together by Lloyd's method (1982), in which every sample moves to the weighted mean of the dense points that are
/// nearest to it. No two coincide. Those of the surface first; fewer than asked for where there are fewer distinct dense points.
/// The same for any number of threads.
struct Samples {
  std::vector<Vec3> points;
  std::size_t surface = 0;
};
Samples spread_samples(const DensePoints& dense, const SampleOptions& options, const RunContext& context = {});

/// What part of the volume, or without points in a volume of the area, is nearest to each of the samples (thesis 8.4: Voronoi
/// volumes). They add up to dense.volume or dense.area.
std::vector<double> voronoi_shares(std::span<const Vec3> samples, const DensePoints& dense, const RunContext& context = {});

}  // namespace deform
