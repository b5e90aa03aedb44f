// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "client/cli/compare/compared.h"
#include "core/report/comparison_page.h"

namespace deform::cli {

/// One row per method: the source of its options, and its costs.
ComparisonPage::Table methods_table(const MethodComparison& comparison);
/// One row per method that was not rejected, below a row for the mesh at rest: its result for a design. The best values of each
/// column are marked, as are defects.
ComparisonPage::Table design_table(const MethodComparison& comparison, std::size_t design);

/// What the server says of a design by each method, with the name of the method: reasons of its verdict, or else
/// warnings.
std::vector<std::string> design_remarks(const MethodComparison& comparison, std::size_t design);

}  // namespace deform::cli
