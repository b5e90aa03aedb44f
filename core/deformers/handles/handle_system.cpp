// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/handle_system.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <sstream>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/parallel.h"
#include "core/base/vectors.h"
#include "core/deformers/handles/handle_fields.h"
#include "core/deformers/handles/handle_map.h"
#include "core/deformers/handles/sector_points.h"
#include "core/deformers/handles/sliding_checks.h"

namespace deform {

namespace {

constexpr std::size_t held_points_per_task = 8192;
constexpr const char* only_slides =
    "; points on a symmetry plane only slide in it: take them out of the handle with `difference`";

[[noreturn]] void refuse(std::size_t design, const std::string& message) {
  throw Error(ErrorCode::invalid_argument, "designs[" + std::to_string(design) + "]" + message);
}

}  // namespace

/// The mesh whose points follow, and the mesh with the handle and fixed points.
struct HandleSystem::Held {
  std::shared_ptr<const Mesh> mesh, held;
};

HandleSystem::HandleSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, HandleMode handles, Unit unit,
                           const RunContext& context)
    : HandleSystem(Held{mesh, mesh}, setup, handles, unit, context) {}

HandleSystem::HandleSystem(std::shared_ptr<const Mesh> mesh, const Setup& setup, std::shared_ptr<const Mesh> controls,
                           const RunContext& context)
    : HandleSystem(Held{std::move(mesh), std::move(controls)}, setup, HandleMode::soft, Unit::diagonal, context) {
  points_.coincident.clear();  // control points may part
  info_.deformable_points = mesh_->point_count();
}

HandleSystem::HandleSystem(Held held, const Setup& setup, HandleMode handles, Unit unit, const RunContext& context)
    : mesh_(std::move(held.mesh)), held_mesh_(std::move(held.held)), setup_(setup), handles_(handles) {
  context.progress("select", 0);
  regions_ = validate(setup_, *mesh_, context);
  const Box bounds = bounding_box(mesh_->points);
  info_.diagonal = bounds.diagonal();
  for (std::size_t k = 0; k < 3; ++k) {
    largest_coordinate_ = std::max({largest_coordinate_, std::abs(bounds.min[k]), std::abs(bounds.max[k])});
  }
  flat_ = FlatCase(*mesh_);
  check_one_sided(flat_, setup_, regions_);
  box_ = {bounds.min, unit == Unit::diagonal ? info_.diagonal : 0};
  for (int k = 0; k < 3 && unit == Unit::longest_edge; ++k) box_.scale = std::max(box_.scale, bounds.max[k] - bounds.min[k]);
  if (!(box_.scale > 0)) box_.scale = 1;
  points_ = constraint_points(*held_mesh_, regions_, context);
  if (!hard_handles()) {
    all_.resize(mesh_->point_count());
    std::iota(all_.begin(), all_.end(), PointId{0});
  }
  if (held_mesh_ != mesh_) control_symmetry_ = regions_.symmetry.for_points(held_mesh_->points);
  rank_of_.assign(held_mesh_->point_count(), 0);
  for (const auto& handle : regions_.handles) {
    info_.handle_points += handle.size();
    for (std::size_t k = 0; k < handle.size(); ++k) {
      rank_of_[handle[k]] = static_cast<std::uint32_t>(k);
      if (held_symmetry().on(handle[k]) != 0) sliding_.push_back(handle[k]);
    }
  }
  std::sort(sliding_.begin(), sliding_.end());
  frames_ = handle_frames(*held_mesh_, regions_, held_symmetry(), box_);
  info_.points = mesh_->point_count();
  info_.fixed_points = regions_.fixed.size();
  info_.constraint_points = points_.count;
  info_.deformable_points = points_.deformable.size();
}

std::string HandleSystem::without_basis() const {
  return "it was prepared without a handle basis; prepare it with basis BASIS_ALWAYS";
}

std::array<double, 4> HandleSystem::handle_fields(std::size_t handle, PointId id) const {
  const HandleFrame& frame = frames_[handle];
  const Vec3 x = box_.to_unit(held_mesh_->points[id]) - frame.reference;
  return {1, dot(frame.axes[0], x), dot(frame.axes[1], x), dot(frame.axes[2], x)};
}

