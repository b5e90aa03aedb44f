// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace deform {

/// The values of one property for all entities of a kind, independent of the type of the values. Keeps the arrays of a
/// mesh synchronized.
class PropertyArrayBase {
 public:
  explicit PropertyArrayBase(std::string name) : name_(std::move(name)) {}
  virtual ~PropertyArrayBase() = default;
  const std::string& name() const { return name_; }

  virtual void resize(std::size_t count) = 0;  ///< new entries have the default value
  /// Entry i becomes entry order[i]; the size becomes that of `order`.
  virtual void gather(std::span<const std::uint32_t> order) = 0;
  virtual std::unique_ptr<PropertyArrayBase> clone() const = 0;
  virtual std::size_t bytes() const = 0;

 private:
  std::string name_;
};

/// The values of one property. T must not be bool, because elements of std::vector<bool> have no addresses; use char.
template <typename T>
class PropertyArray final : public PropertyArrayBase {
  static_assert(!std::is_same_v<T, bool>, "std::vector<bool> has no addresses: use char");

 public:
  PropertyArray(std::string name, T initial) : PropertyArrayBase(std::move(name)), initial_(std::move(initial)) {}

  void resize(std::size_t count) override { values.resize(count, initial_); }
  void gather(std::span<const std::uint32_t> order) override {
    std::vector<T> gathered;
    gathered.reserve(order.size());
    for (const std::uint32_t i : order) gathered.push_back(std::move(values[i]));
    values = std::move(gathered);
  }
  std::unique_ptr<PropertyArrayBase> clone() const override { return std::make_unique<PropertyArray>(*this); }
  std::size_t bytes() const override { return values.capacity() * sizeof(T); }

  std::vector<T> values;  ///< at least one per entity

 private:
  T initial_;
};

/// Access to a property by the handles of its kind. Valid as long as the mesh holds the property; a copy of the mesh has arrays
/// of its own, found by name. Any thread may read while none writes.
template <typename HandleType, typename T>
class Property {
 public:
  Property() = default;
  explicit Property(PropertyArray<T>* array) : array_(array) {}

  T& operator[](HandleType handle) const { return array_->values[handle.index()]; }
  T* data() const { return array_->values.data(); }  ///< invalidated when entities are added
  bool valid() const { return array_ != nullptr; }   ///< false: the mesh has no such property
  const std::string& name() const { return array_->name(); }

 private:
  PropertyArray<T>* array_ = nullptr;
};

/// All properties of one kind of entity. Copies are deep.
class PropertySet {
 public:
  PropertySet() = default;
  PropertySet(const PropertySet& other);
  PropertySet& operator=(const PropertySet& other);
  PropertySet(PropertySet&&) = default;
  PropertySet& operator=(PropertySet&&) = default;

  /// Throws Error(already_exists) when the name is taken.
  template <typename T>
  PropertyArray<T>* add(const std::string& name, T initial) {
    require_free(name);
    auto array = std::make_unique<PropertyArray<T>>(name, std::move(initial));
    array->resize(size_);
    PropertyArray<T>* const added = array.get();
    arrays_.push_back(std::move(array));
    return added;
  }
  /// Returns nullptr if there is no such property; throws Error(invalid_argument) if it has another type.
  template <typename T>
  PropertyArray<T>* find(const std::string& name) const {
    PropertyArrayBase* const found = find_any(name);
    if (found == nullptr) return nullptr;
    auto* const typed = dynamic_cast<PropertyArray<T>*>(found);
    if (typed == nullptr) refuse_type(name);
    return typed;
  }
  /// Returns false if there is no such property.
  bool remove(const std::string& name);

  /// Makes room for `count` entities. Arrays are kept larger than needed, so that adding an entity usually costs one comparison.
  void grow(std::size_t count) {
    if (count > size_) enlarge(count);
  }
  void resize(std::size_t count);
  void gather(std::span<const std::uint32_t> order);
  std::size_t bytes() const;

 private:
  PropertyArrayBase* find_any(const std::string& name) const;
  void require_free(const std::string& name) const;
  [[noreturn]] static void refuse_type(const std::string& name);
  void enlarge(std::size_t count);

  std::vector<std::unique_ptr<PropertyArrayBase>> arrays_;
  std::size_t size_ = 0;  // size of every array
};

}  // namespace deform
