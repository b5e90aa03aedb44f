// SPDX-License-Identifier: GPL-3.0-or-later
// Handle bases in the store: who finds one serves designs of a system that is not in memory without preparing it, with the same
// bits; who finds none, or a damaged one, prepares. Preparations are told by `prepared_again`.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <fstream>

#include "server/store/geometry_file.h"
#include "tests/server/engine_fixture.h"

namespace deform::server::engine_stored_bases_test {
namespace {

namespace fs = std::filesystem;

class StoredBasesTest : public EngineFixture {
 protected:
  StoredBasesTest() {
    spdlog::set_level(spdlog::level::off);
    options.max_stored_bases = std::size_t{1} << 30;
    options.stored_from = std::chrono::milliseconds(0);
  }
  ~StoredBasesTest() override { spdlog::set_level(spdlog::level::info); }

  std::string prepared(const CallContext& call = {}) {
    register_mesh(mesh);
    return prepare(sheet_setup(id), call).id();
  }
  fs::path folder() const { return options.data_dir / "bases"; }
  fs::path file_of(const std::string& system) const { return folder() / (system + ".basis"); }
  bool is_stored(const std::string& system) const {
    return eventually([&] { return fs::exists(file_of(system)); });
  }
  std::size_t files() const {
    return fs::exists(folder()) ? static_cast<std::size_t>(std::distance(fs::directory_iterator(folder()), {})) : 0;
  }
  /// What is being written is written.
  void close() {
    engine->drain(std::chrono::seconds(60));
    engine.reset();
  }
  void open() { engine = Engine::open(options); }
  void restart() {
    close();
    open();
  }

  v1::DeformRequest designs(const std::string& system) const {
    v1::DeformRequest request = request_for(system, {{0.1, 0}, {-0.05, 0.1}, {0.2, 0.3}});
    auto* motion = request.add_designs()->add_motions();
    motion->set_handle("right");
    for (const double number : {1.0, 0.1, 0.0, 0.0, -0.1, 1.0, 0.0, 0.05, 0.0, 0.0, 1.1, 0.2}) motion->add_affine(number);
    return request;
  }
  static void expect_same(const DeformedDesigns& a, const DeformedDesigns& b) {
    EXPECT_EQ(a.points, b.points);
    ASSERT_EQ(a.results.size(), b.results.size());
    for (std::size_t i = 0; i < a.results.size(); ++i) {
      EXPECT_EQ(a.results[i].SerializeAsString(), b.results[i].SerializeAsString()) << a.results[i].DebugString();
    }
  }
  std::string compiled(const std::string& system) {
    v1::GetBasisRequest request;
    request.set_system_id(system);
    Waiter<std::shared_ptr<BasisRecords>> waiter;
    engine->get_basis(request, {}, waiter.callback());
    std::string bytes, piece;
    for (const auto records = waiter.value(); records->next(piece);) bytes += piece;
    return bytes;
  }

