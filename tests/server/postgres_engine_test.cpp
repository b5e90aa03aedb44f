// SPDX-License-Identifier: GPL-3.0-or-later
// Engines that share a store: what one has registered or prepared is served by the other, and what one deletes is served by none.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include "server/store/geometry_file.h"
#include "tests/server/engine_fixture.h"
#include "tests/server/postgres_database.h"

namespace deform::server::postgres_engine_test {
namespace {

class SharedEngines : public EngineFixture {
 protected:
  SharedEngines() {
    spdlog::set_level(spdlog::level::off);
    options.catalog = new_database();
  }
  void SetUp() override {
    EngineFixture::SetUp();
    other = Engine::open(options);
  }
  /// From now on the verbs of the fixture go to the other one.
  void swap() { engine.swap(other); }

  std::unique_ptr<Engine> other;
  const Mesh mesh = sheet_mesh(20, 10);
  const std::string id = mesh_id(mesh);
};

TEST_F(SharedEngines, what_one_has_prepared_the_other_one_deforms_with_the_same_bits) {
  register_mesh(mesh);
  const std::string system = prepare(sheet_setup(id)).id();
  const DeformedDesigns here = deform(request_for(system, {{0.1, 0}, {-0.05, 0.1}}));
  swap();
  EXPECT_FALSE(engine->get_system(system, {}).resident());
  const DeformedDesigns there = deform(request_for(system, {{0.1, 0}, {-0.05, 0.1}}));
  EXPECT_EQ(here.points, there.points);
  EXPECT_TRUE(there.summary.prepared_again());
  EXPECT_FALSE(deform(request_for(system, {{0.1, 0}})).summary.prepared_again());
  EXPECT_EQ(engine->info().geometries(), 1u);
  EXPECT_EQ(engine->info().setups(), 1u);
}

TEST_F(SharedEngines, what_one_deletes_the_other_one_forgets) {
  register_mesh(mesh);
  const std::string system = prepare(sheet_setup(id)).id();
  swap();
  deform(request_for(system, {{0.1, 0}}));
  EXPECT_EQ(engine->info().systems_resident(), 1u);
  swap();
  v1::DeleteGeometryRequest request;
  request.set_id(id);
  request.set_with_setups(true);
  EXPECT_EQ(engine->delete_geometry(request, {}).setups_deleted(), 1u);
  swap();
  EXPECT_TRUE(eventually([&] { return engine->info().systems_resident() == 0; }));
  try {
    deform(request_for(system, {{0.1, 0}}));
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::not_found) << error.what();
  }
}

TEST_F(SharedEngines, a_system_is_prepared_by_one_server_at_a_time) {
  register_mesh(mesh);
  const std::string system = prepare(sheet_setup(id)).id();
  const auto elsewhere = open_postgres_catalog(quick_postgres(options.catalog));
  auto claim = elsewhere->claim("preparation " + system, std::chrono::seconds(0), {});
  ASSERT_TRUE(claim);
  swap();
  Doorbell bell;
  const auto job = engine->deform(request_for(system, {{0.1, 0}}), 0, {}, bell.ring());
  // It asks for the claim that another one has.
  EXPECT_TRUE(eventually([&] {
    return sql(options.catalog,
               "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
               "AND query LIKE 'SELECT pg_try_advisory_lock%'")
               .number(0, 0) > 2;
  }));
  v1::DeformReply reply;
  EXPECT_EQ(job->poll(reply), DeformJob::Poll::pending);
  EXPECT_EQ(engine->info().systems_resident(), 0u);
  claim.reset();
  bell.wait();
  EXPECT_EQ(job->poll(reply), DeformJob::Poll::reply);
  EXPECT_TRUE(reply.has_header());
}

TEST_F(SharedEngines, without_the_database_systems_in_memory_are_served) {
  register_mesh(mesh);
  const std::string system = prepare(sheet_setup(id)).id();
  const Points before = deform(request_for(system, {{0.1, 0}})).points[0];
  EXPECT_EQ(engine->info().geometries(), 1u);
  control_postgres("stop");
  EXPECT_TRUE(eventually([&] { return !engine->store().writable(); }));
  Doorbell bell;
  const auto job = engine->deform(request_for(system, {{0.1, 0}}), 0, {}, bell.ring());
  EXPECT_TRUE(eventually([&] {
    v1::DeformReply reply;
    return job->poll(reply) == DeformJob::Poll::done;
  }));
  EXPECT_FALSE(job->error());
  EXPECT_EQ(engine->info().geometries(), 1u) << "as it was last known";
  try {
    prepare(sheet_setup(id));
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::unavailable) << error.what();
    EXPECT_GT(error.retry_after_ms(), 0u);
  }
  control_postgres("start");
  EXPECT_TRUE(eventually([&] { return engine->store().writable(); }));
  EXPECT_EQ(deform(request_for(system, {{0.1, 0}})).points[0], before);
  EXPECT_NO_THROW(prepare(sheet_setup(id)));
}

