// SPDX-License-Identifier: Apache-2.0

#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/formats/off/off_header.h"
#include "core/io/readers.h"
#include "core/io/text/text_scanner.h"

namespace deform::io {

namespace {

OffHeader read_header(std::string_view bytes, const std::string& name) {
  TextScanner scanner(bytes, name, Syntax::hash);
  if (!scanner.next_in_file()) scanner.fail("expected an OFF header, the file is empty");
  const std::size_t start = scanner.position();
  const std::string found = scanner.quoted();
  const std::string_view word = scanner.word();
  const std::size_t keyword = word.find("OFF");
  OffHeader header;
  bool known = keyword != std::string_view::npos;
  bool dimensions = false;
  for (std::size_t i = 0; known && i < keyword; ++i) {
    if (word.substr(i, 2) == "ST") {
      header.texture = true;
      ++i;
    } else if (word[i] == 'C') {
      header.colours = true;
    } else if (word[i] == 'N') {
      header.normals = true;
    } else if (word[i] == '4' || word[i] == 'n') {
      dimensions = true;
    } else {
      known = false;
    }
  }
  // "OFF8 6 12" has been seen: the counts may follow without a space.
  if (known && word.size() > keyword + 3) known = word[keyword + 3] >= '0' && word[keyword + 3] <= '9';
  if (!known) scanner.fail_at(start, "expected an OFF header (OFF, COFF, NOFF, STOFF, ...), found " + found);
  if (dimensions) scanner.fail_at(start, found + " holds points of more than 3 dimensions; only 3 are supported");
  scanner.move_to(start + keyword + 3);
  header.end = scanner.position();
  if (scanner.next_in_line() && scanner.accept("binary")) {
    header.binary = true;
    scanner.skip_line();
    header.end = scanner.position();
  }
  return header;
}

/// Vertices usually stand one per line, followed by anything (colours in plain OFF, three or four of them); the format itself
/// knows no lines.
enum class Layout { one_vertex_per_line, free };

class OffReader {
 public:
  OffReader(std::string_view bytes, const std::string& name, const OffHeader& header, Layout layout)
      : scanner_(bytes, name, Syntax::hash), header_(header), layout_(layout), size_(bytes.size()) {
    scanner_.move_to(header.end);
  }

  void read() {
    const std::int64_t vertices = read_count("the number of vertices");
    const std::int64_t faces = read_count("the number of faces");
    if (scanner_.next_in_line()) scanner_.whole_integer("the number of edges");
    if (vertices == 0) scanner_.fail("the header claims no vertices, at least one is needed");
    // Shortest vertex "0 0 0", shortest face "1 0", each with a separator.
    const std::uint64_t needed = static_cast<std::uint64_t>(vertices) * 6 + static_cast<std::uint64_t>(faces) * 4 - 1;
    if (needed > size_ - scanner_.position()) {
      scanner_.fail("the header claims " + std::to_string(vertices) + " vertices and " + std::to_string(faces) +
                    " faces, which need at least " + std::to_string(needed) + " bytes, but only " +
                    std::to_string(size_ - scanner_.position()) + " are left");
    }
    read_vertices(static_cast<std::size_t>(vertices));
    read_faces(static_cast<std::size_t>(faces));
    if (scanner_.next_in_file()) {
      scanner_.fail("expected the end of the file after " + std::to_string(vertices) + " vertices and " + std::to_string(faces) +
                    " faces, found " + scanner_.quoted());
    }
  }

  std::shared_ptr<const Mesh> mesh() { return mesh_; }
  TextRecords take_records() { return std::move(records_); }

 private:
  std::int64_t read_count(const char* what) {
    if (!scanner_.next_in_file()) scanner_.fail(std::string("expected ") + what + ", found the end of the file");
    const std::size_t at = scanner_.position();
    const std::int64_t count = scanner_.whole_integer(what);
    if (count < 0 || count > static_cast<std::int64_t>(most_ids)) {
      scanner_.fail_at(at, std::string(what) + " is " + std::to_string(count) + ", outside 0.." + std::to_string(most_ids));
    }
    return count;
  }

