#include "client/cli/region_points.h"

#include <algorithm>
#include <utility>

#include "core/base/error.h"
#include "core/mesh/region.h"

namespace deform::cli {

namespace {

Vec3 vec3(const google::protobuf::RepeatedField<double>& numbers) {
  Vec3 result{};
  for (int k = 0; k < std::min(3, numbers.size()); ++k) result[static_cast<std::size_t>(k)] = numbers[k];
  return result;
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
  if (message.union__size() > 0) return {Region::Union{regions_of(message.union_())}};
  if (message.intersection_size() > 0) return {Region::Intersection{regions_of(message.intersection())}};
  if (message.difference_size() > 0) return {Region::Difference{regions_of(message.difference())}};
  if (message.has_complement()) return {Region::Complement{only(message.complement())}};
  if (message.has_grow()) return {Region::Grow{only(message.grow().region()), static_cast<int>(message.grow().rings())}};
  throw Error(ErrorCode::failed_precondition, "the setup has a kind of region that this program does not know; update it");
}

}  // namespace

std::vector<PointId> handle_points(const v1::Setup& setup, const std::string& handle, const Mesh& mesh) {
  std::vector<std::string> names;
  for (const auto& candidate : setup.handles()) {
    if (candidate.name() == handle) return select(region_of(candidate.region()), mesh, "handle \"" + handle + "\"");
    names.push_back(candidate.name());
  }
  const std::string near = nearest_names(handle, names);
  throw Error(ErrorCode::invalid_argument,
              "handle \"" + handle + "\": the setup has no such handle" + (near.empty() ? "" : "; did you mean " + near + "?"));
}

std::vector<std::uint32_t> region_labels(const v1::Setup& setup, const Mesh& mesh) {
  std::vector<std::uint32_t> labels(mesh.point_count(), 0);
  const auto mark = [&](const v1::Region& region, std::uint32_t label, const std::string& what) {
    for (const PointId point : select(region_of(region), mesh, what)) labels[point] = label;
  };
  for (int i = 0; i < setup.fixed_size(); ++i) mark(setup.fixed(i), 1, "fixed[" + std::to_string(i) + "]");
  for (int i = setup.handles_size() - 1; i >= 0; --i) {
    mark(setup.handles(i).region(), static_cast<std::uint32_t>(2 + i), "handle \"" + setup.handles(i).name() + "\"");
  }
  return labels;
}

}  // namespace deform::cli
