// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/green_system.h"

#include <algorithm>
#include <limits>
#include <mutex>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/cage/cage_model.h"
#include "core/deformers/cage/green_evaluation.h"
#include "core/deformers/cage/green_scratch.h"
#include "core/deformers/option_checks.h"

namespace deform {

namespace {

constexpr std::size_t green_tiles_per_task = 16, green_tiles_per_sum = 64;
constexpr std::size_t listed_points = 10;
/// The error of the coordinates over the machine precision, where the diagonal over the least altitude of a triangle is at most
/// usual_ratio; with it they grow.
constexpr double green_roundings = 10, usual_ratio = 10;

std::shared_ptr<const Mesh> vertices_of(const CageOptions& options) {
  auto controls = std::make_shared<Mesh>();
  controls->points = options.vertices;
  return controls;
}

/// "points 3, 7, 8 and 12 more"
std::string points_text(const std::vector<PointId>& ids) {
  std::string text = ids.size() == 1 ? "point " : "points ";
  const std::size_t shown = std::min(ids.size(), listed_points);
  for (std::size_t i = 0; i < shown; ++i) {
    text += (i == 0 ? "" : i + 1 == ids.size() ? " and " : ", ") + std::to_string(ids[i]);
  }
  return ids.size() > shown ? text + " and " + std::to_string(ids.size() - shown) + " more" : text;
}

}  // namespace

/// The points that have no coordinates.
struct GreenSystem::Rejected {
  std::mutex guard;
  std::vector<PointId> outside, overlapped;

  void add(PointId id, int winding) {
    const std::lock_guard<std::mutex> lock(guard);
    (winding <= 0 ? outside : overlapped).push_back(id);
  }
  void refuse_any(std::size_t points) {
    for (std::vector<PointId>* ids : {&outside, &overlapped}) std::sort(ids->begin(), ids->end());
    const std::string field = "method.cage.coordinates: GREEN exist only inside of the cage, but ";
    const std::string use = "; use a cage around all points, which `deform cage mesh` makes, or coordinates MEAN_VALUE";
    if (!outside.empty()) {
      refuse_argument(field + points_text(outside) + " of " + std::to_string(points) + (outside.size() == 1 ? " lies" : " lie") +
                      " outside" + use);
    }
    if (!overlapped.empty()) {
      refuse_argument(field + points_text(overlapped) + (overlapped.size() == 1 ? " lies" : " lie") +
                      " where parts of the cage overlap" + use);
    }
  }
};

GreenSystem::GreenSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const CageOptions& options,
                         const RunContext& context)
    : GreenSystem(std::move(mesh), setup, options, vertices_of(options), context) {}

GreenSystem::GreenSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const CageOptions& options,
                         const std::shared_ptr<const Mesh>& controls, const RunContext& context)
    : HandleSystem(std::move(mesh), setup, controls, context),
      cage_(cage_of(options)),
      coordinates_(cage_),
      fields_(cage_.size()) {
  for (std::size_t v = 0; v < fields_.size(); ++v) {
    if (moves(v)) fields_[v] = handle_fields(points_.region_of[v], static_cast<PointId>(v));
  }
  double least = 1;
  for (const Cage::Face& face : cage_.faces()) {
    for (const double altitude : face.altitudes) least = std::min(least, altitude);
  }
  rounding_ = green_roundings * std::numeric_limits<double>::epsilon() * std::max(usual_ratio, 1 / least);
  find_columns();
  end_stage("select");
  prepare_coordinates(options.basis, context);
  end_stage("coordinates");
  fill_info();
}

void GreenSystem::find_columns() {
  for (std::uint32_t v = 0; v < cage_.size(); ++v) {
    if (moves(v)) columns_.vertices.push_back(v);
  }
  for (std::uint32_t t = 0; t < cage_.triangles().size(); ++t) {
    const Cage::Triangle& triangle = cage_.triangles()[t];
    if (std::none_of(triangle.begin(), triangle.end(), [&](std::uint32_t v) { return moves(v); })) continue;
    columns_.triangles.push_back(t);
    normals_.emplace_back(corners(t, cage_.vertices()));
  }
}

StretchedNormal::Corners GreenSystem::corners(std::size_t triangle, std::span<const Vec3> of) const {
  const auto& [a, b, c] = cage_.triangles()[triangle];
  return {of[a], of[b], of[c]};
}

int GreenSystem::compute_point(const Vec3& x, Scratch& scratch, double* at) const {
  scratch.phi.resize(cage_.size());
  scratch.psi.resize(cage_.triangles().size());
  const int winding = coordinates_.evaluate(x, scratch.views, scratch.phi, scratch.psi);
  for (const std::uint32_t v : columns_.vertices) {
    *at = scratch.phi[v];
    at += tile_size;
  }
  for (const std::uint32_t t : columns_.triangles) {
    *at = scratch.psi[t];
    at += tile_size;
  }
  return winding;
}

