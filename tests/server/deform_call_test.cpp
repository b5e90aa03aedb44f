// SPDX-License-Identifier: GPL-3.0-or-later
// One deformation over a fake system: order of the replies, the slow reader, cancellation, deadlines, memory.
#include "server/engine/deform_call.h"

#include <gtest/gtest.h>

#include <thread>

#include "core/codec/block.h"
#include "server/engine/deform_job.h"
#include "tests/server/server_fakes.h"

namespace deform::server::deform_call_test {
namespace {

using Poll = DeformJob::Poll;

class DeformCallTest : public testing::Test {
 protected:
  void open(std::size_t points, std::size_t queue_limit = 256, int workers = 2) {
    Scheduler::Options options;
    options.workers = workers;
    options.queue_limit = queue_limit;
    options.running_limit = 4;
    scheduler = std::make_unique<Scheduler>(options);
    cache = std::make_shared<SystemCache>(
        1u << 30,
        [this](const std::string& client, const void* owner, double seconds, std::function<void()> work) {
          scheduler->prepare(client, owner, seconds, std::move(work));
        },
        [this](const void* owner) { scheduler->remove(owner); });
    resident = fake_resident(points, 1000);
  }
  void TearDown() override {
    preparation.open();
    if (resident && fake().gate) fake().gate->open();
    calls.fail_all(Error(ErrorCode::unavailable, "the test is over"));
    if (scheduler) scheduler->stop();
  }
  FakeSystem& fake() const { return const_cast<FakeSystem&>(static_cast<const FakeSystem&>(*resident->system)); }

  DeformTask task(std::size_t designs, v1::Encoding encoding = v1::RAW_F64) {
    DeformTask task;
    task.system_id = "fake";
    task.request_id = 42;
    task.designs = designs;
    task.output.set_encoding(encoding);
    task.source.prepare = [this](const RunContext&) {
      if (slow_preparation) preparation.pass();
      return resident;
    };
    task.bind_bytes = [](const ResidentSystem&) { return std::size_t{1000}; };
    task.bind = [designs](const ResidentSystem& system, const RunContext& context) {
      return system.system->bind(std::vector<Design>(designs), EvaluationPath::automatic, context);
    };
    return task;
  }
  struct Wake {
    std::mutex mutex;
    std::condition_variable changed;
    int calls = 0;
  };
  std::shared_ptr<DeformJob> begin(DeformTask task, const CallContext& context = {}, std::shared_ptr<Wake> wake = nullptr) {
    DeformParts parts{{scheduler.get(), cache.get(), &calls}, &memory, block_points, [this](std::size_t n) { served += n; }};
    const auto call = std::make_shared<DeformCall>(parts, std::move(task), context, [wake] {
      if (!wake) return;
      const std::lock_guard lock(wake->mutex);
      ++wake->calls;
      wake->changed.notify_all();
    });
    call->begin();
    return make_deform_job(call);
  }
  /// Reads to the end, woken by on_ready.
  std::vector<v1::DeformReply> read_all(DeformTask task, std::optional<Error>* error = nullptr) {
    const auto wake = std::make_shared<Wake>();
    const auto job = begin(std::move(task), {}, wake);
    std::vector<v1::DeformReply> replies;
    int pending = 0;
    for (;;) {
      v1::DeformReply reply;
      const Poll poll = job->poll(reply);
      if (poll == Poll::done) break;
      if (poll == Poll::reply) {
        replies.push_back(std::move(reply));
        continue;
      }
      ++pending;
      std::unique_lock lock(wake->mutex);
      if (!wake->changed.wait_for(lock, std::chrono::seconds(60), [&] { return wake->calls == pending; })) {
        ADD_FAILURE() << "never woken";
        break;
      }
    }
    if (error != nullptr) *error = job->error();
    return replies;
  }

