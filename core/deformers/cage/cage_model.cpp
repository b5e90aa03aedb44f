// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/cage/cage_model.h"

#include <algorithm>
#include <cstdio>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/cage/cage_images.h"
#include "core/deformers/option_checks.h"
#include "core/mesh/remeshing/closest_point.h"
#include "core/mesh/winding_number.h"

namespace deform {

namespace {

constexpr std::size_t cage_points_per_task = 1024, cage_rows_per_task = 16;
constexpr std::size_t listed_points = 10;
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
  const std::vector<CagePlane> planes = own_planes(cage);
  return "A cage of " + std::to_string(cage.size()) + " vertices and " + std::to_string(cage.triangles().size()) +
         " triangles, of diagonal " + diagonal + (planes.empty() ? "" : ", its own mirror image in " + planes_text(planes)) + ".";
}

void add_outside_note(const Cage& cage, const Mesh& mesh, std::size_t most, std::size_t model, const RunContext& context,
                      std::vector<std::string>& notes) {
  const auto units = units_note("cage", cage.diagonal(), bounding_box(mesh.points).diagonal());
  const OutsidePoints outside = points_outside(cage, mesh, most, context);
  if (units) notes.push_back(*units);
  if (outside.count == 0) return;
  if (outside.count == outside.looked_at) return notes.push_back(beside_note(units.has_value()));
  std::string note = std::to_string(outside.count) + " points";
  if (outside.looked_at < mesh.point_count()) note += " of " + std::to_string(outside.looked_at) + " that were looked at";
  if (model > 0) {
    notes.push_back(note + " lie outside of the cage, the first is " + std::to_string(outside.ids[0]) +
                    ": with control MESH a cage must surround the model, with the ids below " + std::to_string(model) +
                    ", and its images, with the others; `generate` makes one.");
    return;
  }
  notes.push_back(note + " lie outside of the cage: they follow as well, the less smoothly the nearer they are to it.");
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

std::string points_text(std::span<const PointId> ids, std::size_t count) {
  std::string text = count == 1 ? "point " : "points ";
  const std::size_t shown = std::min(ids.size(), listed_points);
  for (std::size_t i = 0; i < shown; ++i) {
    text += (i == 0 ? "" : i + 1 == count ? " and " : ", ") + std::to_string(ids[i]);
  }
  return count > shown ? text + " and " + std::to_string(count - shown) + " more" : text;
}

OutsidePoints points_outside(const Cage& cage, const Mesh& mesh, std::size_t most, const RunContext& context) {
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
  const std::size_t points = mesh.point_count(), step = most == 0 ? 1 : (points + most - 1) / most;
  OutsidePoints result;
  result.looked_at = points == 0 ? 0 : (points - 1) / step + 1;
  std::vector<OutsidePoints> parts(result.looked_at / cage_points_per_task + 1);
  parallel_for(context, result.looked_at, cage_points_per_task, [&](std::size_t begin, std::size_t end) {
    OutsidePoints& part = parts[begin / cage_points_per_task];
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3& x = mesh.points[i * step];
      if (winding.at(x) >= least_winding || distance(closest(x), x) <= on_cage * cage.diagonal()) continue;
      ++part.count;
      part.ids.push_back(static_cast<PointId>(i * step));
    }
  });
  for (const OutsidePoints& part : parts) {
    result.count += part.count;
    for (const PointId id : part.ids) {
      if (result.ids.size() < listed_points) result.ids.push_back(id);
    }
  }
  return result;
}

}  // namespace deform
