// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/compiled/content.h"

namespace deform::compiled {

/// The bytes of a file, piece by piece: each piece is at most `piece_bytes` long, or as long as a name needs, and made when it is
/// asked for. For one thread.
class Records {
 public:
  static constexpr std::size_t piece_bytes = std::size_t{768} << 10;
  /// Values [first, first + out.size()) of a basis, in the place of Basis::values.
  using Values = std::function<void(std::size_t basis, std::size_t first, std::span<double> out)>;

  /// The content, with all but the values of its bases, must outlive this. Throws Error(invalid_argument) for ids that are none
  /// and names beyond 64 KiB.
  Records(const Content& content, Values values);
  /// Writes a content that has the values.
  explicit Records(const Content& content);

  /// The size of the whole file.
  std::uint64_t bytes() const { return bytes_; }
  /// The next piece, whole records; false after the last one.
  bool next(std::vector<std::byte>& piece);

 private:
  struct Item {
    std::uint32_t kind = 0, basis = 0;
    std::size_t first = 0, count = 0;  ///< entries of an array; else which of its kind
    std::size_t payload = 0;           ///< bytes
  };
  void plan(std::uint32_t kind, std::size_t first, std::size_t payload);
  void plan_array(std::uint32_t kind, std::uint32_t basis, std::size_t count, std::size_t entry_bytes);
  void fill(const Item& item, std::byte* payload);
  void fill_array(const Item& item, std::byte* entries) const;
  void append(const Item& item, std::vector<std::byte>& piece);

  const Content& content_;
  const Values values_;
  std::vector<std::pair<std::string, std::string>> texts_;
  std::vector<std::pair<std::uint32_t, const Driven*>> driven_;  ///< of all variables, with the number of each
  std::vector<Item> items_;
  std::uint64_t bytes_ = 0;
  std::size_t next_ = 0;
  std::vector<std::byte> headers_;  ///< of the records so far
};

}  // namespace deform::compiled
