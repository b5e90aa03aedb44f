// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <ostream>

#include "client/cli/compare/compared.h"

namespace deform::cli {

/// Keys "setup", "points", "at_rest", "designs", "methods".
nlohmann::ordered_json comparison_json(const MethodComparison& comparison);

/// A table of the methods, and one of each design.
void print_comparison(const MethodComparison& comparison, std::ostream& out);

/// A page with pictures of the designs that have points.
void write_comparison_page(const MethodComparison& comparison, const std::filesystem::path& path);

}  // namespace deform::cli
