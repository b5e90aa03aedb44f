// SPDX-License-Identifier: Apache-2.0
#include "core/io/gzip.h"

#include <zlib.h>

#include <algorithm>
#include <limits>

#include "core/base/error.h"
#include "core/base/text.h"

namespace deform::io {

namespace {

constexpr int gzip_only = 15 + 16;  // largest window, gzip wrapping

uInt clamped(std::size_t count) { return static_cast<uInt>(std::min<std::size_t>(count, std::numeric_limits<uInt>::max())); }

struct Inflater {
  z_stream stream{};
  Inflater() {
    if (inflateInit2(&stream, gzip_only) != Z_OK) throw Error(ErrorCode::out_of_budget, "no memory for decompression");
  }
  ~Inflater() { inflateEnd(&stream); }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;
};

struct Deflater {
  z_stream stream{};
  Deflater() {
    if (deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, gzip_only, 8, Z_DEFAULT_STRATEGY) != Z_OK) {
      throw Error(ErrorCode::out_of_budget, "no memory for compression");
    }
  }
  ~Deflater() { deflateEnd(&stream); }
  Deflater(const Deflater&) = delete;
  Deflater& operator=(const Deflater&) = delete;
};

Bytef* writable(const char* bytes) { return reinterpret_cast<Bytef*>(const_cast<char*>(bytes)); }  // zlib 1 takes no const

[[noreturn]] void damaged(const std::string& name, std::size_t at, const std::string& problem) {
  throw Error(ErrorCode::invalid_argument, name + ": byte " + std::to_string(at) + ": gzip data " + problem);
}

/// Room for more output: doubled, but never beyond one byte over the limit, which tells too long from just fitting.
void make_room(std::string& out, std::size_t used, std::size_t max_bytes, const std::string& name) {
  if (used > max_bytes) {
    throw Error(ErrorCode::out_of_budget, name + ": more than " + std::to_string(max_bytes) + " bytes after decompression");
  }
  if (used < out.size()) return;
  constexpr std::size_t first = 1 << 16;
  const std::size_t limit = max_bytes == std::numeric_limits<std::size_t>::max() ? max_bytes : max_bytes + 1;
  out.resize(std::min(limit, std::max(first, out.size() * 2)));
}

}  // namespace

bool has_gzip_extension(const std::string& name) { return lower_case(name).ends_with(".gz"); }

bool is_gzip(std::string_view bytes) { return bytes.size() >= 3 && bytes.substr(0, 3) == "\x1f\x8b\x08"; }

std::string gunzip(std::string_view bytes, const std::string& name, std::size_t max_bytes) {
  Inflater inflater;
  z_stream& stream = inflater.stream;
  std::string out;
  std::size_t read = 0, written = 0;
  for (;;) {
    make_room(out, written, max_bytes, name);
    stream.next_in = writable(bytes.data() + read);
    stream.avail_in = clamped(bytes.size() - read);
    stream.next_out = reinterpret_cast<Bytef*>(out.data() + written);
    stream.avail_out = clamped(out.size() - written);
    const uInt offered = stream.avail_in, room = stream.avail_out;
    const int status = inflate(&stream, Z_NO_FLUSH);
    read += offered - stream.avail_in;
    written += room - stream.avail_out;
    if (status == Z_STREAM_END) {
      // Another member may follow; zero bytes are padding.
      if (is_gzip(bytes.substr(read))) {
        inflateReset(&stream);
        continue;
      }
      if (bytes.substr(read).find_first_not_of('\0') != std::string_view::npos)
        damaged(name, read, "is followed by something else");
      if (written > max_bytes) make_room(out, written, max_bytes, name);
      break;
    }
    if (status == Z_BUF_ERROR && read == bytes.size()) damaged(name, read, "is truncated");
    if (status != Z_OK && status != Z_BUF_ERROR)
      damaged(name, read, std::string("is damaged: ") + (stream.msg ? stream.msg : "unknown"));
  }
  out.resize(written);
  if (out.capacity() - out.size() > out.size() / 4) out.shrink_to_fit();
  return out;
}

std::string gzip(std::string_view bytes) {
  Deflater deflater;
  z_stream& stream = deflater.stream;
  std::string out;
  std::size_t read = 0, written = 0;
  int status = Z_OK;
  while (status != Z_STREAM_END) {
    if (written == out.size()) out.resize(std::max<std::size_t>(1 << 16, out.size() * 2));
    stream.next_in = writable(bytes.data() + read);
    stream.avail_in = clamped(bytes.size() - read);
    stream.next_out = reinterpret_cast<Bytef*>(out.data() + written);
    stream.avail_out = clamped(out.size() - written);
    const uInt offered = stream.avail_in, room = stream.avail_out;
    status = deflate(&stream, offered == bytes.size() - read ? Z_FINISH : Z_NO_FLUSH);
    read += offered - stream.avail_in;
    written += room - stream.avail_out;
  }
  out.resize(written);
  return out;
}

}  // namespace deform::io
