// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/client.h"

#include <gtest/gtest.h>

#include <atomic>
#include <mutex>
#include <thread>

#include "tests/client/scripted_service.h"
#include "tests/support/expect_error.h"

namespace deform::client_test {
namespace {

using client::CallOptions;
using client::Client;
using client::ClientOptions;
using test::expect_error;
using test::ReplyScript;
using test::ScriptedService;

v1::DeformRequest raw_request(std::size_t designs = 1) {
  v1::DeformRequest request;
  request.set_system_id("system");
  request.mutable_output()->set_encoding(v1::RAW_F64);
  for (std::size_t d = 0; d < designs; ++d) request.add_designs();
  return request;
}

void keep(Client& client, std::size_t points = 5000) {
  client.keep_points("geometry", std::make_shared<const Points>(test::registered_points(points)));
}

grpc::Status answer(ScriptedService::Writer& writer, const ReplyScript& script) {
  for (const auto& reply : test::replies(script)) writer.Write(reply, grpc::WriteOptions());
  return grpc::Status::OK;
}

grpc::Status refusal(grpc::ServerContext& context, const char* retry_after_ms) {
  if (retry_after_ms != nullptr) context.AddTrailingMetadata("retry-after-ms", retry_after_ms);
  return {grpc::StatusCode::RESOURCE_EXHAUSTED, "the queue is full"};
}

TEST(Client, DeformsAndFetchesThePointsOnce) {
  ScriptedService service;
  int fetched = 0;
  service.on_get_geometry = [](const v1::GetGeometryRequest&, v1::GeometryInfo& info) {
    info.set_points(5000);
    return grpc::Status::OK;
  };
  service.on_points = [&](const v1::GetPointsRequest& request, grpc::ServerWriterInterface<v1::PointChunk>& writer) {
    EXPECT_EQ(request.id(), "geometry");
    ++fetched;
    const Points points = test::registered_points(5000);
    v1::PointChunk chunk;
    chunk.set_xyz(points.data(), points.size() * sizeof(Vec3));
    writer.Write(chunk, grpc::WriteOptions());
    return grpc::Status::OK;
  };
  service.on_deform = [](grpc::ServerContext&, const v1::DeformRequest&, ScriptedService::Writer& writer) {
    return answer(writer, {});
  };
  Client client = service.client();
  for (int k = 0; k < 3; ++k) EXPECT_EQ(client.deform(raw_request()).designs.at(0).points, test::deformed_points(5000, 0));
  EXPECT_EQ(fetched, 1);
}

/// One of a version that knows Prepare only.
TEST(Client, LargeSetupsGoInOneMessageToAServerThatTakesNoPieces) {
  ScriptedService service;
  int seen = 0;
  service.on_prepare = [&](const v1::PrepareRequest& request, grpc::ServerWriterInterface<v1::PrepareReply>& writer) {
    seen = request.setup().fixed(0).ids_size();
    v1::PrepareReply reply;
    reply.mutable_system()->set_id("system");
    writer.Write(reply, grpc::WriteOptions());
    return grpc::Status::OK;
  };
  v1::Setup setup;
  v1::Region& region = *setup.add_fixed();
  for (std::uint32_t id = 0; id < 500'000; ++id) region.add_ids(id);
  ASSERT_GT(setup.ByteSizeLong(), std::size_t{1} << 20);
  Client client = service.client();
  EXPECT_EQ(client.prepare(setup).id(), "system");
  EXPECT_EQ(seen, 500'000);
}

/// The encodings that a client asks for, by deform() and in a session, when its request names `asked`.
std::vector<v1::Encoding> sent_encodings(const ClientOptions& options, v1::Encoding asked) {
  ScriptedService service;
  std::vector<v1::Encoding> sent;
  const auto script_for = [&](const v1::DeformRequest& request) {
    sent.push_back(request.output().encoding());
    ReplyScript script;
    script.encoding = request.output().encoding();
    return script;
  };
  service.on_deform = [&](grpc::ServerContext&, const v1::DeformRequest& request, ScriptedService::Writer& writer) {
    return answer(writer, script_for(request));
  };
  service.on_stream = [&](grpc::ServerContext&, ScriptedService::Stream& stream) {
    v1::DeformStreamRequest message;
    while (stream.Read(&message)) {
      ReplyScript script = script_for(message.request());
      script.request_id = message.request_id();
      for (const auto& reply : test::replies(script)) stream.Write(reply, grpc::WriteOptions());
    }
    return grpc::Status::OK;
  };
  Client client = service.client(options);
  keep(client);
  v1::DeformRequest request = raw_request();
  request.mutable_output()->set_encoding(asked);
  EXPECT_EQ(client.deform(request).designs.size(), 1u);
  EXPECT_EQ(client.open_session()->submit(request).get().designs.size(), 1u);
  return sent;
}

TEST(Client, NamesTheEncodingThatSuitsTheServer) {
  using Sent = std::vector<v1::Encoding>;
  ClientOptions options;
  EXPECT_EQ(sent_encodings(options, v1::ENCODING_DEFAULT), Sent(2, v1::RAW_F64));  // 127.0.0.1
  EXPECT_EQ(sent_encodings(options, v1::DRACO), Sent(2, v1::DRACO));
  options.encoding = v1::DELTA_ZSTD;
  EXPECT_EQ(sent_encodings(options, v1::ENCODING_DEFAULT), Sent(2, v1::DELTA_ZSTD));
  EXPECT_EQ(sent_encodings(options, v1::RAW_F64), Sent(2, v1::RAW_F64));
  options.encoding = v1::RAW_F32;
  EXPECT_EQ(sent_encodings(options, v1::ENCODING_DEFAULT), Sent(2, v1::RAW_F32));
  options.encoding = static_cast<v1::Encoding>(77);
  expect_error(ErrorCode::invalid_argument, {"encoding", "77"}, [&] { options.validate(); });
}

TEST(Client, SaysWhichEncodingItNames) {
  ClientOptions options;
  EXPECT_EQ(Client(options).encoding(), v1::RAW_F64);
  options.address = "deformd.example.org:50051";
  EXPECT_EQ(Client(options).encoding(), v1::DELTA_ZSTD);
}

/// The replies of a request whose first of two designs has failed alone.
std::vector<v1::DeformReply> first_failed() {
  ReplyScript script;
  script.designs = 2;
  std::vector<v1::DeformReply> answer;
  for (const auto& reply : test::replies(script)) {
    if (reply.has_block() && reply.block().design() == 0) continue;
    answer.push_back(reply);
    if (!reply.has_result() || reply.result().design() != 0) continue;
    answer.back().mutable_result()->Clear();
    answer.back().mutable_result()->mutable_error()->set_code(10);
    answer.back().mutable_result()->mutable_error()->set_message("singular");
  }
  return answer;
}

TEST(Client, ADesignThatFailsAloneIsNeverOverlooked) {
  ScriptedService service;
  v1::Failures asked = v1::FAILURES_DEFAULT;
  service.on_deform = [&](grpc::ServerContext&, const v1::DeformRequest& request, ScriptedService::Writer& writer) {
    asked = request.failures();
    for (const auto& reply : first_failed()) writer.Write(reply, grpc::WriteOptions());
    return grpc::Status::OK;
  };
  service.on_stream = [&](grpc::ServerContext&, ScriptedService::Stream& stream) {
    v1::DeformStreamRequest message;
    while (stream.Read(&message)) {
      asked = message.request().failures();
      for (auto reply : first_failed()) {
        reply.set_request_id(message.request_id());
        stream.Write(reply, grpc::WriteOptions());
      }
    }
    return grpc::Status::OK;
  };
  Client client = service.client();
  keep(client);
  v1::DeformRequest request = raw_request(2);
  expect_error(ErrorCode::data_loss, {"singular"}, [&] { client.deform(request); });
  expect_error(ErrorCode::data_loss, {"singular"}, [&] { client.open_session()->submit(request).get(); });
  request.set_failures(v1::FAILURES_PER_DESIGN);
  const auto session = client.open_session();
  for (const auto& outcome : {client.deform(request), session->submit(request).get()}) {
    EXPECT_EQ(asked, v1::FAILURES_PER_DESIGN);
    ASSERT_TRUE(outcome.designs.at(0).error);
    EXPECT_EQ(outcome.designs[0].error->code(), ErrorCode::numerical_failure);
    EXPECT_FALSE(outcome.designs.at(1).error);
    EXPECT_EQ(outcome.designs[1].points, test::deformed_points(5000, 1));
  }
}

TEST(Client, RefusesPointsThatDoNotAddUp) {
  ScriptedService service;
  service.on_get_geometry = [](const v1::GetGeometryRequest&, v1::GeometryInfo& info) {
    info.set_points(std::uint64_t{1} << 60);
    return grpc::Status::OK;
  };
  service.on_points = [](const v1::GetPointsRequest&, grpc::ServerWriterInterface<v1::PointChunk>& writer) {
    v1::PointChunk chunk;
    chunk.set_xyz(std::string(48, 'x'));
    writer.Write(chunk, grpc::WriteOptions());
    return grpc::Status::OK;
  };
  Client client = service.client();
  expect_error(ErrorCode::data_loss, {"2 arrived"}, [&] { client.get_points("geometry"); });
}

TEST(Client, DetectPutsPiecesTogether) {
  const auto ids = [](v1::DetectedIds::Of of, const std::vector<std::uint32_t>& values) {
    v1::DetectReply reply;
    reply.mutable_ids()->set_of(of);
    reply.mutable_ids()->set_ids(values.data(), 4 * values.size());
    return reply;
  };
  std::vector<v1::DetectReply> replies(1);
  replies[0].mutable_primitive()->set_name("plane_1");
  replies[0].mutable_primitive()->set_faces(3);
  replies[0].mutable_primitive()->set_points(1);
  replies.push_back(ids(v1::DetectedIds::FACES, {1, 2}));
  replies.push_back(ids(v1::DetectedIds::FACES, {5}));
  replies.push_back(ids(v1::DetectedIds::POINTS, {7}));
  replies.emplace_back().mutable_edge()->set_points(2);
  replies.push_back(ids(v1::DetectedIds::POINTS, {9, 8}));
  replies.emplace_back().mutable_summary()->set_area(4);
  ScriptedService service;
  service.on_detect = [&](const v1::DetectRequest&, auto& writer) {
    for (const auto& reply : replies) writer.Write(reply, grpc::WriteOptions());
    return grpc::Status::OK;
  };
  Client client = service.client();
  const client::Detected detected = client.detect({});
  ASSERT_EQ(detected.primitives.size(), 1u);
  EXPECT_EQ(detected.primitives[0].about.name(), "plane_1");
  EXPECT_EQ(detected.primitives[0].faces, (std::vector<FaceId>{1, 2, 5}));
  EXPECT_EQ(detected.primitives[0].points, (std::vector<PointId>{7}));
  ASSERT_EQ(detected.edges.size(), 1u);
  EXPECT_EQ(detected.edges[0].points, (std::vector<PointId>{9, 8}));
  EXPECT_EQ(detected.summary.area(), 4);

  const std::vector<v1::DetectReply> whole = replies;
  const auto broken = [&](const char* part, const std::function<void()>& spoil) {
    replies = whole;
    spoil();
    expect_error(ErrorCode::data_loss, {part}, [&] { client.detect({}); });
  };
  broken("no summary", [&] { replies.pop_back(); });
  broken("after the summary", [&] { replies.push_back(whole[0]); });
  broken("of 3 ids", [&] { replies.erase(replies.begin() + 2); });
  broken("of 2 ids", [&] { replies.erase(replies.begin() + 5); });
  broken("ids of nothing", [&] { replies.erase(replies.begin()); });
  broken("cut off", [&] { replies[1].mutable_ids()->set_ids("12345"); });
}

TEST(Client, HandsOverTheBytesOfABasisInOrder) {
  std::vector<v1::BasisReply> replies(3);
  replies[0].mutable_header()->set_system_id("system");
  replies[0].mutable_header()->set_bytes(7);
  replies[1].set_records("1234");
  replies[2].set_records("567");
  std::mutex mutex;  // of the replies: an attempt that the client has given up may still be sending them
  std::string asked;
  std::atomic<int> attempts{0};
  int failures = 0;
  ScriptedService service;
  service.on_get_basis = [&](const v1::GetBasisRequest& request, auto& writer) {
    EXPECT_EQ(request.system_id(), "system");
    asked = request.mesh();
    const bool fails = attempts++ < failures;
    std::unique_lock lock(mutex);
    const auto all = replies;
    lock.unlock();
    for (const auto& reply : all) writer.Write(reply, grpc::WriteOptions());
    return fails ? grpc::Status(grpc::StatusCode::UNAVAILABLE, "lost") : grpc::Status::OK;
  };
  Client client = service.client();
  std::string bytes;
  const auto sink = [&](std::span<const std::byte> piece) {
    bytes.append(reinterpret_cast<const char*>(piece.data()), piece.size());
  };
  EXPECT_EQ(client.get_basis("system", sink).bytes(), 7u);
  EXPECT_EQ(bytes, "1234567");
  EXPECT_EQ(asked, "");
  v1::GetBasisRequest request;
  request.set_system_id("system");
  request.set_mesh("copy.obj");
  EXPECT_EQ(client.get_basis(request, sink).bytes(), 7u);
  EXPECT_EQ(asked, "copy.obj");

  const std::vector<v1::BasisReply> whole = replies;
  const auto broken = [&](const char* part, const std::function<void()>& spoil) {
    {
      const std::lock_guard lock(mutex);
      replies = whole;
      spoil();
    }
    expect_error(ErrorCode::data_loss, {part}, [&] { client.get_basis("system", sink); });
  };
  broken("no header", [&] { replies.erase(replies.begin()); });
  broken("second header", [&] { replies.push_back(whole[0]); });
  broken("4 of 7 bytes", [&] { replies.pop_back(); });
  broken("more bytes than announced", [&] { replies.push_back(whole[1]); });
  broken("0 of 0 bytes", [&] { replies.clear(); });

  // What was handed over is not handed over twice.
  {
    const std::lock_guard lock(mutex);
    replies = whole;
  }
  attempts = 0;
  failures = 1;
  expect_error(ErrorCode::unavailable, {"lost"}, [&] { client.get_basis("system", sink); });
  EXPECT_EQ(attempts, 1);
  {
    const std::lock_guard lock(mutex);
    replies.resize(1);
    replies[0].mutable_header()->set_bytes(0);
  }
  attempts = 0;
  EXPECT_EQ(client.get_basis("system", sink).bytes(), 0u);
  EXPECT_EQ(attempts, 2);
}

/// How often a call is tried when its first attempts fail in some way.
struct RetryRow {
  const char* name;
  grpc::StatusCode status;
  const char* hint;
  int failures;  ///< attempts that fail
  int expected_attempts;
  bool succeeds;
};

TEST(Client, RetriesWhatIsSafe) {
  const std::vector<RetryRow> table = {
      {"lost once", grpc::StatusCode::UNAVAILABLE, nullptr, 1, 2, true},
      {"lost for ever", grpc::StatusCode::UNAVAILABLE, nullptr, 100, 3, false},
      {"refused with a hint", grpc::StatusCode::RESOURCE_EXHAUSTED, "20", 2, 3, true},
      {"refused without", grpc::StatusCode::RESOURCE_EXHAUSTED, nullptr, 1, 1, false},
      {"hint that is no number", grpc::StatusCode::RESOURCE_EXHAUSTED, "soon", 1, 1, false},
      {"wrong input", grpc::StatusCode::INVALID_ARGUMENT, "20", 1, 1, false},
      {"corrupted", grpc::StatusCode::DATA_LOSS, nullptr, 1, 1, false},
  };
  for (const auto& row : table) {
    SCOPED_TRACE(row.name);
    ScriptedService service;
    std::atomic<int> attempts{0};
    service.on_deform = [&](grpc::ServerContext& context, const v1::DeformRequest&, ScriptedService::Writer& writer) {
      if (++attempts > row.failures) return answer(writer, {});
      writer.Write(test::replies({})[0], grpc::WriteOptions());  // a header that must not spoil the next attempt
      if (row.hint != nullptr) context.AddTrailingMetadata("retry-after-ms", row.hint);
      return grpc::Status(row.status, "told to");
    };
    ClientOptions options;
    options.max_attempts = 3;
    Client client = service.client(options);
    keep(client);
    if (row.succeeds) {
      EXPECT_EQ(client.deform(raw_request()).designs.at(0).points, test::deformed_points(5000, 0));
    } else {
      EXPECT_THROW(client.deform(raw_request()), Error);
    }
    EXPECT_EQ(attempts, row.expected_attempts);
  }
}

TEST(Client, TheAttemptsOfACallHaveOneIdWhichItsErrorNames) {
  ScriptedService service;
  std::vector<std::string> ids;
  service.on_info = [&](grpc::ServerContext& context, v1::ServerInfo&) {
    const auto [first, last] = context.client_metadata().equal_range("x-request-id");
    for (auto it = first; it != last; ++it) ids.emplace_back(it->second.data(), it->second.size());
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "told to");
  };
  ClientOptions options;
  options.max_attempts = 2;
  Client client = service.client(options), other = service.client(options);
  const auto id_of_failed_call = [](Client& caller) {
    try {
      caller.server_info();
    } catch (const Error& error) {
      return client::request_id_of(error);
    }
    return std::string("none failed");
  };
  const std::string first = id_of_failed_call(client), second = id_of_failed_call(client), others = id_of_failed_call(other);
  EXPECT_EQ(ids, (std::vector<std::string>{first, first, second, second, others, others}));
  EXPECT_NE(first, second);
  EXPECT_NE(first, others);
  EXPECT_EQ(client::request_id_of(Error(ErrorCode::internal, "here")), "");
  service.stop();
  EXPECT_EQ(id_of_failed_call(client), "") << "nothing was sent";
}

// As haproxy before 3.2 does when the server answers before all of the request has come.
TEST(Client, AsksByTheHeaderAloneWhenAProxyHasCutAnUploadShort) {
  struct Row {
    const char* name;
    grpc::Status of_header;
    ErrorCode expected;
    int uploads;
  };
  const std::vector<Row> table = {
      {"refused", {grpc::StatusCode::PERMISSION_DENIED, "not you"}, ErrorCode::permission_denied, 1},
      {"taken, the rest was not", {grpc::StatusCode::INVALID_ARGUMENT, "incomplete"}, ErrorCode::unavailable, 2},
  };
  const Points points = test::registered_points(3);
  const std::vector<std::uint32_t> sizes = {3}, corners = {0, 1, 2};
  client::GeometryArrays arrays;
  arrays.points = points;
  arrays.face_sizes = sizes;
  arrays.face_points = corners;
  for (const auto& row : table) {
    SCOPED_TRACE(row.name);
    ScriptedService service;
    int uploads = 0, headers = 0;
    service.on_get_geometry = [](const v1::GetGeometryRequest&, v1::GeometryInfo&) {
      return grpc::Status(grpc::StatusCode::NOT_FOUND, "unknown");
    };
    service.on_register = [&](grpc::ServerReaderInterface<v1::RegisterGeometryRequest>& reader, v1::GeometryInfo&) {
      v1::RegisterGeometryRequest message;
      int messages = 0;
      while (reader.Read(&message)) ++messages;
      if (messages == 1) return ++headers, row.of_header;
      ++uploads;
      return grpc::Status(grpc::StatusCode::CANCELLED, "Received RST_STREAM with error code 8");
    };
    ClientOptions options;
    options.max_attempts = 2;
    Client client = service.client(options);
    expect_error(row.expected, {}, [&] { client.register_geometry(arrays); });
    EXPECT_EQ(uploads, row.uploads);
    EXPECT_EQ(headers, row.uploads);
  }
}

TEST(Client, RepeatsTwiceAsOftenBehindAProxy) {
  for (const bool replicas : {false, true}) {
    ScriptedService service;
    std::atomic<int> attempts{0};
    service.on_info = [&](grpc::ServerContext&, v1::ServerInfo&) {
      ++attempts;
      return grpc::Status(grpc::StatusCode::UNAVAILABLE, "shutting down");
    };
    ClientOptions options;
    options.max_attempts = 2;
    options.replicas = replicas;
    Client client = service.client(options);
    EXPECT_THROW(client.server_info(), Error);
    EXPECT_EQ(attempts, replicas ? 4 : 2);
  }
}

TEST(Client, WaitsAsLongAsTheServerSays) {
  ScriptedService service;
  std::atomic<int> attempts{0};
  service.on_info = [&](grpc::ServerContext& context, v1::ServerInfo&) {
    return ++attempts == 1 ? refusal(context, "150") : grpc::Status::OK;
  };
  Client client = service.client();
  const auto start = std::chrono::steady_clock::now();
  client.server_info();
  EXPECT_GE(std::chrono::steady_clock::now() - start, std::chrono::milliseconds(150));
}

TEST(Client, DoesNotRepeatWhatASinkHasTaken) {
  ScriptedService service;
  std::vector<int> asked;
  service.on_deform = [&](grpc::ServerContext&, const v1::DeformRequest& request, ScriptedService::Writer& writer) {
    asked.push_back(request.designs_size());
    ReplyScript script;
    script.designs = static_cast<std::size_t>(request.designs_size());
    auto all = test::replies(script);
    all.pop_back();  // the summary
    for (const auto& reply : all) writer.Write(reply, grpc::WriteOptions());
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "going down");
  };
  Client client = service.client();
  keep(client);
  int taken = 0;
  const auto sink = [&](std::size_t, client::DeformedDesign&&) { ++taken; };
  const auto outcome = client.deform(raw_request(2), {}, sink);
  EXPECT_EQ(asked, std::vector<int>{2});
  EXPECT_EQ(taken, 2);
  EXPECT_EQ(outcome.summary.bytes(), 0u) << "it never came";
  v1::DeformRequest warm = raw_request(2);
  warm.set_warm_start(true);
  expect_error(ErrorCode::unavailable, {"going down"}, [&] { client.deform(warm, {}, sink); });
  EXPECT_EQ(asked, (std::vector<int>{2, 2}));
}

TEST(Client, GoesOnAsLongAsDesignsCome) {
  ScriptedService service;
  std::vector<int> asked;
  service.on_deform = [&](grpc::ServerContext&, const v1::DeformRequest& request, ScriptedService::Writer& writer) {
    asked.push_back(request.designs_size());
    ReplyScript script;
    script.designs = static_cast<std::size_t>(request.designs_size());
    script.block_points = script.points;
    for (const auto& reply : test::replies(script)) {
      writer.Write(reply, grpc::WriteOptions());
      if (reply.has_result()) break;  // of the first design
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "going down");
  };
  ClientOptions options;
  options.max_attempts = 2;
  Client client = service.client(options);
  keep(client);
  std::vector<std::size_t> taken;
  client.deform(raw_request(5), {}, [&](std::size_t design, client::DeformedDesign&&) { taken.push_back(design); });
  EXPECT_EQ(asked, (std::vector<int>{5, 4, 3, 2, 1})) << "each attempt brought one";
  EXPECT_EQ(taken, (std::vector<std::size_t>{0, 1, 2, 3, 4}));
}

TEST(Client, DoesNotRepeatARemovalThatMayHaveHappened) {
  ScriptedService service;
  int attempts = 0;
  service.on_delete = [&](const v1::DeleteGeometryRequest&) {
    ++attempts;
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "connection reset");
  };
  Client client = service.client();
  expect_error(ErrorCode::unavailable, {"connection reset"}, [&] { client.delete_geometry({}); });
  EXPECT_EQ(attempts, 1);
}

TEST(Client, VerifiesChecksums) {
  ScriptedService service;
  service.on_deform = [&](grpc::ServerContext&, const v1::DeformRequest&, ScriptedService::Writer& writer) {
    auto all = test::replies({});
    (*all[1].mutable_block()->mutable_data())[5] ^= 4;
    for (const auto& reply : all) writer.Write(reply, grpc::WriteOptions());
    return grpc::Status::OK;
  };
  Client client = service.client();
  keep(client);
  expect_error(ErrorCode::data_loss, {"design 0, block 0", "checksum"}, [&] { client.deform(raw_request()); });
}

TEST(Client, AStreamThatEndsEarlyIsAnError) {
  ScriptedService service;
  service.on_deform = [&](grpc::ServerContext&, const v1::DeformRequest&, ScriptedService::Writer& writer) {
    auto all = test::replies({});
    all.resize(3);
    for (const auto& reply : all) writer.Write(reply, grpc::WriteOptions());
    return grpc::Status::OK;
  };
  Client client = service.client();
  keep(client);
  expect_error(ErrorCode::data_loss, {"ends before its summary"}, [&] { client.deform(raw_request()); });
}

TEST(Client, DeadlineReachesTheServerAndEndsTheCall) {
  ScriptedService service;
  std::atomic<bool> saw_deadline{false}, saw_cancel{false};
  service.on_deform = [&](grpc::ServerContext& context, const v1::DeformRequest&, ScriptedService::Writer&) {
    saw_deadline = context.deadline() < std::chrono::system_clock::now() + std::chrono::seconds(2);
    while (!context.IsCancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
    saw_cancel = true;
    return grpc::Status(grpc::StatusCode::CANCELLED, "");
  };
  {
    Client client = service.client();
    keep(client);
    CallOptions call;
    call.timeout = std::chrono::milliseconds(200);
    expect_error(ErrorCode::deadline_exceeded, {"deadline"}, [&] { client.deform(raw_request(), call); });
  }
  for (int k = 0; k < 1000 && !saw_cancel; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  EXPECT_TRUE(saw_deadline);
  EXPECT_TRUE(saw_cancel);
}

TEST(Client, StopEndsTheCallHereAndThere) {
  ScriptedService service;
  std::atomic<bool> started{false}, saw_cancel{false};
  service.on_deform = [&](grpc::ServerContext& context, const v1::DeformRequest&, ScriptedService::Writer&) {
    started = true;
    while (!context.IsCancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
    saw_cancel = true;
    return grpc::Status(grpc::StatusCode::CANCELLED, "");
  };
  Client client = service.client();
  keep(client);
  CallOptions call;
  std::stop_source stop;
  call.stop = stop.get_token();
  std::thread canceller([&] {
    while (!started) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    stop.request_stop();
  });
  expect_error(ErrorCode::cancelled, {"cancelled"}, [&] { client.deform(raw_request(), call); });
  canceller.join();
  for (int k = 0; k < 1000 && !saw_cancel; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  EXPECT_TRUE(saw_cancel);
}

TEST(Client, TakesACallThatTheServerCutsOffForLost) {
  ScriptedService service;
  int attempts = 0;
  service.on_info = [&](grpc::ServerContext&, v1::ServerInfo&) {
    return ++attempts == 1 ? grpc::Status::CANCELLED : grpc::Status::OK;
  };
  Client client = service.client();
  client.server_info();
  EXPECT_EQ(attempts, 2);
}

TEST(Client, GivesUpWaitingForAnotherAttemptAtTheDeadline) {
  ScriptedService service;
  std::atomic<int> attempts{0};
  service.on_info = [&](grpc::ServerContext& context, v1::ServerInfo&) {
    ++attempts;
    return refusal(context, "60000");
  };
  Client client = service.client();
  CallOptions call;
  call.timeout = std::chrono::milliseconds(500);
  expect_error(ErrorCode::out_of_budget, {"the queue is full"}, [&] { client.server_info(call); });
  EXPECT_EQ(attempts, 1);
}

TEST(Client, SaysWhenNobodyListens) {
  ClientOptions options;
  options.address = "127.0.0.1:1";
  options.max_attempts = 2;
  Client client(options);
  expect_error(ErrorCode::unavailable, {"cannot reach deformd at 127.0.0.1:1", "start it"}, [&] { client.server_info(); });
}

/// A server that answers calls for ServerInfo, at a port where there was none for a while.
class ReturningServer {
 public:
  explicit ReturningServer(int port)
      : thread_([this, port] {
          std::this_thread::sleep_for(std::chrono::milliseconds(700));
          service_ = std::make_unique<ScriptedService>(port);
          service_->on_info = [](grpc::ServerContext&, v1::ServerInfo&) { return grpc::Status::OK; };
        }) {}
  ~ReturningServer() { thread_.join(); }

 private:
  std::unique_ptr<ScriptedService> service_;
  std::thread thread_;
};

// Within less than the 5 s after which gRPC itself would go on with connecting.
TEST(Client, GoesOnAsSoonAsTheServerIsBack) {
  for (const bool after_an_answer : {true, false}) {
    SCOPED_TRACE(after_an_answer);
    auto service = std::make_unique<ScriptedService>();
    service->on_info = [](grpc::ServerContext&, v1::ServerInfo&) { return grpc::Status::OK; };
    ClientOptions options;
    options.address = service->address();
    options.max_attempts = 1;
    options.patience = std::chrono::seconds(4);
    Client client(options);
    if (after_an_answer) client.server_info();
    const int port = service->port();
    service.reset();
    const ReturningServer returning(port);
    EXPECT_NO_THROW(client.server_info());
  }
}

TEST(Client, IsPatientOnceThereWasAnAnswer) {
  auto service = std::make_unique<ScriptedService>();
  service->on_info = [](grpc::ServerContext&, v1::ServerInfo&) { return grpc::Status::OK; };
  ClientOptions options;
  options.address = service->address();
  options.max_attempts = 1;
  Client client(options), impatient([&] {
    ClientOptions other = options;
    other.patience = std::chrono::seconds(0);
    return other;
  }()),
      new_one(options);
  client.server_info();
  impatient.server_info();
  const int port = service->port();
  service.reset();
  expect_error(ErrorCode::unavailable, {"cannot reach"}, [&] { new_one.server_info(); });
  expect_error(ErrorCode::unavailable, {options.address.c_str()}, [&] { impatient.server_info(); });
  const ReturningServer returning(port);
  EXPECT_NO_THROW(client.server_info());
}

TEST(Client, ChecksItsOptions) {
  ClientOptions options;
  options.max_attempts = 0;
  expect_error(ErrorCode::invalid_argument, {"max_attempts", "1 to 100"}, [&] { Client client(options); });
  options.max_attempts = 1;
  for (const std::chrono::hours patience : {std::chrono::hours(-1), std::chrono::hours(7 * 24 + 1)}) {
    options.patience = patience;
    expect_error(ErrorCode::invalid_argument, {"patience (ms)", "0 to 604800000"}, [&] { Client client(options); });
  }
}

TEST(Client, FollowsPagesToTheEnd) {
  ScriptedService service;
  service.on_list = [](const v1::ListGeometriesRequest& request, v1::ListGeometriesReply& reply) {
    reply.add_geometries()->set_id("of page " + request.page_token());
    if (request.page_token() != "b") reply.set_next_page_token(request.page_token().empty() ? "a" : "b");
    return grpc::Status::OK;
  };
  Client client = service.client();
  EXPECT_EQ(client.list_geometries().size(), 3u);
  service.on_list = [](const v1::ListGeometriesRequest&, v1::ListGeometriesReply& reply) {
    reply.set_next_page_token("again");
    return grpc::Status::OK;
  };
  expect_error(ErrorCode::data_loss, {"repeats its page token"}, [&] { client.list_geometries(); });
}

}  // namespace
}  // namespace deform::client_test
