// Calls that stream replies or requests: order, cancellation before, during and while writing, deadlines, slow readers, early
// ends.
#include <thread>

#include "tests/server/service_fixture.h"

namespace deform::server {
namespace {

using grpc::StatusCode;
using support::eventually;
using support::FakeJob;

class ServiceStreams : public ServiceFixture {
 protected:
  v1::DeformRequest request() {
    v1::DeformRequest out;
    out.set_system_id("0123456789abcdef");
    out.add_designs();
    return out;
  }
};

TEST_P(ServiceStreams, DeformDeliversAllRepliesInOrder) {
  engine.on_job = [](FakeJob& job) {
    for (std::uint32_t i = 0; i < 20; ++i) job.push_block(i, 700'000);
    job.end();
  };
  start();
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, request());
  v1::DeformReply reply;
  std::uint32_t expected = 0;
  while (reader->Read(&reply)) {
    EXPECT_EQ(reply.block().block(), expected++);
    EXPECT_EQ(reply.block().data(), std::string(700'000, 'b'));
  }
  EXPECT_EQ(expected, 20u);
  EXPECT_TRUE(reader->Finish().ok());
  EXPECT_EQ(engine.job(0)->request().system_id(), "0123456789abcdef");
}

TEST_P(ServiceStreams, RepliesThatComeLateAreWrittenWhenTheyCome) {
  start();
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, request());
  v1::DeformReply reply;
  const auto job = engine.job(0);
  for (std::uint32_t i = 0; i < 100; ++i) {
    job->push_block(i);
    ASSERT_TRUE(reader->Read(&reply));
    EXPECT_EQ(reply.block().block(), i);
  }
  job->end();
  EXPECT_FALSE(reader->Read(&reply));
  EXPECT_TRUE(reader->Finish().ok());
}

TEST_P(ServiceStreams, AnErrorOfTheJobBecomesTheStatusAfterTheRepliesBeforeIt) {
  engine.on_job = [](FakeJob& job) {
    job.push_block(0);
    job.end(Error(ErrorCode::numerical_failure, "singular"));
  };
  start();
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, request());
  v1::DeformReply reply;
  EXPECT_TRUE(reader->Read(&reply));
  EXPECT_FALSE(reader->Read(&reply));
  const grpc::Status status = reader->Finish();
  EXPECT_EQ(status.error_code(), StatusCode::ABORTED);
  EXPECT_EQ(status.error_message(), "singular");
}

TEST_P(ServiceStreams, ARefusedDeformCarriesItsRetryHint) {
  engine.deform_error = Error(ErrorCode::out_of_budget, "the queue is full", 250);
  start();
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, request());
  v1::DeformReply reply;
  EXPECT_FALSE(reader->Read(&reply));
  EXPECT_EQ(reader->Finish().error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(retry_hint(context), "250");
}

TEST_P(ServiceStreams, ContinuedDesignsBelongToTheStreamOnly) {
  start();
  v1::DeformRequest continued = request();
  continued.mutable_designs(0)->set_continues(true);
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, continued);
  const grpc::Status status = reader->Finish();
  EXPECT_EQ(status.error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_NE(status.error_message().find("designs[0].continues"), std::string::npos);
}

TEST_P(ServiceStreams, CancelWhileTheJobComputesReachesIt) {
  start();
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, request());
  const auto job = engine.job(0);
  context.TryCancel();
  EXPECT_TRUE(eventually([&] { return job->cancelled() && job->call().cancel.cancelled(); }));
  EXPECT_EQ(reader->Finish().error_code(), StatusCode::CANCELLED);
}

TEST_P(ServiceStreams, CancelBeforeTheCallReachesTheServerLeavesNothing) {
  start();
  grpc::ClientContext context;
  context.TryCancel();
  const auto reader = stub->Deform(&context, request());
  EXPECT_EQ(reader->Finish().error_code(), StatusCode::CANCELLED);
  EXPECT_TRUE(eventually([&] { return engine.job_count() == 0 || engine.job(0)->cancelled(); }));
}

TEST_P(ServiceStreams, CancelWhileWritingEndsTheCallAndTheJob) {
  engine.on_job = [](FakeJob& job) {
    for (std::uint32_t i = 0; i < 100; ++i) job.push_block(i, 900'000);
  };
  start();
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, request());
  v1::DeformReply reply;
  EXPECT_TRUE(reader->Read(&reply));
  context.TryCancel();
  EXPECT_EQ(reader->Finish().error_code(), StatusCode::CANCELLED);
  EXPECT_TRUE(eventually([&] { return engine.job(0)->cancelled(); }));
}

TEST_P(ServiceStreams, TheDeadlineTravelsAndEndsTheCall) {
  start();
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(200));
  const auto reader = stub->Deform(&context, request());
  const auto job = engine.job(0);
  ASSERT_TRUE(job->call().deadline.has_value());
  EXPECT_LT(*job->call().deadline, std::chrono::steady_clock::now() + std::chrono::milliseconds(201));
  EXPECT_EQ(reader->Finish().error_code(), StatusCode::DEADLINE_EXCEEDED);
  EXPECT_TRUE(eventually([&] { return job->cancelled(); }));
}

