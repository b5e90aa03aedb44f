// SPDX-License-Identifier: Apache-2.0
#include "core/compiled/records.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <utility>

#include "core/base/error.h"
#include "core/compiled/bytes.h"
#include "core/compiled/checksum.h"
#include "core/compiled/layout.h"

namespace deform::compiled {

namespace {

constexpr std::size_t most_text = std::size_t{64} << 10;
constexpr std::size_t position_bytes = sizeof(std::uint64_t);  // before the entries of an array

[[noreturn]] void refuse_content(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

std::string all_digits(double value) {
  std::array<char, 32> digits{};
  return {digits.data(), std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr};
}

void check_text(const std::string& text, const std::string& what) {
  if (text.size() > most_text) {
    refuse_content(what + ": " + std::to_string(text.size()) + " bytes, the limit of a compiled deformation is " +
                   std::to_string(most_text));
  }
}

std::uint8_t digit(char c, const std::string& what) {
  if (c >= '0' && c <= '9') return static_cast<std::uint8_t>(c - '0');
  if (c >= 'a' && c <= 'f') return static_cast<std::uint8_t>(c - 'a' + 10);
  refuse_content(what + ": expected 64 lower-case hexadecimal digits");
}

std::array<std::uint8_t, 32> id_bytes(const std::string& id, const std::string& what) {
  std::array<std::uint8_t, 32> bytes{};
  if (id.size() != 2 * bytes.size()) refuse_content(what + ": expected 64 lower-case hexadecimal digits");
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<std::uint8_t>(digit(id[2 * i], what) << 4 | digit(id[2 * i + 1], what));
  }
  return bytes;
}

Head head_of(const Content& content) {
  Head head;
  head.flags = (content.converged ? flag_converged : 0u) | (content.held ? flag_held : 0u) | (content.sector ? flag_sector : 0u) |
               (content.misfits ? flag_misfits : 0u);
  head.handles = static_cast<std::uint32_t>(content.handles.size());
  head.variables = static_cast<std::uint32_t>(content.variables.size());
  head.bases = static_cast<std::uint32_t>(content.bases.size());
  head.planes = content.planes;
  for (const Variable& variable : content.variables) head.driven += static_cast<std::uint32_t>(variable.also.size());
  head.points = content.points();
  head.following = following_points(content);
  head.controls = content.controls.size();
  head.pairs = content.coincident.size();
  head.error_points = content.bases.empty() ? 0 : content.bases[0].errors.size() / content.fields();
  head.setup_bytes = content.setup.size();
  for (std::size_t b = 0; b < content.bases.size(); ++b) {
    head.components[b] = content.bases[b].components;
    head.code_bytes[b] = content.bases[b].codes.size();
  }
  head.diagonal = content.diagonal;
  head.largest_coordinate = content.largest_coordinate;
  head.error_margin = content.error_margin;
  head.allowed_error = content.allowed_error;
  head.condition = content.condition;
  head.scale = content.scale;
  head.origin = content.origin;
  head.plane_axes = content.plane_axes;
  head.reach = content.reach;
  head.geometry_id = id_bytes(content.geometry_id, "geometry_id");
  head.system_id = id_bytes(content.system_id, "system_id");
  return head;
}

/// Some entries of an array.
template <typename T>
void copy(const std::vector<T>& from, std::size_t first, std::size_t count, std::byte* to) {
  std::memcpy(to, from.data() + first, count * sizeof(T));
}

template <typename Numbers>
void put(const Numbers& numbers, const std::string& name, std::byte* to) {
  std::memcpy(to, &numbers, sizeof numbers);
  std::memcpy(to + sizeof numbers, name.data(), name.size());
}

Records::Values stored_values(const Content& content) {
  return [&content](std::size_t basis, std::size_t first, std::span<double> out) {
    std::copy_n(content.bases[basis].values.begin() + static_cast<std::ptrdiff_t>(first), out.size(), out.begin());
  };
}

}  // namespace

Records::Records(const Content& content) : Records(content, stored_values(content)) {}

Records::Records(const Content& content, Values values) : content_(content), values_(std::move(values)) {
  if (content.bases.empty() || content.bases.size() > most_bases) {
    refuse_content("bases: " + std::to_string(content.bases.size()) + ", expected 1 to " + std::to_string(most_bases));
  }
  head_of(content);  // refuses what has no form
  const auto number = [](Kind kind) { return static_cast<std::uint32_t>(kind); };
  texts_ = {{"creator", content.creator}, {"method", content.method}, {"mesh", content.mesh}};
  if (content.reduction_error != 0) texts_.emplace_back("reduction_error", all_digits(content.reduction_error));
  for (const std::string& note : content.notes) texts_.emplace_back("note", note);
  plan(number(Kind::head), 0, sizeof(Head));
  for (std::size_t i = 0; i < texts_.size(); ++i) {
    check_text(texts_[i].second, texts_[i].first);
    plan(number(Kind::text), i, sizeof(std::uint32_t) + texts_[i].first.size() + texts_[i].second.size());
  }
  for (std::size_t h = 0; h < content.handles.size(); ++h) {
    check_text(content.handles[h].name, "handles[" + std::to_string(h) + "].name");
    plan(number(Kind::handle), h, sizeof(HandleNumbers) + content.handles[h].name.size());
  }
  for (std::size_t k = 0; k < content.variables.size(); ++k) {
    check_text(content.variables[k].name, "variables[" + std::to_string(k) + "].name");
    plan(number(Kind::variable), k, sizeof(VariableNumbers) + content.variables[k].name.size());
  }
  for (std::uint32_t k = 0; k < content.variables.size(); ++k) {
    for (const Driven& driven : content.variables[k].also) {
      plan(number(Kind::also), driven_.size(), sizeof(DrivenNumbers));
      driven_.emplace_back(k, &driven);
    }
  }
  const std::size_t n = content.points(), fields = content.fields();
  plan_array(number(Kind::setup), 0, content.setup.size(), 1);
  plan_array(number(Kind::rest), 0, n, sizeof(Vec3));
  plan_array(number(Kind::region), 0, n, sizeof(std::uint32_t));
  plan_array(number(Kind::plane), 0, content.on_planes.size(), 1);
  plan_array(number(Kind::control), 0, content.controls.size(), sizeof(Control));
  plan_array(number(Kind::pair), 0, content.coincident.size(), sizeof(Pair));
  const std::size_t following = following_points(content);
  for (std::uint32_t b = 0; b < content.bases.size(); ++b) {
    plan_array(number(Kind::residual), b, fields, sizeof(double));
    plan_array(number(Kind::more), b, fields, sizeof(double));
    plan_array(number(Kind::compression), b, fields, sizeof(double));
    plan_array(number(Kind::error), b, content.bases[b].errors.size(), sizeof(double));
    plan_array(number(Kind::code), b, content.bases[b].codes.size(), 1);
    if (content.bases[b].codes.empty()) plan_array(number(Kind::field), b, basis_values(following, fields), sizeof(double));
  }
  plan(number(Kind::end), 0, sizeof(std::uint64_t));
  bytes_ = sizeof(Preamble);
  for (const Item& item : items_) bytes_ += sizeof(RecordHeader) + padded(item.payload);
}

void Records::plan(std::uint32_t kind, std::size_t first, std::size_t payload) { items_.push_back({kind, 0, first, 1, payload}); }

void Records::plan_array(std::uint32_t kind, std::uint32_t basis, std::size_t count, std::size_t entry_bytes) {
  const std::size_t most = (piece_bytes / 2 - position_bytes) / entry_bytes;
  for (std::size_t first = 0; first < count; first += most) {
    const std::size_t entries = std::min(most, count - first);
    items_.push_back({kind, basis, first, entries, position_bytes + entries * entry_bytes});
  }
}

void Records::fill_array(const Item& item, std::byte* entries) const {
  const auto doubles = [&](const std::vector<double>& from) {
    if (from.empty()) {
      std::fill_n(entries, item.count * sizeof(double), std::byte{0});
    } else {
      copy(from, item.first, item.count, entries);
    }
  };
  switch (static_cast<Kind>(item.kind)) {
    case Kind::setup:
      std::memcpy(entries, content_.setup.data() + item.first, item.count);
      return;
    case Kind::rest:
      return copy(content_.rest, item.first, item.count, entries);
    case Kind::region:
      return copy(content_.regions, item.first, item.count, entries);
    case Kind::plane:
      return copy(content_.on_planes, item.first, item.count, entries);
    case Kind::pair:
      return copy(content_.coincident, item.first, item.count, entries);
    case Kind::control:
      std::fill_n(entries, item.count * sizeof(Control), std::byte{0});
      for (std::size_t i = 0; i < item.count; ++i) {
        const Control& control = content_.controls[item.first + i];
        std::memcpy(entries + i * sizeof(Control), &control.handle, sizeof control.handle);
        std::memcpy(entries + i * sizeof(Control) + 8, &control.place, sizeof control.place);
      }
      return;
    case Kind::residual:
      return doubles(content_.bases[item.basis].residuals);
    case Kind::more:
      return doubles(content_.bases[item.basis].more);
    case Kind::compression:
      return doubles(content_.bases[item.basis].compression);
    case Kind::error:
      return doubles(content_.bases[item.basis].errors);
    case Kind::code:
      return copy(content_.bases[item.basis].codes, item.first, item.count, entries);
    case Kind::field:
      return values_(item.basis, item.first, std::span(reinterpret_cast<double*>(entries), item.count));
    default:
      throw Error(ErrorCode::internal, "compiled deformation: a record that is no array");
  }
}

void Records::fill(const Item& item, std::byte* payload) {
  switch (static_cast<Kind>(item.kind)) {
    case Kind::head: {
      const Head head = head_of(content_);
      std::memcpy(payload, &head, sizeof head);
      return;
    }
    case Kind::text: {
      const auto& [key, value] = texts_[item.first];
      put(static_cast<std::uint32_t>(key.size()), key, payload);
      std::memcpy(payload + sizeof(std::uint32_t) + key.size(), value.data(), value.size());
      return;
    }
    case Kind::handle: {
      const Handle& handle = content_.handles[item.first];
      return put(HandleNumbers{handle.points, handle.reference, handle.axes}, handle.name, payload);
    }
    case Kind::variable: {
      const Variable& v = content_.variables[item.first];
      const auto kind = static_cast<std::uint32_t>(v.motion.kind);
      return put(VariableNumbers{v.handle, kind, v.motion.vector, v.motion.centre, v.lower, v.upper, v.motion.unit}, v.name,
                 payload);
    }
    case Kind::also: {
      const auto& [variable, driven] = driven_[item.first];
      const VariableMotion& motion = driven->motion;
      const DrivenNumbers numbers{
          variable, 0, driven->handle, static_cast<std::uint32_t>(motion.kind), motion.vector, motion.centre, motion.unit};
      std::memcpy(payload, &numbers, sizeof numbers);
      return;
    }
    case Kind::end: {
      const std::uint64_t sum = checksum(headers_);
      std::memcpy(payload, &sum, sizeof sum);
      return;
    }
    default:
      break;
  }
  const std::uint64_t first = item.first;
  std::memcpy(payload, &first, sizeof first);
  fill_array(item, payload + position_bytes);
}

void Records::append(const Item& item, std::vector<std::byte>& piece) {
  const std::size_t at = piece.size();
  piece.resize(at + sizeof(RecordHeader) + padded(item.payload));  // zeros
  std::byte* const payload = piece.data() + at + sizeof(RecordHeader);
  fill(item, payload);
  const RecordHeader header{static_cast<Kind>(item.kind), item.basis, item.payload, checksum({payload, item.payload})};
  std::memcpy(piece.data() + at, &header, sizeof header);
  headers_.insert(headers_.end(), piece.data() + at, piece.data() + at + sizeof header);
}

bool Records::next(std::vector<std::byte>& piece) {
  piece.clear();
  if (next_ == items_.size()) return false;
  if (next_ == 0) {
    Preamble preamble;
    preamble.bytes = bytes_;
    piece.resize(sizeof preamble);
    std::memcpy(piece.data(), &preamble, sizeof preamble);
  }
  do {
    append(items_[next_++], piece);
  } while (next_ < items_.size() && piece.size() + sizeof(RecordHeader) + padded(items_[next_].payload) <= piece_bytes);
  return true;
}

}  // namespace deform::compiled
