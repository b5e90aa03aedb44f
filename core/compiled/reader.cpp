// SPDX-License-Identifier: Apache-2.0
#include "core/compiled/reader.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/vectors.h"
#include "core/compiled/bytes.h"
#include "core/compiled/checksum.h"
#include "core/compiled/coded_fields.h"
#include "core/compiled/layout.h"

namespace deform::compiled {

namespace {

constexpr double largest_tilt = 1e-9;  // of axes that are orthonormal

[[noreturn]] void damaged(const std::string& message) { throw Error(ErrorCode::data_loss, "compiled deformation: " + message); }

std::string text_of(std::uint32_t kind) {
  std::string text;
  for (int i = 0; i < 4; ++i) {
    const auto c = static_cast<char>(kind >> (8 * i) & 0xffu);
    text += c >= '!' && c <= '~' ? c : '?';
  }
  return text;
}

std::string hexadecimal(const std::array<std::uint8_t, 32>& bytes) {
  constexpr const char* digits = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += digits[byte >> 4];
    text += digits[byte & 15];
  }
  return text;
}

bool orthonormal(const std::array<Vec3, 3>& axes) {
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      if (!(std::abs(dot(axes[i], axes[j]) - (i == j ? 1.0 : 0.0)) <= largest_tilt)) return false;
    }
  }
  return true;
}

class Parser {
 public:
  explicit Parser(ByteSource& source) : source_(source), left_(source.size()) {}
  Content parse();

 private:
  /// The entries of one array, filled from its records.
  struct Array {
    Kind kind;
    std::uint32_t basis;
    std::byte* to;
    std::size_t entry_bytes, count;
    std::size_t filled = 0;
  };

  void take(void* to, std::size_t bytes);
  void read_preamble();
  void read_head();
  bool read_record();
  void read_text();
  void read_handle();
  void read_variable();
  void read_driven();
  VariableMotion checked_motion(std::uint32_t handle, std::uint32_t kind, const VariableMotion& numbers,
                                const std::string& what) const;
  void read_array(const RecordHeader& header);
  void add_array(Kind kind, std::uint32_t basis, void* to, std::size_t entry_bytes, std::size_t count);
  void check_size() const;
  void allocate();
  void check_handles() const;
  void check_variables() const;
  void check_points() const;
  void decode_bases();
  std::string name_after(std::size_t numbers) const;

  ByteSource& source_;
  std::uint64_t left_;  ///< bytes of the file
  Head head_;
  Content content_;
  std::uint32_t driven_ = 0;  ///< other handles of variables that have come
  std::vector<Array> arrays_;
  std::vector<std::byte> payload_;
  std::vector<std::byte> headers_;
};

void Parser::take(void* to, std::size_t bytes) {
  if (bytes > left_) damaged("it ends in the middle of a record");
  source_.read({static_cast<std::byte*>(to), bytes});
  left_ -= bytes;
}

void Parser::read_preamble() {
  const std::uint64_t size = left_;
  Preamble preamble;
  if (size < sizeof preamble) damaged("a file of " + std::to_string(size) + " bytes is none");
  take(&preamble, sizeof preamble);
  if (preamble.magic != magic) damaged("the file does not begin like one");
  if (preamble.version != layout_version) {
    throw Error(ErrorCode::failed_precondition, "compiled deformation: its layout has version " +
                                                    std::to_string(preamble.version) + ", this program reads version " +
                                                    std::to_string(layout_version) + "; compile it again");
  }
  if (preamble.bytes != size) {
    damaged("the file has " + std::to_string(size) + " bytes, it was written with " + std::to_string(preamble.bytes));
  }
}

/// What the head announces must have room in the file, so that nothing larger is allocated.
void Parser::check_size() const {
  const std::uint64_t most = left_;
  std::uint64_t needed = 0;
  const auto need = [&](std::uint64_t count, std::uint64_t bytes, const char* what) {
    if (bytes != 0 && count > (most - needed) / bytes) {
      damaged("HEAD: " + std::to_string(count) + " " + what + " do not fit into the file");
    }
    needed += count * bytes;
  };
  need(head_.handles, sizeof(RecordHeader) + sizeof(HandleNumbers), "handles");
  need(head_.variables, sizeof(RecordHeader) + sizeof(VariableNumbers), "variables");
  need(head_.driven, sizeof(RecordHeader) + sizeof(DrivenNumbers), "other handles of variables");
  need(head_.points, sizeof(Vec3) + sizeof(std::uint32_t) + (head_.planes > 0 ? 1 : 0), "points");
  need(head_.controls, sizeof(Control), "control points");
  need(head_.pairs, sizeof(Pair), "pairs");
  need(head_.setup_bytes, 1, "bytes of the setup");
  if (head_.following > head_.points) damaged("HEAD: more points follow than there are");
  const std::uint64_t fields = 4 * std::uint64_t{head_.handles};
  for (std::uint32_t b = 0; b < head_.bases; ++b) {
    need(fields, 3 * sizeof(double), "fields");
    need(head_.error_points, fields * sizeof(double), "points with errors");
    const std::uint64_t codes = head_.code_bytes[b];
    need(codes, 1, "bytes of codes");
    if (codes == 0) need((head_.following + tile_points - 1) / tile_points, tile_points * fields * sizeof(double), "tiles");
  }
}

