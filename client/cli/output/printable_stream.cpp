// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/printable_stream.h"

#include <string_view>

#include "core/base/text.h"

namespace deform::cli {

PrintableStream::PrintableStream(std::ostream& stream) : stream_(stream), target_(stream.rdbuf(this)) {}

PrintableStream::~PrintableStream() {
  pass_on(waiting_.size());
  stream_.rdbuf(target_);
}

bool PrintableStream::pass_on(std::size_t count) {
  const std::string text = printable(std::string_view(waiting_).substr(0, count), "\n\t");
  waiting_.erase(0, count);
  const auto size = static_cast<std::streamsize>(text.size());
  return target_->sputn(text.data(), size) == size;
}

PrintableStream::int_type PrintableStream::overflow(int_type c) {
  if (traits_type::eq_int_type(c, traits_type::eof())) return traits_type::not_eof(c);
  const char text = traits_type::to_char_type(c);
  return xsputn(&text, 1) == 1 ? c : traits_type::eof();
}

std::streamsize PrintableStream::xsputn(const char* text, std::streamsize count) {
  const std::string_view added(text, static_cast<std::size_t>(count));
  const std::size_t line_end = added.rfind('\n');
  const std::size_t before = waiting_.size();
  waiting_ += added;
  if (line_end == std::string_view::npos) return count;
  return pass_on(before + line_end + 1) ? count : 0;
}

int PrintableStream::sync() {
  const bool passed = pass_on(waiting_.size());
  return target_->pubsync() == 0 && passed ? 0 : -1;
}

}  // namespace deform::cli
