// SPDX-License-Identifier: GPL-3.0-or-later
// Compiled deformations from the engine: their points are those of its own designs, and what they cost is charged and given back.
#include <gtest/gtest.h>

#include <cstring>

#include "core/compiled/deformation.h"
#include "core/compiled/layout.h"
#include "core/compiled/reader.h"
#include "tests/server/engine_fixture.h"
#include "tests/support/expect_error.h"

namespace deform::server::engine_compiled_test {
namespace {

using test::expect_error;

class EngineCompiledTest : public EngineFixture {
 protected:
  using Records = std::shared_ptr<BasisRecords>;

  Records get_basis(const std::string& system_id, const CallContext& call = {}) {
    v1::GetBasisRequest request;
    request.set_system_id(system_id);
    Waiter<Records> waiter;
    engine->get_basis(request, call, waiter.callback());
    return waiter.value();
  }
  static std::string bytes_of(BasisRecords& records) {
    std::string bytes, piece;
    while (records.next(piece)) {
      EXPECT_LT(piece.size(), std::size_t{1} << 20);
      bytes += piece;
    }
    EXPECT_EQ(bytes.size(), records.header().bytes());
    return bytes;
  }
  bool idle(std::size_t bytes) {
    for (int i = 0; i < 1000; ++i) {
      if (engine->info().memory_in_use() == bytes) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }

  const Mesh mesh = sheet_mesh(60, 40);
};

TEST_F(EngineCompiledTest, gives_the_points_and_derivatives_of_the_engine) {
  const v1::GeometryInfo geometry = register_mesh(mesh, "folder/sheet.obj");
  const v1::SystemInfo system = prepare(sheet_setup(geometry.id()));
  const Records records = get_basis(system.id());
  EXPECT_EQ(records->header().system_id(), system.id());
  EXPECT_EQ(records->header().geometry_id(), geometry.id());
  EXPECT_EQ(records->header().version(), compiled::layout_version);
  const std::string bytes = bytes_of(*records);
  const compiled::Deformation deformation(compiled::read_content(std::as_bytes(std::span(bytes))));
  const compiled::Content& content = deformation.content();
  EXPECT_EQ(content.system_id, system.id());
  EXPECT_EQ(content.geometry_id, geometry.id());
  EXPECT_EQ(content.mesh, "folder/sheet.obj");
  EXPECT_EQ(content.method, "rbf");
  EXPECT_EQ(content.rest, mesh.points);
  v1::Setup setup;
  ASSERT_TRUE(setup.ParseFromString(content.setup));
  EXPECT_EQ(setup.SerializeAsString(), system.setup().SerializeAsString());
  ASSERT_EQ(deformation.variables(), 2u);
  EXPECT_EQ(content.variables[0].name, "up");
  EXPECT_EQ(content.variables[0].upper, 0.5);

  const std::vector<double> design{0.2, -0.3};
  const DeformedDesigns deformed = deform(request_for(system.id(), {design}));
  Points points(mesh.point_count()), vectors(mesh.point_count());
  deformation.evaluate(design, std::span(points[0].data(), 3 * points.size()));
  EXPECT_LE(largest_difference(points, deformed.points[0]), 1e-14 * system.diagonal());
  EXPECT_NEAR(deformation.report(design).error, deformed.results[0].estimated_error(),
              1e-12 * deformed.results[0].estimated_error());
  v1::JacobianVectorRequest product;
  product.set_system_id(system.id());
  for (const double v : design) product.add_variables(v);
  for (const double v : design) product.add_direction(v);
  deformation.jacobian_vector(design, design, std::span(vectors[0].data(), 3 * vectors.size()));
  EXPECT_LE(largest_difference(vectors, jacobian_vector(product).points[0]), 1e-14 * system.diagonal());
  v1::VectorJacobianHeader header;
  header.set_system_id(system.id());
  for (const double v : design) header.add_variables(v);
  std::vector<double> gradient(2);
  deformation.vector_jacobian(design, std::span<const double>(vectors[0].data(), 3 * vectors.size()), gradient);
  const std::vector<double> expected = vector_jacobian(header, vectors);
  for (std::size_t k = 0; k < 2; ++k) EXPECT_NEAR(gradient[k], expected[k], 1e-12 * std::abs(expected[k]));
}

TEST_F(EngineCompiledTest, names_the_mesh_that_was_asked_for) {
  const v1::SystemInfo system = prepare(sheet_setup(register_mesh(mesh, "first.obj").id()));
  const auto name_in = [](BasisRecords& records) {
    const std::string bytes = bytes_of(records);
    return compiled::read_content(std::as_bytes(std::span(bytes))).mesh;
  };
  v1::GetBasisRequest request;
  request.set_system_id(system.id());
  for (const std::string name : {"", "copy.obj", "a"}) {
    request.set_mesh(name);
    Waiter<Records> waiter;
    engine->get_basis(request, {}, waiter.callback());
    EXPECT_EQ(name_in(*waiter.value()), name.empty() ? "first.obj" : name);
  }
  request.set_mesh(std::string(4097, 'x'));
  expect_error(ErrorCode::invalid_argument, {"mesh", "4097", "4096"}, [&] { engine->get_basis(request, {}, [](auto) {}); });
}

TEST_F(EngineCompiledTest, what_it_holds_is_charged_until_it_is_let_go) {
  const v1::SystemInfo system = prepare(sheet_setup(register_mesh(mesh).id()));
  const std::size_t before = engine->info().memory_in_use();
  Records records = get_basis(system.id());
  EXPECT_GE(engine->info().memory_in_use(), before + mesh.point_count() * 28);
  std::string piece;
  records->next(piece);
  records.reset();
  EXPECT_TRUE(idle(before)) << engine->info().memory_in_use();
}

TEST_F(EngineCompiledTest, a_system_that_was_released_is_prepared_again) {
  const v1::SystemInfo system = prepare(sheet_setup(register_mesh(mesh).id()));
  const std::string bytes = bytes_of(*get_basis(system.id()));
  v1::ReleaseSystemRequest release;
  release.set_id(system.id());
  for (int i = 0; i < 1000 && engine->info().running() != 0; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_GT(engine->release_system(release, {}).bytes_released(), 0u);
  EXPECT_EQ(bytes_of(*get_basis(system.id().substr(0, 12))), bytes);
}

TEST_F(EngineCompiledTest, says_why_there_is_none) {
  const v1::GeometryInfo geometry = register_mesh(mesh);
  v1::Setup setup = sheet_setup(geometry.id());
  setup.mutable_method()->mutable_rbf()->set_basis(v1::BASIS_NEVER);
  expect_error(ErrorCode::failed_precondition, {"cannot be compiled", "BASIS_ALWAYS"}, [&] { get_basis(prepare(setup).id()); });
  expect_error(ErrorCode::not_found, {"unknown id"}, [&] { get_basis(std::string(64, '0')); });
  std::stop_source stop;
  CallContext cancelled;
  cancelled.stop = stop.get_token();
  stop.request_stop();
  expect_error(ErrorCode::cancelled, {}, [&] { get_basis(prepare(sheet_setup(geometry.id())).id(), cancelled); });
}

}  // namespace
}  // namespace deform::server::engine_compiled_test
