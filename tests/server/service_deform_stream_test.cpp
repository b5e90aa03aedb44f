// SPDX-License-Identifier: GPL-3.0-or-later
// DeformStream: pipelining, fairness, refusals that leave the stream going, cancellation, half-close, draining.
#include <algorithm>
#include <map>
#include <random>
#include <set>
#include <thread>

#include "tests/server/ended_with.h"
#include "tests/server/service_fixture.h"

namespace deform::server::service_deform_stream_test {
namespace {

using grpc::StatusCode;
using support::eventually;
using support::FakeJob;

class ServiceDeformStream : public ServiceFixture {
 protected:
  using Stream = grpc::ClientReaderWriter<v1::DeformStreamRequest, v1::DeformReply>;

  void open(const ServiceOptions& options = {}) {
    start(options);
    stream = stub->DeformStream(&context);
  }
  static v1::DeformStreamRequest message(std::uint64_t id, bool more = false) {
    v1::DeformStreamRequest out;
    out.set_request_id(id);
    out.mutable_request()->set_system_id(std::string("s").append(std::to_string(id)));
    out.mutable_request()->add_designs()->add_variables(static_cast<double>(id));
    out.set_more(more);
    return out;
  }
  static v1::DeformStreamRequest cancel_message(std::uint64_t id) {
    v1::DeformStreamRequest out;
    out.set_request_id(id);
    out.set_cancel(true);
    return out;
  }
  v1::DeformReply read() {
    v1::DeformReply reply;
    EXPECT_TRUE(stream->Read(&reply));
    return reply;
  }
  StatusCode finish() {
    v1::DeformReply reply;
    EXPECT_FALSE(stream->Read(&reply)) << reply.ShortDebugString();
    return stream->Finish().error_code();
  }

