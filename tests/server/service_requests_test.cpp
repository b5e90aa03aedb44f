// SPDX-License-Identifier: GPL-3.0-or-later
// The bookkeeping of a DeformStream, without a stream.
#include "server/rpc/streams/service_requests.h"

#include <gtest/gtest.h>

#include <string>

namespace deform::server::service_requests_test {
namespace {

class Requests : public testing::Test {
 protected:
  static v1::DeformStreamRequest message(std::uint64_t id, bool more = false) {
    v1::DeformStreamRequest out;
    out.set_request_id(id);
    out.mutable_request()->set_system_id("s");
    out.mutable_request()->add_designs();
    out.set_more(more);
    return out;
  }
  static v1::DeformStreamRequest cancel(std::uint64_t id) {
    v1::DeformStreamRequest out;
    out.set_request_id(id);
    out.set_cancel(true);
    return out;
  }
  StreamLimits limits{.open_requests = 3, .running_requests = 2, .buffered_bytes = 1000};
};

TEST_F(Requests, StartInOrderOfTheirLastMessageWithinTheWindow) {
  StreamRequests requests(limits, {});
  requests.accept(message(1, true), 10);
  requests.accept(message(2), 10);
  requests.accept(message(3), 10);
  requests.accept(message(1), 10);
  const auto first = requests.start();
  const auto second = requests.start();
  EXPECT_EQ(first->id, 2u);
  EXPECT_EQ(second->id, 3u);
  EXPECT_EQ(requests.start(), nullptr);
  requests.close(first);
  const auto third = requests.start();
  ASSERT_NE(third, nullptr);
  EXPECT_EQ(third->id, 1u);
  EXPECT_EQ(third->message.designs_size(), 2);
  EXPECT_EQ(third->record.bytes_in, 20u);
  requests.close(second);
  requests.close(third);
  EXPECT_TRUE(requests.empty());
}

TEST_F(Requests, EveryRequestIsStoppedByItself) {
  StreamRequests requests(limits, {});
  requests.accept(message(1), 10);
  requests.accept(message(2), 10);
  const auto one = requests.start();
  const auto two = requests.start();
  const auto effect = requests.accept(cancel(1), 5);
  EXPECT_EQ(effect.answered, one);
  EXPECT_EQ(effect.answered->refusal->code(), ErrorCode::cancelled);
  EXPECT_TRUE(one->call.stop.stop_requested());
  EXPECT_FALSE(two->call.stop.stop_requested());
}

TEST_F(Requests, RefusalsWaitForTheLastMessageAndFreeTheId) {
  StreamRequests requests(limits, {});
  v1::DeformStreamRequest bad = message(1, true);
  bad.mutable_request()->mutable_designs(0)->set_continues(true);
  EXPECT_EQ(requests.accept(std::move(bad), 10).answered, nullptr);
  EXPECT_EQ(requests.accept(message(1, true), 10).answered, nullptr);
  const auto effect = requests.accept(message(1), 10);
  ASSERT_NE(effect.answered, nullptr);
  EXPECT_EQ(effect.answered->refusal->code(), ErrorCode::invalid_argument);
  EXPECT_NE(std::string(effect.answered->refusal->what()).find("designs[0].continues"), std::string::npos);
  EXPECT_TRUE(requests.empty());
  requests.accept(message(1), 10);
  EXPECT_NE(requests.start(), nullptr);
}

TEST_F(Requests, AnIdUsedTwiceEndsOnceWhenRunningAndWhenWaiting) {
  limits.running_requests = 1;
  StreamRequests requests(limits, {});
  requests.accept(message(1), 10);
  requests.accept(message(2), 10);
  requests.start();
  for (const std::uint64_t id : {1u, 2u}) {
    EXPECT_EQ(requests.accept(message(id, true), 10).answered, nullptr);
    const auto effect = requests.accept(message(id), 10);
    ASSERT_NE(effect.answered, nullptr);
    EXPECT_EQ(effect.answered->refusal->code(), ErrorCode::invalid_argument);
    EXPECT_TRUE(effect.answered->call.stop.stop_requested());
  }
  EXPECT_TRUE(requests.empty());
  EXPECT_EQ(requests.start(), nullptr);
  requests.accept(message(3), 10);
  EXPECT_NE(requests.start(), nullptr) << "the window is free again";
}

TEST_F(Requests, TheLimitOfOpenRequestsRefusesWithAHintAndTheFloodEndsTheStream) {
  StreamRequests requests(limits, {});
  for (std::uint64_t id = 1; id <= 3; ++id) requests.accept(message(id, true), 10);
  const auto effect = requests.accept(message(4), 10);
  ASSERT_NE(effect.answered, nullptr);
  EXPECT_EQ(effect.answered->refusal->code(), ErrorCode::out_of_budget);
  EXPECT_GT(effect.answered->refusal->retry_after_ms(), 0u);
  for (std::uint64_t id = 5; id <= 7; ++id) requests.accept(message(id, true), 10);
  EXPECT_THROW(requests.accept(message(8, true), 10), Error);
}

TEST_F(Requests, ReadingPausesOnlyWhenSomethingWillEndByItself) {
  StreamRequests requests(limits, {});
  requests.accept(message(1), 600);
  EXPECT_TRUE(requests.may_read());
  requests.accept(message(2, true), 600);
  EXPECT_FALSE(requests.may_read()) << "request 1 will end and give its bytes back";
  const auto one = requests.start();
  EXPECT_FALSE(requests.may_read()) << "running, it still holds them";
  requests.close(one);
  EXPECT_TRUE(requests.may_read());
  requests.accept(message(2, true), 600);  // 1200 bytes that only more messages could complete
  EXPECT_TRUE(requests.may_read());
  const auto effect = requests.accept(message(2), 1);
  ASSERT_NE(effect.answered, nullptr);
  EXPECT_EQ(effect.answered->refusal->code(), ErrorCode::out_of_budget);
  EXPECT_EQ(effect.answered->refusal->retry_after_ms(), 0u);
}

TEST_F(Requests, CancelOfAnUnknownIdIsNothing) {
  StreamRequests requests(limits, {});
  const auto effect = requests.accept(cancel(5), 5);
  EXPECT_EQ(effect.answered, nullptr);
  EXPECT_TRUE(requests.empty());
}

TEST_F(Requests, HalfCloseRefusesWhatIsIncompleteAndNothingElse) {
  StreamRequests requests(limits, {});
  requests.accept(message(1), 10);
  requests.accept(message(2, true), 10);
  const auto unfinished = requests.half_close();
  ASSERT_EQ(unfinished.size(), 1u);
  EXPECT_EQ(unfinished[0]->id, 2u);
  EXPECT_EQ(requests.size(), 1u);
}

}  // namespace
}  // namespace deform::server::service_requests_test
