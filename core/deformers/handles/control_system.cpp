// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/control_system.h"

#include <algorithm>
#include <atomic>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/handles/control_evaluation.h"

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

}  // namespace

ControlSystem::ControlSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, ControlModel model,
                             const EnergyOptions& options, const RunContext& context)
    : HandleSystem(std::move(mesh), setup, model.controls, context),
      model_(std::move(model)),
      fields_(held_mesh_->point_count()) {
  for (std::size_t p = 0; p < fields_.size(); ++p) {
    if (moves(p)) fields_[p] = handle_fields(points_.region_of[p], static_cast<PointId>(p));
  }
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
      model_.rows->for_each(static_cast<std::int64_t>(i), [&](std::int64_t p, double value) {
        std::atomic<bool>& known = reaches[static_cast<std::size_t>(p)];
        if (value != 0 && !known.load(std::memory_order_relaxed)) known.store(true, std::memory_order_relaxed);
      });
    }
  });
  std::vector<std::string> names;
  for (std::size_t h = 0; h < regions_.handles.size(); ++h) {
    const auto& controls = regions_.handles[h];
    const bool any = std::any_of(controls.begin(), controls.end(), [&](PointId p) { return reaches[p].load(); });
    if (!any) names.push_back(setup_.handles[h].name);
  }
  return names;
}

void ControlSystem::prepare_basis(const EnergyOptions& options, const RunContext& context) {
  const std::size_t bytes = HandleBasis::bytes_for(following().size(), fields(), options.basis_tolerance);
  if (!wants_basis(options.basis, bytes, 0)) return;
  context.progress("basis", 0);
  HandleBasis basis{{0, 1, 2}, FieldTiles(following().size(), fields()), std::vector<double>(fields(), 0.0)};
  basis.more.assign(fields(), 0.0);
  for (std::size_t p = 0; p < fields_.size(); ++p) {
    for (std::size_t f = 0; f < 4 && moves(p); ++f) {
      double& error = basis.more[first_field(p) + f];
      error = std::max(error, model_.rounding * std::abs(fields_[p][f]));
    }
  }
  parallel_for(context, tile_count(following().size()), control_tiles_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t t = begin; t < end; ++t) {
      double* const out = basis.tiles.tile(t);
      std::fill_n(out, fields() * tile_size, 0.0);
      const std::size_t last = std::min((t + 1) * tile_size, following().size());
      for (std::size_t s = t * tile_size; s < last; ++s) {
        model_.rows->for_each(following()[s], [&](std::int64_t column, double value) {
          const auto p = static_cast<std::size_t>(column);
          if (!moves(p)) return;
          double* const at = out + first_field(p) * tile_size + s % tile_size;
          for (std::size_t f = 0; f < 4; ++f) at[f * tile_size] += value * fields_[p][f];
        });
      }
    }
  });
  add_basis(std::move(basis), options.basis_tolerance, context);
}

void ControlSystem::fill_info() {
  info_.solver = Solver::automatic;  // nothing is solved
  info_.samples = info_.functions = fields_.size();
  const std::size_t crossings = model_.crossings ? model_.crossings->bytes() : 0;
  set_bytes(0, model_.rows->bytes() + crossings + fields_.size() * (sizeof(Vec3) + sizeof fields_[0]) +
                   (following().size() + model_.outside.size()) * sizeof(PointId));
  info_.notes = model_.notes;
  info_.notes.push_back(std::to_string(info_.handle_points) + " control points are in handles, the other " +
                        std::to_string(fields_.size() - info_.handle_points) + " stay.");
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
  std::vector<Vec3> result(fields_.size());
  for (std::size_t p = 0; p < result.size(); ++p) {
    if (!moves(p)) continue;
    const auto id = static_cast<PointId>(p);
    const Vec3 to = points.place(design, id, kind);
    result[p] = kind == MotionKind::position ? to - held_mesh_->points[p] : to;
  }
  return result;
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
    model_.rows->for_each(following()[s], [&](std::int64_t column, double value) {
      for (std::size_t j = 0; j < g.size(); ++j) {
        Vec3& sum = g[j][static_cast<std::size_t>(column)];
        sum = sum + value * at_following[j][s];
      }
    });
  }
  Fields result(g.size(), std::vector<double>(3 * fields(), 0.0));
  for (std::size_t j = 0; j < g.size(); ++j) {
    for (std::size_t p = 0; p < fields_.size(); ++p) {
      if (!moves(p)) continue;
      for (std::size_t f = 0; f < 4; ++f) {
        for (std::size_t k = 0; k < 3; ++k) result[j][3 * (first_field(p) + f) + k] += fields_[p][f] * g[j][p][k];
      }
    }
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
  const std::size_t basis_bytes = HandleBasis::bytes_for(n, fields, options.basis_tolerance);
  const bool basis = wants_basis(options.basis, basis_bytes, 0);
  estimate.basis_bytes = basis ? basis_bytes + 2 * fields * sizeof(double) : 0;
  const std::size_t crossings = model.crossings ? model.crossings->bytes() : 0;
  const std::size_t own = point_bytes(n + k, regions.symmetry) + model.rows->bytes() + model.in_space->bytes() + crossings +
                          k * (sizeof(Vec3) + 4 * sizeof(double)) + (n + model.outside.size()) * sizeof(PointId);
  estimate.resident_bytes = estimate.basis_bytes + own;
  estimate.peak_bytes = own + k + (basis ? HandleBasis::peak_bytes_for(n, fields, options.basis_tolerance) : 0);
  const double row = static_cast<double>(first_row_count(*model.rows)) * seconds_per_value + model.seconds_per_row;
  estimate.seconds = (basis ? 2 : 1) * static_cast<double>(n) * row / thread_count({});
  estimate.notes = model.notes;
  if (!basis)
    estimate.notes.emplace_back("No handle basis will be stored: every design is one sum over control points per point.");
  estimate.advice = "use fewer handles or basis BASIS_NEVER";
  return estimate;
}

}  // namespace deform
