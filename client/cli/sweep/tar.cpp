// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/sweep/tar.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <string_view>

#include "core/base/error.h"

namespace deform::cli {

namespace {

constexpr std::size_t block = 512;
constexpr std::size_t longest_name = 100;
constexpr std::uint64_t largest_entry = 077777777777;  // eleven octal digits

std::size_t padding(std::uint64_t bytes) { return static_cast<std::size_t>((block - bytes % block) % block); }

using Header = std::array<char, block>;

void put_text(Header& header, std::size_t at, std::string_view text) {
  std::memcpy(header.data() + at, text.data(), text.size());
}

void put_octal(Header& header, std::size_t at, int digits, std::uint64_t value) {
  char text[24];
  std::snprintf(text, sizeof(text), "%0*llo", digits, static_cast<unsigned long long>(value));
  put_text(header, at, text);
}

/// Owner root, mode 0644, time 0: the same sweep gives the same archive.
Header make_header(const std::string& name, std::uint64_t bytes) {
  Header header{};
  put_text(header, 0, name);
  put_octal(header, 100, 7, 0644);
  put_octal(header, 108, 7, 0);
  put_octal(header, 116, 7, 0);
  put_octal(header, 124, 11, bytes);
  put_octal(header, 136, 11, 0);
  put_text(header, 148, "        ");  // the checksum counts as blanks
  header[156] = '0';
  put_text(header, 257,
           std::string_view("ustar\0"
                            "00",
                            8));
  unsigned sum = 0;
  for (const char c : header) sum += static_cast<unsigned char>(c);
  put_octal(header, 148, 6, sum);
  header[154] = '\0';
  return header;
}

void check_fits(const std::string& name, std::uint64_t bytes) {
  if (name.size() <= longest_name && bytes <= largest_entry) return;
  throw Error(ErrorCode::invalid_argument, "archive: " + name + " does not fit; write to a folder instead");
}

}  // namespace

std::uint64_t tar_entry_bytes(std::uint64_t bytes) { return block + bytes + padding(bytes); }

bool tar_has_entry(const DurableFile& archive, std::uint64_t offset, const std::string& name, std::uint64_t bytes) {
  if (name.size() > longest_name || bytes > largest_entry || archive.size() < offset) return false;
  if (archive.size() - offset < tar_entry_bytes(bytes)) return false;
  const Header header = make_header(name, bytes);
  return archive.read(offset, block) == std::string_view(header.data(), block);
}

TarWriter::TarWriter(const std::filesystem::path& path, std::uint64_t end) : file_(path), end_(end) {
  if (file_.size() != end) file_.cut(end);
}

void TarWriter::add(const std::string& name, std::string_view bytes) {
  check_fits(name, bytes.size());
  const Header header = make_header(name, bytes.size());
  try {
    file_.append({header.data(), block});
    file_.append(bytes);
    file_.append(std::string(padding(bytes.size()), '\0'));
    file_.sync();
  } catch (...) {
    file_.cut(end_);
    throw;
  }
  end_ += tar_entry_bytes(bytes.size());
}

void TarWriter::add_copy(const std::string& name, const DurableFile& from, std::uint64_t offset, std::uint64_t bytes) {
  constexpr std::uint64_t piece = 1 << 22;
  check_fits(name, bytes);
  const Header header = make_header(name, bytes);
  file_.append({header.data(), block});
  for (std::uint64_t done = 0; done < bytes;) {
    const std::string content = from.read(offset + block + done, static_cast<std::size_t>(std::min(piece, bytes - done)));
    if (content.empty()) throw Error(ErrorCode::data_loss, "archive " + from.path().string() + ": it has become shorter");
    file_.append(content);
    done += content.size();
  }
  file_.append(std::string(padding(bytes), '\0'));
  end_ += tar_entry_bytes(bytes);
}

void TarWriter::close() {
  file_.append(std::string(tar_end_bytes, '\0'));
  file_.sync();
}

void TarWriter::rename(const std::filesystem::path& target) { file_.rename(target); }

}  // namespace deform::cli