TEST_F(SharedEngines, options_name_what_is_wrong) {
  options.catalog = "postgresql://user:hush@db/x";
  try {
    Engine::open(options);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::invalid_argument);
    EXPECT_TRUE(std::string(error.what()).starts_with("option catalog: ")) << error.what();
    EXPECT_EQ(std::string(error.what()).find("hush"), std::string::npos) << error.what();
  }
}

/// With handle bases of all systems in the shared folder.
class SharedBases : public SharedEngines {
 protected:
  SharedBases() {
    options.max_stored_bases = std::size_t{1} << 30;
    options.stored_from = std::chrono::milliseconds(0);
  }
  std::filesystem::path file_of(const std::string& system) const { return options.data_dir / "bases" / (system + ".basis"); }
};

TEST_F(SharedBases, another_server_serves_designs_of_a_system_at_once_with_the_same_bits) {
  register_mesh(mesh);
  const std::string system = prepare(sheet_setup(id)).id();
  const DeformedDesigns here = deform(request_for(system, {{0.1, 0}, {-0.05, 0.1}}));
  ASSERT_TRUE(eventually([&] { return std::filesystem::exists(file_of(system)); }));
  swap();
  other.reset();  // the one that prepared it
  const DeformedDesigns there = deform(request_for(system, {{0.1, 0}, {-0.05, 0.1}}));
  EXPECT_EQ(here.points, there.points);
  EXPECT_FALSE(there.summary.prepared_again());
  for (std::size_t i = 0; i < 2; ++i) EXPECT_EQ(here.results[i].SerializeAsString(), there.results[i].SerializeAsString());
}

TEST_F(SharedBases, what_one_deletes_has_no_basis_any_more) {
  register_mesh(mesh);
  const std::string system = prepare(sheet_setup(id)).id();
  ASSERT_TRUE(eventually([&] { return std::filesystem::exists(file_of(system)); }));
  swap();
  v1::ReleaseSystemRequest forget;
  forget.set_id(system);
  forget.set_forget(true);
  engine->release_system(forget, {});
  EXPECT_FALSE(std::filesystem::exists(file_of(system)));
  prepare(sheet_setup(id));
  ASSERT_TRUE(eventually([&] { return std::filesystem::exists(file_of(system)); }));
  v1::DeleteGeometryRequest request;
  request.set_id(id);
  request.set_with_setups(true);
  engine->delete_geometry(request, {});
  EXPECT_FALSE(std::filesystem::exists(file_of(system)));
}

TEST_F(SharedBases, without_the_folder_systems_are_prepared_and_no_basis_is_written_elsewhere) {
  register_mesh(mesh);
  engine->get_points(id, {});  // so that it is in memory
  const std::filesystem::path away = options.data_dir.string() + ".away";
  std::filesystem::rename(options.data_dir, away);
  std::filesystem::create_directory(options.data_dir);  // below the place where it was mounted
  const std::string system = prepare(sheet_setup(id)).id();
  engine->drain(std::chrono::seconds(60));
  EXPECT_TRUE(std::filesystem::is_empty(options.data_dir));
  std::filesystem::remove(options.data_dir);
  std::filesystem::rename(away, options.data_dir);
  swap();
  EXPECT_TRUE(deform(request_for(system, {{0.1, 0}})).summary.prepared_again());
  ASSERT_TRUE(eventually([&] { return std::filesystem::exists(file_of(system)); }));
}

}  // namespace
}  // namespace deform::server::postgres_engine_test