void GreenSystem::compute_places(std::span<const Vec3> places, std::uint64_t first, Scratch& scratch, double* out) const {
  std::fill_n(out, columns_.size() * tile_size, 0.0);
  for (std::size_t i = 0; i < places.size(); ++i) {
    const int winding = compute_point(places[i], scratch, out + i);
    if (winding == 1) continue;
    refuse_argument("points[" + std::to_string(first + i) +
                    "]: " + (winding <= 0 ? "lies outside of the cage" : "lies where parts of the cage overlap") +
                    ", and coordinates GREEN exist only inside of it; use coordinates MEAN_VALUE or leave the point out");
  }
}

void GreenSystem::compute_tile(std::size_t tile, Scratch& scratch, double* out, Rejected* rejected) const {
  std::fill_n(out, columns_.size() * tile_size, 0.0);
  const std::size_t begin = tile * tile_size, end = std::min(begin + tile_size, mesh_->point_count());
  for (std::size_t i = begin; i < end; ++i) {
    const int winding = compute_point(mesh_->points[i], scratch, out + (i - begin));
    if (winding != 1 && rejected != nullptr) rejected->add(static_cast<PointId>(i), winding);
  }
}

const double* GreenSystem::tile(std::size_t tile, Scratch& scratch) const {
  if (stored_) return stored_->tile(tile);
  scratch.values.resize(columns_.size() * tile_size);
  compute_tile(tile, scratch, scratch.values.data(), nullptr);
  return scratch.values.data();
}

void GreenSystem::prepare_coordinates(BasisMode mode, const RunContext& context) {
  context.progress("coordinates", 0);
  const std::size_t points = mesh_->point_count();
  if (wants_basis(mode, FieldTiles::bytes_for(points, columns_.size()), 0)) stored_.emplace(points, columns_.size());
  Rejected rejected;
  parallel_for(context, tile_count(points), green_tiles_per_task, [&](std::size_t begin, std::size_t end) {
    Scratch scratch;
    if (!stored_) scratch.values.resize(columns_.size() * tile_size);
    for (std::size_t t = begin; t < end; ++t) {
      compute_tile(t, scratch, stored_ ? stored_->tile(t) : scratch.values.data(), &rejected);
    }
  });
  rejected.refuse_any(points);
}

void GreenSystem::fill_info() {
  info_.solver = Solver::automatic;  // nothing is solved
  info_.samples = info_.functions = cage_.size();
  set_bytes(0, (stored_ ? stored_->bytes() : 0) + green_overhead_bytes(cage_) + following().size() * sizeof(PointId));
  info_.notes = {size_note(cage_), std::to_string(columns_.vertices.size()) + " vertices of the cage are in handles, the other " +
                                       std::to_string(cage_.size() - columns_.vertices.size()) + " stay."};
  info_.notes.push_back("Green coordinates have no handle basis, as normals are no linear function of the vertices; " +
                        std::string(stored_ ? "the coordinates of all points are stored."
                                            : "every design computes the coordinates of all points again."));
  const auto units = units_note("cage", cage_.diagonal(), info_.diagonal);
  if (units) info_.notes.push_back(*units);
}

std::string GreenSystem::without_basis() const {
  return "Green coordinates have no handle basis, as normals of the cage are no linear function of the motions of the handles; "
         "use "
         "coordinates MEAN_VALUE, or evaluate on the server";
}

std::vector<Vec3> GreenSystem::displacements(const BoundDesign& design, MotionKind kind) const {
  const HeldPoints points = held();
  std::vector<Vec3> result(cage_.size());
  for (const std::uint32_t v : columns_.vertices) result[v] = points.displacement(design, v, kind);
  return result;
}

std::vector<Vec3> GreenSystem::moved(std::span<const Vec3> displacements, const std::string& what) const {
  std::vector<Vec3> result = cage_.vertices();
  for (const std::uint32_t v : columns_.vertices) result[v] = result[v] + displacements[v];
  for (std::size_t t = 0; t < normals_.size(); ++t) {
    if (normals_[t].exists(corners(columns_.triangles[t], result))) continue;
    const auto& [a, b, c] = cage_.triangles()[columns_.triangles[t]];
    refuse_argument(what + ": moves vertices " + std::to_string(a) + ", " + std::to_string(b) + " and " + std::to_string(c) +
                    " of the cage onto a line; triangle " + std::to_string(columns_.triangles[t]) +
                    " then has no normal, which coordinates GREEN need");
  }
  return result;
}

