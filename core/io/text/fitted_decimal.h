// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace deform::io {

enum class DecimalStyle {
  abaqus,   ///< exponents with e; no point needed
  nastran,  ///< exponents with a sign only (1.5-3); always with a point; .5 instead of 0.5
};

/// The finite number that the whole of `token` is: exponents with e or d in any case, in Nastran's style also with a sign only.
std::optional<double> parse_decimal(std::string_view token, DecimalStyle style);

/// The shortest decimal that parses to the same double, or where that has more than `width` characters, one of those that fit
/// that is nearest to the value. Nothing when all that fit overflow (values near the largest double). width >= 8.
std::optional<std::string> fitted_decimal(double value, std::size_t width, DecimalStyle style);

}  // namespace deform::io
