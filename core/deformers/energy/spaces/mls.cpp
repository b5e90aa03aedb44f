// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/mls.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/energy/spaces/body_reach.h"
#include "core/deformers/energy/spaces/enclosed_pieces.h"
#include "core/deformers/energy/spaces/local_functions.h"
#include "core/deformers/energy/spaces/mesh_pieces.h"
#include "core/deformers/energy/spaces/mls_ties.h"
#include "core/deformers/energy/spaces/unit_points.h"
#include "core/mesh/region.h"
#include "core/numerics/sampling/mls_basis.h"
#include "core/numerics/sampling/sampling.h"
#include "core/numerics/sparse/row_gram.h"

namespace deform {

namespace {

double cover_of(const MlsOptions& options) { return options.cover != 0 ? options.cover : default_cover(options.domain); }

constexpr std::size_t mls_points_per_range = 128;
// Thesis 8.6: 4000, or 5000 and 2000 with cells. More inside: handles that move a whole boundary in detail bend the
// functions there.
constexpr std::size_t automatic_surface = 4000, automatic_boundary = 5000, automatic_volume = 3000;
constexpr std::size_t enclosed_surface = 4000, enclosed_volume = 5000;
constexpr std::size_t connected_surface = 6000, connected_volume = 8000;
constexpr std::size_t body_surface = 8000, body_volume = 10000;  // twice as many move points by less than 1 %
constexpr std::size_t fewest_samples = 64;
constexpr std::size_t dense_per_point = 20;  // of the integration points: thesis 8.6 takes 28,000
constexpr double flat_surface = 1e-2;
constexpr double open_share = 0.25;  // of the area: holes that leave nothing enclosed

/// A triangle of a fan of a face.
struct FanTriangle {
  std::array<Vec3, 3> corners;
  Vec3 normal() const { return cross(corners[1] - corners[0], corners[2] - corners[0]); }  ///< twice its area long
};

template <typename Use>
void for_each_triangle(const Mesh& mesh, const Use& use) {
  std::size_t at = 0;
  for (const std::uint32_t size : mesh.face_sizes) {
    const PointId* const corners = mesh.face_points.data() + at;
    for (std::size_t i = 2; i < size; ++i) {
      use(FanTriangle{{mesh.points[corners[0]], mesh.points[corners[i - 1]], mesh.points[corners[i]]}});
    }
    at += size;
  }
}

/// Whether to determine the enclosed volume. The area vectors of closed faces add up to zero, except for holes.
bool may_enclose(const Mesh& mesh, const MlsOptions& options) {
  if (options.domain == MlsDomain::surface || mesh.cell_count() != 0) return false;
  Vec3 sum{};
  double area = 0;
  for_each_triangle(mesh, [&](const FanTriangle& triangle) {
    const Vec3 normal = triangle.normal();
    sum = sum + normal;
    area += length(normal);
  });
  return length(sum) < open_share * area;
}

/// Whether supports go around slots of an enclosed volume.
bool around_slots(MlsDomain domain) { return domain == MlsDomain::connected || domain == MlsDomain::body; }

/// The default numbers of samples on faces and inside.
SampleOptions automatic_counts(const Mesh& mesh, MlsDomain domain, bool enclosed) {
  SampleOptions counts;
  const std::size_t some = std::max(mesh.point_count(), fewest_samples);
  if (mesh.cell_count() != 0) {
    counts.surface = std::min(some, automatic_boundary);
    counts.volume = std::min(some, automatic_volume);
  } else if (!enclosed) {
    counts.surface = std::min(some, automatic_surface);
  } else if (domain == MlsDomain::body) {
    counts.surface = body_surface;
    counts.volume = body_volume;
  } else {
    const bool connected = domain == MlsDomain::connected;
    counts.surface = std::min(some, connected ? connected_surface : enclosed_surface);
    counts.volume = std::min(some, connected ? connected_volume : enclosed_volume);
  }
  return counts;
}

SampleOptions sample_counts(const Mesh& mesh, const MlsOptions& options) {
  SampleOptions counts = automatic_counts(mesh, options.domain, may_enclose(mesh, options));
  if (options.surface_samples != 0) counts.surface = options.surface_samples;
  if (options.volume_samples != 0) counts.volume = options.volume_samples;
  if (mesh.cell_count() != 0 && mesh.face_count() == 0) {  // nothing to put the others on
    counts.volume += counts.surface;
    counts.surface = 0;
  }
  return counts;
}

/// Whether a mesh has fewer points than there would be samples of either kind by default.
bool fewer_than_default(const Mesh& mesh, const MlsOptions& options) {
  const bool automatic = options.surface_samples == 0 || options.volume_samples == 0;
  return automatic && options.domain == MlsDomain::connected && mesh.cell_count() == 0 && mesh.point_count() < connected_volume;
}

SampleOptions times(const SampleOptions& counts, double factor) {
  SampleOptions more = counts;
  more.surface = static_cast<std::size_t>(std::llround(factor * static_cast<double>(counts.surface)));
  more.volume = static_cast<std::size_t>(std::llround(factor * static_cast<double>(counts.volume)));
  return more;
}

std::size_t fan_triangles(const Mesh& mesh) {
  return mesh.face_points.size() - std::min(mesh.face_points.size(), 2 * mesh.face_count());
}

std::size_t whole_cover(double cover) { return static_cast<std::size_t>(std::ceil(cover)); }

/// gamma_s and gamma_b at every integration point.
struct Weights {
  std::vector<double> stretching, bending;
};

Weights weights_at(const Mesh& mesh, std::span<const Vec3> points, const std::vector<Vec3>& places, const MlsOptions& options,
                   const RunContext& context) {
  Weights weights{std::vector<double>(places.size(), options.stretching), std::vector<double>(places.size(), options.bending)};
  if (options.weights.empty()) return weights;
  std::vector<std::size_t> last(points.size(), 0);  // the region that counts, from 1
  for (std::size_t r = 0; r < options.weights.size(); ++r) {
    const std::string what = "method.mls.weights[" + std::to_string(r) + "]";
    for (const PointId id : select(options.weights[r].region, mesh, what)) last[id] = r + 1;
  }
  const std::vector<std::uint32_t> nearest = nearest_points(PointTree(points), places, context);
  for (std::size_t i = 0; i < places.size(); ++i) {
    const std::size_t r = last[nearest[i]];
    if (r == 0) continue;
    weights.stretching[i] = options.weights[r - 1].stretching;
    weights.bending[i] = options.weights[r - 1].bending;
  }
  return weights;
}

/// Keeps about one in `factor` of the dense points, equally distributed, so that there are as many per sample as per integration
/// point. Points of a cloud, which may be in any order, are all kept.
DensePoints thinned(const DensePoints& dense, double factor) {
  const auto step = static_cast<std::size_t>(factor);
  if (!dense.uniform || step < 2) return dense;
  DensePoints few;
  few.area = dense.area;
  few.volume = dense.volume;
  few.enclosed = dense.enclosed;
  for (std::size_t i = 0; i < dense.surface; i += step) few.points.push_back(dense.points[i]);
  few.surface = few.points.size();
  for (std::size_t i = dense.surface; i < dense.points.size(); i += step) few.points.push_back(dense.points[i]);
  return few;
}

/// Integration points with the measures of their Voronoi cells; points with empty cells are left out.
struct Cubature {
  std::vector<Vec3> points;
  std::vector<double> shares;
};

Cubature cubature_of(const DensePoints& dense, SampleOptions counts, const RunContext& context) {
  counts.relaxation_steps /= 2;  // they have weights for what is left uneven
  const Samples all = spread_samples(dense, counts, context);
  const std::vector<double> shares = voronoi_shares(all.points, dense, context);
  Cubature cubature;
  for (std::size_t i = 0; i < shares.size(); ++i) {
    if (shares[i] == 0) continue;
    cubature.points.push_back(all.points[i]);
    cubature.shares.push_back(shares[i]);
  }
  return cubature;
}

/// Which derivatives make the rows of one integration point.
struct RowForm {
  bool gradient = false, second = false;

