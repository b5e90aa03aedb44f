// SPDX-License-Identifier: Apache-2.0
#include "client/setup/expression.h"

#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

#include "client/setup/refuse.h"

namespace deform::client {

namespace {

struct Function {
  std::string_view name;
  double (*of)(double);
};
constexpr std::array<Function, 5> functions{{{"sqrt", [](double x) { return std::sqrt(x); }},
                                             {"sin", [](double x) { return std::sin(x); }},
                                             {"cos", [](double x) { return std::cos(x); }},
                                             {"tan", [](double x) { return std::tan(x); }},
                                             {"abs", [](double x) { return std::abs(x); }}}};

bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Recursive descent, one function per precedence.
class Expression {
 public:
  Expression(std::string_view text, const NamedValue& named) : text_(text), named_(named) {
    constexpr std::size_t longest = 1000;
    if (text.size() > longest) refuse("an expression has at most " + std::to_string(longest) + " characters");
  }

  double value() {
    const double value = sum();
    skip_blanks();
    if (at_ < text_.size()) fail("expected an operator");
    return value;
  }

 private:
  /// A parenthesis, a sign or an exponent, which may hold others.
  class Nesting {
   public:
    explicit Nesting(Expression& expression) : expression_(expression) {
      constexpr int deepest = 50;
      if (++expression_.depth_ > deepest) expression_.fail("nested deeper than " + std::to_string(deepest));
    }
    ~Nesting() { --expression_.depth_; }
    Nesting(const Nesting&) = delete;
    Nesting& operator=(const Nesting&) = delete;

   private:
    Expression& expression_;
  };

  double sum() {
    double value = product();
    while (true) {
      const std::size_t from = next();
      if (taken('+')) {
        value = finite(value + product(), from);
      } else if (taken('-')) {
        value = finite(value - product(), from);
      } else {
        return value;
      }
    }
  }

  double product() {
    double value = signed_power();
    while (true) {
      const std::size_t from = next();
      if (taken('*')) {
        value = finite(value * signed_power(), from);
      } else if (taken('/')) {
        value = finite(value / signed_power(), from);
      } else {
        return value;
      }
    }
  }

  double signed_power() {
    const Nesting nesting(*this);
    if (taken('-')) return -signed_power();
    if (taken('+')) return signed_power();
    const double base = operand();
    const std::size_t from = next();
    return taken('^') ? finite(std::pow(base, signed_power()), from) : base;
  }

  double operand() {
    const std::size_t from = next();
    if (taken('(')) return closed();
    if (at_ == text_.size()) fail("expected a number, a name or a parenthesis");
    if (is_letter(text_[at_])) return word(from);
    if (!is_digit(text_[at_]) && text_[at_] != '.') fail("expected a number, a name or a parenthesis");
    double number = 0;
    const auto [end, failure] = std::from_chars(text_.data() + at_, text_.data() + text_.size(), number);
    if (failure == std::errc::result_out_of_range) fail("the number is out of range");
    if (failure != std::errc()) fail("expected a number, a name or a parenthesis");
    at_ = static_cast<std::size_t>(end - text_.data());
    return number;
  }

  double word(std::size_t from) {
    while (at_ < text_.size() && (is_letter(text_[at_]) || is_digit(text_[at_]))) ++at_;
    const std::string_view name = text_.substr(from, at_ - from);
    for (const Function& function : functions) {
      if (function.name != name) continue;
      if (!taken('(')) fail("expected ( behind " + std::string(name));
      return finite(function.of(closed()), from);
    }
    if (name == "pi") return std::numbers::pi;
    const std::optional<double> value = named_ ? named_(name) : std::nullopt;
    if (value) return finite(*value, from);
    at_ = from;
    fail("there is no name \"" + std::string(name) + "\" here");
  }

  /// The rest of a parenthesis that is open.
  double closed() {
    const Nesting nesting(*this);
    const double value = sum();
    if (!taken(')')) fail("expected ) or an operator");
    return value;
  }

  double finite(double value, std::size_t from) {
    if (std::isfinite(value)) return value;
    at_ = from;
    fail("the value is not finite");
  }

  void skip_blanks() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\t')) ++at_;
  }
  std::size_t next() {
    skip_blanks();
    return at_;
  }
  bool taken(char c) {
    if (next() == text_.size() || text_[at_] != c) return false;
    ++at_;
    return true;
  }
  [[noreturn]] void fail(const std::string& why) const { refuse("column " + std::to_string(at_ + 1) + ": " + why); }

  const std::string_view text_;
  const NamedValue& named_;
  std::size_t at_ = 0;
  int depth_ = 0;
};

}  // namespace

double evaluate_expression(std::string_view text, const NamedValue& named) { return Expression(text, named).value(); }

}  // namespace deform::client
