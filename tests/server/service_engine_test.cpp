// SPDX-License-Identifier: GPL-3.0-or-later
// Every RPC on the real engine through the real service: the life of a geometry, and what bad input is told.
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>

#include "core/compiled/deformation.h"
#include "core/compiled/reader.h"
#include "server/store/geometry_file.h"
#include "tests/server/ended_with.h"
#include "tests/server/service_fixture.h"
#include "tests/server/test_mesh.h"

namespace deform::server::service_engine_test {
namespace {

using grpc::StatusCode;

class ServiceEngine : public testing::TestWithParam<support::Transport> {
 protected:
  ServiceEngine() : server(GetParam(), small_options()), stub(v1::DeformService::NewStub(server.channel())) {}

  static ServerOptions small_options() {
    ServerOptions options;
    options.engine.block_points = 256;
    options.engine.workers = 2;
    options.engine.memory_budget = std::size_t{1} << 30;
    return options;
  }

  grpc::Status upload(const v1::GeometryHeader& header, const std::vector<v1::RegisterGeometryRequest>& parts) {
    grpc::ClientContext context;
    const auto writer = stub->RegisterGeometry(&context, &geometry);
    v1::RegisterGeometryRequest first;
    *first.mutable_header() = header;
    bool open = writer->Write(first);
    for (std::size_t i = 0; open && i < parts.size(); ++i) open = writer->Write(parts[i]);
    writer->WritesDone();
    return writer->Finish();
  }
  void register_sheet() {
    const grpc::Status status = upload(header_of(mesh), upload_messages(mesh));
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
  grpc::Status prepare(const v1::Setup& setup) {
    grpc::ClientContext context;
    v1::PrepareRequest request;
    *request.mutable_setup() = setup;
    const auto reader = stub->Prepare(&context, request);
    v1::PrepareReply reply;
    while (reader->Read(&reply)) {
      if (reply.has_system()) system = reply.system();
    }
    return reader->Finish();
  }
  void prepare_sheet() {
    register_sheet();
    const grpc::Status status = prepare(sheet_setup(geometry.id()));
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
  v1::DeformRequest request(std::vector<double> variables) {
    v1::DeformRequest out;
    out.set_system_id(system.id());
    v1::Design& design = *out.add_designs();
    for (const double v : variables) design.add_variables(v);
    out.mutable_output()->set_encoding(v1::RAW_F64);
    return out;
  }
  /// Puts a raw block where it belongs.
  static void place(const v1::Block& block, Points& points) {
    ASSERT_EQ(block.encoding(), v1::RAW_F64);
    ASSERT_EQ(block.data().size(), block.count() * sizeof(Vec3));
    if (points.size() < block.first() + block.count()) points.resize(block.first() + block.count());
    std::memcpy(points.data() + block.first(), block.data().data(), block.data().size());
  }
  template <typename Reader>
  Points read_points(Reader& reader, grpc::Status& status) {
    Points points;
    v1::DeformReply reply;
    while (reader.Read(&reply)) {
      if (reply.has_block()) place(reply.block(), points);
    }
    status = reader.Finish();
    return points;
  }
  Points deform(const v1::DeformRequest& asked, grpc::Status& status) {
    grpc::ClientContext context;
    const auto reader = stub->Deform(&context, asked);
    return read_points(*reader, status);
  }

  const Mesh mesh = sheet_mesh(40, 25);
  support::InProcessServer server;
  std::unique_ptr<v1::DeformService::Stub> stub;
  v1::GeometryInfo geometry;
  v1::SystemInfo system;
};

/// Folders where files should be, and files where folders should be: every access fails.
TEST_P(ServiceEngine, NoErrorOfTheDiskTellsWhereTheServerKeepsItsFiles) {
  namespace fs = std::filesystem;
  prepare_sheet();
  const fs::path data = server.options().engine.data_dir;
  const auto expect_told = [&](const grpc::Status& status, const std::string& what) {
    EXPECT_FALSE(status.ok());
    EXPECT_NE(status.error_message().find(what), std::string::npos) << status.error_message();
    EXPECT_EQ(status.error_message().find(data.string()), std::string::npos) << status.error_message();
  };
  const auto bounded = [&](double upper) {
    v1::Setup setup = sheet_setup(geometry.id());
    setup.mutable_variables(0)->set_upper(upper);
    return setup;
  };
  server.restart();
  stub = v1::DeformService::NewStub(server.channel());
  const fs::path content = data / "geometries" / geometry.id();
  fs::rename(content, data / "unclaimed" / "kept");
  fs::create_directory(content);
  grpc::Status status;
  deform(request({0.1, 0}), status);
  expect_told(status, "store: cannot read geometries/" + geometry.id());
  expect_told(prepare(bounded(0.4)), "store: cannot read geometries/" + geometry.id());
  fs::remove(content);
  fs::rename(data / "unclaimed" / "kept", content);

  fs::rename(data / "tmp", data / "unclaimed" / "tmp");
  std::ofstream(data / "tmp") << "a file";
  const Mesh other = sheet_mesh(7, 6);
  expect_told(upload(header_of(other), upload_messages(other)), "store: cannot open tmp/" + mesh_id(other));
  expect_told(prepare(bounded(0.3)), "store: cannot open tmp/");
}

TEST_P(ServiceEngine, TheLifeOfAGeometry) {
  register_sheet();
  EXPECT_EQ(geometry.points(), mesh.points.size());
  EXPECT_FALSE(geometry.existed());
  const std::string id = geometry.id();

  v1::GeometryHeader known = header_of(mesh);
  known.set_id(id);
  ASSERT_TRUE(upload(known, {}).ok()) << "known by its id, nothing needs to be sent";
  EXPECT_TRUE(geometry.existed());
  {
    grpc::ClientContext context;
    v1::GetGeometryRequest request;
    v1::GeometryInfo info;
    request.set_id(id.substr(0, 12));
    ASSERT_TRUE(stub->GetGeometry(&context, request, &info).ok());
    EXPECT_EQ(info.id(), id);
  }
  {
    grpc::ClientContext context;
    v1::ListGeometriesReply reply;
    ASSERT_TRUE(stub->ListGeometries(&context, {}, &reply).ok());
    ASSERT_EQ(reply.geometries_size(), 1);
    EXPECT_EQ(reply.geometries(0).name(), "sheet");
  }
  {
    grpc::ClientContext context;
    v1::GetPointsRequest request;
    request.set_id(id);
    const auto reader = stub->GetPoints(&context, request);
    v1::PointChunk chunk;
    std::string bytes;
    while (reader->Read(&chunk)) bytes += chunk.xyz();
    ASSERT_TRUE(reader->Finish().ok());
    EXPECT_EQ(bytes, raw_bytes(mesh.points, 0, mesh.points.size()));
  }
  {
    grpc::ClientContext context;
    v1::EstimateRequest request;
    v1::EstimateReply reply;
    *request.mutable_setup() = sheet_setup(id);
    ASSERT_TRUE(stub->Estimate(&context, request, &reply).ok());
    EXPECT_TRUE(reply.fits());
    ASSERT_TRUE(prepare(sheet_setup(id)).ok());
    EXPECT_EQ(system.id(), reply.system_id());
    EXPECT_LE(system.bytes(), reply.resident_bytes());
  }
  {
    grpc::ClientContext context;
    v1::GetSystemRequest request;
    v1::SystemInfo info;
    request.set_id(system.id());
    ASSERT_TRUE(stub->GetSystem(&context, request, &info).ok());
    EXPECT_TRUE(info.resident());
  }
  {
    grpc::ClientContext context;
    v1::ListSystemsReply reply;
    ASSERT_TRUE(stub->ListSystems(&context, {}, &reply).ok());
    EXPECT_EQ(reply.systems_size(), 1);
  }
  {
    grpc::ClientContext context;
    v1::DeleteGeometryRequest request;
    v1::DeleteGeometryReply reply;
    request.set_id(id);
    EXPECT_THAT(stub->DeleteGeometry(&context, request, &reply), EndedWith(StatusCode::FAILED_PRECONDITION));
  }
  {
    grpc::ClientContext context;
    v1::ReleaseSystemRequest request;
    v1::ReleaseSystemReply reply;
    request.set_id(system.id());
    request.set_forget(true);
    ASSERT_TRUE(stub->ReleaseSystem(&context, request, &reply).ok());
    EXPECT_GT(reply.bytes_released(), 0u);
  }
  {
    grpc::ClientContext context;
    v1::DeleteGeometryRequest request;
    v1::DeleteGeometryReply reply;
    request.set_id(id);
    EXPECT_TRUE(stub->DeleteGeometry(&context, request, &reply).ok());
  }
  grpc::ClientContext context;
  v1::ServerInfo info;
  ASSERT_TRUE(stub->GetServerInfo(&context, {}, &info).ok());
  EXPECT_EQ(info.geometries(), 0u);
}

TEST_P(ServiceEngine, DeformAndDeformStreamGiveTheSamePoints) {
  prepare_sheet();
  grpc::Status status;
  const Points rest = deform(request({0, 0}), status);
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(rest.size(), mesh.points.size());
  for (std::size_t i = 0; i < rest.size(); ++i) {
    for (int k = 0; k < 3; ++k) ASSERT_NEAR(rest[i][k], mesh.points[i][k], 1e-9);
  }
  std::map<std::uint64_t, Points> expected;
  grpc::ClientContext context;
  const auto stream = stub->DeformStream(&context);
  for (std::uint64_t id = 1; id <= 20; ++id) {
    const v1::DeformRequest asked = request({0.01 * static_cast<double>(id), -0.02});
    expected[id] = deform(asked, status);
    ASSERT_TRUE(status.ok());
    v1::DeformStreamRequest message;
    message.set_request_id(id);
    *message.mutable_request() = asked;
    ASSERT_TRUE(stream->Write(message));
  }
  stream->WritesDone();
  std::map<std::uint64_t, Points> got;
  v1::DeformReply reply;
  while (stream->Read(&reply)) {
    ASSERT_FALSE(reply.has_error()) << reply.error().message();
    if (reply.has_block()) place(reply.block(), got[reply.request_id()]);
  }
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(got, expected) << "bit for bit";
}

TEST_P(ServiceEngine, AStreamGoesOnWhereTheLastDesignEnded) {
  register_sheet();
  v1::Setup setup = sheet_setup(geometry.id());
  setup.mutable_method()->mutable_shell();
  v1::Constraint& round = *setup.add_constraints();
  round.set_name("round");
  round.set_weight(1e5);
  round.mutable_cylindrical();
  v1::Box& box = *round.add_regions()->mutable_box();
  for (const double x : {0.4, 0.2, -1.0}) box.add_min(x);
  for (const double x : {0.6, 0.8, 1.0}) box.add_max(x);
  ASSERT_TRUE(prepare(setup).ok());

  const auto converge = [&](auto& reader) {
    v1::ConstraintsReport report;
    v1::DeformReply reply;
    while (reader.Read(&reply)) {
      EXPECT_FALSE(reply.has_error()) << reply.error().message();
      if (reply.has_result()) report = reply.result().constraints();
      if (reply.has_summary()) break;
    }
    EXPECT_TRUE(report.converged());
    return report.iterations();
  };
  grpc::ClientContext context;
  const auto stream = stub->DeformStream(&context);
  std::uint64_t id = 0;
  const auto streamed = [&](bool warm) {
    v1::DeformStreamRequest message;
    message.set_request_id(++id);
    *message.mutable_request() = request({0.2, 0.1});
    message.mutable_request()->set_warm_start(warm);
    EXPECT_TRUE(stream->Write(message));
    return converge(*stream);
  };
  const auto by_itself = streamed(false);
  EXPECT_EQ(streamed(true), by_itself) << "the first";
  const auto next = streamed(true);
  EXPECT_LT(next, by_itself);
  EXPECT_EQ(streamed(false), by_itself);
  EXPECT_LE(streamed(true), next);
  stream->WritesDone();
  EXPECT_TRUE(stream->Finish().ok());
  // Within a request, and not between calls.
  for (int call = 0; call < 2; ++call) {
    v1::DeformRequest asked = request({0.2, 0.1});
    asked.set_warm_start(true);
    if (call == 1) *asked.add_designs() = asked.designs(0);
    grpc::ClientContext unary;
    const auto reader = stub->Deform(&unary, asked);
    EXPECT_EQ(converge(*reader), call == 0 ? by_itself : next);
    EXPECT_TRUE(reader->Finish().ok());
  }
}

TEST_P(ServiceEngine, TheTwoJacobianProductsAreAdjoint) {
  prepare_sheet();
  const std::vector<double> variables = {0.1, 0.05};
  const std::vector<double> direction = {0.7, -1.3};
  v1::JacobianVectorRequest forward;
  forward.set_system_id(system.id());
  for (const double v : variables) forward.add_variables(v);
  for (const double d : direction) forward.add_direction(d);
  grpc::ClientContext context;
  const auto reader = stub->JacobianVector(&context, forward);
  grpc::Status status;
  const Points jv = read_points(*reader, status);
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(jv.size(), mesh.points.size());

  Points w(mesh.points.size());
  for (std::size_t i = 0; i < w.size(); ++i) w[i] = {std::sin(double(i)), std::cos(double(i)), 0.1 * double(i % 7)};
  grpc::ClientContext back_context;
  v1::VectorJacobianReply reply;
  const auto writer = stub->VectorJacobian(&back_context, &reply);
  v1::VectorJacobianRequest message;
  message.mutable_header()->set_system_id(system.id());
  for (const double v : variables) message.mutable_header()->add_variables(v);
  writer->Write(message);
  for (std::size_t i = 0; i < w.size(); i += 300) {
    message.set_cotangent(raw_bytes(w, i, std::min<std::size_t>(300, w.size() - i)));
    writer->Write(message);
  }
  writer->WritesDone();
  status = writer->Finish();
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(reply.gradient_size(), 2);
  double left = 0;
  for (std::size_t i = 0; i < w.size(); ++i) {
    for (int k = 0; k < 3; ++k) left += w[i][k] * jv[i][k];
  }
  EXPECT_NEAR(left, reply.gradient(0) * direction[0] + reply.gradient(1) * direction[1], 1e-9 * std::abs(left));
}

TEST_P(ServiceEngine, ACompiledDeformationGivesThePointsOfDeform) {
  prepare_sheet();
  v1::GetBasisRequest basis;
  basis.set_system_id(system.id());
  grpc::ClientContext context;
  const auto reader = stub->GetBasis(&context, basis);
  v1::BasisReply reply;
  ASSERT_TRUE(reader->Read(&reply));
  ASSERT_TRUE(reply.has_header());
  const v1::BasisHeader header = reply.header();
  std::string bytes;
  while (reader->Read(&reply)) {
    ASSERT_FALSE(reply.has_header());
    EXPECT_LT(reply.ByteSizeLong(), std::size_t{1} << 20);
    bytes += reply.records();
  }
  grpc::Status status = reader->Finish();
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(bytes.size(), header.bytes());
  const compiled::Deformation deformation(compiled::read_content(std::as_bytes(std::span(bytes))));
  const Points right = deform(request({0.2, 0.3}), status);
  Points points(right.size());
  deformation.evaluate(std::vector<double>{0.2, 0.3}, std::span(points[0].data(), 3 * points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(points[i][k], right[i][k], 1e-14 * system.diagonal());
  }

  basis.set_system_id(std::string(64, '0'));
  grpc::ClientContext second;
  const auto refused = stub->GetBasis(&second, basis);
  EXPECT_FALSE(refused->Read(&reply));
  EXPECT_THAT(refused->Finish(), EndedWith(StatusCode::NOT_FOUND));
}

TEST_P(ServiceEngine, BadInputIsToldWhatIsWrongAndLeavesNothing) {
  prepare_sheet();
  grpc::Status status;
  const auto expect = [&](const grpc::Status& got, StatusCode code, const char* part) {
    EXPECT_EQ(got.error_code(), code) << got.error_message();
    EXPECT_NE(got.error_message().find(part), std::string::npos) << got.error_message();
  };
  deform(request({0.1}), status);
  expect(status, StatusCode::INVALID_ARGUMENT, "variables");
  deform(request({0.1, 0.1, 0.1}), status);
  expect(status, StatusCode::INVALID_ARGUMENT, "variables");
  deform(request({0.9, 0}), status);
  expect(status, StatusCode::INVALID_ARGUMENT, "up");
  deform(request({std::nan(""), 0}), status);
  expect(status, StatusCode::INVALID_ARGUMENT, "");
  v1::DeformRequest unknown = request({0, 0});
  unknown.set_system_id(std::string(64, '0'));
  deform(unknown, status);
  expect(status, StatusCode::NOT_FOUND, "0000");
  unknown.set_system_id(std::string("..\0/etc", 7));
  deform(unknown, status);
  EXPECT_FALSE(status.ok());
  v1::DeformRequest none = request({0, 0});
  none.clear_designs();
  deform(none, status);
  expect(status, StatusCode::INVALID_ARGUMENT, "designs");

  v1::Setup setup = sheet_setup(geometry.id());
  setup.mutable_handles(0)->mutable_region()->set_group("rigth");
  expect(prepare(setup), StatusCode::INVALID_ARGUMENT, "right");
  setup = sheet_setup(std::string(64, 'f'));
  expect(prepare(setup), StatusCode::NOT_FOUND, "ffff");
  setup = sheet_setup(geometry.id());
  setup.mutable_handles(0)->set_name(std::string("a\0\n", 3));
  status = prepare(setup);
  EXPECT_EQ(status.error_message().find('\n'), std::string::npos);

  v1::GeometryHeader header = header_of(mesh);
  header.set_point_count(~std::uint64_t{0});
  expect(upload(header, {}), StatusCode::INVALID_ARGUMENT, "point");
  header = header_of(mesh);
  header.set_id(std::string(64, 'a'));
  expect(upload(header, upload_messages(mesh)), StatusCode::INVALID_ARGUMENT, "");
  expect(upload(header_of(mesh), {}), StatusCode::INVALID_ARGUMENT, "");

  grpc::ClientContext context;
  v1::ServerInfo info;
  ASSERT_TRUE(stub->GetServerInfo(&context, {}, &info).ok());
  EXPECT_EQ(info.geometries(), 1u);
  deform(request({0.1, 0.1}), status);
  EXPECT_TRUE(status.ok()) << "and the server goes on";
}

TEST_P(ServiceEngine, ABadDesignOfAStreamFailsAlone) {
  prepare_sheet();
  grpc::ClientContext context;
  const auto stream = stub->DeformStream(&context);
  v1::DeformStreamRequest message;
  message.set_request_id(5);
  message.set_more(true);
  *message.mutable_request() = request({0.9, 0});
  message.mutable_request()->set_failures(v1::FAILURES_PER_DESIGN);
  ASSERT_TRUE(stream->Write(message));
  message.Clear();  // the rest of the request in another message
  message.set_request_id(5);
  *message.mutable_request()->add_designs() = request({0.2, 0.1}).designs(0);
  message.mutable_request()->add_designs()->add_motions()->set_handle(std::string("a\0\x1b[2J", 6));
  ASSERT_TRUE(stream->Write(message));
  stream->WritesDone();
  std::map<std::uint32_t, v1::DesignResult> results;
  Points points;
  v1::DeformReply reply;
  bool summary = false;
  while (stream->Read(&reply)) {
    EXPECT_EQ(reply.request_id(), 5u);
    EXPECT_FALSE(reply.has_error()) << reply.error().message();
    if (reply.has_block()) {
      EXPECT_EQ(reply.block().design(), 1u);
      place(reply.block(), points);
    }
    if (reply.has_result()) results[reply.result().design()] = reply.result();
    summary = summary || reply.has_summary();
  }
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_TRUE(summary);
  ASSERT_EQ(results.size(), 3u);
  EXPECT_EQ(results[0].error().code(), static_cast<std::uint32_t>(StatusCode::INVALID_ARGUMENT));
  EXPECT_EQ(results[0].error().message().substr(0, 20), "variables[0] (\"up\"):");
  EXPECT_FALSE(results[1].has_error());
  EXPECT_TRUE(results[2].has_error());
  EXPECT_EQ(results[2].error().message().find('\x1b'), std::string::npos);
  grpc::Status status;
  EXPECT_EQ(points, deform(request({0.2, 0.1}), status));
}

TEST_P(ServiceEngine, EverythingIsThereAfterARestart) {
  prepare_sheet();
  grpc::Status status;
  const Points before = deform(request({0.2, 0.1}), status);
  stub.reset();
  const auto bounded = [&](double upper) {
    v1::Setup setup = sheet_setup(geometry.id());
    setup.mutable_variables(0)->set_upper(upper);
    return setup;
  };
  server.restart();
  stub = v1::DeformService::NewStub(server.channel());
  EXPECT_EQ(deform(request({0.2, 0.1}), status), before);
  EXPECT_TRUE(status.ok()) << status.error_message();
}

TEST_P(ServiceEngine, ACancelledDeformLeavesTheServerIdle) {
  prepare_sheet();
  for (int i = 0; i < 20; ++i) {
    grpc::ClientContext context;
    v1::DeformRequest asked = request({0.1, 0.1});
    for (int d = 0; d < 200; ++d) *asked.add_designs() = asked.designs(0);
    const auto reader = stub->Deform(&context, asked);
    v1::DeformReply reply;
    for (int read = 0; read < i; ++read) reader->Read(&reply);
    context.TryCancel();
    EXPECT_THAT(reader->Finish(), EndedWith(StatusCode::CANCELLED));
  }
  EXPECT_TRUE(support::eventually([&] {
    grpc::ClientContext context;
    v1::ServerInfo info;
    return stub->GetServerInfo(&context, {}, &info).ok() && info.running() == 0 && info.queue_length() == 0;
  }));
}

DEFORM_BOTH_TRANSPORTS(ServiceEngine);

}  // namespace
}  // namespace deform::server::service_engine_test
