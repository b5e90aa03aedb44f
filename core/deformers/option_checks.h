// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>

namespace deform {

class Problems;

/// Throws Error(invalid_argument) with this message.
[[noreturn]] void refuse_argument(const std::string& message);

/// Throws Error(invalid_argument) naming the field and the limits unless least <= value <= most; NaN is rejected.
void check_option_range(double value, double least, double most, const std::string& field);

/// The same as a check of `problems` under the name of the field.
void check_option_range(Problems& problems, double value, double least, double most, const std::string& field);

/// The largest ratio of the diagonals of a mesh and what is around it, in either direction, that does not make one ask for units.
inline constexpr double most_size_ratio = 20;

/// A question about units if the diagonal of `what` ("cage") has another order of magnitude than that of the mesh, `of_mesh`.
std::optional<std::string> units_note(const std::string& what, double diagonal, double of_mesh);

}  // namespace deform