  std::size_t height() const { return (gradient ? 3 : 0) + (second ? 6 : 0); }

  void write(const MlsBasis::Row& row, double root_s, double root_b, double* out) const {
    for (std::size_t a = 0; a < row.samples.size(); ++a) {
      if (gradient) {
        for (std::size_t k = 0; k < 3; ++k) *out++ = root_s * row.gradients[a][k];
      }
      for (std::size_t p = 0; second && p < 6; ++p) *out++ = root_b * (p < 3 ? 1.0 : std::numbers::sqrt2) * row.hessians[a][p];
    }
  }
};

RowBlocks energy_rows(const MlsBasis& basis, const Cubature& cubature, const Weights& weights, const RunContext& context) {
  const auto any = [](const std::vector<double>& values) {
    return std::any_of(values.begin(), values.end(), [](double value) { return value > 0; });
  };
  const RowForm rows_of{any(weights.stretching), any(weights.bending)};
  const std::vector<std::size_t> sizes = basis.row_sizes(cubature.points, context);
  RowBlocks rows;
  rows.height = rows_of.height();
  for (const std::size_t size : sizes) rows.starts.push_back(rows.starts.back() + static_cast<std::int64_t>(size));
  rows.columns.resize(static_cast<std::size_t>(rows.starts.back()));
  rows.values.resize(rows.columns.size() * rows.height);
  const auto order = rows_of.second ? MlsBasis::Order::second : MlsBasis::Order::first;
  parallel_for(context, sizes.size(), mls_points_per_range, [&](std::size_t begin, std::size_t end) {
    MlsBasis::Row row;
    for (std::size_t i = begin; i < end; ++i) {
      basis.evaluate(cubature.points[i], order, row);
      const auto start = static_cast<std::size_t>(rows.starts[i]);
      std::copy(row.samples.begin(), row.samples.end(), rows.columns.begin() + rows.starts[i]);
      rows_of.write(row, std::sqrt(cubature.shares[i] * weights.stretching[i]),
                    std::sqrt(cubature.shares[i] * weights.bending[i]), rows.values.data() + start * rows.height);
    }
  });
  return rows;
}

std::vector<std::string> notes_of(const EnergySpace& space, const Samples& samples, const MlsBasis& basis, bool solid) {
  const auto count = static_cast<double>(space.values.rows());
  char cover[32];
  std::snprintf(cover, sizeof cover, "%.1f", static_cast<double>(space.values.nonZeros()) / std::max(count, 1.0));
  char radius[32];
  std::snprintf(radius, sizeof radius, "%.3g", basis.radius());
  std::vector<std::string> notes;
  notes.push_back(std::to_string(samples.surface) + " samples on the surface, " +
                  std::to_string(samples.points.size() - samples.surface) + " in the volume; supports of radius " + radius +
                  " D, which cover a point " + cover + " times on average");
  notes.push_back(std::to_string(space.cubature_points) + " integration points " +
                  (solid ? "in the volume" : "on the surface, with derivatives along it"));
  return notes;
}

}  // namespace

EnergySpace mls_space(const Mesh& mesh, const MlsOptions& options, std::uint64_t seed, const RunContext& context) {
  const std::vector<Vec3> points = unit_points(mesh);
  SampleOptions counts = sample_counts(mesh, options);
  SampleOptions more = times(counts, options.cubature);
  const bool enclosed = may_enclose(mesh, options);
  const VolumeOf volume_of = !enclosed                     ? VolumeOf::box
                             : options.volume_samples != 0 ? VolumeOf::enclosed_or_box
                                                           : VolumeOf::enclosed;
  context.progress("sample", 0);
  Samples samples;
  Cubature cubature;
  bool solid = false, in_body = false;
  DensePoints few;
  {
    const DensePoints dense =
        dense_points(mesh, points, {dense_per_point * more.surface, dense_per_point * more.volume, volume_of}, seed, context);
    solid = dense.in_volume() != 0;
    in_body = dense.enclosed;
    if (!solid) {
      counts.volume = 0;
      // Faces that might have enclosed a volume, and do not: there are no more samples than points on them.
      if (options.domain == MlsDomain::body && options.surface_samples == 0) {
        counts.surface = automatic_counts(mesh, options.domain, false).surface;
      }
      more = times(counts, options.cubature);
    }
    few = thinned(dense, options.cubature);
    samples = spread_samples(few, counts, context);
    cubature = cubature_of(dense, more, context);
  }
  context.progress("sample", 1);

  std::vector<Vec3> places = points;
  places.insert(places.end(), cubature.points.begin(), cubature.points.end());
  MlsBasis::Options basis_options;
  basis_options.cover.cover = whole_cover(cover_of(options));
  const double radius = covering_radius(PointTree(samples.points), places, basis_options.cover, context);
  std::shared_ptr<const BodyReach> reach;
  if (in_body && around_slots(options.domain)) {
    reach = std::make_shared<const BodyReach>(mesh, points, samples.points, few, radius, context);
    if (reach->cut() > 0) basis_options.reach = reach;
  }
  const MlsBasis basis(samples.points, radius, basis_options);
  MlsBasis::Options along_surface = basis_options;
  if (!solid) along_surface.flat = flat_surface;

  EnergySpace space;
  space.samples = samples.points.size();
  space.cubature_points = cubature.points.size();
  context.progress("basis", 0);
  space.values = basis.values(points, context);
  space.in_space = std::make_shared<const MlsFunctions>(samples.points, radius, basis_options, unit_box(mesh));
  context.progress("assemble", 0);
  const RowBlocks rows = energy_rows(MlsBasis(samples.points, radius, along_surface), cubature,
                                     weights_at(mesh, points, cubature.points, options, context), context);
  space.energy = lower_gram(rows, space.samples, context);
  space.linear = linear_coefficients(samples.points);
  space.notes = notes_of(space, samples, basis, solid);
  if (!solid && options.domain != MlsDomain::surface) {
    space.notes.push_back(
        "The faces do not enclose a volume, so that samples and energies are on them alone: the surface counts as thin, and "
        "curved "
        "parts of it do not turn exactly when all handles do");
  }
  if (reach != nullptr && reach->cut() > 0) {
    space.notes.push_back("supports of " + std::to_string(reach->cut()) +
                          " samples end at slots of the body, whose sides they would join otherwise");
  }
  if (solid && fewer_than_default(mesh, options)) {
    space.notes.push_back("there are only as many samples as points, " + std::to_string(mesh.point_count()) +
                          ": give surface_samples and volume_samples where the last per cent matter");
  }
  const Ties ties = component_ties(samples.points, joined_columns(rows, space.samples), whole_cover(cover_of(options)));
  if (ties.parts > 1) {
    // Far below the stiffness of a part itself, far above rounding.
    const double measure = space.energy.diagonal().mean();
    space.energy += SparseMatrix(1e-6 * measure * lower_gram(ties.rows, space.samples, context));
    space.notes.push_back(std::to_string(ties.parts) + " parts that no support joins follow each other weakly");
  }
  context.progress("assemble", 1);
  return space;
}

namespace {

/// The numbers on which the time depends.
struct MlsWork {
  double samples = 0, cubature = 0, points = 0, dense = 0, dense_inside = 0;
  double cover = 0;        ///< functions at a place, on average
  bool enclosed = false;   ///< the body has to be found
  bool connected = false;  ///< and ways around its slots
};

/// Measured with 150 to 4,500 samples in bodies of 3,000 to 116,000 triangles. With few samples in bodies with slots most of it
/// goes to what a place sees of them: some eight winding numbers each, at fewer places the smaller supports are.
double mls_seconds(const MlsWork& of) {
  constexpr double per_winding = 8e-6, windings_of_body = 1.3e5, windings_inside = 0.2;
  constexpr double per_place = 1.4e-4, cut_everywhere = 300;  // samples
  constexpr double per_dense = 4e-6, per_sample = 1.3e-4, per_value = 2e-7, per_derivative = 4e-7, per_pair = 1.2e-8;
  double seconds = of.points * of.cover * per_value + of.cubature * of.cover * (per_derivative + of.cover * per_pair);
  if (of.enclosed) seconds += per_winding * (windings_of_body + windings_inside * of.dense_inside);
  if (of.connected) {
    const double share = std::min(1.0, std::cbrt(cut_everywhere / std::max(of.samples, 1.0)));
    seconds += of.samples * per_sample + (of.points + of.cubature) * per_place * share;
  }
  return of.dense * per_dense + seconds / thread_count({});
}

}  // namespace

SpaceBytes estimate_mls_space(const Mesh& mesh, const MlsOptions& options) {
  const SampleOptions counts = sample_counts(mesh, options), more = times(counts, options.cubature);
  const double k = static_cast<double>(counts.surface + counts.volume), n = static_cast<double>(mesh.point_count());
  const double N = static_cast<double>(more.surface + more.volume);
  // The corner of a face needs twice the radius its middle needs, that of a box too, so that other places have up to 4 and 8
  // times the cover; of surfaces and bodies that were measured 2.5 and 3.4 times on average. Supports that meet are 4 and 8 times
  // as many, fewer at borders, where most samples are.
  const bool solid = counts.volume != 0;
  const double cover = std::min(k, cover_of(options) * (solid ? 4.5 : 3.2));
  const double couplings = std::min(k, cover * (solid ? 6 : 4));
  constexpr double entry = sizeof(double) + sizeof(std::int64_t);
  const double values = n * (cover * entry + sizeof(std::int64_t));
  const double energy = 0.5 * k * couplings * entry;
  const double rows = N * cover * (9 * sizeof(double) + sizeof(std::uint32_t) + 12);
  const double dense = static_cast<double>(dense_per_point) * N * 2 * (sizeof(Vec3) + sizeof(double)) + n * 3 * sizeof(Vec3);
  const bool enclosed = may_enclose(mesh, options);
  const double inside = enclosed ? static_cast<double>(enclosed_pieces_bytes(mesh)) : 0;
  const bool connected = enclosed && around_slots(options.domain);
  const auto samples = static_cast<std::size_t>(k);
  const double reach = connected ? static_cast<double>(BodyReach::bytes_for(fan_triangles(mesh), samples)) : 0;
  SpaceBytes bytes;
  bytes.samples = counts.surface + counts.volume;
  bytes.cubature_points = more.surface + more.volume;
  bytes.cover = static_cast<std::size_t>(std::ceil(cover));
  bytes.energy_entries = static_cast<std::size_t>(0.5 * k * couplings);
  constexpr double mean_share = 0.7;  // of the largest cover
  bytes.seconds = mls_seconds({k, N, n, static_cast<double>(dense_per_point) * N,
                               static_cast<double>(dense_per_point * more.volume), mean_share * cover, enclosed, connected});
  bytes.resident = static_cast<std::size_t>(values + energy + 4 * k * entry) + local_function_bytes(bytes.samples);
  bytes.peak = static_cast<std::size_t>(values + std::max(dense + inside, rows + 3 * energy) + reach);
  return bytes;
}

namespace {

/// The cells within the largest radius that supports of as many random samples can have: spread samples need no larger one.
std::size_t reach_in_cells(const Mesh& mesh, const SampleOptions& counts, std::size_t cover, std::span<const Vec3> places) {
  const DensePoints random = dense_points(mesh, mesh.points, {counts.surface, counts.volume}, 1);
  const std::size_t all = random.points.size();
  if (all == 0) return counts.surface + counts.volume;
  CoverOptions widest;
  widest.cover = cover;
  widest.factor *= widest.limit;
  widest.limit = 1;
  const double radius = covering_radius(PointTree(random.points), random.points, widest);
  const PointTree tree(places);
  const auto reached = static_cast<double>(std::count_if(
      random.points.begin(), random.points.end(), [&](const Vec3& x) { return tree.nearest(x).square <= radius * radius; }));
  return static_cast<std::size_t>(std::ceil(reached + 3 * std::sqrt(reached)));
}

}  // namespace

std::size_t estimate_mls_reach(const Mesh& mesh, const MlsOptions& options, std::span<const Vec3> places) {
  const SampleOptions counts = sample_counts(mesh, options);
  const std::size_t all = counts.surface + counts.volume, cover = whole_cover(cover_of(options));
  if (places.empty()) return all;
  if (counts.volume != 0)
    return mesh.cell_count() == 0 ? all : std::min(all, cover + reach_in_cells(mesh, counts, cover, places));
  double area = 0;  // twice, like those below
  for_each_triangle(mesh, [&](const FanTriangle& triangle) { area += length(triangle.normal()); });
  if (!(area > 0)) return all;
  // On a plane a disk of this radius has `cover` samples; supports are at most so much wider.
  const double share = static_cast<double>(cover) / static_cast<double>(all);
  const double reach = CoverOptions().limit * std::sqrt(0.5 * area * share / std::numbers::pi);
  Box near;
  for (const Vec3& x : places) near.add(x);
  const PointTree tree(places);
  double reached = 0;
  for_each_triangle(mesh, [&](const FanTriangle& triangle) {
    const Vec3 middle = (1.0 / 3) * (triangle.corners[0] + triangle.corners[1] + triangle.corners[2]);
    double within = reach;
    for (const Vec3& corner : triangle.corners) within = std::max(within, reach + length(corner - middle));
    for (std::size_t k = 0; k < 3; ++k) {
      if (middle[k] < near.min[k] - within || middle[k] > near.max[k] + within) return;
    }
    if (tree.nearest(middle).square <= within * within) reached += length(triangle.normal());
  });
  const double samples = std::ceil(static_cast<double>(all) * reached / area) + static_cast<double>(cover);
  return std::min(all, static_cast<std::size_t>(samples));
}

}  // namespace deform
