// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/compare/compared_table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>

#include "client/cli/output/cell_options.h"
#include "client/cli/output/format.h"
#include "client/cli/output/gates.h"

namespace deform::cli {

namespace {

using Cell = ComparisonPage::Cell;
using Mark = ComparisonPage::Mark;

constexpr double nothing = std::numeric_limits<double>::quiet_NaN();

std::string short_number(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.4g", value);
  return text;
}

/// A number of a design, and what is a good one.
struct Column {
  std::string title;
  Better better = Better::lower;
  std::function<double(const ComparedDesign&)> of;
  double at_rest = nothing;
  bool wrong_above_zero = false;
};

bool any_design(const MethodComparison& comparison, std::size_t design, const std::function<bool(const ComparedDesign&)>& holds) {
  return std::any_of(comparison.methods.begin(), comparison.methods.end(), [&](const ComparedMethod& method) {
    return method.refusals.empty() && method.designs.at(design).error.empty() && holds(method.designs[design]);
  });
}

std::vector<Column> columns_of(const MethodComparison& comparison, std::size_t design) {
  const auto any = [&](const std::function<bool(const ComparedDesign&)>& holds) { return any_design(comparison, design, holds); };
  std::vector<Column> columns;
  if (any([](const auto& d) { return d.misfit.has_value(); })) {
    columns.push_back({"misfit at handles", Better::lower, [](const auto& d) { return d.misfit ? d.misfit->largest : nothing; }});
  }
  columns.push_back({"largest displacement", Better::neither, [](const auto& d) { return d.result.max_displacement(); }});
  if (any([](const auto& d) { return d.result.has_faces(); })) {
    const auto flipped = [](const ComparedDesign& d) { return static_cast<double>(d.result.faces().flipped()); };
    columns.push_back({"flipped faces", Better::lower, flipped, 0, true});
  }
  if (any([](const auto& d) { return d.result.has_cells(); })) {
    const auto inverted = [](const ComparedDesign& d) { return static_cast<double>(d.result.cells().inverted()); };
    columns.push_back({"inverted cells", Better::lower, inverted, nothing, true});
    columns.push_back({"safe amplitude", Better::higher, [](const auto& d) { return d.result.cells().safe_amplitude(); }});
  }
  for (std::size_t m = 0; m < comparison.measures.size(); ++m) {
    const ShownMeasure& shown = comparison.measures[m];
    columns.push_back({shown.label, shown.better, [m](const auto& d) { return d.measures[m]; }, shown.at_rest});
  }
  if (any([](const auto& d) { return d.smoothness.has_value(); })) {
    columns.push_back(
        {"roughness", Better::lower, [](const auto& d) { return d.smoothness ? d.smoothness->high_pass_energy : nothing; }, 0});
    columns.push_back({"kink at borders (degrees)", Better::lower,
                       [](const auto& d) { return d.smoothness ? d.smoothness->border_kink : nothing; }, 0});
  }
  if (any([](const auto& d) { return d.result.has_constraints(); })) {
    const auto residual = [](const ComparedDesign& d) {
      double largest = 0;
      for (const auto& constraint : d.result.constraints().residuals()) largest = std::max(largest, constraint.largest());
      return largest;
    };
    columns.push_back({"constraints missed by", Better::lower, residual});
  }
  return columns;
}

bool is_bad(const ComparedDesign& design) { return design.result.verdict() == v1::VERDICT_BAD; }

/// The best and the worst of a column among the designs that may be used, those whose verdict is not bad; both are not numbers
/// where there is nothing to compare.
std::pair<double, double> range_of(const MethodComparison& comparison, std::size_t design, const Column& column) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const ComparedMethod& method : comparison.methods) {
    if (!method.refusals.empty() || !method.designs[design].error.empty() || is_bad(method.designs[design])) continue;
    const double value = column.of(method.designs[design]);
    if (std::isnan(value)) continue;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  return column.better == Better::higher ? std::pair(high, low) : std::pair(low, high);
}

Mark mark_of(double value, const Column& column, const std::pair<double, double>& range) {
  if (column.wrong_above_zero && value > 0) return Mark::bad;
  constexpr double alike = 1e-3;
  const double spread = std::abs(range.first - range.second);
  if (column.better == Better::neither || !(spread > alike * std::max(std::abs(range.first), std::abs(range.second)))) {
    return Mark::none;
  }
  return std::abs(value - range.first) <= alike * spread ? Mark::good : Mark::none;
}

Cell number_cell(double value, Mark mark = Mark::none) { return {std::isnan(value) ? "-" : short_number(value), mark}; }

Mark mark_of(v1::Verdict verdict) {
  return verdict == v1::VERDICT_GOOD ? Mark::good : verdict == v1::VERDICT_BAD ? Mark::bad : Mark::none;
}

std::string worst_verdict(const ComparedMethod& method, Mark& mark) {
  v1::Verdict worst = v1::VERDICT_UNKNOWN;
  for (const ComparedDesign& design : method.designs) {
    if (!design.error.empty()) {
      mark = Mark::bad;
      return "failed";
    }
    worst = std::max(worst, design.result.verdict());
  }
  mark = mark_of(worst);
  return verdict_name(worst);
}

}  // namespace

