// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/gates.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>

#include "client/cli/output/format.h"
#include "client/cli/setup/reading.h"
#include "core/base/error.h"

namespace deform::cli {

namespace {

using Measured = std::optional<double>;

constexpr char missed_alone[] = "missed";
constexpr char newly_intersecting[] = "newly_intersecting_faces";

Measured missed(const v1::DesignResult& result) {
  const auto& constraints = result.constraints();
  const auto count = std::count_if(constraints.residuals().begin(), constraints.residuals().end(),
                                   [](const v1::ConstraintResidual& residual) { return residual.missed(); });
  return std::max(static_cast<double>(count), constraints.exact_given_up() ? 1.0 : 0.0);
}

/// A split ends where nothing is inverted, be it short of the whole motion; its cells are reported for one full step.
Measured inverted_cells(const v1::DesignResult& result) {
  if (result.has_split()) return 0;
  return result.has_cells() ? Measured(static_cast<double>(result.cells().inverted())) : std::nullopt;
}

Measured safe_amplitude(const v1::DesignResult& result) {
  if (result.has_split()) return result.split().inversion_free() ? 1 : result.split().reached();
  return result.has_cells() ? Measured(result.cells().safe_amplitude()) : std::nullopt;
}

Measured least_determinant(const v1::DesignResult& result) {
  if (result.has_split()) return result.split().least_determinant();
  return result.has_cells() ? Measured(result.cells().least_determinant()) : std::nullopt;
}

Measured displacement_ratio(const v1::DesignResult& result) {
  if (result.prescribed_displacement() > 0) return result.max_displacement() / result.prescribed_displacement();
  return result.max_displacement() > 0 ? std::nullopt : Measured(1);
}

struct Measure {
  const char* name;
  Measured (*of)(const v1::DesignResult& result);
};

constexpr Measure measures[] = {
    {"flipped_faces",
     [](const v1::DesignResult& result) {
       return result.has_faces() ? Measured(static_cast<double>(result.faces().flipped())) : std::nullopt;
     }},
    {newly_intersecting,
     [](const v1::DesignResult& result) {
       return result.faces().has_intersecting() ? Measured(static_cast<double>(result.faces().intersecting())) : std::nullopt;
     }},
    {"inverted_cells", inverted_cells},
    {"inverted_at_rest",
     [](const v1::DesignResult& result) {
       return result.has_cells() ? Measured(static_cast<double>(result.cells().inverted_at_rest())) : std::nullopt;
     }},
    {"safe_amplitude", safe_amplitude},
    {"least_determinant", least_determinant},
    {"max_displacement", [](const v1::DesignResult& result) { return Measured(result.max_displacement()); }},
    {"prescribed_displacement", [](const v1::DesignResult& result) { return Measured(result.prescribed_displacement()); }},
    {"displacement_ratio", displacement_ratio},
    {"interpolation_residual", [](const v1::DesignResult& result) { return Measured(result.interpolation_residual()); }},
    {"estimated_error", [](const v1::DesignResult& result) { return Measured(result.estimated_error()); }},
    {"relative_error", [](const v1::DesignResult& result) { return Measured(result.relative_error()); }},
    {"max_error", [](const v1::DesignResult& result) { return Measured(result.max_error()); }},
    {"missed", missed},
};

std::string all_names() {
  std::string all;
  for (const Measure& measure : measures) all += std::string(all.empty() ? "" : ", ") + measure.name;
  return all;
}

const Measure& find_measure(const std::string& name, const std::string& where) {
  for (const Measure& measure : measures) {
    if (name == measure.name) return measure;
  }
  std::vector<std::string> names;
  for (const Measure& measure : measures) names.emplace_back(measure.name);
  const std::string near = nearest_names(name, names);
  refuse(where + "there is no measure \"" + name + "\" of designs; " + (near.empty() ? "" : "did you mean " + near + "? ") +
         "there are " + all_names());
}

}  // namespace

Gate parse_gate(const std::string& text) {
  if (text == missed_alone) return {text, text, Gate::Fails::above, 0};
  const std::size_t sign = text.find_first_of("<>");
  if (sign == std::string::npos || sign == 0) refuse("--fail-on " + text + ": expected NAME>NUMBER or NAME<NUMBER");
  const auto limit = parse_number(text.substr(sign + 1));
  if (!limit) refuse("--fail-on " + text + ": \"" + text.substr(sign + 1) + "\" is not a number");
  return {text, text.substr(0, sign), text[sign] == '>' ? Gate::Fails::above : Gate::Fails::below, *limit};
}

std::string to_text(const FailedGate& failed) {
  return failed.text + (failed.value ? ": it is " + number_text(*failed.value)
                                     : ": it was not measured, there is nothing of that kind or --check is off");
}

void add_gate_option(CLI::App& command, std::vector<Gate>& gates, const std::string& help,
                     const std::function<void(const Gate&)>& check) {
  const auto take = [&gates, check](const std::vector<std::string>& texts) {
    for (const auto& text : texts) {
      try {
        gates.push_back(parse_gate(text));
        if (check) check(gates.back());
      } catch (const Error& error) {
        throw CLI::ValidationError(error.what());
      }
    }
  };
  command.add_option_function<std::vector<std::string>>("--fail-on", take, help)->type_name("CONDITION")->allow_extra_args(false);
}

void DesignGates::add_to(CLI::App& command) {
  add_gate_option(
      command, gates_,
      "Exit code 4 when NAME>NUMBER or NAME<NUMBER holds for a design, or missed alone; may be repeated. Names: " + all_names(),
      [](const Gate& gate) { find_measure(gate.name, "--fail-on " + gate.text + ": "); });
}

bool DesignGates::need_intersections() const {
  return std::any_of(gates_.begin(), gates_.end(), [](const Gate& gate) { return gate.name == newly_intersecting; });
}

std::vector<FailedGate> DesignGates::failed(const v1::DesignResult& result) const {
  std::vector<FailedGate> failures;
  for (const Gate& gate : gates_) {
    const auto value = design_measure(gate.name, result);
    if (!value || gate.holds_for(*value)) failures.push_back({gate.text, value});
  }
  return failures;
}

std::vector<std::string> design_measures() {
  std::vector<std::string> names;
  for (const Measure& measure : measures) names.emplace_back(measure.name);
  return names;
}

std::optional<double> design_measure(const std::string& name, const v1::DesignResult& result) {
  return find_measure(name, "").of(result);
}

namespace {

/// How many reasons are for the verdict: all of a server that does not say.
int reasons_of_verdict(const v1::DesignResult& result) {
  const auto told = result.reasons_of_verdict();
  return told > 0 ? static_cast<int>(std::min<std::uint32_t>(told, static_cast<std::uint32_t>(result.reasons_size())))
                  : result.reasons_size();
}

}  // namespace

std::vector<std::string> bad_reasons(const v1::DesignResult& result) {
  if (result.verdict() != v1::VERDICT_BAD) return {};
  return {result.reasons().begin(), result.reasons().begin() + reasons_of_verdict(result)};
}

std::vector<std::string> doubts(const v1::DesignResult& result) {
  if (result.verdict() == v1::VERDICT_DOUBTFUL) return {result.reasons().begin(), result.reasons().end()};
  return {result.reasons().begin() + reasons_of_verdict(result), result.reasons().end()};
}

std::string verdict_name(v1::Verdict verdict) {
  return verdict == v1::VERDICT_GOOD       ? "good"
         : verdict == v1::VERDICT_DOUBTFUL ? "doubtful"
         : verdict == v1::VERDICT_BAD      ? "bad"
                                           : "unknown";
}

}  // namespace deform::cli
