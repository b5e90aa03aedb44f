// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cstring>
#include <numeric>

#include "client/address.h"
#include "client/request_splitter.h"
#include "client/retry.h"
#include "client/status.h"
#include "client/upload.h"
#include "tests/client/scripted_service.h"
#include "tests/support/expect_error.h"

namespace deform::messages_test {
namespace {

using test::expect_error;
using test::ScriptedService;

TEST(Address, AcceptsWhatGrpcUnderstands) {
  for (const char* address :
       {"127.0.0.1:50051", "localhost:1", "deform-server.example.com:65535", "[::1]:50051", "unix:/run/deformd"}) {
    EXPECT_EQ(client::checked_address(address), address);
  }
}

TEST(Address, RefusesAndSaysWhatWasExpected) {
  for (const char* address : {"", "localhost", "localhost:", ":50051", "localhost:0", "localhost:65536", "localhost:http",
                              "http://localhost:50051", "::1:50051", "[]:50051", "[::1:50051", "a b:50051", "unix:", "a:1:2"}) {
    expect_error(ErrorCode::invalid_argument, {"expected HOST:PORT"}, [&] { client::checked_address(address); });
  }
}

TEST(Address, EncodingFollowsWhereTheServerIs) {
  for (const char* local : {"unix:/run/deformd.sock", "unix:relative.sock", "localhost:50051", "LocalHost:1", "localhost.:1",
                            "127.0.0.1:50051", "127.255.3.1:50051", "[::1]:50051", "[0:0:0:0:0:0:0:1]:50051",
                            "[0000::0001]:50051", "[::ffff:127.0.0.1]:50051", "[::FFFF:127.9.9.9]:50051"}) {
    EXPECT_EQ(client::checked_address(local), local);
    EXPECT_TRUE(client::is_local(local)) << local;
    EXPECT_EQ(client::encoding_for(local), v1::RAW_F64) << local;
  }
  for (const char* elsewhere : {"deformd.example.org:50051",
                                "localhost.example.org:50051",
                                "mylocalhost:50051",
                                "127.example.org:50051",
                                "127.0.0.1.example.org:50051",
                                "127.0.0:50051",
                                "127.0.0.256:50051",
                                "127.0.0.1.1:50051",
                                "10.0.0.1:50051",
                                "128.0.0.1:50051",
                                "0.0.0.0:50051",
                                "[::]:50051",
                                "[::2]:50051",
                                "[::11]:50051",
                                "[::1:1]:50051",
                                "[1::]:50051",
                                "[fe80::1]:50051",
                                "[2001:db8::1]:50051",
                                "[::ffff:10.0.0.1]:50051",
                                "unix.example.org:50051"}) {
    EXPECT_EQ(client::checked_address(elsewhere), elsewhere);
    EXPECT_FALSE(client::is_local(elsewhere)) << elsewhere;
    EXPECT_EQ(client::encoding_for(elsewhere), v1::DELTA_ZSTD) << elsewhere;
  }
}

TEST(Retry, SameSeedSameWaitingTimesThatGrow) {
  const Error lost(ErrorCode::unavailable, "lost");
  client::RetryPolicy a({5, 7, client::Retry::safe}), b({5, 7, client::Retry::safe}), c({5, 8, client::Retry::safe});
  bool differs = false;
  double base = 100;
  for (int k = 0; k < 4; ++k, base *= 2) {
    const auto wait = a.next_wait(lost);
    ASSERT_TRUE(wait);
    EXPECT_EQ(wait, b.next_wait(lost));
    differs = differs || wait != c.next_wait(lost);
    EXPECT_GE(static_cast<double>(wait->count()), 0.5 * base - 1);
    EXPECT_LE(static_cast<double>(wait->count()), 1.5 * base);
  }
  EXPECT_TRUE(differs);
  EXPECT_FALSE(a.next_wait(lost));
}

TEST(Retry, APatientOneWaitsForLostConnectionsAndComesBackWhenTold) {
  const Error lost(ErrorCode::unavailable, "lost"), full(ErrorCode::out_of_budget, "the queue is full", 20);
  client::RetryPolicy patient({2, 7, client::Retry::safe, std::chrono::hours(1)});
  for (int k = 0; k < 20; ++k) {
    const auto wait = patient.next_wait(lost);
    ASSERT_TRUE(wait) << k;
    EXPECT_LE(wait->count(), 9600) << "no longer than 6.4 s, times at most 1.5";
  }
  for (int k = 0; k < 20; ++k) {
    const auto wait = patient.next_wait(full);
    ASSERT_TRUE(wait) << k;
    EXPECT_GE(wait->count(), 20);
    EXPECT_LE(wait->count(), 30);
  }
  EXPECT_FALSE(patient.next_wait(Error(ErrorCode::out_of_budget, "too large"))) << "no hint";
  client::RetryPolicy spent({2, 7, client::Retry::safe, std::chrono::milliseconds(0)});
  EXPECT_TRUE(spent.next_wait(full));
  EXPECT_FALSE(spent.next_wait(full)) << "attempts count";
  client::RetryPolicy removing({2, 7, client::Retry::when_refused, std::chrono::hours(1)});
  EXPECT_FALSE(removing.next_wait(lost)) << "it may have been carried out";
}

TEST(Retry, WhatWasNeverSentMayBeRepeatedAlways) {
  const Error lost(ErrorCode::unavailable, "lost");
  const client::NotConnected unreached("nobody listens there", false);
  client::RetryPolicy when_refused({3, 7, client::Retry::when_refused});
  EXPECT_TRUE(when_refused.next_wait(unreached));
  EXPECT_FALSE(when_refused.next_wait(lost));
  EXPECT_FALSE(when_refused.next_wait(unreached)) << "attempts are counted";
}

// As gRPC says it of a server that is there, when its errno is not connect()'s any more.
TEST(Connecting, AMissingFileIsOfSocketsWithAPathOnly) {
  const auto error_at = [](const std::string& address) {
    const grpc::Status status(grpc::StatusCode::UNAVAILABLE, "failed to connect to all addresses; last error: UNKNOWN: " +
                                                                 address + ": No such file or directory");
    const grpc::ClientContext context;
    try {
      client::throw_error(status, context, address, "c-1");
    } catch (const client::NotConnected& error) {
      return error;
    }
  };
  const client::NotConnected missing = error_at("unix:/run/deformd.sock");
  EXPECT_FALSE(missing.silent());
  EXPECT_THAT(missing.what(), testing::HasSubstr("(there is no such socket)"));
  const client::NotConnected misread = error_at("127.0.0.1:50051");
  EXPECT_TRUE(misread.silent()) << "it is waited for";
  EXPECT_THAT(misread.what(), testing::HasSubstr("last error: UNKNOWN"));
}

TEST(Connecting, AConnectionThatIsLostIsThatWhateverGrpcCallsIt) {
  const auto error_of = [](grpc::StatusCode code, const std::string& message) {
    try {
      client::throw_error({code, message}, grpc::ClientContext(), "a:1", "c-1");
    } catch (const Error& error) {
      return error;
    }
  };
  using grpc::StatusCode;
  for (const auto& [code, message] : {std::pair{StatusCode::UNAVAILABLE, "Socket closed"},
                                      {StatusCode::UNKNOWN, "Stream removed"},
                                      {StatusCode::CANCELLED, "Received RST_STREAM with error code 8"},
                                      {StatusCode::INTERNAL, "Received RST_STREAM with error code 2"}}) {
    const Error error = error_of(code, message);
    EXPECT_EQ(error.code(), ErrorCode::unavailable) << message;
    EXPECT_STREQ(error.what(), "lost the connection to deformd at a:1");
  }
  EXPECT_EQ(error_of(StatusCode::INTERNAL, "a bug").code(), ErrorCode::internal);
  EXPECT_EQ(error_of(StatusCode::RESOURCE_EXHAUSTED, "Received RST_STREAM with error code 11").code(), ErrorCode::out_of_budget);
  const Error proxy = error_of(StatusCode::UNAVAILABLE, "Received http2 header with status: 503");
  EXPECT_EQ(proxy.code(), ErrorCode::unavailable);
  EXPECT_THAT(proxy.what(), testing::HasSubstr("a proxy answers at a:1, with HTTP status 503"));
}

/// A mesh with a face and a group that no single message can hold.
struct LargeGeometry {
  Points points = test::registered_points(300'000);
  std::vector<std::uint32_t> face_sizes;
  std::vector<std::uint32_t> face_points;
  std::vector<PointId> group_points;
  std::vector<FaceId> group_faces;

  LargeGeometry() {
    for (std::uint32_t f = 0; f < 250'000; ++f) {
      const std::uint32_t size = f == 70'000 ? 300'000 : 3;
      face_sizes.push_back(size);
      for (std::uint32_t k = 0; k < size; ++k) face_points.push_back((f + k) % 300'000);
    }
    group_points.resize(250'000);
    std::iota(group_points.begin(), group_points.end(), 5);
    group_faces.resize(240'000);
    std::iota(group_faces.begin(), group_faces.end(), 0);
  }

  client::GeometryArrays arrays() const {
    client::GeometryArrays result;
    result.points = points;
    result.face_sizes = face_sizes;
    result.face_points = face_points;
    result.groups = {{"large", group_points, group_faces}, {"empty", {}, {}}, {"small", {}, std::span(group_faces).first(2)}};
    result.name = "label";
    return result;
  }
};

template <typename T>
void append(std::vector<T>& values, const std::string& bytes) {
  ASSERT_EQ(bytes.size() % sizeof(T), 0u);
  const std::size_t before = values.size();
  values.resize(before + bytes.size() / sizeof(T));
  if (!bytes.empty()) std::memcpy(values.data() + before, bytes.data(), bytes.size());
}

/// Puts a geometry together again.
struct Received {
  v1::GeometryHeader header;
  Points points;
  std::vector<std::uint32_t> face_sizes, face_points;
  std::vector<std::string> names;
  std::vector<std::vector<PointId>> group_points;
  std::vector<std::vector<FaceId>> group_faces;

  void add(const v1::RegisterGeometryRequest& message) {
    EXPECT_LT(message.ByteSizeLong(), std::size_t{1} << 20);
    if (message.has_header()) header = message.header();
    if (message.has_points()) append(points, message.points().xyz());
    if (message.has_faces()) {
      append(face_sizes, message.faces().sizes());
      append(face_points, message.faces().corners());
    }
    if (!message.has_group()) return;
    if (!message.group().name().empty()) {
      names.push_back(message.group().name());
      group_points.emplace_back();
      group_faces.emplace_back();
    }
    append(group_points.back(), message.group().points());
    append(group_faces.back(), message.group().faces());
  }

  std::string id() const {
    std::vector<codec::GroupView> groups;
    for (std::size_t g = 0; g < names.size(); ++g) groups.push_back({names[g], group_points[g], group_faces[g]});
    return codec::geometry_id({points, face_sizes, face_points, groups});
  }
};

std::string id_of(const client::GeometryArrays& arrays) {
  return codec::geometry_id({arrays.points, arrays.face_sizes, arrays.face_points, arrays.groups, arrays.cells});
}

TEST(Upload, CutsEveryArrayIntoSmallMessages) {
  const LargeGeometry geometry;
  const auto arrays = geometry.arrays();
  client::GeometryMessages messages(arrays, id_of(arrays));
  v1::RegisterGeometryRequest message;
  Received received;
  double last = 0;
  while (messages.next(message)) {
    received.add(message);
    EXPECT_GE(messages.fraction(), last);
    last = messages.fraction();
  }
  EXPECT_EQ(last, 1.0);
  EXPECT_EQ(received.id(), id_of(arrays));
  EXPECT_EQ(received.header.id(), id_of(arrays));
  EXPECT_EQ(received.header.corner_count(), geometry.face_points.size());
  EXPECT_EQ(received.names, (std::vector<std::string>{"large", "empty", "small"}));
}

TEST(Upload, CutsCellsIntoSmallMessages) {
  const Points points(100'000);
  std::vector<std::uint8_t> types(900'000, 0);
  std::vector<PointId> nodes(4 * types.size());
  std::iota(nodes.begin(), nodes.end(), 0u);
  std::vector<std::uint64_t> offsets{0};
  while (offsets.size() <= 500'000) offsets.push_back(offsets.back() + 3 + offsets.size() % 2);
  std::vector<PointId> corners(offsets.back());
  std::iota(corners.begin(), corners.end(), 7u);
  const std::vector<std::uint32_t> owner(500'000, 3), neighbour(400'000, 2);
  const std::vector<char> empty(500'000, 1);
  for (const bool by_faces : {false, true}) {
    client::GeometryArrays arrays;
    arrays.points = points;
    if (by_faces) {
      arrays.cells = {{}, {}, 9, offsets, corners, owner, neighbour, empty};
    } else {
      arrays.cells.element_types = types;
      arrays.cells.element_points = nodes;
    }
    client::GeometryMessages messages(arrays, "");
    v1::RegisterGeometryRequest message;
    v1::CellCounts counts;
    std::vector<std::uint8_t> got_types;
    std::vector<std::uint32_t> got_nodes, sizes, got_corners, got_owner, got_neighbour;
    std::vector<char> got_empty;
    while (messages.next(message)) {
      EXPECT_LT(message.ByteSizeLong(), std::size_t{1} << 20);
      if (message.has_header()) counts = message.header().cells();
      append(got_types, message.cells().element_types());
      append(got_nodes, message.cells().element_points());
      append(sizes, message.cells().face_sizes());
      append(got_corners, message.cells().face_points());
      append(got_owner, message.cells().owners());
      append(got_neighbour, message.cells().neighbours());
      append(got_empty, message.cells().empty_faces());
    }
    EXPECT_EQ(messages.fraction(), 1.0);
    EXPECT_EQ(counts.elements(), by_faces ? 0 : types.size());
    EXPECT_EQ(counts.faces(), by_faces ? owner.size() : 0);
    EXPECT_EQ(got_types, by_faces ? std::vector<std::uint8_t>() : types);
    EXPECT_EQ(got_nodes, by_faces ? std::vector<PointId>() : nodes);
    if (!by_faces) continue;
    ASSERT_EQ(sizes.size(), owner.size());
    for (std::size_t f = 0; f < sizes.size(); ++f) ASSERT_EQ(sizes[f], offsets[f + 1] - offsets[f]);
    EXPECT_EQ(got_corners, corners);
    EXPECT_EQ(got_owner, owner);
    EXPECT_EQ(got_neighbour, neighbour);
    EXPECT_EQ(got_empty, empty);
    EXPECT_EQ(counts.cells(), 9u);
    EXPECT_TRUE(counts.empty_faces());
  }
}

TEST(Upload, RefusesSizesThatDoNotAddUp) {
  LargeGeometry geometry;
  geometry.face_points.pop_back();
  const auto arrays = geometry.arrays();
  expect_error(ErrorCode::invalid_argument, {"face sizes add up to"}, [&] { client::GeometryMessages(arrays, ""); });
}

TEST(Upload, SendsOnlyWhatTheServerDoesNotHave) {
  ScriptedService service;
  const LargeGeometry geometry;
  const auto arrays = geometry.arrays();
  bool known = false;
  int uploads = 0;
  service.on_get_geometry = [&](const v1::GetGeometryRequest& request, v1::GeometryInfo& info) {
    info.set_id(request.id());
    return known ? grpc::Status::OK : grpc::Status(grpc::StatusCode::NOT_FOUND, "no such geometry");
  };
  service.on_register = [&](grpc::ServerReaderInterface<v1::RegisterGeometryRequest>& reader, v1::GeometryInfo& info) {
    ++uploads;
    Received received;
    v1::RegisterGeometryRequest message;
    while (reader.Read(&message)) received.add(message);
    info.set_id(received.id());
    known = true;
    return grpc::Status::OK;
  };
  auto client = service.client();
  EXPECT_EQ(client.register_geometry(arrays).id(), id_of(arrays));
  EXPECT_TRUE(client.register_geometry(arrays).existed());
  EXPECT_EQ(uploads, 1);
}

TEST(Upload, AServerThatAnswersEarlyOrWithAnotherId) {
  ScriptedService service;
  const LargeGeometry geometry;
  const auto arrays = geometry.arrays();
  std::string answer = id_of(arrays);
  service.on_get_geometry = [](const v1::GetGeometryRequest&, v1::GeometryInfo&) {
    return grpc::Status(grpc::StatusCode::NOT_FOUND, "no such geometry");
  };
  service.on_register = [&](grpc::ServerReaderInterface<v1::RegisterGeometryRequest>& reader, v1::GeometryInfo& info) {
    v1::RegisterGeometryRequest header;
    reader.Read(&header);
    info.set_id(answer);
    return grpc::Status::OK;
  };
  auto client = service.client();
  EXPECT_EQ(client.register_geometry(arrays).id(), answer);
  answer = std::string(64, '0');
  expect_error(ErrorCode::data_loss, {"the server stored id"}, [&] { client.register_geometry(arrays); });
}

/// Joins the messages of a split request again, as the server does.
v1::DeformRequest joined(const v1::DeformRequest& request) {
  client::RequestSplitter splitter(request, 9);
  v1::DeformStreamRequest message;
  v1::DeformRequest result;
  bool more = true;
  while (splitter.next(message)) {
    EXPECT_TRUE(more);
    EXPECT_EQ(message.request_id(), 9u);
    EXPECT_LT(message.ByteSizeLong(), std::size_t{1} << 20);
    more = message.more();
    if (!message.request().system_id().empty()) {
      v1::DeformRequest head = message.request();
      head.clear_designs();
      result.MergeFrom(head);
    }
    for (const auto& design : message.request().designs()) {
      if (!design.continues()) {
        *result.add_designs() = design;
        continue;
      }
      v1::Design& target = *result.mutable_designs(result.designs_size() - 1);
      for (const auto& motion : design.motions()) {
        const int last = target.motions_size() - 1;
        if (last >= 0 && target.motions(last).handle() == motion.handle()) {
          target.mutable_motions(last)->mutable_displacements()->MergeFrom(motion.displacements());
        } else {
          *target.add_motions() = motion;
        }
      }
    }
  }
  EXPECT_FALSE(more);
  for (auto& design : *result.mutable_designs()) {  // pieces of displacements to one
    for (auto& motion : *design.mutable_motions()) {
      if (motion.displacements_size() < 2) continue;
      std::string all;
      for (const auto& piece : motion.displacements()) {
        EXPECT_EQ(piece.first() * sizeof(Vec3), all.size());
        all += piece.xyz();
      }
      motion.clear_displacements();
      motion.add_displacements()->set_xyz(all);
    }
  }
  return result;
}

TEST(RequestSplitter, LosesNothing) {
  v1::DeformRequest request;
  request.set_system_id("system");
  request.mutable_output()->set_tolerance(0.5);
  request.set_path(v1::PATH_DIRECT);
  for (int d = 0; d < 40; ++d) {
    v1::Design& design = *request.add_designs();
    for (int k = 0; k < 1000 * (d % 3); ++k) design.add_variables(k + 0.25 * d);
    for (int m = 0; m < d % 5; ++m) {
      v1::Motion& motion = *design.add_motions();
      motion.set_handle("handle " + std::to_string(m));
      if (m % 2 == 0) {
        for (int k = 0; k < 12; ++k) motion.add_affine(k);
      } else {
        std::string xyz(static_cast<std::size_t>(24 * 40'000 * (d % 7)), static_cast<char>(d));
        motion.add_displacements()->set_xyz(xyz);
      }
    }
  }
  EXPECT_TRUE(joined(request).SerializeAsString() == request.SerializeAsString());
}

/// A field that is added to requests and forgotten in the splitter is lost on streams only.
TEST(RequestSplitter, SendsEveryFieldOfARequest) {
  v1::DeformRequest request;
  const auto& type = *v1::DeformRequest::descriptor();
  const auto& reflection = *request.GetReflection();
  using Field = google::protobuf::FieldDescriptor;
  for (int k = 0; k < type.field_count(); ++k) {
    const Field& field = *type.field(k);
    if (field.is_repeated()) continue;
    SCOPED_TRACE(field.name());
    if (field.cpp_type() == Field::CPPTYPE_STRING) {
      reflection.SetString(&request, &field, "x");
    } else if (field.cpp_type() == Field::CPPTYPE_ENUM) {
      reflection.SetEnumValue(&request, &field, 1);
    } else if (field.cpp_type() == Field::CPPTYPE_BOOL) {
      reflection.SetBool(&request, &field, true);
    } else if (field.cpp_type() == Field::CPPTYPE_DOUBLE) {
      reflection.SetDouble(&request, &field, 0.5);
    } else if (field.cpp_type() == Field::CPPTYPE_MESSAGE) {
      reflection.MutableMessage(&request, &field);
    } else {
      ADD_FAILURE() << "teach this test the type of the field";
    }
  }
  request.mutable_output()->set_tolerance(0.5);
  request.mutable_splitting()->set_most_steps(3);
  request.add_designs()->add_variables(1);
  EXPECT_EQ(joined(request).DebugString(), request.DebugString());
}

TEST(RequestSplitter, ManySmallDesignsShareMessages) {
  v1::DeformRequest request;
  request.set_system_id("system");
  request.mutable_output()->set_encoding(v1::RAW_F32);
  for (int d = 0; d < 100'000; ++d) request.add_designs()->add_variables(d);
  EXPECT_TRUE(joined(request).SerializeAsString() == request.SerializeAsString());
  client::RequestSplitter splitter(request, 9);
  v1::DeformStreamRequest message;
  int messages = 0;
  while (splitter.next(message)) ++messages;
  EXPECT_LE(messages, 12);
}

}  // namespace
}  // namespace deform::messages_test