  void read_vertices(std::size_t count) {
    mesh_->points.resize(count);
    records_.tokens.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      std::size_t positions[3];
      for (int k = 0; k < 3; ++k) {
        if (!scanner_.next_in_file()) end_of_file("vertex", i, count);
        positions[k] = scanner_.position();
        mesh_->points[i][k] = scanner_.number("vertex coordinate");
      }
      records_.tokens[i] = CoordinateTokens::at(positions, scanner_);
      if (layout_ == Layout::one_vertex_per_line) {
        scanner_.skip_line();
        continue;
      }
      for (std::size_t extra = 0; extra < header_.extras(); ++extra) {
        if (!scanner_.next_in_file()) end_of_file("vertex", i, count);
        scanner_.number("vertex normal, colour or texture coordinate");
      }
    }
  }

  void read_faces(std::size_t count) {
    mesh_->face_sizes.resize(count);
    mesh_->face_points.reserve(count * 3);
    const auto points = static_cast<std::int64_t>(mesh_->points.size());
    for (std::size_t i = 0; i < count; ++i) {
      if (!scanner_.next_in_file()) end_of_file("face", i, count);
      const std::size_t at = scanner_.position();
      const std::int64_t size = scanner_.whole_integer("the number of corners of a face");
      if (size < 1) scanner_.fail_at(at, "a face with " + std::to_string(size) + " corners, at least 1 is needed");
      if (static_cast<std::uint64_t>(size) > (size_ - scanner_.position()) / 2) {
        scanner_.fail_at(at, "a face with " + std::to_string(size) + " corners needs more bytes than the " +
                                 std::to_string(size_ - scanner_.position()) + " that are left");
      }
      mesh_->face_sizes[i] = static_cast<std::uint32_t>(size);
      for (std::int64_t c = 0; c < size; ++c) {
        if (!scanner_.next_in_file()) end_of_file("face", i, count);
        const std::size_t index_at = scanner_.position();
        const std::int64_t point = scanner_.whole_integer("vertex index");
        if (point < 0 || point >= points) {
          scanner_.fail_at(index_at,
                           "vertex index " + std::to_string(point) + " is out of range 0.." + std::to_string(points - 1));
        }
        mesh_->face_points.push_back(static_cast<PointId>(point));
      }
      scanner_.skip_line();  // face colours
    }
  }

  [[noreturn]] void end_of_file(const char* noun, std::size_t index, std::size_t count) {
    scanner_.fail(std::string("the file ends in ") + noun + " " + std::to_string(index) + " of " + std::to_string(count) +
                  " (from 0)");
  }

  TextScanner scanner_;
  const OffHeader& header_;
  const Layout layout_;
  const std::size_t size_;
  std::shared_ptr<Mesh> mesh_ = std::make_shared<Mesh>();
  TextRecords records_;
};

std::unique_ptr<MeshFile> parse_layout(std::string& bytes, const std::string& name, const OffHeader& header, Layout layout) {
  OffReader reader(bytes, name, header, layout);
  reader.read();
  return make_text_mesh_file(Format::off, std::move(bytes), reader.mesh(), reader.take_records());
}

std::unique_ptr<MeshFile> parse_off(std::string bytes, const std::string& name) {
  const OffHeader header = read_header(bytes, name);
  if (header.binary) return parse_off_binary(std::move(bytes), name, header);
  try {
    return parse_layout(bytes, name, header, Layout::one_vertex_per_line);
  } catch (const Error&) {
    try {
      return parse_layout(bytes, name, header, Layout::free);
    } catch (const Error&) {
    }
    throw;  // the error for the usual layout is more helpful
  }
}

}  // namespace

Reader off_reader() { return {.format = Format::off, .name = "OFF", .extensions = {".off"}, .parse = parse_off}; }

}  // namespace deform::io
