#include "client/cli/setup/region_points.h"

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "core/mesh/point_owners.h"
#include "core/mesh/region.h"

namespace deform::cli {

namespace {

[[noreturn]] void invalid(const std::string& what) { throw Error(ErrorCode::invalid_argument, what); }

Vec3 vec3(const google::protobuf::RepeatedField<double>& numbers) {
  if (numbers.size() != 3) invalid("expected 3 numbers, got " + std::to_string(numbers.size()));
  return {numbers[0], numbers[1], numbers[2]};
}

void expect_one_kind(const v1::Region& message) {
  std::vector<const google::protobuf::FieldDescriptor*> kinds;
  message.GetReflection()->ListFields(message, &kinds);
  if (kinds.empty()) invalid("no kind of region is given (group, box, sphere, ...)");
  if (kinds.size() > 1) invalid("expected exactly one kind of region, got " + kinds[0]->name() + " and " + kinds[1]->name());
}

Region region_of(const v1::Region& message);

std::vector<Region> regions_of(const google::protobuf::RepeatedPtrField<v1::Region>& messages) {
  std::vector<Region> regions;
  for (const auto& message : messages) regions.push_back(region_of(message));
  return regions;
}

std::vector<Region> only(const v1::Region& message) {
  std::vector<Region> regions;
  regions.push_back(region_of(message));
  return regions;
}

Region region_of(const v1::Region& message) {
  expect_one_kind(message);
  if (!message.group().empty()) return {Region::GroupName{message.group()}};
  if (message.has_box()) return {Region::InBox{vec3(message.box().min()), vec3(message.box().max())}};
  if (message.has_sphere()) return {Region::InSphere{vec3(message.sphere().centre()), message.sphere().radius()}};
  if (message.has_cylinder()) {
    const auto& cylinder = message.cylinder();
    return {Region::InCylinder{vec3(cylinder.start()), vec3(cylinder.end()), cylinder.radius()}};
  }
  if (message.has_half_space()) {
    return {Region::InHalfSpace{vec3(message.half_space().point()), vec3(message.half_space().normal())}};
  }
  if (message.ids_size() > 0) return {Region::Ids{{message.ids().begin(), message.ids().end()}}};
  if (message.open_boundary()) return {Region::OpenBoundary{}};
  if (message.all()) return {Region::All{}};
  if (message.boundary()) return {Region::Boundary{}};
  if (message.union__size() > 0) return {Region::Union{regions_of(message.union_())}};
  if (message.intersection_size() > 0) return {Region::Intersection{regions_of(message.intersection())}};
  if (message.difference_size() > 0) return {Region::Difference{regions_of(message.difference())}};
  if (message.has_complement()) return {Region::Complement{only(message.complement())}};
  if (message.has_grow()) return {Region::Grow{only(message.grow().region()), static_cast<int>(message.grow().rings())}};
  throw Error(ErrorCode::failed_precondition, "the setup has a kind of region that this program does not know; update it");
}

/// select() of a message; `what` stands before whatever is wrong with it.
std::vector<PointId> points_of(const v1::Region& message, const Mesh& mesh, const std::string& what) {
  const auto region = [&] {
    try {
      return region_of(message);
    } catch (const Error& error) {
      throw Error(error.code(), what + ": " + error.what());
    }
  }();
  return select(region, mesh, what);
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

ResolvedRegions resolve_regions(const v1::Setup& setup, const Mesh& mesh) { return Resolver(setup, mesh).resolve(); }

std::vector<PointId> handle_points(const v1::Setup& setup, const std::string& handle, const Mesh& mesh) {
  std::vector<std::string> names;
  for (const auto& candidate : setup.handles()) {
    if (candidate.name() == handle) return points_of(candidate.region(), mesh, "handle \"" + handle + "\"");
    names.push_back(candidate.name());
  }
  const std::string near = nearest_names(handle, names);
  throw Error(ErrorCode::invalid_argument,
              "handle \"" + handle + "\": the setup has no such handle" + (near.empty() ? "" : "; did you mean " + near + "?"));
}

std::vector<std::uint32_t> region_labels(const v1::Setup& setup, const Mesh& mesh) {
  std::vector<std::uint32_t> labels(mesh.point_count(), 0);
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
