// SPDX-License-Identifier: GPL-3.0-or-later
// Joining chunks: the right ones, and a table of wrong ones.
#include "server/engine/geometry_upload.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "server/store/geometry_file.h"
#include "tests/server/server_fakes.h"
#include "tests/server/volume_mesh.h"
#include "tests/support/expect_error.h"

namespace deform::server::geometry_upload_test {
namespace {

class UploadBufferTest : public testing::Test {
 protected:
  UploadBufferTest() { limits.max_points = 1000; }
  Mesh upload(const v1::GeometryHeader& head, const std::vector<v1::RegisterGeometryRequest>& messages) {
    UploadBuffer buffer(head, limits, memory);
    for (const auto& message : messages) buffer.add(message);
    return buffer.take();
  }
  /// The message of the refusal, empty when there was none.
  std::string refusal(const v1::GeometryHeader& head, const std::vector<v1::RegisterGeometryRequest>& messages) {
    try {
      upload(head, messages);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::invalid_argument) << error.what();
      EXPECT_EQ(memory.in_use(), 0u);
      return error.what();
    }
    return {};
  }

  EngineOptions limits;
  MemoryBudget memory{1u << 30};
  const Mesh mesh = sheet_mesh(20, 10);
  const v1::GeometryHeader header = header_of(mesh);
};

TEST_F(UploadBufferTest, any_chunk_size_gives_the_same_mesh) {
  for (const std::size_t chunk : {1, 7, 100, 100000}) {
    EXPECT_EQ(mesh_id(upload(header, upload_messages(mesh, chunk))), mesh_id(mesh)) << chunk;
  }
}

TEST_F(UploadBufferTest, a_face_may_go_on_in_the_next_chunk) {
  std::vector<v1::RegisterGeometryRequest> messages;
  messages.emplace_back().mutable_points()->set_xyz(raw_bytes(mesh.points, 0, 200));
  messages.emplace_back().mutable_faces()->set_sizes(raw_bytes(mesh.face_sizes, 0, mesh.face_sizes.size()));
  for (std::size_t i = 0; i < mesh.face_points.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, mesh.face_points.size() - i);
    messages.emplace_back().mutable_faces()->set_corners(raw_bytes(mesh.face_points, i, count));
  }
  v1::GeometryHeader without_groups = header;
  without_groups.set_group_count(0);
  EXPECT_EQ(upload(without_groups, messages).face_points, mesh.face_points);
}

TEST_F(UploadBufferTest, memory_is_charged_and_given_back) {
  UploadBuffer buffer(header, limits, memory);
  EXPECT_EQ(memory.in_use(), 0u) << "a header alone takes nothing";
  for (const auto& message : upload_messages(mesh)) buffer.add(message);
  {
    const Charge charge = buffer.take_charge();
    EXPECT_GE(charge.bytes(), mesh_bytes(mesh) - sizeof(Mesh));
    EXPECT_LE(charge.bytes(), 2 * mesh_bytes(mesh));
    EXPECT_EQ(memory.in_use(), charge.bytes());
  }
  EXPECT_EQ(memory.in_use(), 0u);
}

// The content is hashed and written piece by piece: what is cancelled ends with the piece that it is at, and leaves no file.
TEST_F(UploadBufferTest, a_cancel_stops_the_hash_and_the_file_within_a_piece) {
  Mesh large;
  large.points.resize(10 * content_piece / sizeof(Vec3));
  const TemporaryDirectory directory;
  const auto path = directory.path() / "geometry";
  const std::map<std::string, std::function<void(const RunContext&)>> works{
      {"hash", [&](const RunContext& context) { mesh_id(large, context); }},
      {"write", [&](const RunContext& context) { write_geometry_file(large, path, system_files(), context); }}};
  for (const auto& [stage, work] : works) {
    for (const std::size_t last : {0, 1, 4}) {
      std::stop_source stop;
      std::vector<double> fractions;
      RunContext context;
      context.stop = stop.get_token();
      context.on_progress = [&](const std::string& of, double fraction) {
        EXPECT_EQ(of, stage);
        fractions.push_back(fraction);
        if (fractions.size() == last) stop.request_stop();
      };
      if (last == 0) stop.request_stop();
      test::expect_error(ErrorCode::cancelled, {}, [&] { work(context); });
      EXPECT_EQ(fractions.size(), last) << "pieces";
      EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end()));
      EXPECT_FALSE(std::filesystem::exists(path));
    }
    std::size_t pieces = 0;
    RunContext context;
    context.on_progress = [&](const std::string&, double) { ++pieces; };
    work(context);
    EXPECT_EQ(pieces, 10u);
  }
  EXPECT_EQ(mesh_id(read_geometry_file(path, mesh_id(large))), mesh_id(large));
}

TEST_F(UploadBufferTest, claims_beyond_the_memory_are_refused_at_the_header) {
  MemoryBudget tiny(1000);
  try {
    UploadBuffer buffer(header, limits, tiny);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_EQ(error.retry_after_ms(), 0u);
  }
}

