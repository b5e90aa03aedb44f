// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/cage_model.h"

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/option_checks.h"
#include "core/mesh/remeshing/closest_point.h"
#include "core/mesh/winding_number.h"

namespace deform {

namespace {

constexpr std::size_t cage_points_per_task = 1024, cage_rows_per_task = 16;
constexpr double on_cage = 1e-9;        // of its diagonal: distance of points on the cage, whose winding numbers are any
constexpr double least_winding = 0.02;  // on an edge or vertex of the cage it is the solid angle there over 4 pi
constexpr double seconds_per_triangle = 1.2e-7;
/// The rounding error of the sum over all vertices, whose coordinates may be negative, as a fraction of the largest displacement.
constexpr double cage_rounding = 1e-12;

std::string beside_note(bool other_units) {
  return std::string("No point of the mesh lies in the cage") +
         (other_units ? "." : ": is it the cage of this mesh, in the same units and the same place?");
}

}  // namespace

CageRows::CageRows(Cage cage, std::shared_ptr<const Mesh> mesh)
    : cage_(std::move(cage)), coordinates_(cage_), mesh_(std::move(mesh)) {}

CageRows::CageRows(Cage cage, std::shared_ptr<const Mesh> mesh, std::vector<PointId> kept, const RunContext& context)
    : cage_(std::move(cage)), coordinates_(cage_), mesh_(std::move(mesh)), kept_(std::move(kept)) {
  values_.resize(kept_.size() * cage_.size());
  parallel_for(context, kept_.size(), cage_rows_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::vector<double> values = values_at(kept_[i]);
      std::copy(values.begin(), values.end(), values_.begin() + static_cast<std::ptrdiff_t>(i * values.size()));
    }
  });
}

std::vector<double> CageRows::values_at(PointId id) const {
  MeanValue::Scratch scratch;
  std::vector<double> values(cage_.size());
  coordinates_.evaluate(mesh_->points[id], scratch, values);
  return values;
}

void CageRows::for_each(std::int64_t row, const std::function<void(std::int64_t, double)>& use) const {
  const auto id = static_cast<PointId>(row);
  const auto found = std::lower_bound(kept_.begin(), kept_.end(), id);
  if (found != kept_.end() && *found == id) {
    const double* const values = values_.data() + static_cast<std::size_t>(found - kept_.begin()) * cage_.size();
    for (std::size_t i = 0; i < cage_.size(); ++i) use(static_cast<std::int64_t>(i), values[i]);
    return;
  }
  const std::vector<double> values = values_at(id);
  for (std::size_t i = 0; i < values.size(); ++i) use(static_cast<std::int64_t>(i), values[i]);
}

SpaceFunctions::Outside CageRows::rows(std::span<const Vec3> places, std::uint64_t, const Use& use) const {
  MeanValue::Scratch scratch;
  std::vector<double> values(cage_.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    coordinates_.evaluate(places[i], scratch, values);
    for (std::size_t v = 0; v < values.size(); ++v) use(i, static_cast<std::int64_t>(v), values[v]);
  }
  return {};
}

std::size_t CageRows::bytes_for(const Cage& cage, std::size_t kept) {
  return cage.bytes() + kept * (sizeof(PointId) + cage.size() * sizeof(double));
}

std::string size_note(const Cage& cage) {
  char diagonal[32];
  std::snprintf(diagonal, sizeof diagonal, "%.4g", cage.diagonal());
  return "A cage of " + std::to_string(cage.size()) + " vertices and " + std::to_string(cage.triangles().size()) +
         " triangles, of diagonal " + diagonal + ".";
}

void add_place_notes(const Cage& cage, const Mesh& mesh, std::vector<std::string>& notes) {
  const auto units = units_note("cage", cage.diagonal(), bounding_box(mesh.points).diagonal());
  if (units) notes.push_back(*units);
  const Box of_mesh = bounding_box(mesh.points), of_cage = bounding_box(cage.vertices());
  bool apart = false;
  for (std::size_t k = 0; k < 3; ++k) apart = apart || of_mesh.max[k] < of_cage.min[k] || of_cage.max[k] < of_mesh.min[k];
  if (apart) notes.push_back(beside_note(units.has_value()));
}

void add_outside_note(const Cage& cage, const Mesh& mesh, const RunContext& context, std::vector<std::string>& notes) {
  const auto units = units_note("cage", cage.diagonal(), bounding_box(mesh.points).diagonal());
  const std::size_t outside = points_outside(cage, mesh, context);
  if (units) notes.push_back(*units);
  if (outside == 0) return;
  if (outside == mesh.point_count()) return notes.push_back(beside_note(units.has_value()));
  notes.push_back(std::to_string(outside) +
                  " points lie outside of the cage: they follow as well, the less smoothly the nearer they are to it.");
}

double seconds_per_row(const Cage& cage) { return seconds_per_triangle * static_cast<double>(cage.triangles().size()); }

Cage cage_of(const CageOptions& options) {
  try {
    return {options.vertices, options.triangles};
  } catch (const Error& error) {
    throw Error(error.code(), std::string("method.cage.") + error.what());
  }
}

ControlModel cage_model(const CageOptions& options, const std::shared_ptr<const Mesh>& mesh) {
  Cage cage = cage_of(options);
  auto controls = std::make_shared<Mesh>();
  controls->points = cage.vertices();
  ControlModel model;
  model.controls = std::move(controls);
  model.notes = {size_note(cage)};
  model.seconds_per_row = seconds_per_row(cage);
  model.rounding = cage_rounding;
  model.reach = ControlModel::Reach::everywhere;
  const auto rows = std::make_shared<const CageRows>(std::move(cage), mesh);
  model.images.push_back({0, rows, {}});
  model.in_space = rows;
  return model;
}

std::size_t points_outside(const Cage& cage, const Mesh& mesh, const RunContext& context) {
  Mesh surface;
  surface.points = cage.vertices();
  for (const Cage::Triangle& triangle : cage.triangles()) {
    surface.face_sizes.push_back(3);
    surface.face_points.insert(surface.face_points.end(), triangle.begin(), triangle.end());
  }
  const WindingNumber winding(surface, surface.points);
  std::vector<TriangleCorners> triangles;
  for (const auto& [a, b, c] : cage.triangles()) triangles.push_back({surface.points[a], surface.points[b], surface.points[c]});
  const ClosestPoint closest(std::move(triangles));
  std::atomic<std::size_t> outside = 0;
  parallel_for(context, mesh.point_count(), cage_points_per_task, [&](std::size_t begin, std::size_t end) {
    std::size_t count = 0;
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3& x = mesh.points[i];
      count += winding.at(x) < least_winding && distance(closest(x), x) > on_cage * cage.diagonal() ? 1 : 0;
    }
    outside += count;
  });
  return outside;
}

}  // namespace deform