Vec3 HandleSystem::components(Vec3 in_frame, PointId id) const { return Symmetry::within(in_frame, regions_.symmetry.on(id)); }

/// With constraints a design is no sum of fields, even where they are known.
std::unique_ptr<const DisplacementFields> HandleSystem::displacement_fields() const {
  if (!has_basis() || !setup_.constraints.empty()) return nullptr;
  return std::make_unique<const HandleFields>(*this);
}

void HandleSystem::add_basis(HandleBasis&& basis, double tolerance, const RunContext& context) {
  if (tolerance > 0) basis.compress(following_places(), tolerance, context);
  basis_.push_back(std::move(basis));
}

void HandleSystem::set_bytes(std::size_t factor_bytes, std::size_t more) {
  info_.factor_bytes = factor_bytes;
  info_.basis_fields = has_basis() ? fields() : 0;
  for (const HandleBasis& basis : basis_) info_.basis_bytes += basis.bytes();
  info_.bytes = factor_bytes + info_.basis_bytes + more + point_bytes(mesh_->point_count(), regions_.symmetry);
}

void HandleSystem::check(const BoundDesign& design, std::size_t index) const {
  check_tolerance(design, index);
  held().check_coincident(design, index);
  check_sliding(design, index);
  check_flat(design, index);
  check_motions(design, index);
}

std::string HandleSystem::unchecked_motions() const {
  Problems problems(Problems::Mode::collect);
  const SlidingPlaces places{regions_.symmetry, held_mesh_->points, regions_.handles, info_.diagonal,
                             held_mesh_ == mesh_ ? "point" : "control point"};
  check_variables_flat(flat_, setup_, places, problems);
  return problems.empty() ? std::string() : problems.list()[0].message;
}

void HandleSystem::check_flat(const BoundDesign& design, std::size_t index) const {
  const HeldPoints points = held();
  for (std::size_t h = 0; h < regions_.handles.size() && flat_.exists(); ++h) {
    if (!design.moves(h)) continue;
    for (const PointId id : regions_.handles[h]) {
      const std::string reason = flat_.leaves(points.displacement(design, id, MotionKind::position), info_.diagonal);
      if (!reason.empty()) refuse(index, std::string(": ") + point_word() + name_of(id) + " " + reason);
    }
  }
}

void HandleSystem::check_motions(const BoundDesign&, std::size_t) const {}

void HandleSystem::check_motions(const std::vector<Affine>&, const std::string&) const {}

void HandleSystem::check_tolerance(const BoundDesign& design, std::size_t index) const {
  const double tolerance = design.tolerance;
  if (tolerance == 0) return;
  const std::string text = ".tolerance: " + number_digits(tolerance);
  if (!to_tolerance(info_.solver)) {
    refuse(index, text + " (solver_tolerance of the request), but solver " + to_string(info_.solver) + " has none");
  }
  const bool prepared_for = info_.solver == Solver::incremental_qr;
  const double least = prepared_for ? info_.tolerance : least_tolerance;
  if (tolerance >= least && tolerance <= largest_tolerance) return;
  refuse(index, text + " is out of range " + number_digits(least) + ".." + number_digits(largest_tolerance) +
                    (prepared_for ? "; the system was prepared for " + number_digits(info_.tolerance) : ""));
}

/// Partners in regions must move alike, and points on the axis along it.
void HandleSystem::check_sector(const BoundDesign& design, std::size_t index) const {
  const HeldPoints points = held();
  const auto moved = [&](PointId id) -> std::optional<Vec3> {
    if (!is_prescribed(id)) return std::nullopt;
    return points.prescribed_position(design, id, MotionKind::position) - mesh_->points[id];
  };
  const std::string conflict = sector_conflict(
      regions_.symmetry, moved, [&](PointId id) { return name_of(id); }, sector_agreement * info_.diagonal);
  if (!conflict.empty()) refuse(index, ": " + conflict);
}

