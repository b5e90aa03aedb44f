// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <vector>

#include "core/deformers/handles/handle_evaluation.h"
#include "core/deformers/handles/sector_points.h"
#include "core/deformers/space_map.h"

namespace deform {

/// A design of a HandleSystem as a map of space.
class HandleMap : public SpaceMap {
 public:
  /// The first design of `evaluation`, which is on the direct path.
  explicit HandleMap(std::unique_ptr<const HandleEvaluation> evaluation);

  const DesignReport& report() const override { return evaluation_->report(0); }
  Found evaluate(std::span<const Vec3> points, std::uint64_t first, std::span<Vec3> out,
                 const RunContext& context) const override;

  /// The memory that it takes besides the evaluation, for so many points whose places are given.
  static std::size_t bytes_for(std::size_t given) { return given * sizeof(Given); }

 private:
  /// A point that the solution does not determine.
  struct Given {
    Vec3 from{}, to{};
  };

  const std::unique_ptr<const HandleEvaluation> evaluation_;
  const PartnerPlaces partners_;  ///< of a sector
  std::vector<Given> given_;      ///< ascending by `from`
};

}  // namespace deform
