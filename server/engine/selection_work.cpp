// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/selection_work.h"

#include <google/protobuf/message.h>

#include <string>
#include <vector>

#include "core/base/error.h"

namespace deform::server {

namespace {

/// The work of one region, measured: a box takes 1 to 3 ns, a sphere 3 to 7, a patch and the boundary of elements about 30 times
/// that.
constexpr double seconds_per_point = 4e-9;

std::uint64_t count(const v1::Region& region) {
  std::uint64_t sum = 1;
  if (region.open_boundary() || region.boundary() || region.has_patch() || region.has_grow()) sum = SelectionWork::surface_weight;
  for (const auto& part : region.union_()) sum += count(part);
  for (const auto& part : region.intersection()) sum += count(part);
  for (const auto& part : region.difference()) sum += count(part);
  if (region.has_complement()) sum += count(region.complement());
  if (region.has_grow() && region.grow().has_region()) sum += count(region.grow().region());
  return sum;
}

/// The work of all regions in a message, whatever holds them.
std::uint64_t count_in(const google::protobuf::Message& message) {
  if (message.GetDescriptor() == v1::Region::descriptor()) return count(static_cast<const v1::Region&>(message));
  std::uint64_t sum = 0;
  const auto& reflection = *message.GetReflection();
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  for (const auto* field : fields) {
    if (field->cpp_type() != google::protobuf::FieldDescriptor::CPPTYPE_MESSAGE) continue;
    if (!field->is_repeated()) {
      sum += count_in(reflection.GetMessage(message, field));
      continue;
    }
    for (int i = 0; i < reflection.FieldSize(message, field); ++i) {
      sum += count_in(reflection.GetRepeatedMessage(message, field, i));
    }
  }
  return sum;
}

}  // namespace

SelectionWork selection_work(const v1::Setup& setup, std::uint64_t points) { return {count_in(setup), points}; }

double SelectionWork::seconds() const { return seconds_per_point * product(); }

void SelectionWork::check(std::size_t limit) const {
  if (product() <= static_cast<double>(limit)) return;
  throw Error(ErrorCode::invalid_argument,
              "setup: its " + std::to_string(regions) + " regions (one that needs the surface or neighbours counts as " +
                  std::to_string(surface_weight) + ") times the " + std::to_string(points) + " points of the geometry are " +
                  std::to_string(regions * points) + ", more than the limit of " + std::to_string(limit) +
                  " (--max-setup-work of the server); use fewer regions, or groups or ids of points in place of many small ones");
}

}  // namespace deform::server
