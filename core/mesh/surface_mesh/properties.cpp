// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/surface_mesh/properties.h"

#include <algorithm>

#include "core/base/error.h"

namespace deform {

PropertySet::PropertySet(const PropertySet& other) : size_(other.size_) {
  arrays_.reserve(other.arrays_.size());
  for (const auto& array : other.arrays_) arrays_.push_back(array->clone());
}

PropertySet& PropertySet::operator=(const PropertySet& other) {
  if (this != &other) *this = PropertySet(other);
  return *this;
}

bool PropertySet::remove(const std::string& name) {
  return std::erase_if(arrays_, [&](const auto& array) { return array->name() == name; }) > 0;
}

void PropertySet::resize(std::size_t count) {
  for (const auto& array : arrays_) array->resize(count);
  size_ = count;
}

void PropertySet::gather(std::span<const std::uint32_t> order) {
  for (const auto& array : arrays_) array->gather(order);
  size_ = order.size();
}

std::size_t PropertySet::bytes() const {
  std::size_t sum = 0;
  for (const auto& array : arrays_) sum += array->bytes();
  return sum;
}

PropertyArrayBase* PropertySet::find_any(const std::string& name) const {
  const auto found = std::find_if(arrays_.begin(), arrays_.end(), [&](const auto& array) { return array->name() == name; });
  return found == arrays_.end() ? nullptr : found->get();
}

void PropertySet::require_free(const std::string& name) const {
  if (find_any(name) != nullptr) throw Error(ErrorCode::already_exists, "property \"" + name + "\" is already there");
}

void PropertySet::refuse_type(const std::string& name) {
  throw Error(ErrorCode::invalid_argument, "property \"" + name + "\" is of another type");
}

void PropertySet::enlarge(std::size_t count) { resize(std::max(count, size_ + size_ / 2)); }

}  // namespace deform
