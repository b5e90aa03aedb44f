// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server.h>

#include <functional>
#include <memory>
#include <string>

#include "client/client.h"
#include "core/base/types.h"
#include "deform/v1/service.grpc.pb.h"

namespace deform::test {

/// A service whose every answer the test writes, over loopback: an in-process channel never tells a blocked writer that
/// the server has answered. What has no script is UNIMPLEMENTED.
class ScriptedService final : public v1::DeformService::Service {
 public:
  using Writer = grpc::ServerWriterInterface<v1::DeformReply>;
  using Stream = grpc::ServerReaderWriterInterface<v1::DeformReply, v1::DeformStreamRequest>;

  /// port: of 127.0.0.1; 0: any that is free.
  explicit ScriptedService(int port = 0);
  ~ScriptedService() override;

  client::Client client(client::ClientOptions options = {});
  int port() const { return port_; }
  /// 127.0.0.1 and the port.
  std::string address() const;
  /// Nobody answers any more; calls under way are cut off.
  void stop();

  std::function<grpc::Status(grpc::ServerContext&, const v1::DeformRequest&, Writer&)> on_deform;
  std::function<grpc::Status(grpc::ServerContext&, Stream&)> on_stream;
  std::function<grpc::Status(grpc::ServerContext&, grpc::ServerReaderWriterInterface<v1::EvaluateReply, v1::EvaluateRequest>&)>
      on_evaluate;
  std::function<grpc::Status(const v1::GetGeometryRequest&, v1::GeometryInfo&)> on_get_geometry;
  std::function<grpc::Status(grpc::ServerReaderInterface<v1::RegisterGeometryRequest>&, v1::GeometryInfo&)> on_register;
  std::function<grpc::Status(const v1::PrepareRequest&, grpc::ServerWriterInterface<v1::PrepareReply>&)> on_prepare;
  std::function<grpc::Status(grpc::ServerContext&, v1::ServerInfo&)> on_info;
  std::function<grpc::Status(const v1::DeleteGeometryRequest&)> on_delete;
  std::function<grpc::Status(const v1::ListGeometriesRequest&, v1::ListGeometriesReply&)> on_list;
  std::function<grpc::Status(const v1::DetectRequest&, grpc::ServerWriterInterface<v1::DetectReply>&)> on_detect;
  std::function<grpc::Status(const v1::GetBasisRequest&, grpc::ServerWriterInterface<v1::BasisReply>&)> on_get_basis;
  std::function<grpc::Status(const v1::GetPointsRequest&, grpc::ServerWriterInterface<v1::PointChunk>&)> on_points;

 private:
  grpc::Status Deform(grpc::ServerContext* context, const v1::DeformRequest* request,
                      grpc::ServerWriter<v1::DeformReply>* writer) override;
  grpc::Status DeformStream(grpc::ServerContext* context,
                            grpc::ServerReaderWriter<v1::DeformReply, v1::DeformStreamRequest>* stream) override;
  grpc::Status Evaluate(grpc::ServerContext* context,
                        grpc::ServerReaderWriter<v1::EvaluateReply, v1::EvaluateRequest>* stream) override;
  grpc::Status GetGeometry(grpc::ServerContext* context, const v1::GetGeometryRequest* request, v1::GeometryInfo* reply) override;
  grpc::Status RegisterGeometry(grpc::ServerContext* context, grpc::ServerReader<v1::RegisterGeometryRequest>* reader,
                                v1::GeometryInfo* reply) override;
  grpc::Status Prepare(grpc::ServerContext* context, const v1::PrepareRequest* request,
                       grpc::ServerWriter<v1::PrepareReply>* writer) override;
  grpc::Status GetServerInfo(grpc::ServerContext* context, const v1::GetServerInfoRequest* request,
                             v1::ServerInfo* reply) override;
  grpc::Status DeleteGeometry(grpc::ServerContext* context, const v1::DeleteGeometryRequest* request,
                              v1::DeleteGeometryReply* reply) override;
  grpc::Status ListGeometries(grpc::ServerContext* context, const v1::ListGeometriesRequest* request,
                              v1::ListGeometriesReply* reply) override;
  grpc::Status Detect(grpc::ServerContext* context, const v1::DetectRequest* request,
                      grpc::ServerWriter<v1::DetectReply>* writer) override;
  grpc::Status GetBasis(grpc::ServerContext* context, const v1::GetBasisRequest* request,
                        grpc::ServerWriter<v1::BasisReply>* writer) override;
  grpc::Status GetPoints(grpc::ServerContext* context, const v1::GetPointsRequest* request,
                         grpc::ServerWriter<v1::PointChunk>* writer) override;

  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

/// n points on a curve, registered; and the same, moved by design number `design`.
Points registered_points(std::size_t n);
Points deformed_points(std::size_t n, std::size_t design);

/// The correct replies to a request of `designs` designs on registered_points(n), designs interleaved block by block.
struct ReplyScript {
  std::size_t points = 5000;
  std::size_t designs = 1;
  std::size_t block_points = 2048;
  v1::Encoding encoding = v1::RAW_F64;
  double tolerance = 1e-6;
  std::uint64_t request_id = 0;
};
std::vector<v1::DeformReply> replies(const ReplyScript& script);

}  // namespace deform::test