  grpc::ClientContext context;
  std::unique_ptr<Stream> stream;
};

TEST_P(ServiceDeformStream, AThousandPipelinedRequestsAreAnsweredOutOfOrder) {
  constexpr std::uint64_t count = 1000;
  std::mutex mutex;
  std::vector<FakeJob*> held;
  // The engine ends jobs in shuffled groups, on threads of its own.
  engine.on_job = [&](FakeJob& job) {
    job.push_block(static_cast<std::uint32_t>(job.request_id()), 100);
    const std::lock_guard lock(mutex);
    held.push_back(&job);
  };
  open();
  std::atomic<bool> all_read{false};
  std::thread ender([&] {
    std::mt19937 random(7);
    while (!all_read) {
      std::vector<FakeJob*> group;
      {
        const std::lock_guard lock(mutex);
        group.swap(held);
      }
      std::shuffle(group.begin(), group.end(), random);
      for (FakeJob* job : group) {
        v1::DeformReply reply;
        reply.mutable_summary()->set_bytes(job->request_id());
        job->push(std::move(reply));
        job->end();
      }
      std::this_thread::yield();
    }
  });
  std::thread writer([&] {
    for (std::uint64_t id = 1; id <= count; ++id) EXPECT_TRUE(stream->Write(message(id)));
    stream->WritesDone();
  });
  std::map<std::uint64_t, std::vector<v1::DeformReply>> replies;
  v1::DeformReply reply;
  while (stream->Read(&reply)) replies[reply.request_id()].push_back(reply);
  all_read = true;
  writer.join();
  ender.join();
  EXPECT_TRUE(stream->Finish().ok());
  ASSERT_EQ(replies.size(), count);
  for (const auto& [id, parts] : replies) {
    ASSERT_EQ(parts.size(), 2u);
    EXPECT_EQ(parts[0].block().block(), id);
    EXPECT_EQ(parts[1].summary().bytes(), id);
  }
}

// The job has not said that it is done: only the summary tells the client.
TEST_P(ServiceDeformStream, ARequestEndsWithItsSummary) {
  open();
  stream->Write(message(1));
  v1::DeformReply last;
  last.mutable_summary()->set_bytes(5);
  engine.job(0)->push(last);
  EXPECT_EQ(read().summary().bytes(), 5u);
  stream->Write(cancel_message(1));  // crosses the summary: no reply
  stream->Write(message(1));         // another request
  engine.job(1)->push(last);
  const v1::DeformReply again = read();
  EXPECT_EQ(again.request_id(), 1u);
  EXPECT_TRUE(again.has_summary()) << again.ShortDebugString();
  stream->WritesDone();
  EXPECT_EQ(finish(), StatusCode::OK);
  EXPECT_FALSE(engine.job(0)->cancelled());
}

TEST_P(ServiceDeformStream, TheEngineIsGivenNoMoreThanTheWindow) {
  ServiceOptions options;
  options.stream.running_requests = 3;
  open(options);
  for (std::uint64_t id = 1; id <= 10; ++id) stream->Write(message(id));
  engine.job(2);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(engine.job_count(), 3u);
  for (std::size_t n = 0; n < 10; ++n) {
    engine.job(n)->push_block(0);
    engine.job(n)->end();
    EXPECT_TRUE(read().has_block());
  }
  stream->WritesDone();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, JobsTakeTurns) {
  std::atomic<int> full{0};
  engine.on_job = [&](FakeJob& job) {
    for (std::uint32_t i = 0; i < 50; ++i) job.push_block(i, 400'000);
    job.end();
    ++full;
  };
  open();
  for (std::uint64_t id = 1; id <= 4; ++id) stream->Write(message(id));
  stream->WritesDone();
  ASSERT_TRUE(eventually([&] { return full == 4; }));
  std::map<std::uint64_t, int> seen;
  v1::DeformReply reply;
  int widest = 0;
  int total = 0;
  while (stream->Read(&reply)) {
    ++seen[reply.request_id()];
    ++total;
    if (seen.size() < 4) continue;
    const auto [least, most] =
        std::minmax_element(seen.begin(), seen.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
    widest = std::max(widest, most->second - least->second);
  }
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(total, 200);
  // What was written before all four were known is the head start.
  EXPECT_LE(widest, 25);
}

TEST_P(ServiceDeformStream, MessagesOfOneRequestAreJoined) {
  open();
  v1::DeformStreamRequest first = message(7, true);
  v1::Motion* motion = first.mutable_request()->mutable_designs(0)->add_motions();
  motion->set_handle("roof");
  motion->add_displacements()->set_xyz("part1");
  first.mutable_request()->mutable_output()->set_encoding(v1::RAW_F32);
  first.mutable_request()->set_path(v1::PATH_DIRECT);
  first.mutable_request()->set_check(v1::CELL_QUALITY);
  first.mutable_request()->mutable_splitting()->set_most_steps(7);
  first.mutable_request()->set_solver_tolerance(1e-3);
  v1::DeformStreamRequest second;
  second.set_request_id(7);
  v1::Design* more = second.mutable_request()->add_designs();
  more->set_continues(true);
  motion = more->add_motions();
  motion->set_handle("roof");
  motion->add_displacements()->set_xyz("part2");
  more->add_motions()->set_handle("nose");
  second.mutable_request()->add_designs()->add_variables(3);
  stream->Write(first);
  stream->Write(second);
  stream->WritesDone();
  const auto job = engine.job(0);
  ASSERT_EQ(job->request().designs_size(), 2);
  const v1::Design& joined = job->request().designs(0);
  ASSERT_EQ(joined.motions_size(), 2);
  EXPECT_EQ(joined.motions(0).displacements_size(), 2);
  EXPECT_EQ(joined.motions(0).displacements(1).xyz(), "part2");
  EXPECT_EQ(joined.motions(1).handle(), "nose");
  EXPECT_EQ(job->request().designs(1).variables(0), 3);
  EXPECT_EQ(job->request().system_id(), "s7");
  EXPECT_EQ(job->request().output().encoding(), v1::RAW_F32);
  EXPECT_EQ(job->request().path(), v1::PATH_DIRECT);
  EXPECT_EQ(job->request().check(), v1::CELL_QUALITY);
  EXPECT_EQ(job->request().splitting().most_steps(), 7u);
  EXPECT_EQ(job->request().solver_tolerance(), 1e-3);
  job->end();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, ARequestErrorLeavesTheStreamGoing) {
  open();
  stream->Write(message(1));
  stream->Write(message(2));
  engine.job(0)->end(Error(ErrorCode::out_of_budget, "no memory", 70));
  const v1::DeformReply error = read();
  EXPECT_EQ(error.request_id(), 1u);
  EXPECT_EQ(error.error().code(), static_cast<std::uint32_t>(StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_EQ(error.error().message(), "no memory");
  EXPECT_EQ(error.error().retry_after_ms(), 70u);
  engine.job(1)->push_block(5);
  EXPECT_EQ(read().block().block(), 5u);
  engine.job(1)->end();
  stream->Write(message(1));  // the id is free again
  engine.job(2)->push_block(6);
  EXPECT_EQ(read().block().block(), 6u);
  engine.job(2)->end();
  stream->WritesDone();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, ARequestTheEngineRefusesIsAnsweredByAnError) {
  engine.deform_error = Error(ErrorCode::not_found, "no such system");
  open();
  stream->Write(message(9));
  const v1::DeformReply error = read();
  EXPECT_EQ(error.request_id(), 9u);
  EXPECT_EQ(error.error().code(), static_cast<std::uint32_t>(StatusCode::NOT_FOUND));
  stream->WritesDone();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, AnIdInUseEndsBothWithOneError) {
  open();
  stream->Write(message(1));
  const auto job = engine.job(0);
  stream->Write(message(1));
  const v1::DeformReply error = read();
  EXPECT_EQ(error.request_id(), 1u);
  EXPECT_EQ(error.error().code(), static_cast<std::uint32_t>(StatusCode::INVALID_ARGUMENT));
  EXPECT_TRUE(eventually([&] { return job->cancelled(); }));
  stream->WritesDone();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, CancelMessagesEndOneRequestOnly) {
  ServiceOptions options;
  options.stream.running_requests = 1;
  open(options);
  stream->Write(message(1));        // runs
  stream->Write(message(2));        // waits
  stream->Write(message(3, true));  // is being sent
  for (const std::uint64_t id : {3, 2, 1, 99}) stream->Write(cancel_message(id));
  for (const std::uint64_t id : {3u, 2u, 1u}) {
    const v1::DeformReply reply = read();
    EXPECT_EQ(reply.request_id(), id);
    EXPECT_EQ(reply.error().code(), static_cast<std::uint32_t>(StatusCode::CANCELLED));
  }
  EXPECT_TRUE(eventually([&] { return engine.job(0)->cancelled(); }));
  stream->Write(message(4));
  engine.job(1)->push_block(4);
  EXPECT_EQ(read().block().block(), 4u);
  EXPECT_EQ(engine.job(1)->request_id(), 4u) << "request 2 never started";
  engine.job(1)->end();
  stream->WritesDone();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, TooManyOpenRequestsAreRefusedWithAHint) {
  ServiceOptions options;
  options.stream.open_requests = 2;
  open(options);
  for (std::uint64_t id = 1; id <= 3; ++id) stream->Write(message(id));
  const v1::DeformReply error = read();
  EXPECT_EQ(error.request_id(), 3u);
  EXPECT_EQ(error.error().code(), static_cast<std::uint32_t>(StatusCode::RESOURCE_EXHAUSTED));
  EXPECT_GT(error.error().retry_after_ms(), 0u);
  engine.job(0)->end();
  engine.job(1)->end();
  stream->WritesDone();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, ReadingPausesWhileTooMuchIsBuffered) {
  ServiceOptions options;
  options.stream.buffered_bytes = std::size_t{4} << 20;
  open(options);
  constexpr int count = 60;
  std::atomic<int> written{0};
  std::thread writer([&] {
    for (int id = 1; id <= count; ++id) {
      v1::DeformStreamRequest big = message(static_cast<std::uint64_t>(id));
      big.mutable_request()->set_system_id(std::string(1'000'000, 's'));
      if (!stream->Write(big)) break;
      ++written;
    }
    stream->WritesDone();
  });
  engine.job(0);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_LT(engine.job_count(), 8u);
  EXPECT_LT(written, count);
  for (int n = 0; n < count; ++n) engine.job(static_cast<std::size_t>(n))->end();
  writer.join();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, ARequestLargerThanTheBufferIsRefusedNotWaitedFor) {
  ServiceOptions options;
  options.stream.buffered_bytes = std::size_t{4} << 20;
  open(options);
  for (int part = 0; part < 8; ++part) {
    v1::DeformStreamRequest big = message(1, part < 7);
    big.mutable_request()->set_system_id(std::string(1'000'000, 's'));
    ASSERT_TRUE(stream->Write(big));
  }
  EXPECT_EQ(read().error().code(), static_cast<std::uint32_t>(StatusCode::RESOURCE_EXHAUSTED));
  stream->WritesDone();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, HalfCloseWaitsForOpenRequests) {
  open();
  stream->Write(message(1));
  stream->WritesDone();
  const auto job = engine.job(0);
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  EXPECT_FALSE(job->cancelled());
  job->push_block(1);
  EXPECT_EQ(read().block().block(), 1u);
  job->end();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, HalfCloseInTheMiddleOfARequestRefusesIt) {
  open();
  stream->Write(message(1, true));
  stream->WritesDone();
  EXPECT_EQ(read().error().code(), static_cast<std::uint32_t>(StatusCode::INVALID_ARGUMENT));
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, AnEmptyStreamEndsWell) {
  open();
  stream->WritesDone();
  EXPECT_EQ(finish(), StatusCode::OK);
}

TEST_P(ServiceDeformStream, CancellingTheStreamCancelsEveryJob) {
  ServiceOptions options;
  options.stream.running_requests = 4;
  open(options);
  for (std::uint64_t id = 1; id <= 10; ++id) stream->Write(message(id));
  engine.job(3);
  context.TryCancel();
  EXPECT_EQ(finish(), StatusCode::CANCELLED);
  for (std::size_t n = 0; n < 4; ++n) EXPECT_TRUE(eventually([&] { return engine.job(n)->cancelled(); }));
  EXPECT_EQ(engine.job_count(), 4u) << "waiting requests never start";
}

TEST_P(ServiceDeformStream, CancellingWhileWritingCancelsEveryJob) {
  engine.on_job = [](FakeJob& job) {
    for (std::uint32_t i = 0; i < 100; ++i) job.push_block(i, 900'000);
  };
  open();
  stream->Write(message(1));
  stream->Write(message(2));
  read();
  context.TryCancel();
  v1::DeformReply reply;
  while (stream->Read(&reply)) {
  }
  EXPECT_THAT(stream->Finish(), EndedWith(StatusCode::CANCELLED));
  EXPECT_TRUE(eventually([&] { return engine.job(0)->cancelled() && engine.job(1)->cancelled(); }));
}

TEST_P(ServiceDeformStream, TheDeadlineEndsTheStream) {
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(200));
  open();
  stream->Write(message(1));
  const auto job = engine.job(0);
  EXPECT_TRUE(job->call().deadline.has_value());
  EXPECT_EQ(finish(), StatusCode::DEADLINE_EXCEEDED);
  EXPECT_TRUE(eventually([&] { return job->cancelled(); }));
}

TEST_P(ServiceDeformStream, DrainingAnswersWhatIsOpenAndEndsTheStream) {
  open();
  stream->Write(message(1));
  const auto job = engine.job(0);
  std::thread stopper([&] { EXPECT_TRUE(server->running().stop(std::chrono::seconds(20))); });
  job->push_block(1);
  EXPECT_EQ(read().block().block(), 1u);
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  job->end();
  EXPECT_EQ(finish(), StatusCode::UNAVAILABLE);
  stopper.join();
}

TEST_P(ServiceDeformStream, AnIdleStreamDoesNotHoldUpTheShutdown) {
  open();
  stream->Write(message(1));
  engine.job(0)->end();
  std::thread reader([&] { EXPECT_EQ(finish(), StatusCode::UNAVAILABLE); });
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_TRUE(server->running().stop(std::chrono::seconds(20)));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5));
  reader.join();
}

DEFORM_BOTH_TRANSPORTS(ServiceDeformStream);

}  // namespace
}  // namespace deform::server::service_deform_stream_test