std::vector<Vec3> GreenSystem::moved_by(std::span<const double> variables) const {
  const Design design{{variables.begin(), variables.end()}, {}};
  return moved(displacements(held().bound(design, 0), MotionKind::position), "variables");
}

std::unique_ptr<const Evaluation> GreenSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                    const RunContext& context) const {
  return std::make_unique<GreenEvaluation>(std::static_pointer_cast<const GreenSystem>(shared_from_this()), designs, path,
                                           context);
}

std::unique_ptr<const Evaluation> GreenSystem::derivative(std::span<const double> variables, const std::vector<Affine>& maps,
                                                          const RunContext&) const {
  return std::make_unique<GreenEvaluation>(std::static_pointer_cast<const GreenSystem>(shared_from_this()), variables, maps);
}

HandleSystem::Fields GreenSystem::adjoint(std::span<const double> variables, Cotangents at_following,
                                          const RunContext& context) const {
  const std::vector<Vec3> moved = moved_by(variables);
  Fields result;
  for (const std::vector<Vec3>& cotangent : at_following) result.push_back(adjoint(moved, cotangent, context));
  return result;
}

std::vector<double> GreenSystem::adjoint(const std::vector<Vec3>& moved, const std::vector<Vec3>& at_following,
                                         const RunContext& context) const {
  // The columns times the cotangents, in an order of summation that does not depend on threads.
  const std::size_t tiles = tile_count(at_following.size()), width = 3 * columns_.size();
  std::vector<std::vector<double>> partial((tiles + green_tiles_per_sum - 1) / green_tiles_per_sum,
                                           std::vector<double>(width, 0.0));
  parallel_for(context, tiles, green_tiles_per_sum, [&](std::size_t begin, std::size_t end) {
    Scratch scratch;
    double cotangents[3 * tile_size];
    for (std::size_t t = begin; t < end; ++t) {
      for (std::size_t i = 0; i < tile_size; ++i) {
        const std::size_t at = t * tile_size + i;
        for (std::size_t k = 0; k < 3; ++k) cotangents[k * tile_size + i] = at < at_following.size() ? at_following[at][k] : 0.0;
      }
      tile_product_transposed(tile(t, scratch), columns_.size(), cotangents, 3, partial[begin / green_tiles_per_sum].data(), 3);
    }
  });
  std::vector<double> sums(width, 0.0);
  for (const std::vector<double>& part : partial) {
    for (std::size_t k = 0; k < width; ++k) sums[k] += part[k];
  }
  const auto sum = [&](std::size_t row) { return Vec3{sums[3 * row], sums[3 * row + 1], sums[3 * row + 2]}; };

  std::vector<Vec3> of_vertices(cage_.size());
  for (std::size_t v = 0; v < columns_.vertices.size(); ++v) of_vertices[columns_.vertices[v]] = sum(v);
  for (std::size_t t = 0; t < columns_.triangles.size(); ++t) {
    const Cage::Triangle& triangle = cage_.triangles()[columns_.triangles[t]];
    const auto gradient = normals_[t].gradient(corners(columns_.triangles[t], moved), sum(columns_.vertices.size() + t));
    for (std::size_t k = 0; k < 3; ++k) of_vertices[triangle[k]] = of_vertices[triangle[k]] + gradient[k];
  }
  std::vector<double> result(3 * fields(), 0.0);
  for (const std::uint32_t v : columns_.vertices) {
    const std::size_t first = std::size_t{4} * points_.region_of[v];
    for (std::size_t f = 0; f < 4; ++f) {
      for (std::size_t k = 0; k < 3; ++k) result[3 * (first + f) + k] += fields_[v][f] * of_vertices[v][k];
    }
  }
  return result;
}

std::size_t green_bytes(const Cage& cage, const SelectedRegions& regions, std::size_t points) {
  std::vector<char> moves(cage.size(), 0);
  std::size_t columns = 0;
  for (const auto& handle : regions.handles) {
    for (const PointId v : handle) moves[v] = 1;
    columns += handle.size();
  }
  for (const Cage::Triangle& triangle : cage.triangles()) {
    columns += std::any_of(triangle.begin(), triangle.end(), [&](std::uint32_t v) { return moves[v] != 0; }) ? 1 : 0;
  }
  return FieldTiles::bytes_for(points, columns);
}

std::size_t green_overhead_bytes(const Cage& cage) {
  return cage.bytes() + cage.size() * (sizeof(std::array<double, 4>) + sizeof(std::uint32_t) + sizeof(Vec3)) +
         cage.triangles().size() * (sizeof(StretchedNormal) + sizeof(std::uint32_t));
}

}  // namespace deform
