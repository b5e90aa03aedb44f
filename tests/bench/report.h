// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdio>
#include <string>

namespace deform::bench {

/// Rows "figure | must reach | measured | PASS or MISS" on standard output, as a Markdown table.
class Report {
 public:
  /// Without a title: open() begins the table.
  Report() = default;
  explicit Report(const std::string& title) {
    std::printf("\n## %s\n", title.c_str());
    open();
  }

  /// Begins a table, after other output.
  void open() { std::printf("\n| figure | must reach | measured | |\n|---|---|---|---|\n"); }

  void at_most(const std::string& figure, double measured, double limit, const std::string& unit) {
    row(figure, "<= " + text(limit) + unit, text(measured) + unit, measured <= limit);
  }
  void at_least(const std::string& figure, double measured, double limit, const std::string& unit) {
    row(figure, ">= " + text(limit) + unit, text(measured) + unit, measured >= limit);
  }
  /// A figure without a limit.
  void info(const std::string& figure, const std::string& measured) {
    std::printf("| %s | | %s | |\n", figure.c_str(), measured.c_str());
    std::fflush(stdout);
  }
  int missed() const { return missed_; }

  static std::string text(double value) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.3g", value);
    return buffer;
  }

 private:
  // A measured NaN is a miss.
  void row(const std::string& figure, const std::string& limit, const std::string& measured, bool reached) {
    std::printf("| %s | %s | %s | %s |\n", figure.c_str(), limit.c_str(), measured.c_str(), reached ? "PASS" : "MISS");
    std::fflush(stdout);
    missed_ += reached ? 0 : 1;
  }

  int missed_ = 0;
};

}  // namespace deform::bench
