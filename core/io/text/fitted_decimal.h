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

/// Parses the whole token as a finite number. Exponents may have e or d in any case, in the style of Nastran also a sign only.
std::optional<double> parse_decimal(std::string_view token, DecimalStyle style);

/// The shortest decimal that parses to the same double or, if that has more than `width` >= 8 characters, a nearest one that
/// fits. std::nullopt if all that fit overflow (values near the largest double).
std::optional<std::string> fitted_decimal(double value, std::size_t width, DecimalStyle style);

}  // namespace deform::io
