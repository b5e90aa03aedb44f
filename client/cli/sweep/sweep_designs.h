// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "client/cli/setup/reading.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

struct NamedDesign {
  std::string name;            ///< file name without extension
  std::vector<double> values;  ///< one per design variable of the setup
  std::string where = {};      ///< "designs.csv:7: "
};

/// A row that is no design.
struct BadDesign {
  std::string name;    ///< as it would be, or "designs.csv:7" where it has none of its own
  std::string reason;  ///< with file and line: "designs.csv:7: roof_up: 0.3 is outside of its bounds [-0.05, 0.05]"
};

struct DesignTable {
  std::vector<NamedDesign> designs;
  std::vector<BadDesign> bad;
};

/// Columns are design variables, in any order, 0 for those that have no column; a column "name" gives the names of the results,
/// else design_0001, ... by row, bad ones counted. Bad are rows with more or fewer fields than the header, no number, a value out
/// of its bounds, a name that is repeated or cannot be a file name. Throws Error(invalid_argument) for what is wrong with the
/// table: an unknown variable, no row.
DesignTable read_designs(const Csv& csv, const v1::Setup& setup);

/// Why the server would not take this value; nothing when it would. See core/base/bounds.h.
std::optional<std::string> out_of_bounds(const v1::DesignVariable& variable, double value);

/// Identity of one result: SHA-256 of everything that determines its bytes.
struct SweepIdentity {
  std::string system_id;
  std::string encoding;
  double tolerance = 0;
  std::string extension;
  std::string splitting = {};  ///< CellOptions::identity()
};
std::string design_hash(const SweepIdentity& identity, const NamedDesign& design);

}  // namespace deform::cli