void HandleSystem::check_sector(const std::vector<Affine>& derivative, const std::string& what) const {
  double size = 0;  // of the terms of a rate
  for (const Affine& m : derivative) {
    for (std::size_t i = 0; i < 12; ++i) size = std::max(size, std::abs(m[i]) * (i % 4 == 3 ? 1.0 : largest_coordinate_));
  }
  const auto rate = [&](PointId id) -> std::optional<Vec3> {
    if (!is_prescribed(id)) return std::nullopt;
    const RegionIndex region = points_.region_of[id];
    return region == fixed_region ? Vec3{} : transformed(derivative[region], mesh_->points[id]);
  };
  const std::string conflict = sector_conflict(
      regions_.symmetry, rate, [&](PointId id) { return name_of(id); }, 10 * sector_agreement * size);
  if (!conflict.empty()) throw Error(ErrorCode::invalid_argument, what + ": " + conflict);
}

std::string HandleSystem::name_of(PointId id) const {
  const RegionIndex region = points_.region_of[id];
  if (region == fixed_region) return std::to_string(id) + " (fixed)";
  return std::to_string(id) + " (handle \"" + setup_.handles[region].name + "\")";
}

void HandleSystem::check_sliding(const BoundDesign& design, std::size_t index) const {
  if (regions_.symmetry.is_sector()) return check_sector(design, index);
  const Symmetry& symmetry = held_symmetry();
  const HeldPoints points = held();
  for (const PointId id : sliding_) {
    const Vec3 u = symmetry.to_frame(points.prescribed_position(design, id, MotionKind::position) - held_mesh_->points[id]);
    for (std::size_t k = 0; k < symmetry.planes(); ++k) {
      if ((symmetry.on(id) >> k & 1u) == 0 || std::abs(u[k]) <= symmetry.reach(k)) continue;
      std::ostringstream text;
      text << ": " << point_word() << id << " (handle \"" << setup_.handles[points_.region_of[id]].name << "\") lies on symmetry["
           << k << "] but is sent a distance of " << number_digits(u[k]) << " out of it" << only_slides;
      refuse(index, text.str());
    }
  }
}

void HandleSystem::check_sliding(const std::vector<Affine>& derivative, const std::string& what) const {
  if (regions_.symmetry.is_sector()) return check_sector(derivative, what);
  const Symmetry& symmetry = held_symmetry();
  for (const PointId id : sliding_) {
    const RegionIndex handle = points_.region_of[id];
    const Affine& m = derivative[handle];
    if (m == Affine{}) continue;
    const auto exit = plane_exit(symmetry, symmetry.on(id), m, held_mesh_->points[id], info_.diagonal);
    if (!exit) continue;
    std::ostringstream text;
    text << what << ": moves " << point_word() << id << " (handle \"" << setup_.handles[handle].name << "\") out of symmetry["
         << exit->plane << "] at a rate of " << number_digits(exit->rate) << only_slides;
    throw Error(ErrorCode::invalid_argument, text.str());
  }
}

Points HandleSystem::jacobian_vector(std::span<const double> variables, std::span<const double> direction,
                                     const RunContext& context) const {
  const std::vector<Affine> maps = motion_derivative(setup_, variables, direction);
  check_sliding(maps, "direction");
  check_motions(maps, "direction");
  const std::unique_ptr<const Evaluation> evaluation = derivative(variables, maps, context);
  Points result(mesh_->point_count());
  parallel_for(context, result.size(), held_points_per_task, [&](std::size_t begin, std::size_t end) {
    Vec3* out = result.data() + begin;
    evaluation->evaluate(begin, end, 0, std::span<Vec3* const>(&out, 1));
  });
  return result;
}

std::string HandleSystem::only_on_mesh() const { return "its method is defined at the points of its geometry only"; }

std::unique_ptr<const SpaceMap> HandleSystem::bind_in_space(const Design& design, const RunContext& context) const {
  const std::string reason = only_on_mesh();
  if (!reason.empty()) throw Error(ErrorCode::failed_precondition, "the system cannot be evaluated at other points: " + reason);
  std::unique_ptr<const Evaluation> bound = bind({&design, 1}, EvaluationPath::direct, context);
  if (dynamic_cast<const HandleEvaluation*>(bound.get()) == nullptr) {
    throw Error(ErrorCode::internal, "a system of handles binds designs to something else");
  }
  return std::make_unique<const HandleMap>(
      std::unique_ptr<const HandleEvaluation>(static_cast<const HandleEvaluation*>(bound.release())));
}

