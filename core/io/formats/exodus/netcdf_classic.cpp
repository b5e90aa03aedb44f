// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/exodus/netcdf_classic.h"

#include <bit>
#include <cstdint>
#include <iterator>
#include <vector>

#include "core/base/error.h"
#include "core/io/binary/byte_order.h"

namespace deform::io {

namespace {

constexpr std::uint32_t dimension_tag = 10, variable_tag = 11, attribute_tag = 12;

/// Bytes of a value of an nc_type, 0 when there is none of that number.
std::uint64_t size_of_type(std::uint32_t type) {
  constexpr std::uint64_t sizes[] = {0, 1, 1, 2, 4, 4, 8, 1, 2, 4, 8, 8};
  return type < std::size(sizes) ? sizes[type] : 0;
}

class Header {
 public:
  Header(std::string_view bytes, const std::string& name)
      : bytes_(bytes), name_(name), wide_(bytes[3] == 5), far_(bytes[3] != 1) {}

  void check() {
    at_ = 4;
    count();  // of records
    std::vector<std::uint64_t> dimensions;
    for (std::uint64_t n = list(dimension_tag, 8); n > 0; --n) {
      skip_name();
      dimensions.push_back(count());
    }
    skip_attributes();
    for (std::uint64_t n = list(variable_tag, 20); n > 0; --n) check_variable(dimensions);
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw Error(ErrorCode::invalid_argument, name_ + ": byte " + std::to_string(at_) + ": " + what);
  }

  void need(std::uint64_t length) const {
    if (length > bytes_.size() - at_) fail("the file ends within the header of netCDF");
  }

  std::uint32_t word() {
    need(4);
    at_ += 4;
    return load_scalar<std::uint32_t>(bytes_.data() + at_ - 4, std::endian::big);
  }

  std::uint64_t long_word() {
    need(8);
    at_ += 8;
    return load_scalar<std::uint64_t>(bytes_.data() + at_ - 8, std::endian::big);
  }

  /// NON_NEG of the specification.
  std::uint64_t count() { return wide_ ? long_word() : word(); }

  /// The number of entries of a list, each of which has `least` bytes.
  std::uint64_t list(std::uint32_t tag, std::uint64_t least) {
    const std::uint32_t found = word();
    const std::uint64_t entries = count();
    if (entries > 0 && found != tag) fail("expected the tag " + std::to_string(tag) + ", found " + std::to_string(found));
    if (entries > (bytes_.size() - at_) / least)
      fail("a list of " + std::to_string(entries) + " entries, the file has only " + std::to_string(bytes_.size() - at_) +
           " bytes left");
    return entries;
  }

  void skip(std::uint64_t length) {
    need(length);
    at_ += length;
    while (at_ % 4 != 0 && at_ < bytes_.size()) ++at_;
  }

  void skip_name() { skip(count()); }

  void skip_attributes() {
    for (std::uint64_t n = list(attribute_tag, 12); n > 0; --n) {
      skip_name();
      const std::uint64_t size = size_of_type(word()), values = count();
      if (size == 0 || values > bytes_.size()) fail("an attribute of unknown type or of " + std::to_string(values) + " values");
      skip(size * values);
    }
  }

  void check_variable(const std::vector<std::uint64_t>& dimensions) {
    const std::size_t begin_of_name = at_;
    skip_name();
    std::uint64_t entries = 1;
    bool records = false;
    const std::uint64_t rank = count();
    if (rank > bytes_.size() / 4) fail("a variable of " + std::to_string(rank) + " dimensions");
    for (std::uint64_t i = 0; i < rank; ++i) {
      const std::uint64_t dimension = count();
      if (dimension >= dimensions.size())
        fail("dimension " + std::to_string(dimension) + " of " + std::to_string(dimensions.size()));
      const std::uint64_t length = dimensions[dimension];
      records |= length == 0;  // the unlimited one
      // More entries than bytes are too many, however many.
      entries = length > 0 && entries > bytes_.size() / length ? bytes_.size() + 1 : entries * length;
    }
    skip_attributes();
    const std::uint64_t size = size_of_type(word());
    count();  // bytes, padded; entries say it too
    const std::uint64_t begin = far_ ? long_word() : word();
    if (size == 0) fail("a variable of unknown type");
    if (records) return;
    if (begin > bytes_.size() || entries > (bytes_.size() - begin) / size) {
      at_ = begin_of_name;
      fail("the variable named here has " + std::to_string(entries) + " values of " + std::to_string(size) + " bytes from byte " +
           std::to_string(begin) + ", the file has only " + std::to_string(bytes_.size()) + " bytes");
    }
  }

  const std::string_view bytes_;
  const std::string& name_;
  const bool wide_, far_;  ///< CDF-5: counts of 64 bits; CDF-2 too: offsets of 64 bits
  std::size_t at_ = 0;
};

}  // namespace

bool is_classic_netcdf(std::string_view bytes) {
  return bytes.size() > 4 && bytes.starts_with("CDF") && (bytes[3] == 1 || bytes[3] == 2 || bytes[3] == 5);
}

void check_classic_netcdf(std::string_view bytes, const std::string& name) {
  if (is_classic_netcdf(bytes)) Header(bytes, name).check();
}

}  // namespace deform::io
