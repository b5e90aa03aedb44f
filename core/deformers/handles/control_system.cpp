// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/control_system.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/handles/control_evaluation.h"
#include "core/deformers/option_checks.h"

namespace deform {

namespace {

constexpr std::size_t control_tiles_per_task = 64, mesh_points_per_task = 2048;
constexpr std::size_t listed_handles = 5;
constexpr double seconds_per_value = 3e-9;  // of a function at a point

std::size_t first_row_count(const ComputedRows& rows) {
  std::size_t most = 0;
  for (std::int64_t i = 0; i < rows.rows() && most == 0; ++i) most = rows.count(i);
  return most;
}

/// What a variable does to a handle; null if it does not move it.
const VariableMotion* motion_of(const DesignVariable& variable, const std::string& handle) {
  if (variable.handle == handle) return &variable.kind;
  for (const DrivenHandle& driven : variable.also) {
    if (driven.handle == handle) return &driven.kind;
  }
  return nullptr;
}

/// Whether a motion is the same before and after a reflection, whatever its size.
bool is_own_image(const VariableMotion& motion, const Symmetry& symmetry, std::size_t plane) {
  const Vec3& n = symmetry.normal(plane);
  const auto along = [&](const Vec3& v) { return norm(cross(n, v)) <= Symmetry::tolerance * norm(v); };
  const auto across = [&](const Vec3& v) { return std::abs(dot(n, v)) <= Symmetry::tolerance * norm(v); };
  if (const auto* translation = std::get_if<Translation>(&motion)) return across(translation->direction);
  if (const auto* rotation = std::get_if<Rotation>(&motion)) return along(rotation->axis);
  const auto& scaling = std::get<Scaling>(motion);
  const bool in_plane = std::abs(symmetry.coordinates(scaling.centre)[plane]) <= symmetry.reach(plane);
  if (norm(scaling.axis) == 0) return in_plane;
  return across(scaling.axis) || (along(scaling.axis) && in_plane);
}

std::string handle_text(std::uint32_t control, std::size_t handle, const Setup& setup) {
  return std::to_string(control) + " (handle \"" + setup.handles[handle].name + "\")";
}

}  // namespace

std::size_t ControlModel::row_bytes() const {
  std::size_t bytes = 0;
  for (const ControlImage& image : images) bytes += (image.rows ? image.rows->bytes() : 0) + image.reflected.size();
  return bytes + matches.bytes();
}

ControlSystem::ControlSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, ControlModel model,
                             const EnergyOptions& options, const RunContext& context)
    : HandleSystem(std::move(mesh), setup, model.controls, context),
      model_(std::move(model)),
      fields_(held_mesh_->point_count()),
      sources_(model_.matches, fields_.size(), regions_) {
  for (std::size_t p = 0; p < fields_.size(); ++p) {
    if (moves(p)) fields_[p] = handle_fields(points_.region_of[p], static_cast<PointId>(p));
  }
  check_images(model_.matches, setup_, regions_);
  idle_ = idle_handles(context);
  end_stage("select");
  prepare_basis(options, context);
  end_stage("basis");
  fill_info();
}

std::vector<std::string> ControlSystem::idle_handles(const RunContext& context) const {
  if (model_.reach == ControlModel::Reach::everywhere) return {};
  std::vector<std::atomic<bool>> reaches(fields_.size());
  parallel_for(context, mesh_->point_count(), mesh_points_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      for_each_image(static_cast<PointId>(i), [&](std::size_t p, double value, unsigned) {
        std::atomic<bool>& known = reaches[p];
        if (value != 0 && !known.load(std::memory_order_relaxed)) known.store(true, std::memory_order_relaxed);
      });
    }
  });
  std::vector<bool> works(fields_.size(), false);
  for (std::size_t p = 0; p < fields_.size(); ++p) {
    for (const ControlSources::Source& source : sources_.of(p))
      works[source.control] = works[source.control] || reaches[p].load();
  }
  std::vector<std::string> names;
  for (std::size_t h = 0; h < regions_.handles.size(); ++h) {
    const auto& controls = regions_.handles[h];
    const bool any = std::any_of(controls.begin(), controls.end(), [&](PointId p) { return works[p]; });
    if (!any) names.push_back(setup_.handles[h].name);
  }
  return names;
}

void ControlSystem::prepare_basis(const EnergyOptions& options, const RunContext& context) {
  const std::vector<ComponentPart> all = component_parts(regions_.symmetry);
  const std::size_t bytes = all.size() * HandleBasis::bytes_for(following().size(), fields(), options.basis_tolerance);
  if (!wants_basis(options.basis, bytes, 0)) return;
  context.progress("basis", 0);
  for (const ComponentPart& part : all) add_part(part, options.basis_tolerance, context);
}