System::SpaceBytes HandleSystem::space_bytes(std::size_t) const {
  std::size_t given = hard_handles() ? points_.count : 0;
  if (!setup_.constraints.empty()) given = mesh_->point_count();  // which may be any
  return {HandleMap::bytes_for(given) + PartnerPlaces::bytes_for(regions_.symmetry.sector()), 0};
}

/// Transpose of "fields of the handles to displacements of the following points": 4H x 3 for each cotangent, model coordinates.
HandleSystem::Fields HandleSystem::pull_back(std::span<const double> variables, std::span<const Points> cotangents,
                                             const RunContext& context) const {
  const Symmetry& symmetry = regions_.symmetry;
  std::vector<std::vector<Vec3>> at_following(cotangents.size());
  for (std::size_t j = 0; j < cotangents.size(); ++j) {
    at_following[j].reserve(following().size());
    for (const PointId id : following()) {
      const Vec3& vector = cotangents[j][id];
      at_following[j].push_back(symmetry.empty() ? vector : components(symmetry.to_frame(vector), id));
    }
  }
  Fields result(cotangents.size(), std::vector<double>(3 * fields(), 0.0));
  if (!has_basis()) result = adjoint(variables, at_following, context);
  const bool compressed = has_basis() && basis_.front().compressed;
  const std::vector<Vec3> places = compressed ? following_places() : std::vector<Vec3>();
  for (std::size_t j = 0; j < cotangents.size(); ++j) {
    for (const HandleBasis& basis : basis_) {
      const std::vector<double> part = basis.compressed ? basis.compressed->transposed_product(at_following[j], places, context)
                                                        : basis.tiles.transposed_product(at_following[j], context);
      for (std::size_t f = 0; f < fields(); ++f) {
        Vec3 sum{};
        for (const std::size_t k : basis.components) sum[k] = part[3 * f + k];
        if (basis.turned) sum = {0, sum[2], -sum[1]};
        for (const std::size_t k : basis.components) result[j][3 * f + k] += sum[k];
      }
    }
    for (std::size_t f = 0; f < fields() && !symmetry.empty(); ++f) {
      const Vec3 back = symmetry.from_frame({result[j][3 * f], result[j][3 * f + 1], result[j][3 * f + 2]});
      std::copy(back.begin(), back.end(), result[j].begin() + static_cast<std::ptrdiff_t>(3 * f));
    }
  }
  return result;
}

std::vector<double> HandleSystem::vector_jacobian(std::span<const double> variables, const Points& cotangent,
                                                  const RunContext& context) const {
  return vector_jacobians(variables, {&cotangent, 1}, context).front();
}

std::vector<std::vector<double>> HandleSystem::vector_jacobians(std::span<const double> variables,
                                                                std::span<const Points> cotangents,
                                                                const RunContext& context) const {
  for (const Points& cotangent : cotangents) check_cotangent(cotangent, mesh_->point_count());
  handle_motions(setup_, variables);  // checks them
  for (std::size_t k = 0; k < setup_.variables.size() && !regions_.symmetry.empty(); ++k) {
    const std::vector<Affine> rate = handle_motion_derivative(setup_, variables, k);
    const std::string what = "variable \"" + setup_.variables[k].name + "\"";
    check_sliding(rate, what);
    check_motions(rate, what);
  }
  const Fields field_sums = pull_back(variables, cotangents, context);
  const Points nothing(hard_handles() ? 0 : held_mesh_->point_count());  // is prescribed by soft handles
  std::vector<std::vector<double>> gradients;
  for (std::size_t j = 0; j < cotangents.size(); ++j) {
    gradients.push_back(
        variable_gradient(held(), variables, hard_handles() ? cotangents[j] : nothing, field_sums[j], frames_, box_));
  }
  return gradients;
}

}  // namespace deform
