// SPDX-License-Identifier: Apache-2.0
#include "client/admin.h"

#include "client/connection.h"
#include "deform/v1/admin.grpc.pb.h"

namespace deform::client {

namespace {

template <typename Request, typename Reply>
using AdminMethod = grpc::Status (v1::Admin::StubInterface::*)(grpc::ClientContext*, const Request&, Reply*);

/// Repeated only where it was not carried out.
template <typename Request, typename Reply>
Reply admin_call(Connection& connection, const CallOptions& call, AdminMethod<Request, Reply> method, const Request& request) {
  Server& server = *connection.servers.all().front();
  const auto stub = v1::Admin::NewStub(server.channel);
  return with_retries(connection, on_server(server), call, Retry::when_refused, [&](Attempt& attempt, const RunContext&) {
    v1::Admin::StubInterface& admin = *stub;
    Reply reply;
    attempt.check((admin.*method)(&attempt.context, request, &reply));
    return reply;
  });
}

using AdminStub = v1::Admin::StubInterface;

}  // namespace

v1::ListCallsReply Admin::calls(const CallOptions& call) {
  return admin_call(*client_.impl_, call, &AdminStub::ListCalls, v1::ListCallsRequest());
}

v1::CancelCallReply Admin::cancel(std::uint64_t id, const std::string& reason, const CallOptions& call) {
  v1::CancelCallRequest request;
  request.set_id(id);
  request.set_reason(reason);
  return admin_call(*client_.impl_, call, &AdminStub::CancelCall, request);
}

v1::DrainReply Admin::drain(const CallOptions& call) {
  return admin_call(*client_.impl_, call, &AdminStub::Drain, v1::DrainRequest());
}

void Admin::undrain(const CallOptions& call) { admin_call(*client_.impl_, call, &AdminStub::Undrain, v1::UndrainRequest()); }

v1::EvictReply Admin::evict(const std::string& system_id, const CallOptions& call) {
  v1::EvictRequest request;
  request.set_system_id(system_id);
  return admin_call(*client_.impl_, call, &AdminStub::Evict, request);
}

v1::EvictReply Admin::evict_all(const CallOptions& call) {
  v1::EvictRequest request;
  request.set_all(true);
  return admin_call(*client_.impl_, call, &AdminStub::Evict, request);
}

v1::ListConnectionsReply Admin::connections(const CallOptions& call) {
  return admin_call(*client_.impl_, call, &AdminStub::ListConnections, v1::ListConnectionsRequest());
}

v1::ListLimitsReply Admin::limits(const CallOptions& call) {
  return admin_call(*client_.impl_, call, &AdminStub::ListLimits, v1::ListLimitsRequest());
}

v1::SetLimitReply Admin::set_limit(const std::string& name, const std::string& value, const CallOptions& call) {
  v1::SetLimitRequest request;
  request.set_name(name);
  request.set_value(value);
  return admin_call(*client_.impl_, call, &AdminStub::SetLimit, request);
}

v1::StoreReply Admin::check_store(const CallOptions& call) {
  return admin_call(*client_.impl_, call, &AdminStub::CheckStore, v1::CheckStoreRequest());
}

v1::StoreReply Admin::backup_store(const std::string& directory, const CallOptions& call) {
  v1::BackupStoreRequest request;
  request.set_directory(directory);
  return admin_call(*client_.impl_, call, &AdminStub::BackupStore, request);
}

}  // namespace deform::client
