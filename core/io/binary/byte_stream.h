// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace deform::io {

/// Writes a sequence of numbers, texts and arrays in native representation, for communication between processes of one program.
class ByteWriter {
 public:
  using Sink = std::function<void(std::string_view)>;
  explicit ByteWriter(Sink sink) : sink_(std::move(sink)) {}

  void number(std::uint64_t value) { put({reinterpret_cast<const char*>(&value), sizeof(value)}); }
  void text(std::string_view text) { array(std::span(text.data(), text.size())); }
  template <typename T>
  void array(std::span<const T> values) {
    static_assert(std::is_trivially_copyable_v<T>);
    number(values.size());
    put({reinterpret_cast<const char*>(values.data()), values.size_bytes()});
  }
  /// Passes buffered bytes to the sink.
  void flush();

 private:
  void put(std::string_view bytes);

  Sink sink_;
  std::string pending_;
};

/// Reads the output of a ByteWriter. Sizes in the input are not trusted: memory is allocated as bytes arrive, at most
/// `most_bytes` in total. Throws Error(data_loss) if the bytes end early or claim more than that.
class ByteReader {
 public:
  /// Reads at most `size` bytes and returns their number; 0 at the end.
  using Source = std::function<std::size_t(char* to, std::size_t size)>;
  ByteReader(Source source, std::uint64_t most_bytes) : source_(std::move(source)), left_(most_bytes) {}

  std::uint64_t number();
  std::string text() { return read<std::string>(); }
  template <typename T>
  std::vector<T> array() {
    return read<std::vector<T>>();
  }

 private:
  template <typename Container>
  Container read() {
    using T = typename Container::value_type;
    static_assert(std::is_trivially_copyable_v<T>);
    constexpr std::size_t first_chunk = (std::size_t{1} << 26) / sizeof(T);
    const std::uint64_t count = number();
    if (count > left_ / sizeof(T)) refuse(count);
    Container values;
    while (values.size() < count) {
      const std::size_t have = values.size();
      values.resize(static_cast<std::size_t>(std::min<std::uint64_t>(count, std::max(first_chunk, 2 * have))));
      fill(reinterpret_cast<char*>(values.data() + have), (values.size() - have) * sizeof(T));
    }
    return values;
  }
  void fill(char* to, std::size_t size);
  [[noreturn]] static void refuse(std::uint64_t count);

  Source source_;
  std::uint64_t left_;
};

}  // namespace deform::io