void Parser::read_head() {
  if (payload_.size() != sizeof(Head)) damaged("HEAD: has " + std::to_string(payload_.size()) + " bytes");
  head_ = number_at<Head>(payload_.data());
  const auto refuse = [](const std::string& what) { damaged("HEAD: " + what); };
  if (head_.handles == 0 || head_.handles > 0xffffffu) refuse(std::to_string(head_.handles) + " handles");
  if (head_.points == 0 || head_.points > following_region) refuse(std::to_string(head_.points) + " points");
  if (head_.bases == 0 || head_.bases > most_bases) refuse(std::to_string(head_.bases) + " bases");
  if (head_.planes > most_planes) refuse(std::to_string(head_.planes) + " symmetry planes");
  if ((head_.flags & ~std::uint32_t{flag_converged | flag_held | flag_sector | flag_misfits}) != 0) refuse("unknown flags");
  const bool sector = (head_.flags & flag_sector) != 0;
  if (sector && head_.planes > 0) refuse("symmetry planes of a sector");
  std::uint32_t seen = 0;
  for (std::uint32_t b = 0; b < head_.bases; ++b) {
    const std::uint32_t components = head_.components[b];
    if (sector && components == turned_components && seen == 7 && b + 1 == head_.bases) continue;
    if (components == 0 || components > 7 || (components & seen) != 0) refuse("components of basis " + std::to_string(b));
    seen |= components;
  }
  if (seen != 7) refuse("a component of the displacement has no basis");
  for (const double number : {head_.diagonal, head_.largest_coordinate, head_.error_margin, head_.allowed_error, head_.condition,
                              head_.reach[0], head_.reach[1], head_.reach[2]}) {
    if (!(number >= 0) || !std::isfinite(number)) refuse("a length that is negative or not finite");
  }
  if (!(head_.scale > 0) || !std::isfinite(head_.scale) || !is_finite(head_.origin)) refuse("unit coordinates");
  if (!orthonormal(head_.plane_axes)) refuse("axes of the symmetry planes");
  check_size();
  allocate();
}

void Parser::add_array(Kind kind, std::uint32_t basis, void* to, std::size_t entry_bytes, std::size_t count) {
  arrays_.push_back({kind, basis, static_cast<std::byte*>(to), entry_bytes, count});
}

void Parser::allocate() {
  Content& c = content_;
  c.geometry_id = hexadecimal(head_.geometry_id);
  c.system_id = hexadecimal(head_.system_id);
  c.diagonal = head_.diagonal;
  c.largest_coordinate = head_.largest_coordinate;
  c.origin = head_.origin;
  c.scale = head_.scale;
  c.error_margin = head_.error_margin;
  c.allowed_error = head_.allowed_error;
  c.condition = head_.condition;
  c.converged = (head_.flags & flag_converged) != 0;
  c.held = (head_.flags & flag_held) != 0;
  c.misfits = (head_.flags & flag_misfits) != 0;
  c.planes = head_.planes;
  c.sector = (head_.flags & flag_sector) != 0;
  c.plane_axes = head_.plane_axes;
  c.reach = head_.reach;
  c.setup.resize(head_.setup_bytes);
  c.rest.resize(head_.points);
  c.regions.resize(head_.points);
  c.on_planes.resize(head_.planes > 0 ? head_.points : 0);
  c.controls.resize(head_.controls);
  c.coincident.resize(head_.pairs);
  c.bases.resize(head_.bases);
  add_array(Kind::setup, 0, c.setup.data(), 1, c.setup.size());
  add_array(Kind::rest, 0, c.rest.data(), sizeof(Vec3), c.rest.size());
  add_array(Kind::region, 0, c.regions.data(), sizeof(std::uint32_t), c.regions.size());
  add_array(Kind::plane, 0, c.on_planes.data(), 1, c.on_planes.size());
  add_array(Kind::control, 0, c.controls.data(), sizeof(Control), c.controls.size());
  add_array(Kind::pair, 0, c.coincident.data(), sizeof(Pair), c.coincident.size());
  const std::size_t fields = 4 * std::size_t{head_.handles};
  for (std::uint32_t b = 0; b < head_.bases; ++b) {
    Basis& basis = c.bases[b];
    basis.components = head_.components[b];
    const auto add = [&](Kind kind, std::vector<double>& to, std::size_t count) {
      to.resize(count);
      add_array(kind, b, to.data(), sizeof(double), count);
    };
    add(Kind::residual, basis.residuals, fields);
    add(Kind::more, basis.more, fields);
    add(Kind::compression, basis.compression, fields);
    add(Kind::error, basis.errors, head_.error_points * fields);
    basis.codes.resize(head_.code_bytes[b]);
    add_array(Kind::code, b, basis.codes.data(), 1, basis.codes.size());
    add(Kind::field, basis.values, basis.codes.empty() ? basis_values(head_.following, fields) : 0);
  }
}

