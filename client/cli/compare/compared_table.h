// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "client/cli/compare/compared.h"
#include "core/report/comparison_page.h"

namespace deform::cli {

/// A row per method: where its options are from, what it costs.
ComparisonPage::Table methods_table(const MethodComparison& comparison);
/// A row per method that is not refused, below one of the mesh at rest: what it made of a design. The best values of a column are
/// marked, and what is wrong.
ComparisonPage::Table design_table(const MethodComparison& comparison, std::size_t design);

/// What the server says of a design by each method, with the name of the method: reasons of its verdict, or else
/// warnings.
std::vector<std::string> design_remarks(const MethodComparison& comparison, std::size_t design);

}  // namespace deform::cli
