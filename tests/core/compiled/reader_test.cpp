// SPDX-License-Identifier: GPL-3.0-or-later
// Files read as they were written, and what becomes of files that nobody wrote.
#include "core/compiled/reader.h"

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <span>
#include <string>

#include "core/compiled/checksum.h"
#include "core/compiled/layout.h"
#include "tests/core/compiled/contents.h"
#include "tests/support/expect_error.h"

namespace deform::compiled::reader_test {
namespace {

using deform::test::expect_error;

void expect_same(const Content& a, const Content& b) {
  EXPECT_EQ(a.geometry_id, b.geometry_id);
  EXPECT_EQ(a.system_id, b.system_id);
  EXPECT_EQ(a.creator, b.creator);
  EXPECT_EQ(a.method, b.method);
  EXPECT_EQ(a.mesh, b.mesh);
  EXPECT_EQ(a.notes, b.notes);
  EXPECT_EQ(a.setup, b.setup);
  EXPECT_EQ(a.diagonal, b.diagonal);
  EXPECT_EQ(a.largest_coordinate, b.largest_coordinate);
  EXPECT_EQ(a.origin, b.origin);
  EXPECT_EQ(a.scale, b.scale);
  EXPECT_EQ(a.error_margin, b.error_margin);
  EXPECT_EQ(a.allowed_error, b.allowed_error);
  EXPECT_EQ(a.condition, b.condition);
  EXPECT_EQ(a.converged, b.converged);
  EXPECT_EQ(a.held, b.held);
  EXPECT_EQ(a.misfits, b.misfits);
  EXPECT_EQ(a.planes, b.planes);
  EXPECT_EQ(a.plane_axes, b.plane_axes);
  EXPECT_EQ(a.reach, b.reach);
  EXPECT_EQ(a.rest, b.rest);
  EXPECT_EQ(a.regions, b.regions);
  EXPECT_EQ(a.on_planes, b.on_planes);
  ASSERT_EQ(a.handles.size(), b.handles.size());
  for (std::size_t h = 0; h < a.handles.size(); ++h) {
    EXPECT_EQ(a.handles[h].name, b.handles[h].name);
    EXPECT_EQ(a.handles[h].points, b.handles[h].points);
    EXPECT_EQ(a.handles[h].reference, b.handles[h].reference);
    EXPECT_EQ(a.handles[h].axes, b.handles[h].axes);
  }
  ASSERT_EQ(a.variables.size(), b.variables.size());
  for (std::size_t k = 0; k < a.variables.size(); ++k) {
    EXPECT_EQ(a.variables[k].name, b.variables[k].name);
    EXPECT_EQ(a.variables[k].handle, b.variables[k].handle);
    EXPECT_EQ(a.variables[k].motion.kind, b.variables[k].motion.kind);
    EXPECT_EQ(a.variables[k].motion.vector, b.variables[k].motion.vector);
    EXPECT_EQ(a.variables[k].motion.centre, b.variables[k].motion.centre);
    EXPECT_EQ(a.variables[k].motion.unit, b.variables[k].motion.unit);
    ASSERT_EQ(a.variables[k].also.size(), b.variables[k].also.size());
    for (std::size_t i = 0; i < a.variables[k].also.size(); ++i) {
      const Driven &one = a.variables[k].also[i], &other = b.variables[k].also[i];
      EXPECT_EQ(one.handle, other.handle);
      EXPECT_EQ(one.motion.kind, other.motion.kind);
      EXPECT_EQ(one.motion.vector, other.motion.vector);
      EXPECT_EQ(one.motion.centre, other.motion.centre);
      EXPECT_EQ(one.motion.unit, other.motion.unit);
    }
    EXPECT_EQ(a.variables[k].lower, b.variables[k].lower);
    EXPECT_EQ(a.variables[k].upper, b.variables[k].upper);
  }
  ASSERT_EQ(a.controls.size(), b.controls.size());
  for (std::size_t i = 0; i < a.controls.size(); ++i) {
    EXPECT_EQ(a.controls[i].handle, b.controls[i].handle);
    EXPECT_EQ(a.controls[i].place, b.controls[i].place);
  }
  ASSERT_EQ(a.coincident.size(), b.coincident.size());
  for (std::size_t i = 0; i < a.coincident.size(); ++i) {
    EXPECT_EQ(a.coincident[i].first, b.coincident[i].first);
    EXPECT_EQ(a.coincident[i].second, b.coincident[i].second);
  }
  ASSERT_EQ(a.bases.size(), b.bases.size());
  for (std::size_t i = 0; i < a.bases.size(); ++i) {
    EXPECT_EQ(a.bases[i].components, b.bases[i].components);
    EXPECT_EQ(a.bases[i].residuals, b.bases[i].residuals);
    EXPECT_EQ(a.bases[i].more, b.bases[i].more);
    EXPECT_EQ(a.bases[i].compression, b.bases[i].compression);
    EXPECT_EQ(a.bases[i].errors, b.bases[i].errors);
    EXPECT_EQ(a.bases[i].values, b.bases[i].values);
  }
}

/// Headers and payloads of a file, to be changed and put together again with right checksums.
struct Taken {
  explicit Taken(const Content& content) {
    const std::vector<std::byte> bytes = test::file_of(content);
    for (std::size_t at = sizeof(Preamble); at < bytes.size();) {
      RecordHeader header;
      std::memcpy(&header, bytes.data() + at, sizeof header);
      at += sizeof header;
      headers.push_back(header);
      payloads.emplace_back(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                            bytes.begin() + static_cast<std::ptrdiff_t>(at + header.bytes));
      at += padded(header.bytes);
    }
    headers.pop_back();
    payloads.pop_back();
  }
  std::size_t find(Kind kind, std::size_t skip = 0) const {
    for (std::size_t i = 0; i < headers.size(); ++i) {
      if (headers[i].kind == kind && skip-- == 0) return i;
    }
    ADD_FAILURE() << "no such record";
    return 0;
  }
  template <typename T>
  void set(Kind kind, std::size_t offset, const T& value) {
    std::memcpy(payloads[find(kind)].data() + offset, &value, sizeof value);
  }
  void head(const std::function<void(Head&)>& change) {
    Head value;
    std::memcpy(&value, payloads[0].data(), sizeof value);
    change(value);
    std::memcpy(payloads[0].data(), &value, sizeof value);
  }
  std::vector<std::byte> bytes() const {
    std::vector<std::byte> result(sizeof(Preamble)), all;
    const auto append = [&](std::vector<std::byte>& to, const void* from, std::size_t size) {
      const auto* first = static_cast<const std::byte*>(from);
      to.insert(to.end(), first, first + size);
    };
    const auto put = [&](RecordHeader header, const std::vector<std::byte>& payload) {
      header.bytes = payload.size();
      header.checksum = checksum(payload);
      append(result, &header, sizeof header);
      if (header.kind != Kind::end) append(all, &header, sizeof header);
      append(result, payload.data(), payload.size());
      result.resize(padded(result.size()));
    };
    for (std::size_t i = 0; i < headers.size(); ++i) put(headers[i], payloads[i]);
    const std::uint64_t sum = checksum(all);
    std::vector<std::byte> end;
    append(end, &sum, sizeof sum);
    put({}, end);
    Preamble preamble;
    preamble.bytes = result.size();
    std::memcpy(result.data(), &preamble, sizeof preamble);
    return result;
  }

