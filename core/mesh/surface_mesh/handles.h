// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstdint>

namespace deform {

/// The number of an entity of a SurfaceMesh, typed by its kind so that a face is never taken for a vertex. 32 bits. A handle
/// stays the same until garbage_collection() or reorder().
template <typename Kind>
class Handle {
 public:
  static constexpr std::uint32_t none = 0xFFFFFFFF;  ///< the number of no entity

  constexpr Handle() = default;
  constexpr explicit Handle(std::uint32_t index) : index_(index) {}
  constexpr std::uint32_t index() const { return index_; }
  constexpr bool valid() const { return index_ != none; }  ///< whether it names an entity at all
  friend constexpr auto operator<=>(const Handle&, const Handle&) = default;

 private:
  std::uint32_t index_ = none;
};

using VertexHandle = Handle<struct VertexKind>;
using HalfedgeHandle = Handle<struct HalfedgeKind>;
using EdgeHandle = Handle<struct EdgeKind>;
using FaceHandle = Handle<struct FaceKind>;

}  // namespace deform