TEST_F(UploadBufferTest, headers_out_of_range) {
  const auto with = [&](const std::function<void(v1::GeometryHeader&)>& spoil) {
    v1::GeometryHeader bad = header;
    spoil(bad);
    return refusal(bad, upload_messages(mesh));
  };
  EXPECT_NE(with([](auto& h) { h.set_point_count(0); }).find("header.point_count"), std::string::npos);
  EXPECT_NE(with([](auto& h) { h.set_point_count(1001); }).find("1 to 1000"), std::string::npos);
  EXPECT_NE(with([](auto& h) { h.set_point_count(~0ull); }).find("header.point_count"), std::string::npos);
  EXPECT_NE(with([](auto& h) { h.set_face_count(~0ull); }).find("header.face_count"), std::string::npos);
  EXPECT_NE(with([](auto& h) { h.set_corner_count(~0ull); }).find("header.corner_count"), std::string::npos);
  EXPECT_NE(with([](auto& h) { h.set_corner_count(3); }).find("header.corner_count"), std::string::npos);
  EXPECT_NE(with([](auto& h) { h.set_face_count(0); }).find("header.corner_count"), std::string::npos);
  EXPECT_NE(with([](auto& h) { h.set_group_count(~0u); }).find("header.group_count"), std::string::npos);
  EXPECT_NE(with([](auto& h) { h.set_name(std::string(5000, 'x')); }).find("header.name"), std::string::npos);
}

TEST_F(UploadBufferTest, missing_and_superfluous_parts) {
  const auto good = upload_messages(mesh);
  for (std::size_t i = 0; i < good.size(); ++i) {
    auto missing = good;
    missing.erase(missing.begin() + static_cast<std::ptrdiff_t>(i));
    if (!good[i].has_group() || !good[i].group().name().empty()) {
      EXPECT_FALSE(refusal(header, missing).empty()) << "without message " << i;
    }
    auto twice = good;
    twice.insert(twice.begin() + static_cast<std::ptrdiff_t>(i), good[i]);
    if (!good[i].has_group()) {
      EXPECT_FALSE(refusal(header, twice).empty()) << "message " << i << " twice";
    }
  }
  EXPECT_FALSE(refusal(header, {}).empty());
}

TEST_F(UploadBufferTest, wrong_order_is_refused) {
  auto messages = upload_messages(mesh);
  std::swap(messages[0], messages[1]);  // faces before points
  EXPECT_NE(refusal(header, messages).find("points: only 0 of 200"), std::string::npos);
  messages = upload_messages(mesh);
  messages.push_back(messages[0]);  // points after groups
  EXPECT_NE(refusal(header, messages).find("order points, faces, groups"), std::string::npos);
}

TEST_F(UploadBufferTest, messages_that_say_nothing_or_the_wrong_thing) {
  auto messages = upload_messages(mesh);
  messages.insert(messages.begin(), v1::RegisterGeometryRequest());
  EXPECT_NE(refusal(header, messages).find("none of points, faces, group"), std::string::npos);
  messages = upload_messages(mesh);
  *messages.emplace_back().mutable_header() = header;
  EXPECT_NE(refusal(header, messages).find("header: sent twice"), std::string::npos);
}

TEST_F(UploadBufferTest, contents_that_are_wrong) {
  const auto with = [&](const std::function<void(Mesh&)>& spoil) {
    Mesh bad = mesh;
    spoil(bad);
    return refusal(header_of(bad), upload_messages(bad));
  };
  EXPECT_FALSE(with([](Mesh& m) { m.points[7][1] = std::numeric_limits<double>::quiet_NaN(); }).empty());
  EXPECT_FALSE(with([](Mesh& m) { m.points[0][2] = std::numeric_limits<double>::infinity(); }).empty());
  EXPECT_FALSE(with([](Mesh& m) { m.face_points[5] = 200; }).empty());
  EXPECT_FALSE(with([](Mesh& m) { m.face_points[5] = ~0u; }).empty());
  EXPECT_FALSE(with([](Mesh& m) { m.face_sizes[0] = 0; }).empty());
  EXPECT_FALSE(with([](Mesh& m) { m.face_sizes[3] = 5; }).empty());
  EXPECT_FALSE(with([](Mesh& m) { m.groups[0].points[0] = 200; }).empty());
  EXPECT_FALSE(with([](Mesh& m) { m.groups[2].faces[0] = 5000; }).empty());
  EXPECT_FALSE(with([](Mesh& m) { m.groups[1].name = "left"; }).empty());
  EXPECT_FALSE(with([](Mesh& m) { m.groups[0].name.clear(); }).empty());
  EXPECT_TRUE(with([](Mesh& m) { m.points[3] = m.points[4]; }).empty()) << "coincident points are legal";
}

