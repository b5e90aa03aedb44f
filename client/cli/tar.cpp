#include "client/cli/tar.h"

#include <array>
#include <cstdio>
#include <cstring>
#include <string_view>

#include "core/base/error.h"

namespace deform::cli {

namespace {

constexpr std::size_t block = 512;
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

}  // namespace

std::uint64_t tar_entry_bytes(std::uint64_t bytes) { return block + bytes + padding(bytes); }

TarWriter::TarWriter(const std::filesystem::path& path, std::uint64_t end) : path_(path), end_(end) {
  if (end > 0) {
    std::filesystem::resize_file(path, end);
    file_.open(path, std::ios::binary | std::ios::app);
  } else {
    file_.open(path, std::ios::binary | std::ios::trunc);
  }
  if (!file_)
    throw Error(ErrorCode::invalid_argument, "cannot write " + path.string() + "; check the folder and its permissions");
}

void TarWriter::add(const std::string& name, const std::string& bytes) {
  constexpr std::size_t longest_name = 100;
  if (name.size() > longest_name || bytes.size() > largest_entry) {
    throw Error(ErrorCode::invalid_argument, "archive: " + name + " does not fit; write to a folder instead");
  }
  const Header header = make_header(name, bytes.size());
  const std::string zeros(padding(bytes.size()), '\0');
  file_.write(header.data(), block);
  file_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  file_.write(zeros.data(), static_cast<std::streamsize>(zeros.size()));
  flush();
  end_ += tar_entry_bytes(bytes.size());
}

void TarWriter::finish() {
  const std::string zeros(2 * block, '\0');
  file_.write(zeros.data(), static_cast<std::streamsize>(zeros.size()));
  flush();
  file_.close();
}

void TarWriter::flush() {
  file_.flush();
  if (!file_) throw Error(ErrorCode::unavailable, "cannot write " + path_.string() + "; is the disk full?");
}

}  // namespace deform::cli
