// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <vector>

#include "core/deformers/system.h"
#include "deform/v1/deformation.pb.h"

namespace deform::convert {

/// Makes the checks of designs that need no system: their number, that no message continues another one, and that all numbers are
/// finite. Throws Error(invalid_argument) with the path of the field ("designs[3].motions[0].affine: ...").
void check_designs(const v1::DeformRequest& request, std::size_t max_designs);
/// The checks of the request as a whole, and those of one design.
void check_design_count(const v1::DeformRequest& request, std::size_t max_designs);
void check_design(const v1::DeformRequest& request, std::size_t design);

/// The designs of a checked request for a setup whose handles have info.handles(i).points() points. Throws as above: unknown
/// handle (with the nearest names), wrong number of values, displacements that do not cover the handle exactly once.
std::vector<Design> designs_from_proto(const v1::DeformRequest& request, const v1::SystemInfo& info);
/// One design of the request.
Design design_from_proto(const v1::DeformRequest& request, std::size_t design, const v1::SystemInfo& info);

/// Whether a design of the request may take the direct path although the system has a handle basis.
bool needs_solution(const v1::DeformRequest& request);

/// An upper bound of the memory of the designs and of binding them, in bytes, for admission control.
std::size_t bind_bytes(const v1::DeformRequest& request, const v1::SystemInfo& info);

}  // namespace deform::convert
