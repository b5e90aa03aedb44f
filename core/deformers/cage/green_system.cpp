// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/green_system.h"

#include <algorithm>
#include <limits>
#include <map>
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
/// The error of the coordinates over the machine precision, where the diagonal over the least altitude of a triangle is at most
/// usual_ratio; with it they grow.
constexpr double green_roundings = 10, usual_ratio = 10;

std::shared_ptr<const Mesh> vertices_of(const CageOptions& options) {
  auto controls = std::make_shared<Mesh>();
  controls->points = options.vertices;
  return controls;
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
      refuse_argument(field + points_text(outside, outside.size()) + " of " + std::to_string(points) +
                      (outside.size() == 1 ? " lies" : " lie") + " outside" + use);
    }
    if (!overlapped.empty()) {
      refuse_argument(field + points_text(overlapped, overlapped.size()) + (overlapped.size() == 1 ? " lies" : " lie") +
                      " where parts of the cage overlap" + use);
    }
  }
};

GreenColumns::GreenColumns(const WholeCage& whole, const ControlSources& sources, const Symmetry& symmetry) {
  unsigned images = 0;  // bits of all
  for (const auto& vertex : whole.vertices) images |= vertex.image;
  parts_ = images == 0 ? std::vector<ComponentPart>{{{0, 1, 2}}} : component_parts(symmetry, images);
  for (std::size_t image = 0; image < (images == 0 ? 1 : symmetry.images()); ++image) {
    for (const ComponentPart& part : parts_) factors_.push_back(part.factor(symmetry, static_cast<unsigned>(image)));
  }
  const auto moves = [&](std::uint32_t v) { return !sources.of(whole.vertices[v].control).empty(); };
  for (std::uint32_t v = 0; v < whole.cage.size(); ++v) {
    if (moves(v)) vertices_.push_back(whole.vertices[v].control);
  }
  std::sort(vertices_.begin(), vertices_.end());
  vertices_.erase(std::unique(vertices_.begin(), vertices_.end()), vertices_.end());
  std::vector<std::uint32_t> position(whole.controls);
  for (std::uint32_t i = 0; i < vertices_.size(); ++i) position[vertices_[i]] = i;
  for (std::uint32_t v = 0; v < whole.cage.size(); ++v) {
    if (moves(v)) vertex_entries_.push_back({v, position[whole.vertices[v].control], whole.vertices[v].image});
  }
  std::vector<std::uint32_t> moving;
  std::map<std::uint32_t, std::uint32_t> position_of;
  for (std::uint32_t t = 0; t < whole.cage.triangles().size(); ++t) {
    const Cage::Triangle& triangle = whole.cage.triangles()[t];
    if (std::none_of(triangle.begin(), triangle.end(), moves)) continue;
    moving.push_back(t);
    if (whole.triangles[t].image != 0) continue;
    position_of[whole.triangles[t].control] = static_cast<std::uint32_t>(triangles_.size());
    triangles_.push_back(t);
  }
  for (const std::uint32_t t : moving) {
    triangle_entries_.push_back({t, position_of.at(whole.triangles[t].control), whole.triangles[t].image});
  }
}

void GreenColumns::add(const std::vector<Entry>& entries, std::size_t first, std::span<const double> values, std::size_t stride,
                       double* out) const {
  const std::size_t parts = parts_.size();
  for (const Entry& entry : entries) {
    double* const at = out + (first + parts * entry.position) * stride;
    for (std::size_t p = 0; p < parts; ++p) at[p * stride] += factors_[entry.image * parts + p] * values[entry.number];
  }
}

void GreenColumns::add_up(std::span<const double> phi, std::span<const double> psi, std::size_t stride, double* out) const {
  add(vertex_entries_, 0, phi, stride, out);
  add(triangle_entries_, of_triangle(0), psi, stride, out);
}

std::size_t GreenColumns::bytes() const {
  return (vertices_.size() + triangles_.size()) * sizeof(std::uint32_t) +
         (vertex_entries_.size() + triangle_entries_.size()) * sizeof(Entry) + factors_.size() * sizeof(double);
}

GreenSystem::GreenSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, const CageOptions& options, WholeCage whole,
                         const RunContext& context)
    : HandleSystem(std::move(mesh), setup, vertices_of(options), context),
      whole_(std::move(whole)),
      cage_(whole_.cage),
      coordinates_(cage_),
      sources_(whole_.matches, whole_.controls, regions_),
      columns_(whole_, sources_, regions_.symmetry),
      fields_(whole_.controls) {
  check_images(whole_.matches, setup_, regions_);
  for (const auto& handle : regions_.handles) {
    for (const PointId v : handle) fields_[v] = handle_fields(points_.region_of[v], v);
  }
  for (const std::uint32_t t : columns_.triangles()) normals_.emplace_back(corners(t, cage_.vertices()));
  double least = 1;
  for (const Cage::Face& face : cage_.faces()) {
    for (const double altitude : face.altitudes) least = std::min(least, altitude);
  }
  rounding_ = green_roundings * std::numeric_limits<double>::epsilon() * std::max(usual_ratio, 1 / least);
  end_stage("select");
  prepare_coordinates(options.basis, context);
  end_stage("coordinates");
  fill_info();
}

StretchedNormal::Corners GreenSystem::corners(std::size_t triangle, std::span<const Vec3> of) const {
  const auto& [a, b, c] = cage_.triangles()[triangle];
  return {of[a], of[b], of[c]};
}