std::string Parser::name_after(std::size_t numbers) const {
  return {reinterpret_cast<const char*>(payload_.data()) + numbers, payload_.size() - numbers};
}

void Parser::read_text() {
  if (payload_.size() < sizeof(std::uint32_t)) damaged("TEXT: is cut off");
  const std::size_t key_bytes = number_at<std::uint32_t>(payload_.data()), at = sizeof(std::uint32_t);
  if (key_bytes > payload_.size() - at) damaged("TEXT: is cut off");
  const std::string both = name_after(at), key = both.substr(0, key_bytes);
  const std::string value = both.substr(key_bytes);
  if (key == "creator") content_.creator = value;
  if (key == "method") content_.method = value;
  if (key == "mesh") content_.mesh = value;
  if (key == "note") content_.notes.push_back(value);
  if (key == "reduction_error") {
    double& error = content_.reduction_error;
    const char* const end = value.data() + value.size();
    const auto read = std::from_chars(value.data(), end, error);
    if (read.ec != std::errc() || read.ptr != end || !std::isfinite(error) || error < 0) damaged("TEXT: reduction_error");
  }
}

void Parser::read_handle() {
  const std::string what = "HAND " + std::to_string(content_.handles.size());
  if (content_.handles.size() == head_.handles) damaged(what + ": the head has fewer handles");
  if (payload_.size() < sizeof(HandleNumbers)) damaged(what + ": is cut off");
  const auto numbers = number_at<HandleNumbers>(payload_.data());
  if (!is_finite(numbers.reference) || !orthonormal(numbers.axes)) damaged(what + ": its frame");
  content_.handles.push_back({name_after(sizeof numbers), numbers.points, numbers.reference, numbers.axes});
}

/// The motion of a handle with the kind put in.
VariableMotion Parser::checked_motion(std::uint32_t handle, std::uint32_t kind, const VariableMotion& numbers,
                                      const std::string& what) const {
  if (handle >= head_.handles) {
    damaged(what + ": handle " + std::to_string(handle) + ", there are " + std::to_string(head_.handles));
  }
  if (kind > static_cast<std::uint32_t>(MotionKind::scaling)) damaged(what + ": kind " + std::to_string(kind));
  VariableMotion motion = numbers;
  motion.kind = static_cast<MotionKind>(kind);
  const double length = norm(motion.vector);
  const bool directed = std::isnormal(length) || (motion.kind == MotionKind::scaling && length == 0);
  if (!is_finite(motion.vector) || !is_finite(motion.centre) || !directed) damaged(what + ": its motion");
  const bool in_units = motion.kind == MotionKind::rotation ? motion.unit > 0 && std::isfinite(motion.unit) : motion.unit == 1;
  if (!in_units) damaged(what + ": its unit");
  return motion;
}

void Parser::read_variable() {
  const std::string what = "VARI " + std::to_string(content_.variables.size());
  if (content_.variables.size() == head_.variables) damaged(what + ": the head has fewer variables");
  if (payload_.size() < sizeof(VariableNumbers)) damaged(what + ": is cut off");
  const auto numbers = number_at<VariableNumbers>(payload_.data());
  const VariableMotion motion =
      checked_motion(numbers.handle, numbers.kind, {{}, numbers.vector, numbers.centre, numbers.unit}, what);
  if (!(numbers.lower <= 0 && numbers.upper >= 0)) damaged(what + ": its bounds");
  content_.variables.push_back({name_after(sizeof numbers), numbers.handle, motion, numbers.lower, numbers.upper});
}

