// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>

#include "core/compiled/content.h"

// The bytes of a file, as docs/compiled.md describes them.

namespace deform::compiled {

static_assert(std::endian::native == std::endian::little, "files are little endian, and their arrays are copied as they are");
static_assert(sizeof(Vec3) == 24 && sizeof(Control) == 32 && sizeof(Pair) == 8);

inline constexpr std::array<char, 8> magic{'\x89', 'D', 'E', 'F', 'O', 'R', 'M', '\n'};

/// The first bytes of a file.
struct Preamble {
  std::array<char, 8> magic = compiled::magic;
  std::uint32_t version = layout_version;
  std::uint32_t zero = 0;
  std::uint64_t bytes = 0;  ///< of the file
};
static_assert(sizeof(Preamble) == 24);

constexpr std::uint32_t record_kind(const char (&letters)[5]) {
  std::uint32_t kind = 0;
  for (std::size_t i = 0; i < 4; ++i) kind |= static_cast<std::uint32_t>(static_cast<unsigned char>(letters[i])) << (8 * i);
  return kind;
}

enum class Kind : std::uint32_t {
  head = record_kind("HEAD"),      ///< Head
  text = record_kind("TEXT"),      ///< length of the key, key, value
  handle = record_kind("HAND"),    ///< HandleNumbers, name
  variable = record_kind("VARI"),  ///< VariableNumbers, name
  also = record_kind("ALSO"),      ///< DrivenNumbers
  setup = record_kind("SETU"),     ///< the arrays: position of the first entry, entries
  rest = record_kind("REST"),
  region = record_kind("REGI"),
  plane = record_kind("PLAN"),
  control = record_kind("CTRL"),
  pair = record_kind("PAIR"),
  residual = record_kind("RESI"),
  more = record_kind("MORE"),
  compression = record_kind("COMP"),
  error = record_kind("ERRO"),
  field = record_kind("FLDS"),
  code = record_kind("CODE"),
  end = record_kind("ENDS"),  ///< checksum of the headers of all records before it
};

/// Before the payload of a record, which is filled up with zeros to a multiple of 8 bytes.
struct RecordHeader {
  Kind kind = Kind::end;
  std::uint32_t basis = 0;     ///< that an array belongs to, else 0
  std::uint64_t bytes = 0;     ///< of the payload
  std::uint64_t checksum = 0;  ///< of the payload
};
static_assert(sizeof(RecordHeader) == 24);

inline constexpr std::size_t most_payload = std::size_t{1} << 20;  ///< bytes

constexpr std::size_t padded(std::size_t bytes) { return (bytes + 7) / 8 * 8; }

enum HeadFlags : std::uint32_t { flag_converged = 1, flag_held = 2, flag_sector = 4, flag_misfits = 8 };

struct Head {
  std::uint32_t flags = 0;
  std::uint32_t handles = 0, variables = 0, bases = 0, planes = 0, driven = 0;
  std::uint64_t points = 0, following = 0, controls = 0, pairs = 0;
  std::uint64_t error_points = 0;  ///< at which every basis has errors
  std::uint64_t setup_bytes = 0;
  std::uint32_t components[most_bases] = {};
  double diagonal = 0, largest_coordinate = 0, error_margin = 0, allowed_error = 0, condition = 0, scale = 0;
  Vec3 origin{};
  std::array<Vec3, 3> plane_axes{};
  std::array<double, most_planes> reach{};
  std::array<std::uint8_t, 32> geometry_id{}, system_id{};
  std::uint64_t code_bytes[most_bases] = {};  ///< of bases that are coded, else 0
};
static_assert(sizeof(Head) == 24 + 6 * 8 + 32 + 6 * 8 + 24 + 72 + 24 + 64 + 64);

struct HandleNumbers {
  std::uint64_t points = 0;
  Vec3 reference{};
  std::array<Vec3, 3> axes{};
};
static_assert(sizeof(HandleNumbers) == 104);

struct VariableNumbers {
  std::uint32_t handle = 0;
  std::uint32_t kind = 0;
  Vec3 vector{}, centre{};
  double lower = 0, upper = 0;
  double unit = 1;
};
static_assert(sizeof(VariableNumbers) == 80);

struct DrivenNumbers {
  std::uint32_t variable = 0, zero = 0;  ///< number of a variable before it
  std::uint32_t handle = 0;
  std::uint32_t kind = 0;
  Vec3 vector{}, centre{};
  double unit = 1;
};
static_assert(sizeof(DrivenNumbers) == 72);

}  // namespace deform::compiled
