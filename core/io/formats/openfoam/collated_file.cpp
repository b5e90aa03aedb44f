// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/openfoam/collated_file.h"

#include <optional>
#include <utility>

#include "core/base/error.h"
#include "core/io/formats/openfoam/foam_scanner.h"

namespace deform::io {

namespace {

constexpr std::string_view collated_class = "decomposedBlockData";

/// What the FoamFile dictionary at the cursor says; the cursor is behind it. std::nullopt, and the cursor where it was, if there
/// is none.
struct Header {
  std::string type, format, arch;  ///< empty: not said
};

std::optional<Header> header_at(FoamScanner& scanner) {
  const std::size_t begin = scanner.position();
  const char first = scanner.peek();
  if (first != 'F' || scanner.word("a word") != "FoamFile") {
    scanner.move_to(begin);
    return std::nullopt;
  }
  Header header;
  scanner.expect('{', "the file's header");
  while (!scanner.accept('}')) {
    const std::string_view key = scanner.word("a key of the file's header");
    std::string* const value = key == "class"                            ? &header.type
                               : key == "format" || key == "data.format" ? &header.format
                               : key == "arch"                           ? &header.arch
                                                                         : nullptr;
    // Newer versions say how the blocks are written in "data.format"; their "format" is that of the file around them.
    const bool of_blocks = key != "format" || header.format.empty();
    if (value != nullptr && scanner.peek() != ';' && of_blocks) *value = std::string(scanner.word("its value"));
    scanner.skip_entry();
  }
  return header;
}

std::string header_text(const Header& header) {
  std::string text = "FoamFile { version 2.0;";
  if (!header.format.empty()) text += " format " + header.format + ";";
  if (!header.arch.empty()) text += " arch \"" + header.arch + "\";";
  return text + " }\n";
}

}  // namespace

bool is_collated(std::string_view bytes) {
  const std::string name;
  FoamScanner scanner(bytes, name);
  try {
    const auto header = header_at(scanner);
    return header && header->type == collated_class;
  } catch (const Error&) {
    return false;
  }
}

CollatedFile::CollatedFile(FoamFiles::Part file, std::size_t count) : file_(std::move(file)) {
  FoamScanner scanner(file_.bytes, file_.name);
  const auto around = header_at(scanner);
  if (!around || around->type != collated_class) scanner.fail("is not of the class decomposedBlockData");
  std::optional<Header> first;
  while (scanner.next()) {
    Block block;
    block.count_begin = scanner.position();
    const std::size_t bytes = scanner.count("the size of a part", 1);
    block.count_end = scanner.position();
    scanner.expect('(', "the file of a part");
    block.begin = scanner.position();
    if (bytes > scanner.left()) {
      scanner.fail_at(block.count_begin, "the size of a part is " + std::to_string(bytes) + ", the file has " +
                                             std::to_string(scanner.left()) + " left");
    }
    block.end = block.begin + bytes;
    FoamScanner within(bytes_of(block), file_.name);
    const auto own = header_at(within);
    block.headed = own.has_value();
    if (blocks_.empty()) first = own;
    blocks_.push_back(block);
    scanner.move_to(block.end);
    scanner.expect(')', "the file of a part");
  }
  if (blocks_.size() != count) {
    scanner.fail("has " + std::to_string(blocks_.size()) + " parts, its folder is that of " + std::to_string(count));
  }
  header_ = header_text(first.value_or(*around));
}

FoamFiles::Part CollatedFile::part(std::size_t block, std::size_t number) const {
  const Block& at = blocks_.at(block);
  return {(at.headed ? std::string() : header_) + std::string(bytes_of(at)),
          file_.name + " (part " + std::to_string(number) + ")"};
}

std::string CollatedFile::with_parts(const std::vector<std::string>& parts) const {
  std::string result;
  std::size_t from = 0;
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const Block& block = blocks_[i];
    const std::string_view bytes = std::string_view(parts.at(i)).substr(block.headed ? 0 : header_.size());
    // A number that still holds stays as it is written ("007").
    const bool same = bytes.size() == block.end - block.begin;
    result.append(file_.bytes, from, (same ? block.count_end : block.count_begin) - from);
    if (!same) result += std::to_string(bytes.size());
    result.append(file_.bytes, block.count_end, block.begin - block.count_end);
    result += bytes;
    from = block.end;
  }
  return result.append(file_.bytes, from);
}

}  // namespace deform::io