void Parser::read_driven() {
  const std::string what = "ALSO " + std::to_string(driven_);
  if (driven_ == head_.driven) damaged(what + ": the head has fewer of them");
  if (payload_.size() != sizeof(DrivenNumbers)) damaged(what + ": has " + std::to_string(payload_.size()) + " bytes");
  const auto numbers = number_at<DrivenNumbers>(payload_.data());
  if (numbers.variable >= content_.variables.size()) {
    damaged(what + ": variable " + std::to_string(numbers.variable) + ", " + std::to_string(content_.variables.size()) +
            " have come");
  }
  const VariableMotion motion =
      checked_motion(numbers.handle, numbers.kind, {{}, numbers.vector, numbers.centre, numbers.unit}, what);
  content_.variables[numbers.variable].also.push_back({numbers.handle, motion});
  ++driven_;
}

void Parser::read_array(const RecordHeader& header) {
  const std::string what = text_of(static_cast<std::uint32_t>(header.kind));
  const auto found = std::find_if(arrays_.begin(), arrays_.end(),
                                  [&](const Array& array) { return array.kind == header.kind && array.basis == header.basis; });
  if (found == arrays_.end()) {
    damaged(what + " " + std::to_string(header.basis) + ": no record of this version");
  }
  std::uint64_t first = 0;
  if (payload_.size() < sizeof first) damaged(what + ": is cut off");
  first = number_at<std::uint64_t>(payload_.data());
  const std::size_t bytes = payload_.size() - sizeof first, count = bytes / found->entry_bytes;
  if (bytes % found->entry_bytes != 0 || first != found->filled || count > found->count - found->filled) {
    damaged(what + ": " + std::to_string(bytes) + " bytes at entry " + std::to_string(first) + " of " +
            std::to_string(found->count) + ", of which " + std::to_string(found->filled) + " have come");
  }
  if (bytes > 0) std::memcpy(found->to + first * found->entry_bytes, payload_.data() + sizeof first, bytes);
  found->filled += count;
}

/// False after the last one.
bool Parser::read_record() {
  RecordHeader header;
  take(&header, sizeof header);
  const std::string what = text_of(static_cast<std::uint32_t>(header.kind));
  if (header.bytes > most_payload || padded(header.bytes) > left_) {
    damaged(what + ": a record of " + std::to_string(header.bytes) + " bytes, " + std::to_string(left_) +
            " are left, the limit is " + std::to_string(most_payload));
  }
  payload_.resize(padded(header.bytes));
  if (!payload_.empty()) take(payload_.data(), payload_.size());
  payload_.resize(header.bytes);
  if (checksum(payload_) != header.checksum) damaged(what + ": its checksum is another one");
  if ((header.kind == Kind::head) != headers_.empty()) damaged(what + ": the head comes first, and once");
  if (header.kind == Kind::end) {
    if (payload_.size() != sizeof(std::uint64_t) || number_at<std::uint64_t>(payload_.data()) != checksum(headers_)) {
      damaged("ENDS: the checksum of the records is another one");
    }
    return false;
  }
  const auto* bytes = reinterpret_cast<const std::byte*>(&header);
  headers_.insert(headers_.end(), bytes, bytes + sizeof header);
  switch (header.kind) {
    case Kind::head:
      read_head();
      break;
    case Kind::text:
      read_text();
      break;
    case Kind::handle:
      read_handle();
      break;
    case Kind::variable:
      read_variable();
      break;
    case Kind::also:
      read_driven();
      break;
    default:
      read_array(header);
  }
  return true;
}

void Parser::check_handles() const {
  if (content_.handles.size() != head_.handles) {
    damaged(std::to_string(content_.handles.size()) + " of " + std::to_string(head_.handles) + " handles are there");
  }
  for (const Control& control : content_.controls) {
    if (control.handle >= head_.handles || !is_finite(control.place)) damaged("CTRL: a handle or place");
  }
}