TEST_P(ServiceStreams, WithoutADeadlineThereIsNone) {
  engine.on_job = [](FakeJob& job) { job.end(); };
  start();
  grpc::ClientContext context;
  EXPECT_TRUE(stub->Deform(&context, request())->Finish().ok());
  EXPECT_FALSE(engine.job(0)->call().deadline.has_value());
}

TEST_P(ServiceStreams, ASlowReaderHoldsBackTheJobAndNobodyElse) {
  engine.on_job = [](FakeJob& job) {
    for (std::uint32_t i = 0; i < 60; ++i) job.push_block(i, 900'000);
    job.end();
  };
  start();
  grpc::ClientContext slow_context;
  const auto slow = stub->Deform(&slow_context, request());
  const auto job = engine.job(0);
  // Others are served while the first does not read.
  for (int i = 0; i < 3; ++i) {
    grpc::ClientContext context;
    const auto reader = stub->Deform(&context, request());
    v1::DeformReply reply;
    int count = 0;
    while (reader->Read(&reply)) ++count;
    EXPECT_EQ(count, 60);
    EXPECT_TRUE(reader->Finish().ok());
  }
  EXPECT_LT(job->delivered(), 60u) << "the server must not swallow what nobody reads";
  v1::DeformReply reply;
  int count = 0;
  while (slow->Read(&reply)) ++count;
  EXPECT_EQ(count, 60);
  EXPECT_TRUE(slow->Finish().ok());
}

TEST_P(ServiceStreams, JacobianVectorStreamsItsBlocks) {
  engine.on_job = [](FakeJob& job) {
    job.push_block(0);
    job.end();
  };
  start();
  grpc::ClientContext context;
  v1::JacobianVectorRequest jacobian;
  jacobian.set_system_id("s");
  const auto reader = stub->JacobianVector(&context, jacobian);
  v1::DeformReply reply;
  EXPECT_TRUE(reader->Read(&reply));
  EXPECT_FALSE(reader->Read(&reply));
  EXPECT_TRUE(reader->Finish().ok());
}

TEST_P(ServiceStreams, GetPointsSendsAllPointsInChunksBelowOneMebibyte) {
  start();
  grpc::ClientContext context;
  v1::GetPointsRequest points;
  points.set_id("g");
  const auto reader = stub->GetPoints(&context, points);
  v1::PointChunk chunk;
  std::string bytes;
  int chunks = 0;
  while (reader->Read(&chunk)) {
    EXPECT_LT(chunk.ByteSizeLong(), std::size_t{1} << 20);
    bytes += chunk.xyz();
    ++chunks;
  }
  EXPECT_TRUE(reader->Finish().ok());
  EXPECT_EQ(chunks, 4);
  const auto expected = engine.get_points("g");
  ASSERT_EQ(bytes.size(), expected->size() * sizeof(Vec3));
  EXPECT_EQ(std::memcmp(bytes.data(), expected->data(), bytes.size()), 0);
}

// ---- prepare ----

TEST_P(ServiceStreams, PrepareTellsProgressAndThenTheSystem) {
  engine.on_prepare = [](const v1::PrepareRequest& asked, const CallContext&, auto on_progress, auto on_done) {
    std::thread([=] {
      v1::Progress progress;
      for (const char* stage : {"assemble", "factor"}) {
        progress.set_stage(stage);
        for (int i = 0; i < 1000; ++i) {
          progress.set_fraction(i / 1000.0);
          on_progress(progress);
        }
      }
      v1::SystemInfo info;
      info.set_id("of " + asked.setup().geometry());
      on_done({info, std::nullopt, {}});
    }).detach();
  };
  start();
  grpc::ClientContext context;
  v1::PrepareRequest prepare;
  prepare.mutable_setup()->set_geometry("g");
  const auto reader = stub->Prepare(&context, prepare);
  v1::PrepareReply reply;
  int progress = 0;
  int systems = 0;
  while (reader->Read(&reply)) {
    EXPECT_EQ(systems, 0) << "the system comes last";
    if (reply.has_progress()) ++progress;
    if (reply.has_system()) ++systems;
  }
  EXPECT_TRUE(reader->Finish().ok());
  EXPECT_EQ(systems, 1);
  EXPECT_LE(progress, 2) << "two thousand reports within a moment are not worth two thousand messages";
  EXPECT_EQ(reply.system().id(), "of g");
}

TEST_P(ServiceStreams, PrepareThatFailsEndsWithItsStatus) {
  engine.on_prepare = [](const v1::PrepareRequest&, const CallContext&, auto, auto on_done) {
    on_done({std::nullopt, Error(ErrorCode::invalid_argument, "handles[0]: empty"), {}});
  };
  start();
  grpc::ClientContext context;
  const auto reader = stub->Prepare(&context, {});
  const grpc::Status status = reader->Finish();
  EXPECT_EQ(status.error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status.error_message(), "handles[0]: empty");
}

TEST_P(ServiceStreams, ACancelledPrepareEndsAtOnceAndItsLateOutcomeIsDropped) {
  std::function<void(Engine::Outcome<v1::SystemInfo>)> late;
  std::optional<CallContext> seen;
  std::atomic<bool> asked{false};
  engine.on_prepare = [&](const v1::PrepareRequest&, const CallContext& call, auto, auto on_done) {
    late = on_done;
    seen = call;
    asked = true;
  };
  start();
  grpc::ClientContext context;
  const auto reader = stub->Prepare(&context, {});
  ASSERT_TRUE(eventually([&] { return asked.load(); }));
  context.TryCancel();
  EXPECT_EQ(reader->Finish().error_code(), StatusCode::CANCELLED);
  EXPECT_TRUE(eventually([&] { return seen->cancel.cancelled(); }));
  server->running().stop(std::chrono::milliseconds(0));  // does not wait for the outcome
  late({v1::SystemInfo(), std::nullopt, {}});
}

// ---- uploads ----

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

TEST_P(ServiceStreams, AnUploadIsFinishedWhenTheClientHasSentAll) {
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

TEST_P(ServiceStreams, AGeometryThatIsThereIsAnsweredBeforeItIsSent) {
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

TEST_P(ServiceStreams, ABadPartEndsTheUploadAtOnce) {
  engine.before = [](const CallContext*) { throw Error(ErrorCode::invalid_argument, "points: too many"); };
  start();
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  writer->Write(header_message(10));
  writer->Write(points_message());
  keep_sending(*writer);
  const grpc::Status status = writer->Finish();
  EXPECT_EQ(status.error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(status.error_message(), "points: too many");
  EXPECT_FALSE(engine.upload(0)->finished);
  EXPECT_TRUE(eventually([&] { return engine.upload(0)->destroyed.load(); }));
}

TEST_P(ServiceStreams, ACancelledUploadIsDroppedUnfinished) {
  start();
  grpc::ClientContext context;
  v1::GeometryInfo info;
  const auto writer = stub->RegisterGeometry(&context, &info);
  EXPECT_TRUE(writer->Write(header_message(10)));
  EXPECT_TRUE(writer->Write(points_message()));
  EXPECT_TRUE(eventually([&] { return engine.upload(0)->parts == 1; }));
  context.TryCancel();
  EXPECT_EQ(writer->Finish().error_code(), StatusCode::CANCELLED);
  EXPECT_TRUE(eventually([&] { return engine.upload(0)->destroyed.load(); }));
  EXPECT_FALSE(engine.upload(0)->finished);
}

TEST_P(ServiceStreams, UploadsWithoutOrWithoutFirstHeaderAreRefused) {
  start();
  {
    grpc::ClientContext context;
    v1::GeometryInfo info;
    const auto writer = stub->RegisterGeometry(&context, &info);
    writer->WritesDone();
    EXPECT_EQ(writer->Finish().error_code(), StatusCode::INVALID_ARGUMENT);
  }
  {
    grpc::ClientContext context;
    v1::GeometryInfo info;
    const auto writer = stub->RegisterGeometry(&context, &info);
    writer->Write(points_message());
    EXPECT_EQ(writer->Finish().error_code(), StatusCode::INVALID_ARGUMENT);
  }
}

// ---- vector-Jacobian ----

class VectorJacobian : public ServiceStreams {
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
    out.add_gradient(cotangent == *engine.get_points("") ? 1 : 0);
    on_done({out, std::nullopt, {}});
  };
  start();
  const auto points = engine.get_points("");
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
  EXPECT_EQ(call(std::string(2399, 0), 2400).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(call(std::string(2401, 0), 2400).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(call("", 1).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(call(std::string(2400, 0), 2400, 0).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(call(std::string(2400, 0), 2400, 2).error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(call("", 1, 0).error_code(), StatusCode::INVALID_ARGUMENT);
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
  EXPECT_EQ(writer->Finish().error_code(), StatusCode::DEADLINE_EXCEEDED);
  EXPECT_TRUE(eventually([&] { return asked.load(); }));
  server->running().stop(std::chrono::milliseconds(0));
  late({v1::VectorJacobianReply(), std::nullopt, {}});
}

DEFORM_BOTH_TRANSPORTS(ServiceStreams);
DEFORM_BOTH_TRANSPORTS(VectorJacobian);

}  // namespace
}  // namespace deform::server
