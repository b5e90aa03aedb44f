// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <ostream>
#include <streambuf>
#include <string>

namespace deform::cli {

/// While it lives, all that is written to the stream passes printable() on its way: a name in a mesh file or a message of a
/// server cannot control the terminal. Line feeds and tabs stay, they are the structure of our own output. Whole lines are passed
/// on, the rest with a flush. Not thread-safe, as the stream itself.
class PrintableStream : private std::streambuf {
 public:
  explicit PrintableStream(std::ostream& stream);
  ~PrintableStream() override;
  PrintableStream(const PrintableStream&) = delete;
  PrintableStream& operator=(const PrintableStream&) = delete;

 private:
  int_type overflow(int_type c) override;
  std::streamsize xsputn(const char* text, std::streamsize count) override;
  int sync() override;
  /// Whether all went through.
  bool pass_on(std::size_t count);

  std::ostream& stream_;
  std::streambuf* const target_;
  std::string waiting_;
};

}  // namespace deform::cli
