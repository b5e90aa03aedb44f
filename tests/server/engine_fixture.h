// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <condition_variable>
#include <cstring>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "core/codec/block.h"
#include "server/engine/engine.h"
#include "tests/server/server_fakes.h"
#include "tests/server/test_mesh.h"

namespace deform::server {

/// A call's result brought together.
struct DeformedDesigns {
  v1::DeformHeader header;
  std::vector<Points> points;
  std::vector<v1::DesignResult> results;
  v1::DeformSummary summary;
};

/// An engine on a directory of its own, with blocking verbs. They throw what the engine reports.
class EngineFixture : public testing::Test {
 protected:
  EngineFixture() {
    options.data_dir = directory.path() / "data";
    options.memory_budget = std::size_t{2} << 30;
    options.workers = 2;
    options.block_points = 256;
    options.max_points = 100'000;
    options.max_designs = 100;
    options.max_stored_bases = 0;  // whether a preparation takes so long that its basis is stored is up to the machine
  }
  void SetUp() override { reopen(); }
  void reopen() {
    engine.reset();
    engine = Engine::open(options);
  }

  v1::GeometryInfo register_mesh(const Mesh& mesh, const std::string& name = "sheet") {
    const auto upload = engine->begin_upload(header_of(mesh, name), {});
    for (const auto& message : upload_messages(mesh)) upload->add(message);
    return upload->finish();
  }

  v1::SystemInfo prepare(const v1::Setup& setup, const CallContext& call = {}) {
    v1::PrepareRequest request;
    *request.mutable_setup() = setup;
    Waiter<v1::SystemInfo> waiter;
    engine->prepare(
        request, call,
        [&](const v1::Progress& progress) {
          const std::lock_guard lock(stages_mutex);
          stages.push_back(progress.stage());
        },
        waiter.callback());
    return waiter.value();
  }

  v1::EstimateReply estimate(const v1::EstimateRequest& request, const CallContext& call = {}) {
    Waiter<v1::EstimateReply> waiter;
    engine->estimate(request, call, waiter.callback());
    return waiter.value();
  }

  DeformedDesigns deform(const v1::DeformRequest& request, const CallContext& call = {}) {
    Doorbell bell;
    const auto job = engine->deform(request, 0, call, bell.ring());
    return collect(*job, bell, call);
  }
  DeformedDesigns jacobian_vector(const v1::JacobianVectorRequest& request) {
    Doorbell bell;
    const auto job = engine->jacobian_vector(request, {}, bell.ring());
    return collect(*job, bell);
  }
  std::vector<double> vector_jacobian(const v1::VectorJacobianHeader& header, const Points& cotangent) {
    Waiter<v1::VectorJacobianReply> waiter;
    engine->vector_jacobian(header, cotangent, {}, waiter.callback());
    const v1::VectorJacobianReply reply = waiter.value();
    return {reply.gradient().begin(), reply.gradient().end()};
  }

  static v1::DeformRequest request_for(const std::string& system_id, const std::vector<std::vector<double>>& designs,
                                       v1::Encoding encoding = v1::RAW_F64) {
    v1::DeformRequest request;
    request.set_system_id(system_id);
    request.mutable_output()->set_encoding(encoding);
    for (const auto& values : designs) {
      auto* design = request.add_designs();
      for (const double value : values) design->add_variables(value);
    }
    return request;
  }

  static double largest_difference(const Points& a, const Points& b) {
    if (a.size() != b.size()) return 1e300;
    double largest = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      for (int k = 0; k < 3; ++k) largest = std::max(largest, std::fabs(a[i][k] - b[i][k]));
    }
    return largest;
  }

  TemporaryDirectory directory;
  EngineOptions options;
  std::unique_ptr<Engine> engine;
  std::mutex stages_mutex;
  std::vector<std::string> stages;

  /// Waits for the one outcome of asynchronous work.
  template <typename T>
  class Waiter {
   public:
    using Outcome = Engine::Outcome<T>;
    std::function<void(Outcome)> callback() {
      return [state = state_](Outcome outcome) {
        const std::lock_guard lock(state->mutex);
        EXPECT_FALSE(state->outcome) << "called twice";
        state->outcome = std::move(outcome);
        state->changed.notify_all();
      };
    }
    T value() {
      std::unique_lock lock(state_->mutex);
      if (!state_->changed.wait_for(lock, std::chrono::seconds(60), [&] { return state_->outcome.has_value(); })) {
        throw std::runtime_error("no outcome after a minute");
      }
      if (state_->outcome->error) throw Error(*state_->outcome->error);
      return *state_->outcome->value;
    }

