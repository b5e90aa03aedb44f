// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace deform::client {

/// The value of a name; nothing when there is no such name.
using NamedValue = std::function<std::optional<double>(std::string_view name)>;

/// The value of an expression of finite numbers, names, + - * / ^ with the usual precedence (^ binds from the right and before a
/// sign on its left), parentheses, and sqrt, sin, cos, tan (of radians), abs. `pi` is always known; `named` gives the others.
/// Throws Error(invalid_argument) naming the column, from 1: what was expected there, an unknown name, a value that is not
/// finite, more than 1000 characters, parentheses nested deeper than 50; and what `named` throws.
double evaluate_expression(std::string_view text, const NamedValue& named = {});

}  // namespace deform::client
