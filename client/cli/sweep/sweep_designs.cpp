// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/sweep/sweep_designs.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "client/cli/setup/motions.h"
#include "core/base/bounds.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/codec/geometry_id.h"

namespace deform::cli {

namespace {

bool is_file_name(const std::string& name) {
  constexpr std::size_t longest = 80;  // the extension has to fit into the 100 of a tar header
  return !name.empty() && name.size() <= longest && name.front() != '.' && name.front() != '-' &&
         std::all_of(name.begin(), name.end(), [](unsigned char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' ||
                  c == '.' || c == '+';
         });
}

std::string numbered_name(std::size_t number, std::size_t count) {
  const std::size_t width = std::max<std::size_t>(4, std::to_string(count).size());
  const std::string digits = std::to_string(number);
  return "design_" + std::string(width - digits.size(), '0') + digits;
}

/// Reads the rows of a table one after the other.
class DesignReader {
 public:
  DesignReader(const Csv& csv, const v1::Setup& setup) : csv_(csv), setup_(setup) {
    for (std::size_t k = 0; k < csv.header.size(); ++k) {
      variable_of_.push_back(csv.header[k] == "name" ? is_name : variable_index(setup, csv.header[k], csv.name));
    }
  }

  DesignTable read() {
    const std::size_t count = csv_.rows.size() + csv_.bad_rows.size();
    if (count == 0) throw Error(ErrorCode::invalid_argument, csv_.name + ": there is no design below the header");
    auto bad = csv_.bad_rows.begin();
    auto row = csv_.rows.begin();
    for (std::size_t number = 1; number <= count; ++number) {
      const std::string numbered = numbered_name(number, count);
      if (row == csv_.rows.end() || (bad != csv_.bad_rows.end() && bad->line < row->line)) {
        add_bad(bad->line, bad->fields, numbered, bad->reason);
        ++bad;
        continue;
      }
      try {
        add(*row, numbered);
      } catch (const Error& error) {
        add_bad(row->line, row->fields, numbered, error.what());
      }
      ++row;
    }
    return std::move(table_);
  }

 private:
  static constexpr std::size_t is_name = static_cast<std::size_t>(-1);

  [[noreturn]] static void refuse(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

  void add(const Csv::Row& row, const std::string& numbered) {
    NamedDesign design{numbered, {}, csv_.name + ":" + std::to_string(row.line) + ": "};
    design.values.resize(static_cast<std::size_t>(setup_.variables_size()), 0.0);
    std::size_t name_column = 0;
    for (std::size_t k = 0; k < row.fields.size(); ++k) {
      if (variable_of_[k] == is_name) {
        design.name = row.fields[k];
        name_column = k;
        if (!is_file_name(design.name)) {
          refuse(csv_.where(row, k) + "\"" + design.name.substr(0, 40) +
                 "\" cannot be a file name: letters, digits and _ - . + only, at most 80");
        }
        continue;
      }
      const double value = csv_.number(row, k);
      const auto problem = out_of_bounds(setup_.variables(static_cast<int>(variable_of_[k])), value);
      if (problem) refuse(csv_.where(row, k) + *problem);
      design.values[variable_of_[k]] = value;
    }
    if (!names_.insert(design.name).second) {
      refuse(csv_.where(row, name_column) + "\"" + design.name + "\" stands there twice");
    }
    table_.designs.push_back(std::move(design));
  }

  /// The name of its own counts as taken, so that no other row gets it.
  void add_bad(std::size_t line, const std::vector<std::string>& fields, const std::string& numbered, const std::string& reason) {
    std::string name = numbered;
    for (std::size_t k = 0; k < std::min(fields.size(), variable_of_.size()); ++k) {
      if (variable_of_[k] == is_name) name = fields[k];
    }
    if (!is_file_name(name) || !names_.insert(name).second) name = csv_.name + ":" + std::to_string(line);
    table_.bad.push_back({name, reason});
  }

  const Csv& csv_;
  const v1::Setup& setup_;
  std::vector<std::size_t> variable_of_;
  std::set<std::string> names_;
  DesignTable table_;
};

}  // namespace

std::optional<std::string> out_of_bounds(const v1::DesignVariable& variable, double value) {
  const double lower = variable.has_lower() ? variable.lower() : -HUGE_VAL;
  const double upper = variable.has_upper() ? variable.upper() : HUGE_VAL;
  if (within_bounds(value, lower, upper)) return std::nullopt;
  return number_digits(value) + " is outside of its bounds [" + number_digits(lower) + ", " + number_digits(upper) + "]";
}

DesignTable read_designs(const Csv& csv, const v1::Setup& setup) { return DesignReader(csv, setup).read(); }

std::string design_hash(const SweepIdentity& identity, const NamedDesign& design) {
  codec::Sha256 hash;
  for (const std::string* text : {&identity.system_id, &identity.encoding, &identity.extension}) {
    hash.add(text->c_str(), text->size() + 1);
  }
  hash.add(&identity.tolerance, sizeof(identity.tolerance));
  hash.add(design.values.data(), design.values.size() * sizeof(double));
  hash.add(identity.splitting.data(), identity.splitting.size());
  return hash.hex();
}

}  // namespace deform::cli
