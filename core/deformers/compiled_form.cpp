// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/compiled_form.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/compiled/coded_fields.h"
#include "core/deformers/composed/composed_system.h"
#include "core/deformers/handles/handle_system.h"
#include "core/deformers/methods.h"
#include "core/deformers/mirrored_system.h"
#include "core/numerics/interpolation/interpolator.h"

namespace deform {

namespace {

static_assert(compiled::tile_points == tile_size && compiled::coded_points == FieldBlock::points);
static_assert(compiled::fixed_region == fixed_region && compiled::following_region == deformable_region);

[[noreturn]] void refuse_form(const std::string& reason) {
  throw Error(ErrorCode::failed_precondition, "this system cannot be compiled: " + reason);
}

}  // namespace

CompiledForm::CompiledForm(const std::shared_ptr<const System>& system)
    : system_(std::dynamic_pointer_cast<const HandleSystem>(system)) {
  if (std::dynamic_pointer_cast<const MirroredSystem>(system) != nullptr) {
    refuse_form(
        "it deforms a half model with its mirror images, or a sector with its images; use method rbf, or compile the whole "
        "model");
  }
  if (std::dynamic_pointer_cast<const ComposedSystem>(system) != nullptr) {
    refuse_form("its setup has several methods, one after the other; compile a setup with one method, or evaluate on the server");
  }
  if (system_ == nullptr) refuse_form("its method has no handle basis");
  const Setup& setup = system_->setup_;
  if (!setup.constraints.empty()) {
    refuse_form(
        "with constraints the points are no linear function of the motions of the handles, and every design is solved for; "
        "leave the constraints out, or evaluate on the server");
  }
  if (!system_->has_basis()) refuse_form(system_->without_basis());
  check_sector();
  const std::string unchecked = system_->unchecked_motions();
  if (!unchecked.empty()) refuse_form(unchecked);
  if (setup.variables.empty()) refuse_form("its setup has no design variables");
  const SystemInfo& info = system_->info();
  content_.method = with_method(setup, []<Method M>(const typename M::Options&) { return std::string(M::name); });
  content_.notes = info.notes;
  content_.diagonal = info.diagonal;
  content_.largest_coordinate = system_->largest_coordinate_;
  content_.origin = system_->box_.origin;
  content_.scale = system_->box_.scale;
  content_.error_margin = error_margin;
  content_.allowed_error = info.solver == Solver::iterative ? info.tolerance : 0;
  content_.condition = std::isfinite(info.condition) ? info.condition : std::numeric_limits<double>::max();
  content_.reduction_error = info.reduction_error;
  content_.held = system_->hard_handles();
  content_.misfits = system_->basis_.front().checked == HandleBasis::Checked::held;
  set_variables();
  set_points();
  set_bases();
}

/// Whether motions keep partners images of each other is checked here and not by what evaluates the file.
void CompiledForm::check_sector() const {
  if (system_->held_mesh_ != system_->mesh_) return;
  const Symmetry& symmetry = system_->regions_.symmetry;
  const auto check = [&](PointId id, const std::string& where) {
    const RegionIndex region = system_->points_.region_of[id];
    if (region == fixed_region || region == deformable_region) return;
    refuse_form("point " + std::to_string(id) + " of handle \"" + system_->setup_.handles[region].name + "\" lies on " + where +
                " of the sector, where not all motions are possible; take it out of the handle with `difference`, or evaluate on "
                "the server");
  };
  for (const Sector::Pair& pair : symmetry.sector().pairs()) {
    check(pair.first, "a periodic boundary");
    check(pair.second, "a periodic boundary");
  }
  for (const PointId id : symmetry.sector().axis_points()) check(id, "the axis");
}

void CompiledForm::set_variables() {
  const Setup& setup = system_->setup_;
  for (std::size_t h = 0; h < setup.handles.size(); ++h) {
    const HandleFrame& frame = system_->frames_[h];
    content_.handles.push_back({setup.handles[h].name, system_->regions_.handles[h].size(), frame.reference, frame.axes});
  }
  const auto index = [&](const std::string& name) {
    const auto handle =
        std::find_if(setup.handles.begin(), setup.handles.end(), [&](const Handle& candidate) { return candidate.name == name; });
    return static_cast<std::uint32_t>(handle - setup.handles.begin());
  };
  for (const DesignVariable& variable : setup.variables) {
    compiled::Variable& to = content_.variables.emplace_back();
    to = {variable.name, index(variable.handle), compiled_motion(variable.kind), variable.lower, variable.upper};
    for (const DrivenHandle& driven : variable.also) to.also.push_back({index(driven.handle), compiled_motion(driven.kind)});
  }
}

void CompiledForm::set_points() {
  const Symmetry& symmetry = system_->regions_.symmetry;
  const std::size_t n = system_->mesh_->point_count();
  content_.rest = system_->mesh_->points;
  content_.planes = static_cast<std::uint32_t>(symmetry.planes());
  content_.sector = symmetry.is_sector();
  if (!symmetry.empty()) {
    for (std::size_t k = 0; k < 3; ++k) content_.plane_axes[k] = symmetry.normal(k);
  }
  if (symmetry.planes() > 0) {
    for (std::size_t k = 0; k < symmetry.planes(); ++k) content_.reach[k] = symmetry.reach(k);
    content_.on_planes.resize(n);
    for (std::size_t i = 0; i < n; ++i) content_.on_planes[i] = static_cast<std::uint8_t>(symmetry.on(static_cast<PointId>(i)));
  }
  if (system_->held_mesh_ == system_->mesh_) {
    content_.regions.assign(system_->points_.region_of.begin(), system_->points_.region_of.end());
  } else {
    content_.regions.assign(n, compiled::following_region);
    for (std::uint32_t h = 0; h < content_.handles.size(); ++h) {
      for (const PointId id : system_->regions_.handles[h]) content_.controls.push_back({h, system_->held_mesh_->points[id]});
    }
  }
  for (const auto& cluster : system_->points_.coincident) {
    for (std::size_t k = 1; k < cluster.size(); ++k) content_.coincident.push_back({cluster[0], cluster[k]});
  }
}

void CompiledForm::set_bases() {
  for (const HandleBasis& basis : system_->basis_) {
    compiled::Basis& to = content_.bases.emplace_back();
    to.components = 0;
    for (const std::size_t k : basis.components) to.components |= 1u << k;
    if (basis.turned) to.components = compiled::turned_components;
    to.residuals = basis.residuals;
    to.more = basis.more;
    to.errors = basis.errors;
    if (basis.compressed) {
      to.compression = basis.compressed->errors();
      for (const FieldBlock& block : basis.compressed->blocks()) {
        compiled::append_block({block.centre, block.inverse_radius, block.affine, block.steps, block.offsets, block.bits,
                                block.directions, block.stride, block.codes, block.exact},
                               system_->fields(), to.codes);
      }
    }
    content_.converged = content_.converged && basis.converged;
  }
}

void CompiledForm::values(std::size_t basis, std::size_t first, std::span<double> out) const {
  std::copy_n(system_->basis_[basis].tiles.tile(0) + first, out.size(), out.begin());
}

std::size_t CompiledForm::bytes_for(const System& system) {
  const SystemInfo& info = system.info();
  const std::size_t held = info.handle_points + info.fixed_points;
  std::size_t codes = 0;
  if (const auto* of_handles = dynamic_cast<const HandleSystem*>(&system)) {
    for (const HandleBasis& basis : of_handles->basis_) codes += basis.compressed ? 2 * basis.compressed->bytes() : 0;
  }
  return codes + info.points * (sizeof(Vec3) + sizeof(std::uint32_t) + 1) +
         held * (sizeof(compiled::Control) + sizeof(compiled::Pair)) + (std::size_t{1} << 20);
}

}  // namespace deform