  const Mesh mesh = sheet_mesh(60, 40);
  const std::string id = mesh_id(mesh);
};

TEST_F(StoredBasesTest, a_restarted_server_serves_designs_without_preparing_with_the_same_bits) {
  const std::string system = prepared();
  const DeformedDesigns before = deform(designs(system));
  v1::JacobianVectorRequest product;
  product.set_system_id(system);
  for (const double v : {0.1, 0.2}) product.add_variables(v);
  for (const double v : {1.0, -1.0}) product.add_direction(v);
  const DeformedDesigns derivative = jacobian_vector(product);
  v1::VectorJacobianHeader header;
  header.set_system_id(system);
  const std::vector<double> gradient = vector_jacobian(header, mesh.points);
  const std::string basis = compiled(system);
  const std::size_t bytes = engine->info().cache_bytes();
  restart();
  EXPECT_TRUE(fs::exists(file_of(system)));
  const DeformedDesigns after = deform(designs(system));
  expect_same(before, after);
  EXPECT_FALSE(after.summary.prepared_again());
  EXPECT_EQ(engine->info().systems_resident(), 1u);
  EXPECT_LT(engine->info().cache_bytes(), bytes) << "without its factor";
  EXPECT_EQ(engine->stored_bases().restored, 1u);
  EXPECT_EQ(engine->stored_bases().written, 0u) << "since it started";
  EXPECT_EQ(engine->stored_bases().bytes, fs::file_size(file_of(system)));
  expect_same(derivative, jacobian_vector(product));
  EXPECT_EQ(gradient, vector_jacobian(header, mesh.points));
  EXPECT_EQ(basis, compiled(system));
  EXPECT_FALSE(deform(designs(system)).summary.prepared_again());
}

TEST_F(StoredBasesTest, what_needs_the_solution_prepares_it_and_replaces_what_was_restored) {
  const std::string system = prepared();
  v1::DeformRequest direct = designs(system);
  direct.set_path(v1::PATH_DIRECT);
  const DeformedDesigns before = deform(direct), on_basis = deform(designs(system));
  restart();
  EXPECT_FALSE(deform(designs(system)).summary.prepared_again());
  const std::size_t bytes = engine->info().cache_bytes();
  const DeformedDesigns after = deform(direct);
  EXPECT_TRUE(after.summary.prepared_again());
  expect_same(before, after);
  EXPECT_EQ(engine->info().systems_resident(), 1u);
  EXPECT_GT(engine->info().cache_bytes(), bytes);
  EXPECT_FALSE(deform(direct).summary.prepared_again());
  expect_same(on_basis, deform(designs(system)));
  // Displacements point by point and a tolerance of its own take the direct path, too.
  restart();
  v1::DeformRequest by_points = request_for(system, {{}});
  auto* motion = by_points.mutable_designs(0)->add_motions();
  motion->set_handle("right");
  Points field(engine->get_system(system, {}).handles(0).points(), Vec3{0, 0, 0.1});
  auto* piece = motion->add_displacements();
  piece->set_xyz(raw_bytes(field, 0, field.size()));
  EXPECT_TRUE(deform(by_points).summary.prepared_again());
}

TEST_F(StoredBasesTest, preparing_again_answers_as_the_first_time_at_once) {
  register_mesh(mesh);
  const v1::SystemInfo first = prepare(sheet_setup(id));
  restart();
  stages.clear();
  const v1::SystemInfo again = prepare(sheet_setup(id));
  EXPECT_EQ(again.SerializeAsString(), first.SerializeAsString());
  EXPECT_EQ(std::count(stages.begin(), stages.end(), "factor"), 0);
  EXPECT_FALSE(deform(designs(first.id())).summary.prepared_again());
}

TEST_F(StoredBasesTest, an_evicted_system_comes_back_from_its_basis) {
  const std::string system = prepared();
  const DeformedDesigns before = deform(designs(system));
  ASSERT_TRUE(is_stored(system));
  engine->evict("", {});
  EXPECT_EQ(engine->info().systems_resident(), 0u);
  const DeformedDesigns after = deform(designs(system));
  EXPECT_FALSE(after.summary.prepared_again());
  expect_same(before, after);
}

TEST_F(StoredBasesTest, a_damaged_basis_is_set_aside_and_made_again) {
  const std::string system = prepared();
  const DeformedDesigns before = deform(designs(system));
  close();
  const auto size = fs::file_size(file_of(system));
  int damages = 0;
  for (const auto& damage : std::vector<std::function<void()>>{
           [&] {
             std::fstream file(file_of(system), std::ios::in | std::ios::out | std::ios::binary);
             file.seekg(static_cast<std::streamoff>(size / 2));
             const char byte = static_cast<char>(file.get() ^ 1);
             file.seekp(static_cast<std::streamoff>(size / 2));
             file.put(byte);
           },
           [&] { fs::resize_file(file_of(system), size / 2); },
           [&] { fs::resize_file(file_of(system), size + 1); },
           [&] { fs::resize_file(file_of(system), 0); },
       }) {
    damage();
    open();
    EXPECT_EQ(engine->check_store({}).outcome, StoreReport::Outcome::faults);
    const DeformedDesigns after = deform(designs(system));
    EXPECT_TRUE(after.summary.prepared_again());
    expect_same(before, after);
    EXPECT_EQ(engine->store().damaged_files(), static_cast<std::uint64_t>(++damages));
    ASSERT_TRUE(is_stored(system)) << "again";
    EXPECT_EQ(engine->stored_bases().refused, 1u);
    EXPECT_TRUE(eventually([&] { return engine->stored_bases().written == 1; }));
    EXPECT_EQ(engine->stored_bases().restored, 0u);
    EXPECT_EQ(engine->check_store({}).outcome, StoreReport::Outcome::well);
    restart();
    EXPECT_FALSE(deform(designs(system)).summary.prepared_again());
    close();
    ASSERT_EQ(fs::file_size(file_of(system)), size);
  }
}

TEST_F(StoredBasesTest, a_basis_under_the_name_of_another_system_is_not_believed) {
  const std::string system = prepared();
  v1::Setup setup = sheet_setup(id);
  setup.mutable_variables(0)->set_upper(0.25);
  const std::string other = prepare(setup).id();
  close();
  fs::copy_file(file_of(system), file_of(other), fs::copy_options::overwrite_existing);
  open();
  EXPECT_TRUE(deform(request_for(other, {{0.1, 0}})).summary.prepared_again());
  EXPECT_FALSE(deform(request_for(system, {{0.1, 0}})).summary.prepared_again());
}

TEST_F(StoredBasesTest, a_geometry_whose_file_is_lost_is_not_served_from_a_basis_until_it_is_registered_again) {
  const std::string system = prepared();
  const DeformedDesigns before = deform(designs(system));
  close();
  fs::remove(options.data_dir / "geometries" / id);
  open();
  for (int i = 0; i < 2; ++i) {
    try {
      deform(designs(system));
      ADD_FAILURE();
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::data_loss) << error.what();
    }
  }
  register_mesh(mesh);
  const DeformedDesigns after = deform(designs(system));
  EXPECT_FALSE(after.summary.prepared_again());
  expect_same(before, after);
}

TEST_F(StoredBasesTest, it_goes_with_its_system_and_with_its_geometry) {
  const std::string system = prepared();
  ASSERT_TRUE(is_stored(system));
  v1::ReleaseSystemRequest release;
  release.set_id(system);
  engine->release_system(release, {});
  EXPECT_TRUE(fs::exists(file_of(system))) << "only its memory is released";
  release.set_forget(true);
  engine->release_system(release, {});
  EXPECT_EQ(files(), 0u);
  prepare(sheet_setup(id));
  ASSERT_TRUE(is_stored(system));
  v1::DeleteGeometryRequest remove;
  remove.set_id(id);
  remove.set_with_setups(true);
  engine->delete_geometry(remove, {});
  EXPECT_EQ(files(), 0u);
}

TEST_F(StoredBasesTest, where_none_can_be_written_systems_are_prepared_as_ever) {
  options.max_stored_bases = 1000;
  reopen();
  const std::string system = prepared();
  restart();
  EXPECT_EQ(files(), 0u) << "too large";
  EXPECT_TRUE(deform(designs(system)).summary.prepared_again());
  close();
  options.max_stored_bases = 0;
  open();
  EXPECT_TRUE(deform(designs(system)).summary.prepared_again());
  close();
  options.max_stored_bases = std::size_t{1} << 30;
  fs::remove(folder());
  std::ofstream(folder()) << "no folder";
  open();
  EXPECT_TRUE(deform(designs(system)).summary.prepared_again());
  close();
  fs::remove(folder());
  options.stored_from = std::chrono::seconds(1000);
  open();
  EXPECT_TRUE(deform(designs(system)).summary.prepared_again());
  restart();
  EXPECT_EQ(files(), 0u) << "not worth it";
}

TEST_F(StoredBasesTest, none_is_read_where_none_are_kept) {
  const std::string system = prepared();
  close();
  ASSERT_EQ(files(), 1u);
  options.max_stored_bases = 0;
  open();
  EXPECT_TRUE(deform(designs(system)).summary.prepared_again());
}

TEST_F(StoredBasesTest, the_oldest_gives_way) {
  const std::string first = prepared();
  ASSERT_TRUE(is_stored(first));
  close();
  options.max_stored_bases = fs::file_size(file_of(first)) * 3 / 2;
  open();
  v1::Setup setup = sheet_setup(id);
  setup.mutable_variables(0)->set_upper(0.25);
  const std::string second = prepare(setup).id();
  ASSERT_TRUE(is_stored(second));
  EXPECT_FALSE(fs::exists(file_of(first)));
}

TEST_F(StoredBasesTest, it_is_kept_within_the_quota_of_its_tenant) {
  CallContext call;
  register_mesh(mesh);
  call.quota.stored_bytes = engine->stored(default_tenant).bytes + 10'000;
  const std::string system = prepare(sheet_setup(id), call).id();
  EXPECT_TRUE(eventually([&] { return engine->stored_bases().not_written == 1; }));
  restart();
  EXPECT_EQ(files(), 0u);
  EXPECT_TRUE(deform(designs(system), call).summary.prepared_again());
  call.quota.stored_bytes += 10'000'000;
  restart();
  EXPECT_TRUE(deform(designs(system), call).summary.prepared_again());
  EXPECT_TRUE(is_stored(system));
}

TEST_F(StoredBasesTest, what_a_killed_server_was_writing_is_swept) {
  const std::string system = prepared();
  close();
  std::ofstream(folder() / (system + ".basis.part.0123456789abcdef.1")) << "half";
  std::ofstream(folder() / "notes.txt") << "of somebody";
  open();
  EXPECT_EQ(files(), 2u);
  EXPECT_TRUE(fs::exists(folder() / "notes.txt"));
}

}  // namespace
}  // namespace deform::server::engine_stored_bases_test
