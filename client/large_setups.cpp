// SPDX-License-Identifier: Apache-2.0
#include "client/large_setups.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "client/upload.h"

namespace deform::client {

namespace {

bool takes_no_pieces(const grpc::Status& status) { return status.error_code() == grpc::StatusCode::UNIMPLEMENTED; }

/// Writes header and setup as long as the server wants them: it may have heard enough, its status tells.
template <typename Message, typename Request, typename Stream>
void write_setup(Stream& stream, const Request& options, const v1::Setup& setup) {
  const std::string bytes = setup.SerializeAsString();
  Message message;
  *message.mutable_header()->mutable_request() = options;
  message.mutable_header()->mutable_setup()->set_bytes(bytes.size());
  bool wanted = true;
  for (std::size_t sent = 0; wanted && sent < bytes.size(); sent += message_payload) {
    message.set_setup(bytes.substr(sent, message_payload));
    wanted = stream.Write(message);
    message.clear_header();
  }
  stream.WritesDone();
}

/// The system of a stream of replies, and how it ended.
template <typename Stream>
grpc::Status read_system(Attempt& attempt, Stream& stream, std::optional<v1::SystemInfo>& system,
                         const std::function<void(const std::string&, double)>& on_progress) {
  grpc::Status status;
  read_to_end<v1::PrepareReply>(attempt, stream, status, [&](v1::PrepareReply&& reply) {
    if (reply.has_progress() && on_progress) on_progress(reply.progress().stage(), reply.progress().fraction());
    if (reply.has_system()) system = std::move(*reply.mutable_system());
  });
  return status;
}

}  // namespace

v1::SystemInfo prepare(Connection& connection, Attempt& attempt, const RunContext& limits, const v1::Setup& setup,
                       SetupInInfo in_info, const std::function<void(const std::string& stage, double fraction)>& on_progress) {
  std::optional<v1::SystemInfo> system;
  const auto answer = [&](Attempt& asked, const grpc::Status& status) {
    asked.check(status);
    if (!system) throw Error(ErrorCode::data_loss, "prepare: the reply has no system");
    return *std::move(system);
  };
  v1::PrepareRequest request;
  request.set_omit_setup(in_info == SetupInInfo::omit);
  const auto whole = [&](Attempt& asked) {
    *request.mutable_setup() = setup;
    const auto stream = asked.stub().Prepare(&asked.context, request);
    return answer(asked, read_system(asked, *stream, system, on_progress));
  };
  if (setup.ByteSizeLong() <= message_payload) return whole(attempt);
  const auto stream = attempt.stub().PrepareLarge(&attempt.context);
  write_setup<v1::PrepareLargeRequest>(*stream, request, setup);
  const grpc::Status status = read_system(attempt, *stream, system, on_progress);
  if (!takes_no_pieces(status)) return answer(attempt, status);
  Attempt again(connection, limits, attempt.server(), {setup.geometry(), attempt.request_id()});
  return whole(again);
}

v1::EstimateReply estimate(Connection& connection, Attempt& attempt, const RunContext& limits,
                           const v1::EstimateRequest& request) {
  if (request.ByteSizeLong() <= message_payload) return ask(attempt, &v1::DeformService::StubInterface::Estimate, request);
  v1::EstimateRequest options;
  options.set_list_centres(request.list_centres());
  options.set_list_problems(request.list_problems());
  v1::EstimateReply reply;
  const auto stream = attempt.stub().EstimateLarge(&attempt.context, &reply);
  write_setup<v1::EstimateLargeRequest>(*stream, options, request.setup());
  const grpc::Status status = stream->Finish();
  if (takes_no_pieces(status)) {
    Attempt again(connection, limits, attempt.server(), {request.setup().geometry(), attempt.request_id()});
    return ask(again, &v1::DeformService::StubInterface::Estimate, request);
  }
  attempt.check(status);
  return reply;
}

v1::Setup fetch_setup(Connection& connection, const std::string& system_id, const CallOptions& options) {
  v1::GetSetupRequest request;
  request.set_system_id(system_id);
  Subject subject = of_system(system_id);
  subject.bring = false;
  return with_retries(connection, subject, options, Retry::safe, [&](Attempt& attempt, const RunContext& limits) {
    std::string bytes;
    grpc::Status status;
    const auto stream = attempt.stub().GetSetup(&attempt.context, request);
    read_to_end<v1::SetupPiece>(attempt, *stream, status, [&](const v1::SetupPiece& piece) { bytes += piece.data(); });
    if (takes_no_pieces(status)) {
      Attempt again(connection, limits, attempt.server(), {{}, attempt.request_id()});
      v1::GetSystemRequest whole;
      whole.set_id(system_id);
      return std::move(*ask(again, &v1::DeformService::StubInterface::GetSystem, whole).mutable_setup());
    }
    attempt.check(status);
    v1::Setup setup;
    if (!setup.ParseFromString(bytes)) throw Error(ErrorCode::data_loss, "system " + system_id + ": its setup came damaged");
    return setup;
  });
}

void complete(Connection& connection, v1::SystemInfo& system, SetupInInfo in_info, const CallOptions& options) {
  if (in_info == SetupInInfo::omit) return system.clear_setup();
  if (system.has_setup() || system.setup_bytes() == 0) return;
  *system.mutable_setup() = fetch_setup(connection, system.id(), options);
}

}  // namespace deform::client
