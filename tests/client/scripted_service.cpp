// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/client/scripted_service.h"

#include <grpcpp/security/server_credentials.h>
#include <grpcpp/server_builder.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "core/codec/block.h"

namespace deform::test {

namespace {

const grpc::Status no_script(grpc::StatusCode::UNIMPLEMENTED, "no script");

}  // namespace

ScriptedService::ScriptedService(int port) {
  grpc::ServerBuilder builder;
  builder.RegisterService(this);
  builder.AddListeningPort("127.0.0.1:" + std::to_string(port), grpc::InsecureServerCredentials(), &port_);
  server_ = builder.BuildAndStart();
}

ScriptedService::~ScriptedService() {
  if (server_) server_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(1));
}

client::Client ScriptedService::client(client::ClientOptions options) {
  options.address = address();
  return client::Client(options);
}

std::string ScriptedService::address() const { return "127.0.0.1:" + std::to_string(port_); }

void ScriptedService::stop() {
  server_->Shutdown(std::chrono::system_clock::now());
  server_.reset();
}

grpc::Status ScriptedService::Deform(grpc::ServerContext* context, const v1::DeformRequest* request,
                                     grpc::ServerWriter<v1::DeformReply>* writer) {
  return on_deform ? on_deform(*context, *request, *writer) : no_script;
}

grpc::Status ScriptedService::DeformStream(grpc::ServerContext* context,
                                           grpc::ServerReaderWriter<v1::DeformReply, v1::DeformStreamRequest>* stream) {
  return on_stream ? on_stream(*context, *stream) : no_script;
}

grpc::Status ScriptedService::Evaluate(grpc::ServerContext* context,
                                       grpc::ServerReaderWriter<v1::EvaluateReply, v1::EvaluateRequest>* stream) {
  return on_evaluate(*context, *stream);
}

grpc::Status ScriptedService::GetGeometry(grpc::ServerContext*, const v1::GetGeometryRequest* request, v1::GeometryInfo* reply) {
  return on_get_geometry ? on_get_geometry(*request, *reply) : no_script;
}

grpc::Status ScriptedService::RegisterGeometry(grpc::ServerContext*, grpc::ServerReader<v1::RegisterGeometryRequest>* reader,
                                               v1::GeometryInfo* reply) {
  return on_register ? on_register(*reader, *reply) : no_script;
}

grpc::Status ScriptedService::Prepare(grpc::ServerContext*, const v1::PrepareRequest* request,
                                      grpc::ServerWriter<v1::PrepareReply>* writer) {
  return on_prepare ? on_prepare(*request, *writer) : no_script;
}

grpc::Status ScriptedService::GetServerInfo(grpc::ServerContext* context, const v1::GetServerInfoRequest*,
                                            v1::ServerInfo* reply) {
  return on_info ? on_info(*context, *reply) : no_script;
}

grpc::Status ScriptedService::DeleteGeometry(grpc::ServerContext*, const v1::DeleteGeometryRequest* request,
                                             v1::DeleteGeometryReply*) {
  return on_delete ? on_delete(*request) : no_script;
}

grpc::Status ScriptedService::ListGeometries(grpc::ServerContext*, const v1::ListGeometriesRequest* request,
                                             v1::ListGeometriesReply* reply) {
  return on_list ? on_list(*request, *reply) : no_script;
}

grpc::Status ScriptedService::Detect(grpc::ServerContext*, const v1::DetectRequest* request,
                                     grpc::ServerWriter<v1::DetectReply>* writer) {
  return on_detect ? on_detect(*request, *writer) : no_script;
}

grpc::Status ScriptedService::GetBasis(grpc::ServerContext*, const v1::GetBasisRequest* request,
                                       grpc::ServerWriter<v1::BasisReply>* writer) {
  return on_get_basis ? on_get_basis(*request, *writer) : no_script;
}

grpc::Status ScriptedService::GetPoints(grpc::ServerContext*, const v1::GetPointsRequest* request,
                                        grpc::ServerWriter<v1::PointChunk>* writer) {
  return on_points ? on_points(*request, *writer) : no_script;
}

Points registered_points(std::size_t n) {
  Points points(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double t = 0.001 * static_cast<double>(i);
    points[i] = {std::cos(t), std::sin(t), 0.1 * t};
  }
  return points;
}

Points deformed_points(std::size_t n, std::size_t design) {
  Points points = registered_points(n);
  for (auto& p : points) p[2] += 0.05 * static_cast<double>(design + 1) * std::sin(3 * p[0]);
  return points;
}

namespace {

v1::Encoding to_proto(codec::Encoding encoding) { return static_cast<v1::Encoding>(static_cast<int>(encoding)); }

v1::DeformReply block_reply(const codec::Block& block, std::size_t design, std::size_t number, std::size_t first) {
  v1::DeformReply reply;
  auto& message = *reply.mutable_block();
  message.set_design(static_cast<std::uint32_t>(design));
  message.set_block(static_cast<std::uint32_t>(number));
  message.set_first(first);
  message.set_count(block.count);
  message.set_encoding(to_proto(block.encoding));
  message.set_fell_back(block.fell_back);
  message.set_step(block.step);
  for (const auto offset : block.offset) message.add_offset(offset);
  message.set_max_error(block.max_error);
  message.set_checksum(block.checksum);
  message.set_data(block.bytes);
  return reply;
}

}  // namespace

std::vector<v1::DeformReply> replies(const ReplyScript& script) {
  const Points registered = registered_points(script.points);
  std::vector<v1::DeformReply> all(1);
  auto& header = *all[0].mutable_header();
  header.set_points(script.points);
  header.set_designs(static_cast<std::uint32_t>(script.designs));
  header.set_block_points(static_cast<std::uint32_t>(script.block_points));
  header.set_geometry_id("geometry");
  std::vector<std::vector<std::uint64_t>> checksums(script.designs);
  std::vector<Points> deformed;
  for (std::size_t d = 0; d < script.designs; ++d) deformed.push_back(deformed_points(script.points, d));
  std::size_t number = 0;
  for (std::size_t first = 0; first < script.points; first += script.block_points, ++number) {
    const std::size_t count = std::min(script.block_points, script.points - first);
    for (std::size_t d = 0; d < script.designs; ++d) {
      const codec::EncodeOptions options{static_cast<codec::Encoding>(static_cast<int>(script.encoding)), script.tolerance};
      const auto block =
          codec::encode(std::span(registered).subspan(first, count), std::span(deformed[d]).subspan(first, count), options);
      checksums[d].push_back(block.checksum);
      all.push_back(block_reply(block, d, number, first));
    }
  }
  for (std::size_t d = 0; d < script.designs; ++d) {
    v1::DeformReply reply;
    reply.mutable_result()->set_design(static_cast<std::uint32_t>(d));
    reply.mutable_result()->set_checksum(codec::fold_checksums(checksums[d]));
    all.push_back(reply);
  }
  all.emplace_back().mutable_summary()->set_bytes(1);
  for (auto& reply : all) reply.set_request_id(script.request_id);
  return all;
}

}  // namespace deform::test
