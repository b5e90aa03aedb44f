// SPDX-License-Identifier: GPL-3.0-or-later
// What the engine refuses: one table per message. The state afterwards is as if the call had not been made.
#include <functional>
#include <limits>

#include "tests/server/engine_fixture.h"
#include "tests/support/expect_error.h"

namespace deform::server::engine_input_test {
namespace {

using test::expect_error;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
const std::string unknown_id(64, 'e');
const std::string bad_ids[] = {
    "", "abc", std::string(64, 'G'), std::string(65, 'a'), std::string("aaaaaaaa\0a", 10), "../../etc/passwd"};

class EngineInputTest : public EngineFixture {
 protected:
  void SetUp() override {
    EngineFixture::SetUp();
    geometry = register_mesh(mesh);
    system = prepare(sheet_setup(geometry.id())).id();
  }
  void TearDown() override {
    // Nothing was left behind and the engine still serves.
    EXPECT_TRUE(eventually([&] { return engine->info().running() == 0 && engine->info().queue_length() == 0; }));
    EXPECT_EQ(engine->info().geometries(), 1u);
    EXPECT_EQ(engine->info().setups(), 1u);
    EXPECT_EQ(deform(request_for(system, {{0.1, 0.1}})).points.size(), 1u);
  }
  const Mesh mesh = sheet_mesh(30, 20);
  v1::GeometryInfo geometry;
  std::string system;
};

TEST_F(EngineInputTest, ids_everywhere) {
  const std::vector<std::pair<const char*, std::function<void(const std::string&)>>> calls = {
      {"get_geometry", [&](const std::string& id) { engine->get_geometry(id, {}); }},
      {"get_points", [&](const std::string& id) { engine->get_points(id, {}); }},
      {"delete_geometry",
       [&](const std::string& id) {
         v1::DeleteGeometryRequest request;
         request.set_id(id);
         engine->delete_geometry(request, {});
       }},
      {"get_system", [&](const std::string& id) { engine->get_system(id, {}); }},
      {"release_system",
       [&](const std::string& id) {
         v1::ReleaseSystemRequest request;
         request.set_id(id);
         request.set_forget(true);
         engine->release_system(request, {});
       }},
      {"deform",
       [&](const std::string& id) {
         deform(request_for(id, {{0, 0}}));
       }},
      {"estimate",
       [&](const std::string& id) {
         v1::EstimateRequest request;
         *request.mutable_setup() = sheet_setup(id);
         EngineFixture::estimate(request, {});
       }},
      {"prepare", [&](const std::string& id) { prepare(sheet_setup(id)); }},
      {"jacobian_vector",
       [&](const std::string& id) {
         v1::JacobianVectorRequest request;
         request.set_system_id(id);
         jacobian_vector(request);
       }},
      {"vector_jacobian",
       [&](const std::string& id) {
         v1::VectorJacobianHeader header;
         header.set_system_id(id);
         vector_jacobian(header, mesh.points);
       }},
  };
  for (const auto& [name, call] : calls) {
    SCOPED_TRACE(name);
    expect_error(ErrorCode::not_found, {"unknown id"}, [&] { call(unknown_id); });
    for (const auto& id : bad_ids) expect_error(ErrorCode::invalid_argument, {}, [&] { call(id); });
  }
}

TEST_F(EngineInputTest, uploads) {
  const auto upload = [&](const std::function<void(v1::GeometryHeader&)>& change) {
    v1::GeometryHeader header = header_of(sheet_mesh(12, 9));
    change(header);
    const auto session = engine->begin_upload(header, {});
    for (const auto& message : upload_messages(sheet_mesh(12, 9))) session->add(message);
    session->finish();
  };
  expect_error(ErrorCode::invalid_argument, {"header.id"}, [&] { upload([](auto& h) { h.set_id("123"); }); });
  expect_error(ErrorCode::invalid_argument, {"header.id", "announced"}, [&] { upload([](auto& h) { h.set_id(unknown_id); }); });
  expect_error(ErrorCode::invalid_argument, {"header.point_count", "100000"},
               [&] { upload([](auto& h) { h.set_point_count(100'001); }); });
  std::stop_source stop;
  CallContext call;
  call.stop = stop.get_token();
  const auto session = engine->begin_upload(header_of(sheet_mesh(12, 9)), call);
  stop.request_stop();
  expect_error(ErrorCode::cancelled, {}, [&] { session->add(upload_messages(sheet_mesh(12, 9))[0]); });
  expect_error(ErrorCode::cancelled, {}, [&] { session->finish(); });
}

TEST_F(EngineInputTest, setups) {
  const auto refused = [&](const std::vector<const char*>& parts, const std::function<void(v1::Setup&)>& spoil) {
    v1::Setup setup = sheet_setup(geometry.id());
    spoil(setup);
    expect_error(ErrorCode::invalid_argument, parts, [&] { prepare(setup); });
    v1::EstimateRequest request;
    *request.mutable_setup() = setup;
    expect_error(ErrorCode::invalid_argument, parts, [&] { EngineFixture::estimate(request, {}); });
  };
  refused({}, [](auto& s) { s.clear_handles(); });
  refused({"geometry"}, [](auto& s) { s.clear_geometry(); });
  refused({"rihgt", "right"}, [](auto& s) { s.mutable_handles(0)->mutable_region()->set_group("rihgt"); });
  refused({"right"}, [](auto& s) { s.mutable_fixed(0)->set_group("right"); });  // handle and fixed overlap
  refused({"right"}, [](auto& s) { *s.add_handles() = s.handles(0); });
  refused({"nobody"}, [](auto& s) { s.mutable_variables(0)->set_handle("nobody"); });
  refused({"up"}, [](auto& s) { s.mutable_variables(1)->set_name("up"); });
  refused({"up"}, [](auto& s) { s.mutable_variables(0)->set_lower(0.1); });
  refused({"600"}, [](auto& s) {
    s.mutable_fixed(0)->clear_group();
    s.mutable_fixed(0)->add_ids(600);
  });
  refused({}, [](auto& s) {  // an empty region
    s.mutable_handles(0)->mutable_region()->clear_group();
    for (const double x : {50., 50., 50.}) s.mutable_handles(0)->mutable_region()->mutable_sphere()->add_centre(x);
    s.mutable_handles(0)->mutable_region()->mutable_sphere()->set_radius(1);
  });
  refused({"radius"}, [](auto& s) {
    s.mutable_handles(0)->mutable_region()->clear_group();
    for (const double x : {0., 0., 0.}) s.mutable_handles(0)->mutable_region()->mutable_sphere()->add_centre(x);
    s.mutable_handles(0)->mutable_region()->mutable_sphere()->set_radius(-1);
  });
  refused({}, [](auto& s) {
    s.mutable_method()->mutable_rbf()->set_shape(-1), s.mutable_method()->mutable_rbf()->set_kernel(v1::GAUSSIAN);
  });
  refused({}, [](auto& s) {
    s.mutable_method()->mutable_rbf()->set_kernel(v1::QUINTIC);
    s.mutable_method()->mutable_rbf()->set_polynomial_degree(0);
  });
}

TEST_F(EngineInputTest, deformations) {
  const auto refused = [&](const std::vector<const char*>& parts, const std::function<void(v1::DeformRequest&)>& spoil) {
    v1::DeformRequest request = request_for(system, {{0.1, 0.1}});
    spoil(request);
    expect_error(ErrorCode::invalid_argument, parts, [&] { deform(request); });
  };
  refused({"designs"}, [](auto& r) { r.clear_designs(); });
  refused({"designs", "101", "100"}, [](auto& r) {
    for (int i = 0; i < 100; ++i) r.add_designs();
  });
  refused({"variables", "2", "3"}, [](auto& r) { r.mutable_designs(0)->add_variables(0); });
  refused({"designs[0].variables[1]"}, [](auto& r) { r.mutable_designs(0)->set_variables(1, nan); });
  refused({"up", "0.5"}, [](auto& r) { r.mutable_designs(0)->set_variables(0, 0.6); });
  refused({"output.tolerance"}, [](auto& r) { r.mutable_output()->set_tolerance(nan); });
  refused({"output.tolerance"}, [](auto& r) { r.mutable_output()->set_tolerance(-1); });
  refused({"output.encoding"}, [](auto& r) { r.mutable_output()->set_encoding(static_cast<v1::Encoding>(17)); });
  refused({"path"}, [](auto& r) { r.set_path(static_cast<v1::EvaluationPath>(17)); });
  refused({"no handle \"wing\""}, [](auto& r) {
    auto* motion = r.mutable_designs(0)->add_motions();
    motion->set_handle("wing");
    for (int k = 0; k < 12; ++k) motion->add_affine(k);
  });
  refused({"40 points"}, [](auto& r) {
    r.mutable_designs(0)->clear_variables();
    auto* motion = r.mutable_designs(0)->add_motions();
    motion->set_handle("right");
    motion->add_displacements()->set_xyz(std::string(24, '\0'));
  });
  refused({}, [](auto& r) {  // a handle that its variables move already
    auto* motion = r.mutable_designs(0)->add_motions();
    motion->set_handle("right");
    for (const double x : {1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.}) motion->add_affine(x);
  });
  refused({}, [](auto& r) {  // two motions of one handle
    r.mutable_designs(0)->clear_variables();
    for (int i = 0; i < 2; ++i) {
      auto* motion = r.mutable_designs(0)->add_motions();
      motion->set_handle("right");
      for (const double x : {1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.}) motion->add_affine(x);
    }
  });
}

TEST_F(EngineInputTest, derivatives) {
  v1::JacobianVectorRequest request;
  request.set_system_id(system);
  expect_error(ErrorCode::invalid_argument, {"direction", "2"}, [&] { jacobian_vector(request); });
  request.add_direction(nan);
  expect_error(ErrorCode::invalid_argument, {"direction[0]"}, [&] { jacobian_vector(request); });
  request.set_direction(0, 1);
  request.add_direction(1);
  request.add_variables(0);
  expect_error(ErrorCode::invalid_argument, {"variables"}, [&] { jacobian_vector(request); });
  v1::VectorJacobianHeader header;
  header.set_system_id(system);
  expect_error(ErrorCode::invalid_argument, {"cotangent", "600"}, [&] { vector_jacobian(header, Points(599)); });
  Points field(600);
  field[17][1] = nan;
  expect_error(ErrorCode::invalid_argument, {"cotangent", "17"}, [&] { vector_jacobian(header, field); });
  header.add_variables(0.1);
  expect_error(ErrorCode::invalid_argument, {"variables"}, [&] { vector_jacobian(header, Points(600)); });
}

TEST(EngineOptions, limits) {
  const auto refused = [](const char* option, const std::function<void(EngineOptions&)>& spoil) {
    EngineOptions options;
    options.data_dir = "somewhere";
    EXPECT_NO_THROW(options.validate());
    spoil(options);
    expect_error(ErrorCode::invalid_argument, {option}, [&] { options.validate(); });
  };
  refused("data_dir", [](auto& o) { o.data_dir.clear(); });
  refused("workers", [](auto& o) { o.workers = -1; });
  refused("workers", [](auto& o) { o.workers = 100'000; });
  refused("queue_limit", [](auto& o) { o.queue_limit = 0; });
  refused("max_points", [](auto& o) { o.max_points = 0; });
  refused("max_points", [](auto& o) { o.max_points = std::size_t{1} << 40; });
  refused("max_designs", [](auto& o) { o.max_designs = 0; });
  refused("max_handles", [](auto& o) { o.max_handles = 0; });
  refused("block_points", [](auto& o) { o.block_points = 255; });
  refused("block_points", [](auto& o) { o.block_points = 40'001; });
  refused("cache_budget", [](auto& o) {
    o.memory_budget = 1000;
    o.cache_budget = 1001;
  });
}

}  // namespace
}  // namespace deform::server::engine_input_test