void Parser::check_variables() const {
  if (content_.variables.size() != head_.variables) {
    damaged(std::to_string(content_.variables.size()) + " of " + std::to_string(head_.variables) + " variables are there");
  }
  if (driven_ != head_.driven) {
    damaged(std::to_string(driven_) + " of " + std::to_string(head_.driven) + " other handles of variables are there");
  }
  for (std::size_t k = 0; k < content_.variables.size(); ++k) {
    const Variable& variable = content_.variables[k];
    std::vector<std::uint32_t> moved{variable.handle};
    for (const Driven& driven : variable.also) moved.push_back(driven.handle);
    std::sort(moved.begin(), moved.end());
    if (std::adjacent_find(moved.begin(), moved.end()) != moved.end()) {
      damaged("ALSO: variable " + std::to_string(k) + " moves a handle twice");
    }
  }
}

void Parser::check_points() const {
  std::uint64_t following = 0;
  for (std::size_t i = 0; i < content_.points(); ++i) {
    const std::uint32_t region = content_.regions[i];
    if (!is_finite(content_.rest[i])) damaged("REST: point " + std::to_string(i) + " is not finite");
    if (region >= head_.handles && region != fixed_region && region != following_region) {
      damaged("REGI: point " + std::to_string(i) + " is of handle " + std::to_string(region) + ", there are " +
              std::to_string(head_.handles));
    }
    if (region == following_region) ++following;
  }
  if (!content_.held) following = content_.points();
  if (following != head_.following) {
    damaged("REGI: " + std::to_string(following) + " points follow, HEAD has " + std::to_string(head_.following));
  }
  for (std::size_t i = 0; i < content_.on_planes.size(); ++i) {
    if (content_.on_planes[i] >> content_.planes != 0) damaged("PLAN: point " + std::to_string(i) + " lies on unknown planes");
  }
  for (const Pair& pair : content_.coincident) {
    for (const std::uint32_t id : {pair.first, pair.second}) {
      if (id >= content_.points() || content_.regions[id] == following_region) {
        damaged("PAIR: point " + std::to_string(id) + " is no point of a handle or fixed region");
      }
    }
  }
}

void Parser::decode_bases() {
  std::vector<Vec3> places;
  for (Basis& basis : content_.bases) {
    if (basis.codes.empty()) continue;
    if (places.empty()) places = following_places(content_);
    basis.values = decoded_fields(basis.codes, places, content_.fields());
    std::vector<std::byte>().swap(basis.codes);
  }
}

Content Parser::parse() {
  read_preamble();
  while (read_record()) {
  }
  if (left_ != 0) damaged(std::to_string(left_) + " bytes follow its last record");
  for (const Array& array : arrays_) {
    if (array.filled == array.count) continue;
    damaged(text_of(static_cast<std::uint32_t>(array.kind)) + " " + std::to_string(array.basis) + ": " +
            std::to_string(array.filled) + " of " + std::to_string(array.count) + " entries are there");
  }
  check_handles();
  check_variables();
  check_points();
  decode_bases();
  return std::move(content_);
}

class MemorySource : public ByteSource {
 public:
  explicit MemorySource(std::span<const std::byte> bytes) : bytes_(bytes), size_(bytes.size()) {}
  std::uint64_t size() const override { return size_; }
  void read(std::span<std::byte> out) override {
    if (out.size() > bytes_.size()) damaged("it is cut off");
    std::memcpy(out.data(), bytes_.data(), out.size());
    bytes_ = bytes_.subspan(out.size());
  }

 private:
  std::span<const std::byte> bytes_;
  const std::uint64_t size_;
};

class FileSource : public ByteSource {
 public:
  explicit FileSource(const std::filesystem::path& file) : stream_(file, std::ios::binary) {
    const std::error_code opened = stream_ ? std::error_code() : std::error_code(errno, std::generic_category());
    std::error_code error;
    size_ = std::filesystem::file_size(file, error);
    if (error || opened)
      throw Error(ErrorCode::not_found, file.string() + ": cannot be read: " + (error ? error : opened).message());
  }
  std::uint64_t size() const override { return size_; }
  void read(std::span<std::byte> out) override {
    stream_.read(reinterpret_cast<char*>(out.data()), static_cast<std::streamsize>(out.size()));
    if (!stream_) damaged("it is cut off");
  }

 private:
  std::ifstream stream_;
  std::uint64_t size_ = 0;
};

}  // namespace

Content read_content(ByteSource& source) { return Parser(source).parse(); }

Content read_content(std::span<const std::byte> bytes) {
  MemorySource source(bytes);
  return read_content(source);
}

Content read_content(const std::filesystem::path& file) {
  FileSource source(file);
  return read_content(source);
}

}  // namespace deform::compiled