   private:
    struct State {
      std::mutex mutex;
      std::condition_variable changed;
      std::optional<Outcome> outcome;
    };
    std::shared_ptr<State> state_ = std::make_shared<State>();
  };

  /// Waits for on_ready.
  class Doorbell {
   public:
    std::function<void()> ring() {
      return [state = state_] {
        const std::lock_guard lock(state->mutex);
        state->rung = true;
        state->changed.notify_all();
      };
    }
    void wait() {
      std::unique_lock lock(state_->mutex);
      if (!state_->changed.wait_for(lock, std::chrono::seconds(60), [&] { return state_->rung; })) {
        throw std::runtime_error("never woken");
      }
      state_->rung = false;
    }

   private:
    struct State {
      std::mutex mutex;
      std::condition_variable changed;
      bool rung = false;
    };
    std::shared_ptr<State> state_ = std::make_shared<State>();
  };

  /// Preparations that stand at a gate, one on each thread for them: what comes later waits until it opens.
  class StandingPreparations {
   public:
    StandingPreparations(Engine& engine, const EngineOptions& options, const std::string& geometry)
        : prepared_(static_cast<std::size_t>(std::max(1, options.workers / 2) + 1)) {
      for (std::size_t i = 0; i < prepared_.size(); ++i) {
        v1::PrepareRequest request;
        *request.mutable_setup() = sheet_setup(geometry);
        request.mutable_setup()->set_seed(1000 + i);
        const auto stand = [gate = gate_](const v1::Progress& progress) {
          if (progress.stage() != "queue") gate->pass();
        };
        CallContext call;
        call.client = "standing";
        engine.prepare(request, call, stand, prepared_[i].callback());
      }
      EXPECT_TRUE(eventually([&] { return gate_->waiting() == static_cast<int>(prepared_.size()); }));
    }
    ~StandingPreparations() { gate_->open(); }
    StandingPreparations(const StandingPreparations&) = delete;
    StandingPreparations& operator=(const StandingPreparations&) = delete;
    void go_on() {
      gate_->open();
      for (auto& each : prepared_) each.value();
    }

   private:
    const std::shared_ptr<Gate> gate_ = std::make_shared<Gate>();
    std::vector<Waiter<v1::SystemInfo>> prepared_;
  };

 private:
  DeformedDesigns collect(DeformJob& job, Doorbell& bell, const CallContext& call = {}) {
    DeformedDesigns deformed;
    std::shared_ptr<const Points> registered;
    std::vector<std::vector<std::uint64_t>> checksums;
    for (;;) {
      v1::DeformReply reply;
      const DeformJob::Poll poll = job.poll(reply);
      if (poll == DeformJob::Poll::done) break;
      if (poll == DeformJob::Poll::pending) {
        bell.wait();
      } else if (reply.has_header()) {
        deformed.header = reply.header();
        registered = engine->get_points(reply.header().geometry_id(), call);
        deformed.points.assign(reply.header().designs(), Points(reply.header().points()));
        checksums.resize(reply.header().designs());
      } else if (reply.has_block()) {
        const v1::Block& block = reply.block();
        decode_block(block, *registered, deformed.points.at(block.design()));
        checksums.at(block.design()).push_back(block.checksum());
      } else if (reply.has_result()) {
        const auto& blocks = checksums.at(reply.result().design());
        EXPECT_EQ(reply.result().has_error(), blocks.empty());
        if (!blocks.empty()) EXPECT_EQ(reply.result().checksum(), codec::fold_checksums(blocks));
        deformed.results.push_back(reply.result());
      } else if (reply.has_summary()) {
        deformed.summary = reply.summary();
      }
    }
    if (const auto error = job.error()) throw Error(*error);
    return deformed;
  }

  static void decode_block(const v1::Block& message, const Points& registered, Points& out) {
    codec::Block block;
    block.encoding = static_cast<codec::Encoding>(message.encoding());
    block.count = message.count();
    block.step = message.step();
    for (int k = 0; k < message.offset_size(); ++k) block.offset.at(static_cast<std::size_t>(k)) = message.offset(k);
    block.checksum = message.checksum();
    block.bytes = message.data();
    codec::decode(block, std::span(registered).subspan(message.first(), message.count()),
                  std::span(out).subspan(message.first(), message.count()));
  }
};

}  // namespace deform::server
