// SPDX-License-Identifier: GPL-3.0-or-later
// Calls whose requests are streams: geometries and the cotangents of vector-Jacobian products.
#include "tests/server/ended_with.h"
#include "tests/server/service_fixture.h"

namespace deform::server::service_uploads_test {
namespace {

using grpc::StatusCode;
using support::eventually;

class ServiceUploads : public ServiceFixture {};

constexpr std::size_t part_bytes = 900'000;

v1::RegisterGeometryRequest header_message(std::size_t parts) {
  v1::RegisterGeometryRequest message;
  message.mutable_header()->set_point_count(parts * part_bytes / sizeof(Vec3));
  return message;
}

v1::RegisterGeometryRequest points_message() {
  v1::RegisterGeometryRequest message;
  message.mutable_points()->set_xyz(std::string(part_bytes, 'x'));
  return message;
}

/// The client goes on sending until it learns of the answer. In-process a blocking Write never learns of it (it completes only
/// when the other side reads, or when the status has been asked for), so there the client stops by itself.
template <typename Writer>
void keep_sending(Writer& writer) {
  if (testing::WithParamInterface<support::Transport>::GetParam() == support::Transport::in_process) return;
  while (writer.Write(points_message())) {
  }
}

TEST_P(ServiceUploads, AnUploadIsFinishedWhenTheClientHasSentAll) {
  start();
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  EXPECT_TRUE(writer->Write(header_message(10)));
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(writer->Write(points_message()));
  EXPECT_FALSE(engine.upload(0)->finished);
  writer->WritesDone();
  EXPECT_TRUE(writer->Finish().ok());
  EXPECT_EQ(info.id(), "abc");
  EXPECT_EQ(engine.upload(0)->parts, 10);
}

TEST_P(ServiceUploads, AGeometryThatIsThereIsAnsweredBeforeItIsSent) {
  engine.already_stored = true;
  start();
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  writer->Write(header_message(10));
  keep_sending(*writer);
  EXPECT_TRUE(writer->Finish().ok());
  EXPECT_TRUE(info.existed());
  EXPECT_EQ(engine.upload(0)->parts, 0);
}

TEST_P(ServiceUploads, ABadPartEndsTheUploadAtOnce) {
  engine.before = [](const CallContext*) { throw Error(ErrorCode::invalid_argument, "points: too many"); };
  start();
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  writer->Write(header_message(10));
  writer->Write(points_message());
  keep_sending(*writer);
  const grpc::Status status = writer->Finish();
  EXPECT_THAT(status, EndedWith(StatusCode::INVALID_ARGUMENT));
  EXPECT_EQ(status.error_message(), "points: too many");
  EXPECT_FALSE(engine.upload(0)->finished);
  EXPECT_TRUE(eventually([&] { return engine.upload(0)->destroyed.load(); }));
}

TEST_P(ServiceUploads, ACancelledUploadIsDroppedUnfinished) {
  start();
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  EXPECT_TRUE(writer->Write(header_message(10)));
  EXPECT_TRUE(writer->Write(points_message()));
  EXPECT_TRUE(eventually([&] { return engine.upload(0)->parts == 1; }));
  context.TryCancel();
  EXPECT_THAT(writer->Finish(), EndedWith(StatusCode::CANCELLED));
  EXPECT_TRUE(eventually([&] { return engine.upload(0)->destroyed.load(); }));
  EXPECT_FALSE(engine.upload(0)->finished);
}

/// Its last group, say, may have been to go on.
TEST_P(ServiceUploads, AClientThatLeavesWhenItsUploadLooksCompleteHasNotSaidAll) {
  start();
  for (std::size_t i = 0; i < 200; ++i) {
    grpc::ClientContext context;
    v1::GeometryInfo info;
    const auto writer = stub->RegisterGeometry(&context, &info);
    ASSERT_TRUE(writer->Write(header_message(1)));
    ASSERT_TRUE(writer->Write(points_message()));
    ASSERT_TRUE(eventually([&] { return engine.upload(i)->parts == 1; }));
    context.TryCancel();
    ASSERT_THAT(writer->Finish(), EndedWith(StatusCode::CANCELLED));
    ASSERT_TRUE(eventually([&] { return engine.upload(i)->destroyed.load(); }));
    ASSERT_FALSE(engine.upload(i)->finished) << "upload " << i;
  }
}

TEST_P(ServiceUploads, UploadsWithoutOrWithoutFirstHeaderAreRefused) {
  start();
  {
    grpc::ClientContext context;
    v1::GeometryInfo info;
    const auto writer = stub->RegisterGeometry(&context, &info);
    writer->WritesDone();
    EXPECT_THAT(writer->Finish(), EndedWith(StatusCode::INVALID_ARGUMENT));
  }
  {
    grpc::ClientContext context;
    v1::GeometryInfo info;
    const auto writer = stub->RegisterGeometry(&context, &info);
    writer->Write(points_message());
    EXPECT_THAT(writer->Finish(), EndedWith(StatusCode::INVALID_ARGUMENT));
  }
}

// ---- vector-Jacobian ----

class VectorJacobian : public ServiceFixture {
 protected:
  /// Sends a header (unless told) and the cotangent in chunks.
  grpc::Status call(const std::string& cotangent, std::size_t chunk, int headers = 1) {
    grpc::ClientContext context;
    const auto writer = stub->VectorJacobian(&context, &reply);
    v1::VectorJacobianRequest message;
    message.mutable_header()->set_system_id("s");
    for (int i = 0; i < headers; ++i) writer->Write(message);
    for (std::size_t at = 0; at < cotangent.size(); at += chunk) {
      message.set_cotangent(cotangent.substr(at, chunk));
      if (!writer->Write(message)) break;
    }
    writer->WritesDone();
    return writer->Finish();
  }
  v1::VectorJacobianReply reply;
};

TEST_P(VectorJacobian, TheFieldArrivesInOrderHoweverItIsCut) {
  engine.point_count = 1000;
  engine.on_vector_jacobian = [&](Points cotangent, const CallContext&, auto on_done) {
    v1::VectorJacobianReply out;
    out.add_gradient(static_cast<double>(cotangent.size()));
    out.add_gradient(cotangent == *engine.get_points("", {}) ? 1 : 0);
    on_done({out, std::nullopt, {}});
  };
  start();
  const auto points = engine.get_points("", {});
  const std::string bytes(reinterpret_cast<const char*>(points->data()), points->size() * sizeof(Vec3));
  for (const std::size_t chunk : {std::size_t{24'000}, std::size_t{2400}, std::size_t{1001}}) {
    ASSERT_TRUE(call(bytes, chunk).ok());
    ASSERT_EQ(reply.gradient_size(), 2);
    EXPECT_EQ(reply.gradient(0), 1000);
    EXPECT_EQ(reply.gradient(1), 1);
  }
}

TEST_P(VectorJacobian, WrongSizesAndOrdersAreRefused) {
  engine.point_count = 100;
  engine.on_vector_jacobian = [](Points, const CallContext&, auto) { FAIL() << "must not be reached"; };
  start();
  EXPECT_THAT(call(std::string(2399, 0), 2400), EndedWith(StatusCode::INVALID_ARGUMENT));
  EXPECT_THAT(call(std::string(2401, 0), 2400), EndedWith(StatusCode::INVALID_ARGUMENT));
  EXPECT_THAT(call("", 1), EndedWith(StatusCode::INVALID_ARGUMENT));
  EXPECT_THAT(call(std::string(2400, 0), 2400, 0), EndedWith(StatusCode::INVALID_ARGUMENT));
  EXPECT_THAT(call(std::string(2400, 0), 2400, 2), EndedWith(StatusCode::INVALID_ARGUMENT));
  EXPECT_THAT(call("", 1, 0), EndedWith(StatusCode::INVALID_ARGUMENT));
}

TEST_P(VectorJacobian, CancelWhileTheEngineComputesEndsTheCallAtOnce) {
  engine.point_count = 1;
  std::function<void(Engine::Outcome<v1::VectorJacobianReply>)> late;
  std::atomic<bool> asked{false};
  engine.on_vector_jacobian = [&](Points, const CallContext&, auto on_done) {
    late = on_done;
    asked = true;
  };
  start();
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(100));
  const auto writer = stub->VectorJacobian(&context, &reply);
  v1::VectorJacobianRequest message;
  message.mutable_header()->set_system_id("s");
  writer->Write(message);
  message.set_cotangent(std::string(24, 0));
  writer->Write(message);
  writer->WritesDone();
  EXPECT_THAT(writer->Finish(), EndedWith(StatusCode::DEADLINE_EXCEEDED));
  EXPECT_TRUE(eventually([&] { return asked.load(); }));
  server->running().stop(std::chrono::milliseconds(0));
  late({v1::VectorJacobianReply(), std::nullopt, {}});
}
DEFORM_BOTH_TRANSPORTS(ServiceUploads);
DEFORM_BOTH_TRANSPORTS(VectorJacobian);

}  // namespace
}  // namespace deform::server::service_uploads_test
