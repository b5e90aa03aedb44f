// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/region_points.h"

#include <algorithm>
#include <utility>

#include "client/cli/setup/control_lattice.h"
#include "client/cli/setup/setup_stages.h"
#include "core/base/error.h"
#include "core/mesh/point_owners.h"
#include "core/mesh/region.h"
#include "proto/convert/mesh/region.h"

namespace deform::cli {

namespace {

/// select() of a message; `what` stands before whatever is wrong with it.
std::vector<PointId> points_of(const v1::Region& message, const Mesh& mesh, const std::string& what) {
  return select(convert::region_from_proto(message, what), mesh, what);
}

class Resolver {
 public:
  Resolver(const v1::Setup& setup, const Mesh& mesh) : setup_(setup), mesh_(mesh), owners_(mesh.point_count()) {}

  ResolvedRegions resolve() {
    if (setup_.handles_size() == 0) result_.problems.push_back("handles: at least one is needed");
    for (int i = 0; i < setup_.handles_size(); ++i) {
      const auto& handle = setup_.handles(i);
      result_.handles.push_back(handle.name());
      claim(handle.region(), ResolvedRegions::first_handle + static_cast<std::uint32_t>(i), name_of(handle));
    }
    for (int i = 0; i < setup_.fixed_size(); ++i) {
      claim(setup_.fixed(i), ResolvedRegions::fixed, "fixed[" + std::to_string(i) + "]");
    }
    for (int i = 0; i < setup_.constraints_size(); ++i) add_constraint(setup_.constraints(i), i);
    for (const std::uint32_t owner : owners_.owners()) {
      result_.labels.push_back(owner == PointOwners::nobody ? ResolvedRegions::free : owner);
    }
    std::sort(result_.contested.begin(), result_.contested.end());
    result_.contested.erase(std::unique(result_.contested.begin(), result_.contested.end()), result_.contested.end());
    return std::move(result_);
  }

 private:
  static std::string name_of(const v1::Handle& handle) { return "handle \"" + handle.name() + "\""; }

  std::vector<PointId> selected(const v1::Region& region, const std::string& what) {
    try {
      std::vector<PointId> points = points_of(region, mesh_, what);
      if (points.empty()) result_.problems.push_back(what + ": " + no_point_text(mesh_));
      return points;
    } catch (const Error& error) {
      if (error.code() != ErrorCode::invalid_argument) throw;
      result_.problems.push_back(error.what());
      return {};
    }
  }

  void claim(const v1::Region& region, std::uint32_t owner, const std::string& what) {
    const std::vector<PointId> points = selected(region, what);
    const PointOwners::Overlap overlap = owners_.claim(points, owner);
    if (overlap.points == 0) return;
    const int other = static_cast<int>(overlap.other - ResolvedRegions::first_handle);
    result_.problems.push_back(what + " " + overlap.text(name_of(setup_.handles(other))));
    for (const PointId point : points) {
      if (owners_.owners()[point] != owner) result_.contested.push_back(point);
    }
  }

  void add_constraint(const v1::Constraint& constraint, int i) {
    const auto* kind =
        constraint.GetReflection()->GetOneofFieldDescriptor(constraint, v1::Constraint::descriptor()->FindOneofByName("kind"));
    ResolvedRegions::Constraint resolved{constraint.name(), kind == nullptr ? "" : kind->name(), {}};
    for (int r = 0; r < constraint.regions_size(); ++r) {
      resolved.regions.push_back(
          selected(constraint.regions(r), "constraints[" + std::to_string(i) + "].regions[" + std::to_string(r) + "]"));
    }
    result_.constraints.push_back(std::move(resolved));
  }

  const v1::Setup& setup_;
  const Mesh& mesh_;
  PointOwners owners_;
  ResolvedRegions result_;
};

}  // namespace

ResolvedRegions resolve_regions(const v1::Setup& setup, const Mesh& mesh) {
  if (!selects_controls(setup)) return Resolver(setup, mesh).resolve();
  throw Error(ErrorCode::invalid_argument,
              std::string(setup.method().has_cage() ? "method.cage" : "method.ffd") +
                  ".control: with CONTROLS handles and fixed regions are control points and no regions of the mesh" +
                  "; `deform lattice` shows them");
}

std::vector<PointId> handle_points(const v1::Setup& setup, const std::string& handle, const Mesh& mesh) {
  std::vector<std::string> names;
  const std::string what = "handle \"" + handle + "\"";
  if (const auto own = setup_of_handle(setup, handle)) {
    const auto found = std::find_if(own->handles().begin(), own->handles().end(),
                                    [&](const v1::Handle& candidate) { return candidate.name() == handle; });
    if (selects_controls(*own)) return control_points_of(found->region(), *own, mesh, what);
    return points_of(found->region(), mesh, what);
  }
  for (const auto& candidate : setup.handles()) names.push_back(candidate.name());
  for (const auto& stage : setup.then()) {
    for (const auto& candidate : stage.handles()) names.push_back(candidate.name());
  }
  const std::string near = nearest_names(handle, names);
  throw Error(ErrorCode::invalid_argument,
              what + ": the setup has no such handle" + (near.empty() ? "" : "; did you mean " + near + "?"));
}

namespace {

/// Fixed is what all methods fix.
std::vector<std::uint32_t> composed_labels(const v1::Setup& setup, const Mesh& mesh) {
  std::vector<std::uint32_t> labels(mesh.point_count(), ResolvedRegions::fixed);
  auto first = ResolvedRegions::first_handle;
  std::vector<std::uint32_t> handled(mesh.point_count(), 0);
  for (int s = -1; s < setup.then_size(); ++s) {
    const v1::Setup own = setup_of_method(setup, s < 0 ? std::nullopt : std::optional(static_cast<std::uint32_t>(s)));
    const std::vector<std::uint32_t> of_method = region_labels(own, mesh);
    for (std::size_t i = 0; i < labels.size(); ++i) {
      if (of_method[i] != ResolvedRegions::fixed) labels[i] = ResolvedRegions::free;
      const bool held = of_method[i] >= ResolvedRegions::first_handle;
      if (held && handled[i] == 0) handled[i] = first + (of_method[i] - ResolvedRegions::first_handle);
    }
    first += static_cast<std::uint32_t>(own.handles_size());
  }
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (handled[i] != 0) labels[i] = handled[i];
  }
  return labels;
}

}  // namespace

std::vector<std::uint32_t> region_labels(const v1::Setup& setup, const Mesh& mesh) {
  if (setup.then_size() > 0) return composed_labels(setup, mesh);
  std::vector<std::uint32_t> labels(mesh.point_count(), 0);
  if (selects_controls(setup)) return labels;
  const auto mark = [&](const v1::Region& region, std::uint32_t label, const std::string& what) {
    for (const PointId point : points_of(region, mesh, what)) labels[point] = label;
  };
  for (int i = 0; i < setup.fixed_size(); ++i) mark(setup.fixed(i), 1, "fixed[" + std::to_string(i) + "]");
  for (int i = setup.handles_size() - 1; i >= 0; --i) {
    mark(setup.handles(i).region(), static_cast<std::uint32_t>(2 + i), "handle \"" + setup.handles(i).name() + "\"");
  }
  return labels;
}

}  // namespace deform::cli
