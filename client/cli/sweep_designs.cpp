#include "client/cli/sweep_designs.h"

#include <algorithm>
#include <set>

#include "client/cli/motions.h"
#include "core/base/error.h"
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

}  // namespace

std::vector<NamedDesign> read_designs(const Csv& csv, const v1::Setup& setup) {
  constexpr std::size_t is_name = static_cast<std::size_t>(-1);
  std::vector<std::size_t> variable_of(csv.header.size());
  for (std::size_t k = 0; k < csv.header.size(); ++k) {
    variable_of[k] = csv.header[k] == "name" ? is_name : variable_index(setup, csv.header[k], csv.name);
  }
  std::vector<NamedDesign> designs;
  std::set<std::string> names;
  for (const auto& row : csv.rows) {
    NamedDesign design;
    design.name = numbered_name(designs.size() + 1, csv.rows.size());
    design.values.resize(static_cast<std::size_t>(setup.variables_size()), 0.0);
    std::size_t name_column = 0;
    for (std::size_t k = 0; k < row.fields.size(); ++k) {
      if (variable_of[k] == is_name) {
        design.name = row.fields[k];
        name_column = k;
        if (!is_file_name(design.name)) {
          throw Error(ErrorCode::invalid_argument, csv.where(row, k) + "\"" + design.name.substr(0, 40) +
                                                       "\" cannot be a file name: letters, digits and _ - . + only, at most 80");
        }
      } else {
        design.values[variable_of[k]] = csv.number(row, k);
      }
    }
    if (!names.insert(design.name).second) {
      throw Error(ErrorCode::invalid_argument, csv.where(row, name_column) + "\"" + design.name + "\" stands there twice");
    }
    designs.push_back(std::move(design));
  }
  if (designs.empty()) throw Error(ErrorCode::invalid_argument, csv.name + ": there is no design below the header");
  return designs;
}

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
