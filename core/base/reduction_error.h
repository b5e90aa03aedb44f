// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace deform {

/// A fraction of the largest prescribed displacement: designs of radial basis functions that may differ by more from those with
/// all handle and fixed points as centres are doubtful.
inline constexpr double doubtful_reduction = 0.01;

/// The reason why designs are doubtful whose points may be so far, as a fraction of the largest prescribed displacement, from
/// where they would be with all centres; empty where they are not.
std::string reduction_doubt(double error);

}  // namespace deform
