// SPDX-License-Identifier: GPL-3.0-or-later
// Calls that stream replies: order, cancellation before, during and while writing, deadlines, slow readers, early
// ends.
#include <thread>

#include "tests/server/ended_with.h"
#include "tests/server/service_fixture.h"

namespace deform::server::service_streams_test {
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
  EXPECT_THAT(status, EndedWith(StatusCode::ABORTED));
  EXPECT_EQ(status.error_message(), "singular");
}

TEST_P(ServiceStreams, ARefusedDeformCarriesItsRetryHint) {
  engine.deform_error = Error(ErrorCode::out_of_budget, "the queue is full", 250);
  start();
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, request());
  v1::DeformReply reply;
  EXPECT_FALSE(reader->Read(&reply));
  EXPECT_THAT(reader->Finish(), EndedWith(StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_EQ(retry_hint(context), "250");
}

TEST_P(ServiceStreams, ContinuedDesignsBelongToTheStreamOnly) {
  start();
  v1::DeformRequest continued = request();
  continued.mutable_designs(0)->set_continues(true);
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, continued);
  const grpc::Status status = reader->Finish();
  EXPECT_THAT(status, EndedWith(StatusCode::INVALID_ARGUMENT));
  EXPECT_NE(status.error_message().find("designs[0].continues"), std::string::npos);
}

TEST_P(ServiceStreams, CancelWhileTheJobComputesReachesIt) {
  start();
  grpc::ClientContext context;
  const auto reader = stub->Deform(&context, request());
  const auto job = engine.job(0);
  context.TryCancel();
  EXPECT_TRUE(eventually([&] { return job->cancelled() && job->call().stop.stop_requested(); }));
  EXPECT_THAT(reader->Finish(), EndedWith(StatusCode::CANCELLED));
}

TEST_P(ServiceStreams, CancelBeforeTheCallReachesTheServerLeavesNothing) {
  start();
  grpc::ClientContext context;
  context.TryCancel();
  const auto reader = stub->Deform(&context, request());
  EXPECT_THAT(reader->Finish(), EndedWith(StatusCode::CANCELLED));
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
  EXPECT_THAT(reader->Finish(), EndedWith(StatusCode::CANCELLED));
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
  EXPECT_THAT(reader->Finish(), EndedWith(StatusCode::DEADLINE_EXCEEDED));
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

TEST_P(ServiceStreams, DetectSendsItsRepliesWhenTheyAreThere) {
  std::function<void(Engine::Outcome<Engine::DetectReplies>)> done;
  std::mutex mutex;
  engine.on_detect = [&](const v1::DetectRequest& request, const CallContext&, auto on_done) {
    if (request.geometry_id() == "bad") throw Error(ErrorCode::not_found, "geometry bad: unknown id");
    const std::lock_guard lock(mutex);
    done = std::move(on_done);
  };
  start();
  v1::DetectRequest request;
  request.set_geometry_id("g");
  grpc::ClientContext context;
  const auto reader = stub->Detect(&context, request);
  ASSERT_TRUE(eventually([&] {
    const std::lock_guard lock(mutex);
    return done != nullptr;
  }));
  std::vector<v1::DetectReply> replies(3);
  replies[0].mutable_primitive()->set_name("plane_1");
  replies[1].mutable_ids()->set_ids("1234");
  replies[2].mutable_summary()->set_area(2);
  done({std::make_shared<const std::vector<v1::DetectReply>>(replies), std::nullopt, {}});
  v1::DetectReply reply;
  for (const auto& expected : replies) {
    ASSERT_TRUE(reader->Read(&reply));
    EXPECT_EQ(reply.SerializeAsString(), expected.SerializeAsString());
  }
  EXPECT_FALSE(reader->Read(&reply));
  EXPECT_TRUE(reader->Finish().ok());

  request.set_geometry_id("bad");
  grpc::ClientContext second;
  const auto refused = stub->Detect(&second, request);
  EXPECT_FALSE(refused->Read(&reply));
  EXPECT_THAT(refused->Finish(), EndedWith(StatusCode::NOT_FOUND));
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
  const auto expected = engine.get_points("g", {});
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
  EXPECT_THAT(status, EndedWith(StatusCode::INVALID_ARGUMENT));
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
  EXPECT_THAT(reader->Finish(), EndedWith(StatusCode::CANCELLED));
  EXPECT_TRUE(eventually([&] { return seen->stop.stop_requested(); }));
  server->running().stop(std::chrono::milliseconds(0));  // does not wait for the outcome
  late({v1::SystemInfo(), std::nullopt, {}});
}

DEFORM_BOTH_TRANSPORTS(ServiceStreams);

}  // namespace
}  // namespace deform::server::service_streams_test