int GreenSystem::compute_point(const Vec3& x, Scratch& scratch, double* at) const {
  scratch.phi.resize(cage_.size());
  scratch.psi.resize(cage_.triangles().size());
  const int winding = coordinates_.evaluate(x, scratch.views, scratch.phi, scratch.psi);
  columns_.add_up(scratch.phi, scratch.psi, tile_size, at);
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
    const PointId at = symmetry().sector().first_of(static_cast<PointId>(i));
    const int winding = compute_point(mesh_->points[at], scratch, out + (i - begin));
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
  info_.samples = info_.functions = whole_.controls;
  set_bytes(0, (stored_ ? stored_->bytes() : 0) + green_overhead_bytes(whole_, sources_, columns_) +
                   following().size() * sizeof(PointId));
  info_.notes = whole_.notes;
  if (symmetry().is_sector()) info_.notes.push_back(symmetry().sector().note());
  info_.notes.push_back(sources_.note(regions_, "vertices of the cage"));
  for (std::string& note : whole_.idle_notes(setup_, regions_)) info_.notes.push_back(std::move(note));
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

void GreenSystem::check_motions(const BoundDesign& design, std::size_t index) const {
  sources_.check_design(held(), design, index);
}

void GreenSystem::check_motions(const std::vector<Affine>& derivative, const std::string& what) const {
  sources_.check_rates(held(), derivative, what);
}

std::vector<Vec3> GreenSystem::displacements(const BoundDesign& design, MotionKind kind) const {
  const HeldPoints points = held();
  std::vector<Vec3> own(whole_.controls);
  for (const auto& handle : regions_.handles) {
    for (const PointId v : handle) own[v] = points.displacement(design, v, kind);
  }
  return sources_.displacements(std::move(own), symmetry());
}

std::vector<Vec3> GreenSystem::in_model(std::span<const Vec3> displacements) const {
  std::vector<Vec3> result(cage_.size());
  for (std::size_t v = 0; v < result.size(); ++v) {
    const auto [control, image] = whole_.vertices[v];
    result[v] = symmetry().components_in(displacements[control], image);
    if (!symmetry().empty()) result[v] = symmetry().from_frame(result[v]);
  }
  return result;
}

std::vector<Vec3> GreenSystem::moved(std::span<const Vec3> displacements, const std::string& what) const {
  std::vector<Vec3> result = cage_.vertices();
  for (std::size_t v = 0; v < result.size(); ++v) result[v] = result[v] + displacements[v];
  for (std::size_t t = 0; t < normals_.size(); ++t) {
    const std::uint32_t triangle = columns_.triangles()[t];
    if (normals_[t].exists(corners(triangle, result))) continue;
    std::string text;
    for (const std::uint32_t v : cage_.triangles()[triangle]) {
      text += (text.empty() ? "" : ", ") + std::to_string(whole_.vertices[v].control);
    }
    refuse_argument(what + ": moves vertices " + text + " of the cage onto a line; triangle " +
                    std::to_string(whole_.triangles[triangle].control) + " then has no normal, which coordinates GREEN need");
  }
  return result;
}

std::vector<Vec3> GreenSystem::moved_by(std::span<const double> variables) const {
  const Design design{{variables.begin(), variables.end()}, {}};
  return moved(in_model(displacements(held().bound(design, 0), MotionKind::position)), "variables");
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
        const Vec3 of_point =
            at < at_following.size() ? symmetry().sector().at_first(static_cast<PointId>(at), at_following[at]) : Vec3{};
        for (std::size_t k = 0; k < 3; ++k) cotangents[k * tile_size + i] = of_point[k];
      }
      tile_product_transposed(tile(t, scratch), columns_.size(), cotangents, 3, partial[begin / green_tiles_per_sum].data(), 3);
    }
  });
  std::vector<double> sums(width, 0.0);
  for (const std::vector<double>& part : partial) {
    for (std::size_t k = 0; k < width; ++k) sums[k] += part[k];
  }
  const auto sum = [&](std::size_t row) { return Vec3{sums[3 * row], sums[3 * row + 1], sums[3 * row + 2]}; };

  const auto whole_sum = [&](std::size_t column) {
    Vec3 result{};
    for (std::size_t p = 0; p < columns_.parts().size(); ++p) result = result + columns_.parts()[p].given(sum(column + p));
    return result;
  };

  std::vector<Vec3> of_controls(whole_.controls);
  for (std::size_t v = 0; v < columns_.vertices().size(); ++v)
    of_controls[columns_.vertices()[v]] = whole_sum(columns_.of_vertex(v));
  for (std::size_t t = 0; t < columns_.triangles().size(); ++t) {
    const std::uint32_t triangle = columns_.triangles()[t];
    Vec3 of_normal = whole_sum(columns_.of_triangle(t));
    if (!symmetry().empty()) of_normal = symmetry().from_frame(of_normal);
    const auto gradient = normals_[t].gradient(corners(triangle, moved), of_normal);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [control, image] = whole_.vertices[cage_.triangles()[triangle][k]];
      of_controls[control] = of_controls[control] + symmetry().components_in(in_frame(gradient[k]), symmetry().inverse(image));
    }
  }
  return field_sums(regions_, fields_, sources_.transposed(of_controls, symmetry()));
}

std::size_t green_overhead_bytes(const WholeCage& whole, const ControlSources& sources, const GreenColumns& columns) {
  return whole.bytes() + sources.bytes() + columns.bytes() + whole.controls * (sizeof(std::array<double, 4>) + sizeof(Vec3)) +
         columns.triangles().size() * sizeof(StretchedNormal);
}

}  // namespace deform
