#pragma once

#include <string>
#include <vector>

#include "client/cli/csv.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

struct NamedDesign {
  std::string name;            ///< file name without extension
  std::vector<double> values;  ///< one per design variable of the setup
};

/// Columns are design variables, in any order, 0 for those that have no column; a column "name" gives the names of the results,
/// else design_0001, ... by row. Throws Error(invalid_argument) with file and line: unknown variable, no number, a name that is
/// repeated or cannot be a file name, no design.
std::vector<NamedDesign> read_designs(const Csv& csv, const v1::Setup& setup);

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
