// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/base/types.h"

namespace deform {

/// Who has which point of a mesh: handles and what is fixed, by numbers of the caller's. A point has one owner at most.
class PointOwners {
 public:
  static constexpr std::uint32_t nobody = 0xffffffff;

  explicit PointOwners(std::size_t points) : owners_(points, nobody) {}

  /// Points that were to get a second owner.
  struct Overlap {
    std::size_t points = 0;
    PointId first = 0;
    std::uint32_t other = nobody;  ///< who has the first

    /// "overlaps OTHER: 2 common points, the first is point 7; ...". noun: what the ids number.
    std::string text(const std::string& other_name, const std::string& noun = "point") const;
  };

  /// Gives points, whose ids are in range, to `owner` (not nobody); those that another has stay with that one.
  Overlap claim(std::span<const PointId> ids, std::uint32_t owner);

  const std::vector<std::uint32_t>& owners() const { return owners_; }

 private:
  std::vector<std::uint32_t> owners_;
};

}  // namespace deform