void ControlSystem::add_part(const ComponentPart& part, double tolerance, const RunContext& context) {
  HandleBasis basis{part.components, FieldTiles(following().size(), fields()), std::vector<double>(fields(), 0.0)};
  basis.turned = part.turn == ComponentPart::Turn::sine;
  basis.more.assign(fields(), 0.0);
  for (std::size_t p = 0; p < fields_.size(); ++p) {
    for (std::size_t f = 0; f < 4 && moves(p); ++f) {
      double& error = basis.more[first_field(p) + f];
      error = std::max(error, rounding() * std::abs(fields_[p][f]));
    }
  }
  parallel_for(context, tile_count(following().size()), control_tiles_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      double* const out = basis.tiles.tile(t);
      std::fill_n(out, fields() * tile_size, 0.0);
      const std::size_t last = std::min((t + 1) * tile_size, following().size());
      for (std::size_t s = t * tile_size; s < last; ++s) {
        // What is added up for points on the axis of a sector is zero but for rounding.
        if (part.turn != ComponentPart::Turn::none && regions_.symmetry.sector().on_axis(following()[s])) continue;
        for_each_image(following()[s], [&](std::size_t p, double value, unsigned image) {
          const std::span<const ControlSources::Source> from = sources_.of(p);
          if (from.empty()) return;
          const double share = value / static_cast<double>(from.size());
          for (const ControlSources::Source& source : from) {
            double* const at = out + first_field(source.control) * tile_size + s % tile_size;
            const double weight = share * part.factor(regions_.symmetry, regions_.symmetry.composed(source.image, image));
            for (std::size_t f = 0; f < 4; ++f) at[f * tile_size] += weight * fields_[source.control][f];
          }
        });
      }
    }
  });
  add_basis(std::move(basis), tolerance, context);
}

void ControlSystem::fill_info() {
  info_.solver = Solver::automatic;  // nothing is solved
  info_.samples = info_.functions = fields_.size();
  const std::size_t crossings = model_.crossings ? model_.crossings->bytes() : 0;
  set_bytes(0, model_.row_bytes() + sources_.bytes() + crossings + fields_.size() * (sizeof(Vec3) + sizeof fields_[0]) +
                   (following().size() + model_.outside.size()) * sizeof(PointId));
  info_.notes = model_.notes;
  if (regions_.symmetry.is_sector()) info_.notes.push_back(regions_.symmetry.sector().note());
  info_.notes.push_back(sources_.note(regions_, "control points"));
  if (!idle_.empty()) {
    std::string names;
    for (std::size_t i = 0; i < std::min(listed_handles, idle_.size()); ++i) names += (i == 0 ? "\"" : ", \"") + idle_[i] + "\"";
    if (idle_.size() > listed_handles) names += " and " + std::to_string(idle_.size() - listed_handles) + " more";
    info_.notes.push_back("No point of the mesh is in reach of the control points of handle " + names + ", which moves nothing.");
  }
  if (!has_basis()) {
    info_.notes.emplace_back("No handle basis is stored: every design is one sum over control points per point.");
  }
}

std::vector<Vec3> ControlSystem::displacements(const BoundDesign& design, MotionKind kind) const {
  const HeldPoints points = held();
  std::vector<Vec3> own(fields_.size());
  for (std::size_t p = 0; p < own.size(); ++p) {
    if (!moves(p)) continue;
    const auto id = static_cast<PointId>(p);
    const Vec3 to = points.place(design, id, kind);
    own[p] = kind == MotionKind::position ? to - held_mesh_->points[p] : to;
  }
  return sources_.displacements(std::move(own), regions_.symmetry);
}

/// Motions of variables that are their own mirror images in the planes of a control point are so for all values, and together.
std::string ControlSystem::unchecked_motions() const {
  const Symmetry& symmetry = regions_.symmetry;
  const auto text = [&](std::uint32_t p) { return "control point " + handle_text(p, points_.region_of[p], setup_); };
  for (std::uint32_t p = 0; p < fields_.size(); ++p) {
    const std::span<const ControlSources::Source> from = sources_.of(p);
    unsigned planes = moves(p) ? held_symmetry().on(p) : 0;
    for (std::size_t i = 1; i < from.size(); ++i) {
      const std::uint32_t a = from[0].control, b = from[i].control;
      if (symmetry.is_sector() || points_.region_of[a] != points_.region_of[b]) {
        return text(a) + " and " + text(b) +
               " are images of each other, which only some motions leave them; take one of them out of " +
               "its handle with `difference`, or evaluate on the server";
      }
      planes |= from[0].image ^ from[i].image;
    }
    const std::size_t handle = from.empty() ? 0 : points_.region_of[from[0].control];
    for (std::size_t k = 0; k < symmetry.planes() && !from.empty(); ++k) {
      if ((planes >> k & 1u) == 0) continue;
      for (const DesignVariable& variable : setup_.variables) {
        const VariableMotion* motion = motion_of(variable, setup_.handles[handle].name);
        if (motion == nullptr || is_own_image(*motion, symmetry, k)) continue;
        return "variable \"" + variable.name + "\" may lead " + text(from[0].control) + " out of symmetry[" + std::to_string(k) +
               "], or away from its mirror image; move along the plane, or evaluate on the server";
      }
    }
  }
  return HandleSystem::unchecked_motions();
}

