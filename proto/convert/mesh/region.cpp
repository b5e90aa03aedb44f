// SPDX-License-Identifier: Apache-2.0
#include "proto/convert/mesh/region.h"

#include <algorithm>
#include <vector>

#include "proto/convert/base/fields.h"

namespace deform::convert {

namespace {

constexpr int deepest_nesting = 64;

Region convert(const v1::Region& message, const std::string& path, int depth);

void sort_unique(google::protobuf::RepeatedField<std::uint32_t>& ids) {
  std::sort(ids.begin(), ids.end());
  ids.Truncate(static_cast<int>(std::unique(ids.begin(), ids.end()) - ids.begin()));
}

std::vector<Region> children(const google::protobuf::RepeatedPtrField<v1::Region>& messages, const std::string& path, int depth) {
  std::vector<Region> regions;
  for (int i = 0; i < messages.size(); ++i) {
    regions.push_back(convert(messages[i], path + "[" + std::to_string(i) + "]", depth + 1));
  }
  return regions;
}

/// Every field of the message is a kind.
void check_one_kind(const v1::Region& message, const std::string& path) {
  std::vector<const google::protobuf::FieldDescriptor*> kinds;
  message.GetReflection()->ListFields(message, &kinds);
  if (kinds.empty()) refuse_field(path, "no kind of region is given (group, box, sphere, ...); an empty list or false is none");
  if (kinds.size() > 1) {
    refuse_field(path, "expected exactly one kind of region, got " + kinds[0]->name() + " and " + kinds[1]->name());
  }
}

Region solid(const v1::Region& message, const std::string& path) {
  if (message.has_box()) {
    return {Region::InBox{vec3(message.box().min(), path + ".box.min"), vec3(message.box().max(), path + ".box.max")}};
  }
  if (message.has_sphere()) {
    return {Region::InSphere{vec3(message.sphere().centre(), path + ".sphere.centre"),
                             finite(message.sphere().radius(), path + ".sphere.radius")}};
  }
  if (message.has_cylinder()) {
    const auto& cylinder = message.cylinder();
    return {Region::InCylinder{vec3(cylinder.start(), path + ".cylinder.start"), vec3(cylinder.end(), path + ".cylinder.end"),
                               finite(cylinder.radius(), path + ".cylinder.radius")}};
  }
  return {Region::InHalfSpace{vec3(message.half_space().point(), path + ".half_space.point"),
                              vec3(message.half_space().normal(), path + ".half_space.normal")}};
}

Region lattice_range(const v1::LatticeRange& message, const std::string& path) {
  const google::protobuf::RepeatedField<std::uint32_t>* given[] = {&message.i(), &message.j(), &message.k()};
  Region::LatticeRange range;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (given[axis]->empty()) continue;
    if (given[axis]->size() != 2) {
      refuse_field(path + "." + "ijk"[axis],
                   "must have two numbers, the first and the last control point, but has " + std::to_string(given[axis]->size()));
    }
    range.along[axis] = {given[axis]->Get(0), given[axis]->Get(1)};
  }
  return {range};
}

Region patch(const v1::Patch& message, const std::string& path) {
  if (message.seed().empty() == !message.has_point()) {
    refuse_field(path, std::string("expected exactly one of seed, point, got ") + (message.has_point() ? "both" : "neither"));
  }
  Region::Patch patch;
  if (message.has_point()) {
    patch.seed = PointId{message.point()};
  } else {
    patch.seed = vec3(message.seed(), path + ".seed");
  }
  if (const double angle = finite(message.angle(), path + ".angle"); angle != 0) patch.angle = angle;
  return {patch};
}

Region convert(const v1::Region& message, const std::string& path, int depth) {
  if (depth > deepest_nesting) refuse_field(path, "regions are nested deeper than " + std::to_string(deepest_nesting));
  check_one_kind(message, path);
  if (!message.group().empty()) return {Region::GroupName{message.group()}};
  if (message.ids_size() > 0) return {Region::Ids{{message.ids().begin(), message.ids().end()}}};
  if (message.has_lattice()) return lattice_range(message.lattice(), path + ".lattice");
  if (message.has_control()) {
    if (message.control().ids().empty()) refuse_field(path + ".control.ids", "must not be empty");
    return {Region::ControlIds{{message.control().ids().begin(), message.control().ids().end()}}};
  }
  if (message.has_patch()) return patch(message.patch(), path + ".patch");
  if (message.open_boundary()) return {Region::OpenBoundary{}};
  if (message.all()) return {Region::All{}};
  if (message.boundary()) return {Region::Boundary{}};
  if (message.union__size() > 0) return {Region::Union{children(message.union_(), path + ".union", depth)}};
  if (message.intersection_size() > 0) {
    return {Region::Intersection{children(message.intersection(), path + ".intersection", depth)}};
  }
  if (message.difference_size() > 0) return {Region::Difference{children(message.difference(), path + ".difference", depth)}};
  if (message.has_complement()) {
    return {Region::Complement{{convert(message.complement(), path + ".complement", depth + 1)}}};
  }
  if (message.has_grow()) {
    if (!message.grow().has_region()) refuse_field(path + ".grow.region", "is missing");
    if (message.grow().rings() < 1 || message.grow().rings() > 1000) {
      refuse_field(path + ".grow.rings", std::to_string(message.grow().rings()) + " is out of range, allowed are 1 to 1000");
    }
    Region::Grow grow;
    grow.of.push_back(convert(message.grow().region(), path + ".grow.region", depth + 1));
    grow.rings = static_cast<int>(message.grow().rings());
    return {grow};
  }
  return solid(message, path);
}

}  // namespace

Region region_from_proto(const v1::Region& message, const std::string& path) { return convert(message, path, 0); }

void canonicalize_region(v1::Region& message) {
  sort_unique(*message.mutable_ids());
  if (message.has_control()) sort_unique(*message.mutable_control()->mutable_ids());
  if (message.has_patch() && message.patch().angle() == 0) message.mutable_patch()->set_angle(Region::Patch{}.angle);
  for (auto& child : *message.mutable_union_()) canonicalize_region(child);
  for (auto& child : *message.mutable_intersection()) canonicalize_region(child);
  for (auto& child : *message.mutable_difference()) canonicalize_region(child);
  if (message.has_complement()) canonicalize_region(*message.mutable_complement());
  if (message.has_grow() && message.grow().has_region()) canonicalize_region(*message.mutable_grow()->mutable_region());
}

}  // namespace deform::convert
