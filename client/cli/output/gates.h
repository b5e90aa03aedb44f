// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <CLI/App.hpp>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "deform/v1/deformation.pb.h"

namespace deform::cli {

/// A condition that must not hold: NAME>NUMBER or NAME<NUMBER; missed alone stands for missed>0.
struct Gate {
  enum class Fails { above, below };

  std::string text;  ///< as it was given
  std::string name;
  Fails fails = Fails::above;
  double limit = 0;

  /// What is not a number fails on either side.
  bool holds_for(double value) const { return !(fails == Fails::above ? value <= limit : value >= limit); }
};

/// Throws Error(invalid_argument) when it has not that form.
Gate parse_gate(const std::string& text);

/// Adds --fail-on. Wrong syntax, and what `check` throws as Error, are errors of usage, found while the command line is read.
/// `gates` outlives the command.
void add_gate_option(CLI::App& command, std::vector<Gate>& gates, const std::string& help,
                     const std::function<void(const Gate&)>& check = {});

/// A gate whose condition holds.
struct FailedGate {
  std::string text;
  std::optional<double> value;  ///< nothing: it was not measured, because there is nothing of that kind or it was not asked for
};

/// "flipped_faces>0: it is 12"
std::string to_text(const FailedGate& failed);

/// --fail-on of commands that deform. Gates are about the result of one design; see design_measures(). Thread-safe but add_to().
class DesignGates {
 public:
  /// Unknown names are errors of usage, too. The object outlives the command.
  void add_to(CLI::App& command);

  bool empty() const { return gates_.empty(); }
  const std::vector<Gate>& gates() const { return gates_; }
  /// Whether one of them is about faces that run into each other, which are not looked for otherwise.
  bool need_intersections() const;
  /// In the order of the command line.
  std::vector<FailedGate> failed(const v1::DesignResult& result) const;

 private:
  std::vector<Gate> gates_;
};

/// Names that gates of designs may use.
std::vector<std::string> design_measures();

/// A measure of a design: nothing where it was not measured. Throws Error(invalid_argument) for names that are none.
std::optional<double> design_measure(const std::string& name, const v1::DesignResult& result);

/// Why the server calls a design bad; empty when it does not. Bad designs are not written unless asked for.
std::vector<std::string> bad_reasons(const v1::DesignResult& result);

/// Why a design is doubtful, or would be if it were not bad: those reasons that did not make it bad.
std::vector<std::string> doubts(const v1::DesignResult& result);

/// "good", "doubtful", "bad"; "unknown" from a server that does not say.
std::string verdict_name(v1::Verdict verdict);

}  // namespace deform::cli