TEST_F(UploadBufferTest, bytes_that_are_no_multiple) {
  for (const char* field : {"points", "sizes", "corners", "group points", "group faces"}) {
    auto messages = upload_messages(mesh);
    const std::string what = field;
    for (auto& message : messages) {
      std::string* bytes = what == "points" && message.has_points()   ? message.mutable_points()->mutable_xyz()
                           : what == "sizes" && message.has_faces()   ? message.mutable_faces()->mutable_sizes()
                           : what == "corners" && message.has_faces() ? message.mutable_faces()->mutable_corners()
                           : what == "group points" && message.has_group() && !message.group().points().empty()
                               ? message.mutable_group()->mutable_points()
                           : what == "group faces" && message.has_group() && !message.group().faces().empty()
                               ? message.mutable_group()->mutable_faces()
                               : nullptr;
      if (bytes != nullptr) bytes->pop_back();
    }
    EXPECT_NE(refusal(header, messages).find("multiple of"), std::string::npos) << field;
  }
}

TEST_F(UploadBufferTest, more_than_the_header_allows) {
  auto messages = upload_messages(mesh);
  messages[0].mutable_points()->mutable_xyz()->append(24, '\0');
  EXPECT_NE(refusal(header, messages).find("more than the 200"), std::string::npos);
  messages = upload_messages(mesh);
  messages.emplace_back().mutable_group()->set_name("one too many");
  EXPECT_NE(refusal(header, messages).find("group"), std::string::npos);
  messages = upload_messages(mesh);
  for (int i = 0; i < 50; ++i) messages.emplace_back().mutable_group()->set_points(raw_bytes(mesh.groups[0].points, 0, 20));
  EXPECT_NE(refusal(header, messages).find("group.points"), std::string::npos);
}

// What a server tells of a geometry lists the groups, and a message has to stay below 1 MiB.
TEST_F(UploadBufferTest, names_of_all_groups_have_a_limit) {
  Mesh many = mesh;
  many.groups.clear();
  for (int i = 0; i < 161; ++i) many.groups.push_back({std::string(4092, 'x') + std::to_string(1000 + i), {0}, {}});
  EXPECT_NE(refusal(header_of(many), upload_messages(many)).find("those of the first 161 groups take 659456 bytes"),
            std::string::npos);
  many.groups.pop_back();
  EXPECT_EQ(upload(header_of(many), upload_messages(many)).groups.size(), 160u);
}

TEST_F(UploadBufferTest, cells_in_any_chunk_size) {
  for (Mesh volume : {volume_mesh(4), polyhedral_mesh(4)}) {
    if (volume.cells) {
      auto cells = std::make_shared<PolyhedralCells>(*volume.cells);
      cells->empty_faces.assign(cells->face_count(), 0);
      cells->empty_faces.back() = 1;
      volume.cells = cells;
    }
    for (const std::size_t chunk : {1, 7, 100000}) {
      EXPECT_EQ(mesh_id(upload(header_of(volume), upload_messages(volume, chunk))), mesh_id(volume)) << chunk;
    }
  }
}

TEST_F(UploadBufferTest, cells_that_are_not_whole) {
  const Mesh elements = volume_mesh(3), cells = polyhedral_mesh(3);
  const auto with = [&](const Mesh& volume, const std::function<void(v1::CellCounts&)>& spoil) {
    v1::GeometryHeader bad = header_of(volume);
    spoil(*bad.mutable_cells());
    return refusal(bad, upload_messages(volume));
  };
  const auto expect = [](const std::string& message, const std::string& part) {
    EXPECT_NE(message.find(part), std::string::npos) << message;
  };
  expect(with(elements, [](auto& c) { c.set_elements(~0ull); }), "cells.elements");
  expect(with(elements, [](auto& c) { c.set_elements(26); }), "cells.element_types");
  expect(with(elements, [](auto& c) { c.set_elements(28); }), "cells.element_types");
  expect(with(elements, [](auto& c) { c.set_element_points(217); }), "cells.element_points");
  expect(with(elements, [](auto& c) { c.set_faces(5); }), "cells.faces");
  expect(with(elements, [](auto& c) { c.clear_elements(); }), "cells.element_points");
  expect(with(cells, [](auto& c) { c.set_cells(0); }), "cells.cells");
  expect(with(cells, [](auto& c) { c.set_cells(~0ull); }), "cells.cells");
  expect(with(cells, [](auto& c) { c.set_cells(26); }), "cell 26 is out of range");
  expect(with(cells, [](auto& c) { c.set_internal_faces(55); }), "cells.neighbours");
  expect(with(cells, [](auto& c) { c.set_face_points(431); }), "cells.face_points");
  expect(with(cells, [](auto& c) { c.set_empty_faces(true); }), "cells.empty_faces");

  auto messages = upload_messages(elements);
  messages.back().mutable_cells()->mutable_element_points()->at(3) = '\x7f';
  expect(refusal(header_of(elements), messages), "is out of range");
  messages = upload_messages(elements);
  messages[messages.size() - 2].mutable_cells()->mutable_element_types()->at(5) = 11;
  expect(refusal(header_of(elements), messages), "11 of element 5 is not a type");
  messages = upload_messages(elements);
  messages[messages.size() - 2].mutable_cells()->mutable_element_types()->at(5) = 0;
  expect(refusal(header_of(elements), messages), "offsets");
  messages = upload_messages(elements);
  std::swap(messages.back(), messages.front());
  expect(refusal(header_of(elements), messages), "points");
}

}  // namespace
}  // namespace deform::server::geometry_upload_test
