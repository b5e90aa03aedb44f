// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstdint>

namespace deform {

/// The 32-bit index of an entity of a SurfaceMesh, typed so that a face cannot be passed for a vertex. Handles stay valid until
/// garbage_collection() or reorder().
template <typename Kind>
class Handle {
 public:
  static constexpr std::uint32_t none = 0xFFFFFFFF;  ///< index of an invalid handle

  constexpr Handle() = default;
  constexpr explicit Handle(std::uint32_t index) : index_(index) {}
  constexpr std::uint32_t index() const { return index_; }
  constexpr bool valid() const { return index_ != none; }  ///< whether it refers to an entity
  friend constexpr auto operator<=>(const Handle&, const Handle&) = default;

 private:
  std::uint32_t index_ = none;
};

using VertexHandle = Handle<struct VertexKind>;
using HalfedgeHandle = Handle<struct HalfedgeKind>;
using EdgeHandle = Handle<struct EdgeKind>;
using FaceHandle = Handle<struct FaceKind>;

}  // namespace deform
