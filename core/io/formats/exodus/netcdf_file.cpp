// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/exodus/netcdf_file.h"

#include <netcdf.h>

#include <algorithm>

#include "core/base/error.h"

namespace deform::io {

namespace {

// The largest compression ratio of deflate, with an allowance for the file itself. The classic formats do not compress.
constexpr std::uint64_t best_compression = 1100;
constexpr std::size_t longest_attribute = 4096;

}  // namespace

NetcdfFile::NetcdfFile(ContainerFile& file, std::size_t bytes, std::string name, Access access)
    : lock_(lock_containers()), name_(std::move(name)) {
  check(nc_open(file.path().c_str(), access == Access::read ? NC_NOWRITE : NC_WRITE, &file_), "");
  open_ = true;
  file.unlink();
  int format = 0;
  check(nc_inq_format(file_, &format), "");
  most_bytes_ = format == NC_FORMAT_NETCDF4 || format == NC_FORMAT_NETCDF4_CLASSIC ? bytes * best_compression : bytes;
}

NetcdfFile::~NetcdfFile() {
  if (open_) nc_close(file_);
}

void NetcdfFile::close() {
  open_ = false;
  check(nc_close(file_), "");
}

void NetcdfFile::fail(const std::string& variable, const std::string& what) const {
  throw Error(ErrorCode::invalid_argument, name_ + ": " + (variable.empty() ? "" : variable + ": ") + what);
}

void NetcdfFile::check(int status, const std::string& variable) const {
  if (status != NC_NOERR) fail(variable, nc_strerror(status));
}

std::optional<std::size_t> NetcdfFile::dimension(const std::string& name) const {
  int dimension = 0;
  std::size_t length = 0;
  if (nc_inq_dimid(file_, name.c_str(), &dimension) != NC_NOERR) return std::nullopt;
  check(nc_inq_dimlen(file_, dimension, &length), name);
  return length;
}

bool NetcdfFile::has(const std::string& variable) const {
  int number = 0;
  return nc_inq_varid(file_, variable.c_str(), &number) == NC_NOERR;
}

int NetcdfFile::id(const std::string& variable) const {
  int number = 0;
  check(nc_inq_varid(file_, variable.c_str(), &number), variable);
  return number;
}

int NetcdfFile::type(const std::string& variable) const {
  nc_type number = NC_NAT;
  check(nc_inq_vartype(file_, id(variable), &number), variable);
  return number;
}

std::vector<std::size_t> NetcdfFile::lengths(const std::string& variable) const {
  const int number = id(variable);
  int count = 0;
  check(nc_inq_varndims(file_, number, &count), variable);
  if (count < 0 || count > NC_MAX_VAR_DIMS) fail(variable, "the variable has " + std::to_string(count) + " dimensions");
  std::vector<int> dimensions(static_cast<std::size_t>(count));
  if (count > 0) check(nc_inq_vardimid(file_, number, dimensions.data()), variable);
  std::vector<std::size_t> result;
  for (const int dimension : dimensions) {
    result.push_back(0);
    check(nc_inq_dimlen(file_, dimension, &result.back()), variable);
  }
  return result;
}

bool NetcdfFile::is_float(const std::string& variable) const { return type(variable) == NC_FLOAT; }

std::size_t NetcdfFile::entries(const std::string& variable, std::size_t size) const {
  std::uint64_t count = 1;
  for (const std::size_t length : lengths(variable)) {
    if (length > 0 && count > most_bytes_ / size / length) {
      fail(variable,
           "the variable is said to have " + std::to_string(length) + " entries along a dimension, more than the file can hold");
    }
    count *= length;
  }
  return static_cast<std::size_t>(count);
}

std::vector<std::int64_t> NetcdfFile::integers(const std::string& variable) const {
  const int kind = type(variable);
  if (kind != NC_INT && kind != NC_INT64) fail(variable, "expected a variable of type int or int64");
  std::vector<long long> values(entries(variable, kind == NC_INT ? 4 : 8));
  if (!values.empty()) check(nc_get_var_longlong(file_, id(variable), values.data()), variable);
  return {values.begin(), values.end()};
}

std::vector<double> NetcdfFile::reals(const std::string& variable) const {
  const int kind = type(variable);
  if (kind != NC_FLOAT && kind != NC_DOUBLE) fail(variable, "expected a variable of type float or double");
  std::vector<double> values(entries(variable, kind == NC_FLOAT ? 4 : 8));
  if (!values.empty()) check(nc_get_var_double(file_, id(variable), values.data()), variable);
  return values;
}

std::vector<std::string> NetcdfFile::texts(const std::string& variable) const {
  const auto sizes = lengths(variable);
  if (type(variable) != NC_CHAR || sizes.size() != 2) fail(variable, "expected a table of characters");
  std::string all(entries(variable, 1), '\0');
  if (!all.empty()) check(nc_get_var_text(file_, id(variable), all.data()), variable);
  std::vector<std::string> result;
  for (std::size_t row = 0; row < sizes[0]; ++row) {
    std::string text = all.substr(row * sizes[1], sizes[1]);
    text.resize(std::min(text.size(), text.find('\0')));
    text.erase(text.find_last_not_of(' ') + 1);
    result.push_back(std::move(text));
  }
  return result;
}

std::string NetcdfFile::attribute(const std::string& variable, const char* name) const {
  nc_type kind = NC_NAT;
  std::size_t length = 0;
  const int number = id(variable);
  if (nc_inq_att(file_, number, name, &kind, &length) != NC_NOERR) return {};
  if (kind != NC_CHAR || length > longest_attribute) fail(variable, std::string("attribute ") + name + " is no short text");
  std::string text(length, '\0');
  if (length > 0) check(nc_get_att_text(file_, number, name, text.data()), variable);
  text.resize(std::min(text.size(), text.find('\0')));
  return text;
}

void NetcdfFile::overwrite(const std::string& variable, std::span<const double> values) {
  check(nc_put_var_double(file_, id(variable), values.data()), variable);
}

}  // namespace deform::io
