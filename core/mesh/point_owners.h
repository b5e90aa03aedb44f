// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Assigns the points of a mesh to handles and fixed regions, which the caller numbers. A point has at most one owner.
class PointOwners {
 public:
  static constexpr std::uint32_t nobody = 0xffffffff;

  explicit PointOwners(std::size_t points) : owners_(points, nobody) {}

  /// Points claimed for a second owner.
  struct Overlap {
    std::size_t points = 0;  ///< that `other` owns
    PointId first = 0;
    std::uint32_t other = nobody;  ///< owner of the first

    /// "overlaps OTHER: 2 common points, the first is point 7; ...". noun: what the ids number.
    std::string text(const std::string& other_name, const std::string& noun = "point") const;
  };

  /// Assigns points to `owner`, which must not be nobody. Ids must be in range. Points that have an owner keep it; the
  /// overlap that is returned is that with the owner of the first of them.
  Overlap claim(std::span<const PointId> ids, std::uint32_t owner);

  const std::vector<std::uint32_t>& owners() const { return owners_; }

 private:
  std::vector<std::uint32_t> owners_;
};

}  // namespace deform
