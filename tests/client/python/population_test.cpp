// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/python/binding/population.h"

#include <gtest/gtest.h>

#include <mutex>
#include <thread>

#include "client/design.h"
#include "tests/client/scripted_service.h"
#include "tests/support/expect_error.h"

namespace deform::population_test {
namespace {

using python::Population;
using test::expect_error;
using test::ReplyScript;
using test::ScriptedService;

constexpr std::size_t points = 3000;
constexpr std::chrono::milliseconds long_enough{20'000};

/// Design i has the variable i, so that the service can tell them apart.
Population::Options numbered_designs(std::size_t count, std::size_t batch) {
  Population::Options options;
  options.request.set_system_id("system");
  options.request.mutable_output()->set_encoding(v1::RAW_F64);
  options.request.set_failures(v1::FAILURES_PER_DESIGN);
  for (std::size_t i = 0; i < count; ++i) {
    options.designs.push_back(client::variables_design(std::vector<double>{static_cast<double>(i)}));
  }
  options.batch = batch;
  return options;
}

/// A service that notes what it is asked for, and a client of it.
class PopulationTest : public ::testing::Test {
 protected:
  PopulationTest() {
    service_.on_deform = [this](grpc::ServerContext&, const v1::DeformRequest& request, ScriptedService::Writer& writer) {
      std::vector<int> designs;
      for (const auto& design : request.designs()) designs.push_back(static_cast<int>(design.variables(0)));
      std::size_t number = 0;
      {
        const std::lock_guard lock(mutex_);
        number = asked_.size();
        asked_.push_back(designs);
      }
      return answer_(number, designs.size(), writer);
    };
    connect(1);
  }

  void connect(int attempts) {
    client::ClientOptions options;
    options.patience = std::chrono::seconds(0);
    options.max_attempts = attempts;
    client_ = std::make_unique<client::Client>(service_.client(options));
    client_->keep_points("geometry", std::make_shared<const Points>(test::registered_points(points)));
  }

  static std::vector<v1::DeformReply> replies(std::size_t designs) {
    ReplyScript script;
    script.points = points;
    script.designs = designs;
    return test::replies(script);
  }

  static grpc::Status whole(std::size_t, std::size_t designs, ScriptedService::Writer& writer) {
    for (const auto& reply : replies(designs)) writer.Write(reply, grpc::WriteOptions());
    return grpc::Status::OK;
  }

  std::vector<std::vector<int>> asked() {
    const std::lock_guard lock(mutex_);
    return asked_;
  }

  std::function<grpc::Status(std::size_t number, std::size_t designs, ScriptedService::Writer& writer)> answer_ = whole;
  std::mutex mutex_;
  std::vector<std::vector<int>> asked_;  ///< designs of each request
  ScriptedService service_;
  std::unique_ptr<client::Client> client_;
};

TEST_F(PopulationTest, AsksAgainOnlyForDesignsThatDidNotCome) {
  connect(2);
  answer_ = [](std::size_t number, std::size_t designs, ScriptedService::Writer& writer) {
    if (number != 0) return whole(number, designs, writer);
    for (const auto& reply : replies(designs)) {
      const bool sent = !reply.has_summary() && !(reply.has_result() && reply.result().design() == 2);
      if (sent) writer.Write(reply, grpc::WriteOptions());
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "going down");
  };
  Population::Options options = numbered_designs(5, 3);
  Points memory(5 * points);
  options.target = memory;
  Population population(*client_, options);
  std::vector<int> seen(5, 0);
  while (!population.at_end()) {
    const auto done = population.next(long_enough);
    ASSERT_TRUE(done);
    EXPECT_FALSE(done->deformed.error);
    ++seen[done->design];
  }
  EXPECT_EQ(seen, std::vector<int>(5, 1));
  EXPECT_EQ(asked(), (std::vector<std::vector<int>>{{0, 1, 2}, {2}, {3, 4}}));
  // The scripted points are those of the place in the request.
  const std::vector<std::size_t> places{0, 1, 0, 0, 1};
  for (std::size_t i = 0; i < 5; ++i) {
    const auto begin = memory.begin() + static_cast<std::ptrdiff_t>(i * points);
    EXPECT_EQ(Points(begin, begin + points), test::deformed_points(points, places[i])) << i;
  }
}

TEST_F(PopulationTest, EndsWithTheErrorOfARequestThatGetsNowhere) {
  answer_ = [](std::size_t number, std::size_t designs, ScriptedService::Writer& writer) {
    return number == 0 ? whole(number, designs, writer) : grpc::Status(grpc::StatusCode::UNAVAILABLE, "going down");
  };
  Population population(*client_, numbered_designs(4, 1));
  const auto first = population.next(long_enough);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->design, 0u);
  expect_error(ErrorCode::unavailable, {"going down"}, [&] { population.next(long_enough); });
  EXPECT_FALSE(population.at_end());
  EXPECT_EQ(asked().size(), 2u) << "and nothing else is asked for";
}

TEST_F(PopulationTest, BeginsNoRequestWhileABatchWaitsToBeTaken) {
  Population population(*client_, numbered_designs(6, 2));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(asked().size(), 1u);
  for (int i = 0; i < 6; ++i) ASSERT_TRUE(population.next(long_enough));
  EXPECT_TRUE(population.at_end());
  EXPECT_EQ(asked(), (std::vector<std::vector<int>>{{0, 1}, {2, 3}, {4, 5}}));
}

TEST_F(PopulationTest, MayBeLeftBeforeItsEnd) {
  std::stop_source left;
  answer_ = [left](std::size_t, std::size_t, ScriptedService::Writer&) {
    while (!left.stop_requested()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return grpc::Status(grpc::StatusCode::CANCELLED, "");
  };
  {
    Population population(*client_, numbered_designs(100, 1));
    while (asked().empty()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_FALSE(population.wait(std::chrono::milliseconds(10)));
    population.cancel();
    EXPECT_TRUE(population.wait(long_enough));
    expect_error(ErrorCode::cancelled, {}, [&] { population.next(long_enough); });
  }
  left.request_stop();
  EXPECT_EQ(asked().size(), 1u);
}

}  // namespace
}  // namespace deform::population_test