ComparisonPage::Table methods_table(const MethodComparison& comparison) {
  ComparisonPage::Table table;
  table.columns = {"options", "unknowns", "prepared in", "a design in", "memory", "while preparing", "worst verdict"};
  for (const ComparedMethod& method : comparison.methods) {
    ComparisonPage::Row row{
        method.choice.label + (method.choice.label == method.choice.kind ? "" : " (" + method.choice.kind + ")"),
        {},
        method.refusals};
    if (method.refusals.empty()) {
      const auto unknowns = std::max(method.system.functions(), method.system.centres());
      Mark mark = Mark::none;
      const std::string verdict = worst_verdict(method, mark);
      row.cells = {{method.choice.source},
                   {std::to_string(unknowns)},
                   {duration_text(method.system.seconds())},
                   {duration_text(method.seconds_per_design)},
                   {bytes_text(method.system.bytes())},
                   {"at most " + bytes_text(method.peak_bytes)},
                   {verdict, mark}};
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

ComparisonPage::Table design_table(const MethodComparison& comparison, std::size_t design) {
  const std::vector<Column> columns = columns_of(comparison, design);
  ComparisonPage::Table table{{"verdict"}, {}};
  ComparisonPage::Row rest{"at rest", {{"-"}}};
  for (const Column& column : columns) {
    table.columns.push_back(column.title);
    rest.cells.push_back(number_cell(column.at_rest));
  }
  table.rows.push_back(std::move(rest));
  for (const ComparedMethod& method : comparison.methods) {
    if (!method.refusals.empty()) continue;
    const ComparedDesign& made = method.designs[design];
    ComparisonPage::Row row{method.choice.label, {}};
    if (!made.error.empty()) {
      row.refusals.push_back(made.error);
    } else {
      row.cells.push_back({verdict_name(made.result.verdict()), mark_of(made.result.verdict())});
      for (const Column& column : columns) {
        const double value = column.of(made);
        const Mark mark = mark_of(value, column, range_of(comparison, design, column));
        row.cells.push_back(number_cell(value, mark == Mark::good && is_bad(made) ? Mark::none : mark));
      }
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::vector<std::string> design_remarks(const MethodComparison& comparison, std::size_t design) {
  std::vector<std::string> remarks;
  for (const ComparedMethod& method : comparison.methods) {
    if (!method.refusals.empty()) continue;
    const auto& result = method.designs[design].result;
    // Warnings say once more what reasons say.
    for (const auto& remark : result.reasons().empty() ? result.warnings() : result.reasons()) {
      remarks.push_back(method.choice.label + ": " + remark);
    }
  }
  return remarks;
}

}  // namespace deform::cli
