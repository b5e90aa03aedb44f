// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/base/plane_sides.h"
#include "core/codec/block.h"
#include "core/deformers/system.h"
#include "core/quality/extreme.h"
#include "deform/v1/deformation.pb.h"

namespace deform::server {

struct ResidentSystem;

/// What is gathered about one design while its blocks are made.
struct DeliveredDesign {
  std::vector<std::uint64_t> checksums;  ///< of its blocks, in order
  Extreme displacement;                  ///< largest so far, model units, and the point that has it
  PlaneSides::Crossings crossings;       ///< so far
  double max_error = 0;                  ///< of the encoding, per coordinate
  std::uint32_t fell_back = 0;           ///< blocks

  void add(const codec::Block& block, const Extreme& largest_displacement, const PlaneSides::Crossings& crossed);
};

/// The reply about a design all of whose blocks have been made, but for its number and what checks found. `info`: of
/// its system, with the setup.
v1::DesignResult design_result(const DeliveredDesign& delivered, const DesignReport& report, const Setup& setup,
                               const v1::SystemInfo& info);

/// Why a design is doubtful whatever its error and its points, one sentence each: handles that it mirrors or flattens, a model
/// whose box is mostly empty, and reduced centres. See handle_shape_doubts(), ModelSize::stray and reduction_doubt(). Throws the
/// errors of handle_motions(). Any thread.
std::vector<std::string> design_doubts(const ResidentSystem& system, const Design& design);

}  // namespace deform::server