  const std::size_t block_points = 500;
  MemoryBudget memory{1u << 30};
  std::atomic<std::size_t> served{0};
  bool slow_preparation = false;
  Gate preparation;
  std::shared_ptr<ResidentSystem> resident;
  CallRegistry calls;
  std::unique_ptr<Scheduler> scheduler;
  std::shared_ptr<SystemCache> cache;
};

TEST_F(DeformCallTest, replies_come_as_the_contract_says) {
  open(1750);
  constexpr std::size_t designs = 37;  // three groups, the last one not full
  std::optional<Error> error;
  const auto replies = read_all(task(designs), &error);
  EXPECT_FALSE(error);
  ASSERT_EQ(replies.size(), 1 + designs * 4 + designs + 1);
  ASSERT_TRUE(replies.front().has_header());
  EXPECT_EQ(replies.front().header().points(), 1750u);
  EXPECT_EQ(replies.front().header().designs(), designs);
  EXPECT_EQ(replies.front().header().block_points(), block_points);
  ASSERT_TRUE(replies.back().has_summary());
  std::vector<Points> points(designs, Points(1750));
  std::vector<std::vector<std::uint64_t>> checksums(designs);
  std::vector<int> results(designs, 0);
  bool interleaved = false;
  std::uint32_t last_design = 0;
  for (const auto& reply : replies) {
    EXPECT_EQ(reply.request_id(), 42u);
    if (reply.has_block()) {
      const v1::Block& block = reply.block();
      ASSERT_LT(block.design(), designs);
      EXPECT_EQ(block.block(), checksums[block.design()].size()) << "blocks of a design ascend";
      EXPECT_EQ(block.first(), block.block() * block_points);
      EXPECT_EQ(results[block.design()], 0) << "no block after the result";
      interleaved = interleaved || block.design() < last_design;
      last_design = block.design();
      codec::Block encoded;
      encoded.count = block.count();
      encoded.checksum = block.checksum();
      encoded.bytes = block.data();
      checksums[block.design()].push_back(block.checksum());
      codec::decode(encoded, std::span(resident->mesh->points).subspan(block.first(), block.count()),
                    std::span(points[block.design()]).subspan(block.first(), block.count()));
    } else if (reply.has_result()) {
      const auto& result = reply.result();
      ++results[result.design()];
      EXPECT_EQ(checksums[result.design()].size(), 4u);
      EXPECT_EQ(result.checksum(), codec::fold_checksums(checksums[result.design()]));
    }
  }
  EXPECT_TRUE(interleaved);
  for (std::size_t d = 0; d < designs; ++d) {
    EXPECT_EQ(results[d], 1);
    for (std::size_t i = 0; i < 1750; ++i) ASSERT_EQ(points[d][i], FakeSystem::moved(i, d));
  }
  EXPECT_EQ(replies.back().summary().bytes(), designs * 1750 * sizeof(Vec3));
  EXPECT_EQ(served, designs);
  EXPECT_EQ(scheduler->load().running, 0u);
  EXPECT_EQ(scheduler->load().waiting, 0u);
  EXPECT_TRUE(eventually([&] { return memory.in_use() == 0; }));
}

TEST_F(DeformCallTest, one_point_one_design) {
  open(1);
  const auto replies = read_all(task(1, v1::DRACO));
  ASSERT_EQ(replies.size(), 4u);
  EXPECT_EQ(replies[1].block().count(), 1u);
  EXPECT_EQ(replies[1].block().encoding(), v1::DRACO);
}

TEST_F(DeformCallTest, a_slow_reader_holds_no_worker_and_bounded_memory) {
  open(100'000, 256, 1);
  const auto slow = begin(task(40));  // 96 MB in all
  ASSERT_TRUE(eventually([&] { return scheduler->load().waiting == 0 && scheduler->load().running == 0; }))
      << "it has given up its slot";
  const int slices = fake().slices;
  EXPECT_LT(slices, 100) << "of 600";
  EXPECT_LT(memory.in_use(), std::size_t{40} << 20);
  // Others are served meanwhile.
  EXPECT_EQ(read_all(task(1)).size(), 1u + 200 + 1 + 1);
  // When the reader comes, it goes on to the end.
  std::size_t replies = 0;
  v1::DeformReply reply;
  ASSERT_TRUE(eventually([&] {
    Poll poll = slow->poll(reply);
    for (; poll == Poll::reply; poll = slow->poll(reply)) ++replies;
    return poll == Poll::done;
  }));
  EXPECT_EQ(replies, 1u + 40 * 200 + 40 + 1);
  EXPECT_FALSE(slow->error());
  EXPECT_TRUE(eventually([&] { return memory.in_use() == 0; }));
}

TEST_F(DeformCallTest, a_lone_population_of_a_small_mesh_uses_all_workers) {
  open(300, 256, 4);  // less than a block
  fake().gate = std::make_shared<Gate>();
  const auto job = begin(task(15));
  EXPECT_TRUE(eventually([&] { return fake().gate->waiting() == 4; }));
  fake().gate->open();
}

TEST_F(DeformCallTest, cancelling_stops_the_steps_and_wakes_the_reader) {
  open(100'000);
  fake().gate = std::make_shared<Gate>();
  const auto wake = std::make_shared<Wake>();
  const auto job = begin(task(100), {}, wake);
  ASSERT_TRUE(eventually([&] { return fake().gate->waiting() == 2; })) << "a lone request uses all workers";
  v1::DeformReply reply;
  ASSERT_EQ(job->poll(reply), Poll::reply);  // the header
  ASSERT_EQ(job->poll(reply), Poll::pending);
  job->cancel();
  EXPECT_TRUE(eventually([&] {
    const std::lock_guard lock(wake->mutex);
    return wake->calls == 1;
  }));
  EXPECT_EQ(job->poll(reply), Poll::done);
  ASSERT_TRUE(job->error());
  EXPECT_EQ(job->error()->code(), ErrorCode::cancelled);
  fake().gate->open();
  EXPECT_TRUE(eventually([&] { return memory.in_use() == 0; })) << "when the running steps are over";
  EXPECT_LE(fake().slices, 4);
}

TEST_F(DeformCallTest, the_callers_stop_is_seen_while_queued) {
  open(1000);
  slow_preparation = true;
  std::stop_source stop;
  CallContext context;
  context.stop = stop.get_token();
  const auto job = begin(task(1), context);
  EXPECT_EQ(scheduler->load().waiting_for_preparation, 1u);
  stop.request_stop();
  v1::DeformReply reply;
  EXPECT_TRUE(eventually([&] { return job->poll(reply) == Poll::done; }));
  EXPECT_EQ(job->error()->code(), ErrorCode::cancelled);
  EXPECT_EQ(scheduler->load().waiting_for_preparation, 0u) << "out of the queue at once, not when its turn comes";
}

TEST_F(DeformCallTest, deadlines_pass_while_queued_while_computing_and_while_nobody_reads) {
  open(100'000, 256, 1);
  const auto in = [](int ms) {
    CallContext context;
    context.deadline = RunContext::Clock::now() + std::chrono::milliseconds(ms);
    return context;
  };
  const auto expect_deadline = [](const std::shared_ptr<DeformJob>& job) {
    v1::DeformReply reply;
    ASSERT_TRUE(eventually([&] {
      Poll poll = job->poll(reply);
      while (poll == Poll::reply) poll = job->poll(reply);
      return poll == Poll::done;
    }));
    ASSERT_TRUE(job->error());
    EXPECT_EQ(job->error()->code(), ErrorCode::deadline_exceeded);
  };
  EXPECT_THROW(begin(task(1), in(-1)), Error);
  const auto unread = begin(task(100), in(100));
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  expect_deadline(unread);
  fake().gate = std::make_shared<Gate>();
  const auto computing = begin(task(100), in(100));
  ASSERT_TRUE(eventually([&] { return fake().gate->waiting() == 1; }));
  const auto queued = begin(task(1), in(50));
  expect_deadline(queued);
  expect_deadline(computing);
}

TEST_F(DeformCallTest, a_full_queue_refuses) {
  open(1000, 2);
  slow_preparation = true;
  const auto first = begin(task(1));
  const auto second = begin(task(1));
  try {
    begin(task(1));
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_GT(error.retry_after_ms(), 0u);
  }
  second->cancel();
  EXPECT_NO_THROW(begin(task(1)));
}

TEST_F(DeformCallTest, waiting_for_a_preparation_holds_no_worker) {
  open(1000, 256, 1);
  slow_preparation = true;
  const auto waiting = begin(task(1));
  ASSERT_TRUE(eventually([&] { return preparation.waiting() == 1; }));
  std::atomic<bool> done{false};
  int owner = 0;
  scheduler->step(&owner, [&] { done = true; });
  EXPECT_TRUE(eventually([&] { return done.load(); }));
  EXPECT_EQ(scheduler->load().running, 0u);
  preparation.open();
  v1::DeformReply reply;
  bool prepared_again = false;
  ASSERT_TRUE(eventually([&] {
    Poll poll = waiting->poll(reply);
    for (; poll == Poll::reply; poll = waiting->poll(reply)) {
      if (reply.has_summary()) prepared_again = reply.summary().prepared_again();
    }
    return poll == Poll::done;
  }));
  EXPECT_FALSE(waiting->error());
  EXPECT_TRUE(prepared_again);
  EXPECT_GT(waiting->stats().queue_ms, 0);
}

TEST_F(DeformCallTest, a_failing_preparation_bind_or_step_ends_the_call) {
  open(1000);
  DeformTask bad = task(1);
  bad.system_id = "bad";
  bad.source.prepare = [](const RunContext&) -> std::shared_ptr<ResidentSystem> {
    throw Error(ErrorCode::numerical_failure, "singular");
  };
  std::optional<Error> error;
  EXPECT_TRUE(read_all(std::move(bad), &error).empty());
  EXPECT_EQ(error->code(), ErrorCode::numerical_failure);
  bad = task(1);
  bad.bind = [](const ResidentSystem&, const RunContext&) -> std::unique_ptr<const Evaluation> {
    throw Error(ErrorCode::invalid_argument, "designs[0]: bad");
  };
  EXPECT_TRUE(read_all(std::move(bad), &error).empty());
  EXPECT_EQ(error->code(), ErrorCode::invalid_argument);
  bad = task(1);
  bad.bind = [](const ResidentSystem&, const RunContext&) -> std::unique_ptr<const Evaluation> { throw std::bad_alloc(); };
  EXPECT_TRUE(read_all(std::move(bad), &error).empty());
  EXPECT_EQ(error->code(), ErrorCode::out_of_budget);
  EXPECT_TRUE(eventually([&] { return memory.in_use() == 0; }));
  EXPECT_EQ(scheduler->load().running, 0u);
}

TEST_F(DeformCallTest, what_does_not_fit_into_memory_is_refused) {
  open(1000);
  DeformTask large = task(1);
  large.bind_bytes = [](const ResidentSystem&) { return std::size_t{2} << 30; };
  std::optional<Error> error;
  read_all(std::move(large), &error);
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code(), ErrorCode::out_of_budget);
  EXPECT_EQ(error->retry_after_ms(), 0u);
  fake().set_design_bytes(std::size_t{600} << 20);  // fits once
  EXPECT_FALSE(read_all(task(1), &error).empty());
  EXPECT_FALSE(error);
  read_all(task(2), &error);
  ASSERT_TRUE(error) << "two threads solve one each";
  EXPECT_EQ(error->code(), ErrorCode::out_of_budget);
  {
    const int before = fake().slices;
    const auto slow = begin(task(1));  // nobody reads
    EXPECT_TRUE(eventually([&] { return fake().slices > before; })) << "bound, and evaluating";
    EXPECT_GT(memory.in_use(), 0u);
    EXPECT_LT(memory.in_use(), std::size_t{100} << 20);
    slow->cancel();
  }
  EXPECT_TRUE(eventually([&] { return memory.in_use() == 0; }));
  fake().set_design_bytes(0);
  const Charge others = memory.charge((std::size_t{1} << 30) - 5000, {"others", "", 0});
  read_all(task(1), &error);
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code(), ErrorCode::out_of_budget);
  EXPECT_GT(error->retry_after_ms(), 0u);
}

TEST_F(DeformCallTest, letting_go_of_the_job_cancels_it) {
  open(100'000);
  fake().gate = std::make_shared<Gate>();
  begin(task(100)).reset();
  fake().gate->open();
  EXPECT_TRUE(calls.wait_until_empty(RunContext::Clock::now() + std::chrono::seconds(60)));
  EXPECT_TRUE(eventually([&] { return memory.in_use() == 0 && scheduler->load().running == 0; }));
}

TEST_F(DeformCallTest, many_calls_of_many_threads) {
  open(3000);
  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 15; ++i) {
        if ((t + i) % 5 == 0) {
          begin(task(20))->cancel();
          continue;
        }
        std::optional<Error> error;
        const std::size_t designs = static_cast<std::size_t>(1 + (t + i) % 20);
        if (read_all(task(designs), &error).size() != 1 + designs * 6 + designs + 1 || error) ++wrong;
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_TRUE(eventually([&] { return memory.in_use() == 0 && scheduler->load().running == 0; }));
  EXPECT_EQ(scheduler->load().waiting, 0u);
}

TEST(StepPlan, covers_everything_once_and_in_order) {
  for (const auto [designs, workers] : std::vector<std::pair<std::size_t, int>>{
           {1, 0}, {15, 0}, {16, 0}, {17, 0}, {33, 0}, {1, 3}, {15, 1}, {16, 5}, {17, 100}, {33, 2}}) {
    for (const std::size_t points : {1, 499, 500, 501, 2000}) {
      StepPlan plan{points, 500, designs};
      if (workers != 0) plan.spread(workers);
      std::vector<std::size_t> next(designs, 0);
      for (std::size_t s = 0; s < plan.steps(); ++s) {
        for (std::size_t d = plan.first_design(s); d < plan.first_design(s) + plan.design_count(s); ++d) {
          EXPECT_EQ(plan.first_point(s), next[d]);
          next[d] += plan.point_count(s);
        }
      }
      EXPECT_EQ(next, std::vector<std::size_t>(designs, points));
    }
  }
}

TEST(StepPlan, gives_every_worker_something_to_do) {
  for (const int workers : {1, 2, 8, 64}) {
    for (const std::size_t designs : {1, 4, 5, 15, 16, 40, 1000}) {
      for (const std::size_t points : {20, 500, 1700, 6000}) {
        StepPlan plan{points, 500, designs};
        const std::size_t unspread = plan.steps(), blocks = plan.blocks();
        plan.spread(workers);
        const auto busy = static_cast<std::size_t>(workers);
        EXPECT_GE(plan.steps(), std::min(busy, designs * blocks)) << workers << " " << designs << " " << points;
        EXPECT_GE(plan.steps(), unspread);
        if (unspread >= 4 * busy) EXPECT_EQ(plan.steps(), unspread) << "as few passes over the basis as before";
      }
    }
  }
}

}  // namespace
}  // namespace deform::server::deform_call_test
