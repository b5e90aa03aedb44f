// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/compiled_form.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/deformers/handles/handle_system.h"
#include "core/deformers/methods.h"
#include "core/numerics/interpolation/interpolator.h"

namespace deform {

namespace {

static_assert(compiled::tile_points == tile_size);
static_assert(compiled::fixed_region == fixed_region && compiled::following_region == deformable_region);

[[noreturn]] void refuse_form(const std::string& reason) {
  throw Error(ErrorCode::failed_precondition, "this system cannot be compiled: " + reason);
}

}  // namespace

CompiledForm::CompiledForm(const std::shared_ptr<const System>& system)
    : system_(std::dynamic_pointer_cast<const HandleSystem>(system)) {
  if (system_ == nullptr) refuse_form("its method has no handle basis");
  const Setup& setup = system_->setup_;
  if (!setup.constraints.empty()) {
    refuse_form(
        "with constraints the points are no linear function of the motions of the handles, and every design is solved for; "
        "leave the constraints out, or evaluate on the server");
  }
  if (!system_->has_basis()) refuse_form("it was prepared without a handle basis; prepare it with basis BASIS_ALWAYS");
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
  content_.held = system_->hard_handles();
  set_variables();
  set_points();
  set_bases();
}

void CompiledForm::set_variables() {
  const Setup& setup = system_->setup_;
  for (std::size_t h = 0; h < setup.handles.size(); ++h) {
    const HandleFrame& frame = system_->frames_[h];
    content_.handles.push_back({setup.handles[h].name, system_->regions_.handles[h].size(), frame.reference, frame.axes});
  }
  for (const DesignVariable& variable : setup.variables) {
    const auto handle = std::find_if(setup.handles.begin(), setup.handles.end(),
                                     [&](const Handle& candidate) { return candidate.name == variable.handle; });
    content_.variables.push_back({variable.name, static_cast<std::uint32_t>(handle - setup.handles.begin()),
                                  compiled_motion(variable.kind), variable.lower, variable.upper});
  }
}

void CompiledForm::set_points() {
  const Symmetry& symmetry = system_->regions_.symmetry;
  const std::size_t n = system_->mesh_->point_count();
  content_.rest = system_->mesh_->points;
  content_.planes = static_cast<std::uint32_t>(symmetry.planes());
  if (!symmetry.empty()) {
    for (std::size_t k = 0; k < 3; ++k) content_.plane_axes[k] = symmetry.normal(k);
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
    to.residuals = basis.residuals;
    to.more = basis.more;
    to.errors = basis.errors;
    if (basis.compressed) to.compression = basis.compressed->errors();
    content_.converged = content_.converged && basis.converged;
  }
}

/// The values that are stored: sums with the coefficient 1 of one field at a time.
void CompiledForm::decode(std::size_t basis, std::size_t first, std::span<double> out) const {
  const CompressedFields& fields = *system_->basis_[basis].compressed;
  const std::size_t count = fields.fields(), size = count * tile_size;
  std::vector<std::uint32_t> rows(count);
  std::iota(rows.begin(), rows.end(), 0u);
  std::vector<double> unit(count * count, 0.0), values(size);
  for (std::size_t f = 0; f < count; ++f) unit[f * count + f] = 1;
  CompressedSums sums(fields, rows, unit.data(), count, count);
  const std::vector<PointId>& ids = system_->following();
  for (std::size_t done = 0; done < out.size();) {
    const std::size_t at = first + done, tile = at / size, inside = at % size, taken = std::min(size - inside, out.size() - done);
    std::vector<Vec3> places;
    for (std::size_t s = tile * tile_size; s < std::min(ids.size(), (tile + 1) * tile_size); ++s) {
      places.push_back(system_->box_.to_unit(system_->mesh_->points[ids[s]]));
    }
    std::fill(values.begin(), values.end(), 0.0);
    sums.add_tile(tile, places, 0, count, values.data());
    std::copy_n(values.data() + inside, taken, out.begin() + static_cast<std::ptrdiff_t>(done));
    done += taken;
  }
}

void CompiledForm::values(std::size_t basis, std::size_t first, std::span<double> out) const {
  const HandleBasis& from = system_->basis_[basis];
  if (from.compressed) return decode(basis, first, out);
  std::copy_n(from.tiles.tile(0) + first, out.size(), out.begin());
}

std::size_t CompiledForm::bytes_for(const SystemInfo& info) {
  const std::size_t held = info.handle_points + info.fixed_points;
  return info.points * (sizeof(Vec3) + sizeof(std::uint32_t) + 1) + held * (sizeof(compiled::Control) + sizeof(compiled::Pair)) +
         (std::size_t{1} << 20);
}

}  // namespace deform