void ControlSystem::check_motions(const BoundDesign& design, std::size_t index) const {
  sources_.check_design(held(), design, index);
}

void ControlSystem::check_motions(const std::vector<Affine>& derivative, const std::string& what) const {
  sources_.check_rates(held(), derivative, what);
}

std::unique_ptr<const Evaluation> ControlSystem::bind(std::span<const Design> designs, EvaluationPath path,
                                                      const RunContext& context) const {
  return std::make_unique<ControlEvaluation>(std::static_pointer_cast<const ControlSystem>(shared_from_this()), designs, path,
                                             context);
}

std::unique_ptr<const Evaluation> ControlSystem::derivative(std::span<const double>, const std::vector<Affine>& maps,
                                                            const RunContext& context) const {
  return std::make_unique<ControlEvaluation>(std::static_pointer_cast<const ControlSystem>(shared_from_this()), maps, context);
}

HandleSystem::Fields ControlSystem::adjoint(std::span<const double>, Cotangents at_following, const RunContext& context) const {
  context.check();
  std::vector<std::vector<Vec3>> g(at_following.size(), std::vector<Vec3>(fields_.size()));
  for (std::size_t s = 0; s < following().size(); ++s) {
    for_each_image(following()[s], [&](std::size_t p, double value, unsigned image) {
      const unsigned back = regions_.symmetry.inverse(image);
      for (std::size_t j = 0; j < g.size(); ++j) {
        g[j][p] = g[j][p] + value * regions_.symmetry.components_in(at_following[j][s], back);
      }
    });
  }
  Fields result;
  for (const std::vector<Vec3>& sums : g) {
    result.push_back(field_sums(regions_, fields_, sources_.transposed(sums, regions_.symmetry)));
  }
  return result;
}

Estimate estimate_controls(const Mesh& mesh, const ControlModel& model, const EnergyOptions& options,
                           const SelectedRegions& regions) {
  const std::size_t n = mesh.point_count(), k = model.controls->point_count(), fields = 4 * regions.handles.size();
  Estimate estimate;
  for (const auto& handle : regions.handles) estimate.constraint_points += handle.size();
  estimate.constraint_points += regions.fixed.size();
  estimate.samples = k;
  const std::size_t parts = ControlSystem::part_count(regions.symmetry);
  const std::size_t basis_bytes = parts * HandleBasis::bytes_for(n, fields, options.basis_tolerance);
  const bool basis = wants_basis(options.basis, basis_bytes, 0);
  estimate.basis_bytes = basis ? basis_bytes + parts * 2 * fields * sizeof(double) : 0;
  const std::size_t crossings = model.crossings ? model.crossings->bytes() : 0;
  const std::size_t own = point_bytes(n + k, regions.symmetry) + model.row_bytes() + model.in_space->bytes() + crossings +
                          k * (sizeof(std::size_t) + 2 * sizeof(std::uint32_t) * regions.symmetry.images()) +
                          k * (sizeof(Vec3) + 4 * sizeof(double)) + (n + model.outside.size()) * sizeof(PointId);
  estimate.resident_bytes = estimate.basis_bytes + own;
  // A copy of the mesh whose points are where their functions are taken, while these are found.
  const std::size_t placed = n * (3 * sizeof(Vec3) + 2 * sizeof(std::uint32_t) + 1) +
                             (mesh.face_sizes.size() + mesh.face_points.size()) * sizeof(std::uint32_t);
  estimate.peak_bytes = own + k + (regions.symmetry.empty() ? 0 : placed) +
                        (basis ? (parts - 1) * HandleBasis::bytes_for(n, fields, options.basis_tolerance) +
                                     HandleBasis::peak_bytes_for(n, fields, options.basis_tolerance)
                               : 0);
  const double row = static_cast<double>(first_row_count(*model.images.front().rows)) * seconds_per_value + model.seconds_per_row;
  estimate.seconds =
      static_cast<double>((basis ? 1 + parts : 1) * model.images.size()) * static_cast<double>(n) * row / thread_count({});
  estimate.notes = model.notes;
  if (!basis)
    estimate.notes.emplace_back("No handle basis will be stored: every design is one sum over control points per point.");
  estimate.advice = "use fewer handles or basis BASIS_NEVER";
  return estimate;
}

}  // namespace deform
