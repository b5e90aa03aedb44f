// SPDX-License-Identifier: GPL-3.0-or-later
// What is deleted or forgotten while others use it, prepare it or upload it again.
#include <atomic>
#include <barrier>
#include <thread>

#include "tests/server/engine_fixture.h"

namespace deform::server::engine_removal_test {
namespace {

class EngineRemovalTest : public EngineFixture {
 protected:
  void SetUp() override {
    EngineFixture::SetUp();
    geometry = register_mesh(mesh);
    system = prepare(sheet_setup(geometry.id()));
    engine->evict("", std::nullopt);
  }
  void TearDown() override { gate.open(); }

  /// Nothing else is prepared until the gate opens.
  void keep_preparations_waiting() {
    constexpr int threads = 2;  // that prepare, of an engine with two workers
    for (int i = 0; i < threads; ++i) {
      v1::PrepareRequest request;
      *request.mutable_setup() = sheet_setup(geometry.id());
      request.mutable_setup()->set_seed(9 + static_cast<std::uint64_t>(i));
      engine->prepare(
          request, {},
          [this](const v1::Progress& progress) {
            if (progress.stage() == "select") gate.pass();
          },
          [](const auto&) {});
    }
    ASSERT_TRUE(eventually([&] { return gate.waiting() == threads; }));
  }
  void forget() {
    v1::ReleaseSystemRequest request;
    request.set_id(system.id());
    request.set_forget(true);
    engine->release_system(request, {});
  }
  v1::PrepareRequest request_to_prepare() const {
    v1::PrepareRequest request;
    *request.mutable_setup() = sheet_setup(geometry.id());
    return request;
  }
  ErrorCode code_of(const std::function<void()>& action) {
    try {
      action();
    } catch (const Error& error) {
      return error.code();
    }
    return ErrorCode::internal;
  }

  const Mesh mesh = sheet_mesh(24, 12);
  v1::GeometryInfo geometry;
  v1::SystemInfo system;
  Gate gate;
};

TEST_F(EngineRemovalTest, who_brings_a_setup_that_is_forgotten_meanwhile_has_it_stored_again) {
  keep_preparations_waiting();
  Doorbell bell;
  const auto job = engine->deform(request_for(system.id(), {{0.1, 0}}), 0, {}, bell.ring());  // begins the preparation
  std::atomic<bool> forgotten{false};
  Waiter<v1::SystemInfo> joins;
  engine->prepare(
      request_to_prepare(), {},
      [&](const v1::Progress& progress) {
        if (progress.stage() == "select" && !forgotten.exchange(true)) forget();
      },
      joins.callback());
  gate.open();
  EXPECT_EQ(joins.value().id(), system.id());
  EXPECT_TRUE(forgotten);
  EXPECT_TRUE(engine->get_system(system.id(), {}).resident());
  forget();
  EXPECT_EQ(code_of([&] { engine->get_system(system.id(), {}); }), ErrorCode::not_found);
  EXPECT_EQ(code_of([&] { deform(request_for(system.id(), {{0.1, 0}})); }), ErrorCode::not_found);
}

TEST_F(EngineRemovalTest, preparing_does_not_fail_because_somebody_else_named_what_was_forgotten) {
  keep_preparations_waiting();
  Doorbell bell;
  const auto job = engine->deform(request_for(system.id(), {{0.1, 0}}), 0, {}, bell.ring());
  Waiter<v1::SystemInfo> joins;
  engine->prepare(request_to_prepare(), {}, {}, joins.callback());
  forget();
  Waiter<v1::SystemInfo> comes_later;
  engine->prepare(request_to_prepare(), {}, {}, comes_later.callback());
  gate.open();
  EXPECT_EQ(joins.value().id(), system.id());
  EXPECT_EQ(comes_later.value().id(), system.id());
  EXPECT_EQ(engine->get_system(system.id(), {}).id(), system.id());
}

TEST_F(EngineRemovalTest, a_system_is_forgotten_once) {
  constexpr int callers = 4;
  for (int round = 0; round < 25; ++round) {
    std::barrier begin(callers);
    std::atomic<int> done{0}, unknown{0};
    std::vector<std::thread> threads;
    for (int i = 0; i < callers; ++i) {
      threads.emplace_back([&] {
        begin.arrive_and_wait();
        try {
          forget();
          ++done;
        } catch (const Error& error) {
          if (error.code() == ErrorCode::not_found) ++unknown;
        }
      });
    }
    for (auto& thread : threads) thread.join();
    EXPECT_EQ(done, 1);
    EXPECT_EQ(unknown, callers - 1);
    prepare(sheet_setup(geometry.id()));
  }
}

TEST_F(EngineRemovalTest, what_was_there_when_its_upload_began_was_there) {
  v1::GeometryHeader header = header_of(mesh, "again");
  header.set_id(geometry.id());
  const auto upload = engine->begin_upload(header, {});
  v1::DeleteGeometryRequest remove;
  remove.set_id(geometry.id());
  remove.set_with_setups(true);
  engine->delete_geometry(remove, {});
  EXPECT_TRUE(upload->finish().existed());
  EXPECT_EQ(code_of([&] { engine->get_geometry(geometry.id(), {}); }), ErrorCode::not_found);
}

}  // namespace
}  // namespace deform::server::engine_removal_test