  std::vector<RecordHeader> headers;
  std::vector<std::vector<std::byte>> payloads;
};

void expect_damaged(const Taken& file, const char* says) {
  const std::vector<std::byte> bytes = file.bytes();
  expect_error(ErrorCode::data_loss, {says}, [&] { read_content(bytes); });
}

TEST(CompiledReader, ReadsWhatWasWritten) {
  for (const std::uint32_t planes : {0u, 1u, 2u}) {
    test::Blend blend(400, planes);
    blend.content.condition = 1e7;
    blend.content.allowed_error = 1e-6;
    blend.content.misfits = planes == 1;
    blend.content.controls = {{1, {1, 2, 3}}};
    blend.content.coincident = {{3, 50}, {3, 51}};
    const std::vector<std::byte> bytes = test::file_of(blend.content);
    EXPECT_EQ(bytes.size(), Records(blend.content).bytes());
    expect_same(read_content(bytes), blend.content);
  }
}

TEST(CompiledReader, SaysWhyAFileCannotBeOpened) {
  expect_error(ErrorCode::not_found, {"/nowhere/car.deformation: cannot be read: No such file or directory"},
               [] { read_content(std::filesystem::path("/nowhere/car.deformation")); });
  const std::filesystem::path folder = std::filesystem::temp_directory_path();
  expect_error(ErrorCode::not_found, {"cannot be read: Is a directory"}, [&] { read_content(folder); });
}

TEST(CompiledReader, LargeArraysAreManyRecords) {
  const test::Blend blend(60000);
  Records records(blend.content);
  std::vector<std::byte> bytes, piece;
  std::size_t pieces = 0;
  while (records.next(piece)) {
    EXPECT_LE(piece.size(), Records::piece_bytes);
    EXPECT_EQ(piece.size() % 8, 0u);
    bytes.insert(bytes.end(), piece.begin(), piece.end());
    ++pieces;
  }
  EXPECT_GT(pieces, 5u);
  EXPECT_EQ(bytes.size(), records.bytes());
  expect_same(read_content(bytes), blend.content);
}

TEST(CompiledReader, RefusesEveryTruncation) {
  const std::vector<std::byte> bytes = test::file_of(test::Blend(120).content);
  for (std::size_t size = 0; size < bytes.size(); size += size < 2000 ? 1 : 97) {
    expect_error(ErrorCode::data_loss, {}, [&] { read_content(std::span(bytes.data(), size)); });
    // The same with a length that is true.
    if (size < sizeof(Preamble)) continue;
    std::vector<std::byte> shorter(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    const std::uint64_t length = size;
    std::memcpy(shorter.data() + 16, &length, sizeof length);
    expect_error(ErrorCode::data_loss, {}, [&] { read_content(shorter); });
  }
}

TEST(CompiledReader, RefusesBytesBehindTheEnd) {
  std::vector<std::byte> bytes = test::file_of(test::Blend(120).content);
  bytes.resize(bytes.size() + 8);
  expect_error(ErrorCode::data_loss, {"it was written with"}, [&] { read_content(bytes); });
  const std::uint64_t length = bytes.size();
  std::memcpy(bytes.data() + 16, &length, sizeof length);
  expect_error(ErrorCode::data_loss, {"8 bytes follow its last record"}, [&] { read_content(bytes); });
}

TEST(CompiledReader, RefusesEveryChangedByteThatCounts) {
  const test::Blend blend(120, 1);
  const std::vector<std::byte> bytes = test::file_of(blend.content);
  std::size_t accepted = 0;
  for (std::size_t i = 0; i < bytes.size(); i += i < 3000 ? 1 : 53) {
    std::vector<std::byte> changed = bytes;
    changed[i] ^= std::byte{0x10};
    try {
      expect_same(read_content(changed), blend.content);  // padding
      ++accepted;
    } catch (const Error& error) {
      EXPECT_TRUE(error.code() == ErrorCode::data_loss || error.code() == ErrorCode::failed_precondition) << error.what();
    }
  }
  EXPECT_LT(accepted, 100u);
}

TEST(CompiledReader, SaysWhatAnotherVersionIs) {
  std::vector<std::byte> bytes = test::file_of(test::Blend(120).content);
  bytes[8] = std::byte{2};
  expect_error(ErrorCode::failed_precondition, {"version 2", "version 1", "compile it again"}, [&] { read_content(bytes); });
}

TEST(CompiledReader, ChecksCountsBeforeItAllocates) {
  const Taken right(test::Blend(120).content);
  const auto refused = [&](const char* says, const std::function<void(Head&)>& change) {
    Taken file = right;
    file.head(change);
    expect_damaged(file, says);
  };
  constexpr std::uint64_t huge = std::uint64_t{1} << 60;
  refused("points", [](Head& head) { head.points = huge; });
  refused("points do not fit", [](Head& head) { head.points = 0xfffffff0u; });
  refused("tiles do not fit", [](Head& head) { head.following = head.points; });
  refused("handles", [](Head& head) { head.handles = 0; });
  refused("handles do not fit", [](Head& head) { head.handles = 0xffffff; });
  refused("variables do not fit", [](Head& head) { head.variables = 0xffffffffu; });
  refused("other handles of variables do not fit", [](Head& head) { head.driven = 0xffffffffu; });
  refused("control points do not fit", [](Head& head) { head.controls = huge; });
  refused("pairs do not fit", [](Head& head) { head.pairs = huge; });
  refused("setup do not fit", [](Head& head) { head.setup_bytes = huge; });
  refused("codes do not fit", [](Head& head) { head.code_bytes[0] = huge; });
  refused("points with errors do not fit", [](Head& head) { head.error_points = huge; });
  refused("more points follow", [](Head& head) { head.following = head.points + 1; });
  refused("bases", [](Head& head) { head.bases = 9; });
  refused("bases", [](Head& head) { head.bases = 0; });
  refused("components of basis 0", [](Head& head) { head.components[0] = 8; });
  refused("no basis", [](Head& head) { head.components[0] = 3; });
  refused("symmetry planes", [](Head& head) { head.planes = 4; });
  refused("unknown flags", [](Head& head) { head.flags = 16; });
  refused("symmetry planes of a sector", [](Head& head) {
    head.flags |= flag_sector;
    head.planes = 1;
  });
  refused("unit coordinates", [](Head& head) { head.scale = 0; });
  for (double Head::*const length :
       {&Head::diagonal, &Head::largest_coordinate, &Head::error_margin, &Head::allowed_error, &Head::condition}) {
    refused("negative or not finite", [&](Head& head) { head.*length = -1; });
    refused("negative or not finite", [&](Head& head) { head.*length = std::numeric_limits<double>::infinity(); });
  }
  for (std::size_t k = 0; k < most_planes; ++k) {
    refused("negative or not finite", [&](Head& head) { head.reach[k] = -1; });
  }
  refused("axes", [](Head& head) { head.plane_axes[1] = {1, 0, 0}; });
}

TEST(CompiledReader, ChecksRecords) {
  const Taken right(test::Blend(120, 1).content);
  EXPECT_NO_THROW(read_content(right.bytes()));
  const auto refused = [&](const char* says, const std::function<void(Taken&)>& change) {
    Taken file = right;
    change(file);
    expect_damaged(file, says);
  };
  const auto drop = [](Taken& file, std::size_t i) {
    file.headers.erase(file.headers.begin() + static_cast<std::ptrdiff_t>(i));
    file.payloads.erase(file.payloads.begin() + static_cast<std::ptrdiff_t>(i));
  };
  refused("the head comes first", [&](Taken& file) { drop(file, 0); });
  refused("1 of 2 handles", [&](Taken& file) { drop(file, file.find(Kind::handle)); });
  refused("4 of 5 variables", [&](Taken& file) { drop(file, file.find(Kind::variable)); });
  refused("1 of 2 other handles", [&](Taken& file) { drop(file, file.find(Kind::also)); });
  // A text of the same size in its place: the file is large enough for what the head announces.
  const auto replace = [](Taken& file, std::size_t i) {
    file.headers[i].kind = Kind::text;
    file.headers[i].basis = 0;
    const std::uint32_t no_key = 0;
    std::memcpy(file.payloads[i].data(), &no_key, sizeof no_key);
  };
  refused("REST 0: 0 of 120 entries", [&](Taken& file) { replace(file, file.find(Kind::rest)); });
  refused("FLDS 1: 0 of", [&](Taken& file) { replace(file, file.find(Kind::field, 1)); });
  refused("no record of this version", [](Taken& file) { file.headers[file.find(Kind::field)].basis = 5; });
  refused("no record of this version", [](Taken& file) { file.headers[file.find(Kind::rest)].kind = static_cast<Kind>(7); });
  refused("fewer handles", [](Taken& file) {
    const std::size_t i = file.find(Kind::handle);
    file.headers.push_back(file.headers[i]);
    file.payloads.push_back(file.payloads[i]);
  });
  refused("REST: 2880 bytes at entry 0", [](Taken& file) {
    const std::size_t i = file.find(Kind::rest);
    file.headers.push_back(file.headers[i]);
    file.payloads.push_back(file.payloads[i]);
  });
  refused("REST: 2879 bytes", [](Taken& file) { file.payloads[file.find(Kind::rest)].pop_back(); });
  refused("REST: 2880 bytes at entry 1 ", [](Taken& file) { file.set(Kind::rest, 0, std::uint64_t{1}); });
  refused("REST: point 2 is not finite", [](Taken& file) { file.set(Kind::rest, 8 + 2 * 24, std::nan("")); });
  refused("REGI: point 3 is of handle 2", [](Taken& file) { file.set(Kind::region, 8 + 3 * 4, std::uint32_t{2}); });
  refused("points follow", [](Taken& file) { file.set(Kind::region, 8, following_region); });
  refused("PLAN: point 0", [](Taken& file) { file.set(Kind::plane, 8, std::uint8_t{2}); });
  refused("VARI 0: handle 2", [](Taken& file) { file.set(Kind::variable, 0, std::uint32_t{2}); });
  refused("VARI 0: kind 3", [](Taken& file) { file.set(Kind::variable, 4, std::uint32_t{3}); });
  refused("VARI 0: its motion", [](Taken& file) { file.set(Kind::variable, 8, Vec3{}); });
  refused("VARI 0: its bounds", [](Taken& file) { file.set(Kind::variable, 56, 0.5); });
  refused("VARI 0: its bounds", [](Taken& file) { file.set(Kind::variable, 64, std::nan("")); });
  refused("VARI 0: its unit", [](Taken& file) { file.set(Kind::variable, 72, 2.0); });
  refused("ALSO 0: variable 5, 5 have come", [](Taken& file) { file.set(Kind::also, 0, std::uint32_t{5}); });
  refused("ALSO 0: handle 2", [](Taken& file) { file.set(Kind::also, 8, std::uint32_t{2}); });
  refused("ALSO: variable 2 moves a handle twice", [](Taken& file) { file.set(Kind::also, 8, std::uint32_t{1}); });
  refused("ALSO 0: kind 3", [](Taken& file) { file.set(Kind::also, 12, std::uint32_t{3}); });
  refused("ALSO 0: its motion", [](Taken& file) { file.set(Kind::also, 16, Vec3{}); });
  refused("ALSO 0: its unit", [](Taken& file) { file.set(Kind::also, 64, 0.0); });
  refused("ALSO 0: its unit", [](Taken& file) { file.set(Kind::also, 64, HUGE_VAL); });
  refused("ALSO 0: has 71 bytes", [](Taken& file) { file.payloads[file.find(Kind::also)].pop_back(); });
  refused("the head has fewer of them", [](Taken& file) {
    const std::size_t i = file.find(Kind::also);
    file.headers.push_back(file.headers[i]);
    file.payloads.push_back(file.payloads[i]);
  });
  refused("HAND 0: its frame", [](Taken& file) { file.set(Kind::handle, 32, 2.0); });
}

TEST(CompiledReader, ChecksPairs) {
  test::Blend blend(120);
  blend.content.coincident = {{0, 119}};  // follows
  const std::vector<std::byte> bytes = test::file_of(blend.content);
  expect_error(ErrorCode::data_loss, {"PAIR: point 119"}, [&] { read_content(bytes); });
}

TEST(CompiledRecords, RefusesWhatHasNoForm) {
  test::Blend blend(120);
  blend.content.system_id = "7";
  expect_error(ErrorCode::invalid_argument, {"system_id"}, [&] { test::file_of(blend.content); });
  blend.content.system_id = std::string(64, 'A');
  expect_error(ErrorCode::invalid_argument, {"system_id"}, [&] { test::file_of(blend.content); });
  blend.content.system_id = std::string(64, 'b');
  blend.content.variables[1].name = std::string(70000, 'x');
  expect_error(ErrorCode::invalid_argument, {"variables[1].name", "70000", "65536"}, [&] { test::file_of(blend.content); });
  blend.content.variables[1].name = "x";
  blend.content.bases.clear();
  expect_error(ErrorCode::invalid_argument, {"bases: 0"}, [&] { test::file_of(blend.content); });
}

}  // namespace
}  // namespace deform::compiled::reader_test
