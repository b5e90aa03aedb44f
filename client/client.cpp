#include "client/client.h"

#include <grpcpp/create_channel.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "client/address.h"
#include "client/connection.h"
#include "client/session.h"
#include "client/upload.h"

namespace deform::client {

namespace {

using Stub = v1::DeformService::StubInterface;

void check_range(const char* name, std::int64_t value, std::int64_t least, std::int64_t most) {
  if (value >= least && value <= most) return;
  throw Error(ErrorCode::invalid_argument, std::string("client option ") + name + ": " + std::to_string(value) + ", expected " +
                                               std::to_string(least) + " to " + std::to_string(most));
}

std::shared_ptr<grpc::ChannelInterface> make_channel(const ClientOptions& options) {
  options.validate();
  grpc::ChannelArguments arguments;
  const auto connect_ms = static_cast<int>(options.connect_timeout.count());
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, connect_ms);  // gRPC's name for the time of one attempt
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2000);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);  // every Client has a connection of its own
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);          // proxies of the environment are for the web
  return grpc::CreateCustomChannel(checked_address(options.address), grpc::InsecureChannelCredentials(), arguments);
}

/// Follows page tokens to the end.
template <typename Fetch>
void for_each_page(const Fetch& fetch) {
  std::string token;
  do {
    const std::string next = fetch(token);
    if (!next.empty() && next == token) throw Error(ErrorCode::data_loss, "list: the server repeats its page token");
    token = next;
  } while (!token.empty());
}

std::vector<codec::GroupView> group_views(const GeometryArrays& arrays) { return {arrays.groups.begin(), arrays.groups.end()}; }

}  // namespace

void ClientOptions::validate() const {
  check_range("connect_timeout (ms)", connect_timeout.count(), 1, 3'600'000);
  check_range("max_attempts", max_attempts, 1, 100);
  check_range("decode_threads", decode_threads, 0, 1024);
  check_range("max_in_flight", max_in_flight, 1, 10'000);
}

Client::Client(const ClientOptions& options) : Client(make_channel(options), options) {}

Client::Client(std::shared_ptr<grpc::ChannelInterface> channel, const ClientOptions& options) {
  options.validate();
  impl_ = std::make_shared<Impl>(std::move(channel), options);
}

Client::~Client() = default;
Client::Client(Client&&) noexcept = default;
Client& Client::operator=(Client&&) noexcept = default;

// ---- geometries ----

namespace {

v1::GeometryInfo upload(Attempt& attempt, Stub& stub, const GeometryArrays& arrays, const std::string& id,
                        const std::function<void(double)>& on_progress) {
  v1::GeometryInfo info;
  const auto stream = stub.RegisterGeometry(&attempt.context, &info);
  GeometryMessages messages(arrays, id);
  v1::RegisterGeometryRequest message;
  while (messages.next(message)) {
    if (!stream->Write(message)) break;  // the server has it already, or refuses it: the status tells
    if (on_progress) on_progress(messages.fraction());
  }
  stream->WritesDone();
  attempt.check(stream->Finish());
  if (info.id() != id) {
    throw Error(ErrorCode::data_loss, "geometry: the server stored id " + info.id() + ", the arrays have " + id);
  }
  return info;
}

}  // namespace

v1::GeometryInfo Client::register_geometry(const GeometryArrays& arrays, const CallOptions& call,
                                           const std::function<void(double)>& on_progress) {
  const std::string id =
      codec::geometry_id({arrays.points, arrays.face_sizes, arrays.face_points, group_views(arrays), arrays.cells});
  const RunContext limits = limits_of(call);
  v1::GeometryInfo info;
  v1::GetGeometryRequest request;
  request.set_id(id);
  bool known = false;
  try {
    info = unary(*impl_, call, Retry::safe, &Stub::GetGeometry, request);
    known = info.damage().empty();  // what is damaged there is mended by uploading it again
    info.set_existed(known);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::not_found) throw;
  }
  if (!known) {
    info = with_retries(*impl_, remaining(limits), Retry::safe, [&](Attempt& attempt, const RunContext&) {
      return upload(attempt, *impl_->stub, arrays, id, on_progress);
    });
  }
  if (!impl_->points.has(id)) impl_->points.keep(id, std::make_shared<const Points>(arrays.points.begin(), arrays.points.end()));
  return info;
}

v1::GeometryInfo Client::get_geometry(const std::string& id, const CallOptions& call) {
  v1::GetGeometryRequest request;
  request.set_id(id);
  return unary(*impl_, call, Retry::safe, &Stub::GetGeometry, request);
}

std::vector<v1::GeometryInfo> Client::list_geometries(const CallOptions& call) {
  std::vector<v1::GeometryInfo> all;
  for_each_page([&](const std::string& token) {
    v1::ListGeometriesRequest request;
    request.set_page_token(token);
    auto page = unary(*impl_, call, Retry::safe, &Stub::ListGeometries, request);
    std::move(page.mutable_geometries()->begin(), page.mutable_geometries()->end(), std::back_inserter(all));
    return page.next_page_token();
  });
  return all;
}

v1::DeleteGeometryReply Client::delete_geometry(const v1::DeleteGeometryRequest& request, const CallOptions& call) {
  auto reply = unary(*impl_, call, Retry::when_refused, &Stub::DeleteGeometry, request);
  impl_->points.forget(request.id());
  return reply;
}

Points Client::get_points(const std::string& geometry_id, const CallOptions& call) {
  return *impl_->registered_points(geometry_id, limits_of(call));
}

void Client::keep_points(const std::string& geometry_id, std::shared_ptr<const Points> points) {
  if (!points) throw Error(ErrorCode::invalid_argument, "keep_points: no points given");
  impl_->points.keep(geometry_id, std::move(points));
}

// ---- systems ----

v1::EstimateReply Client::estimate(const v1::Setup& setup, const CallOptions& call) {
  v1::EstimateRequest request;
  *request.mutable_setup() = setup;
  return estimate(request, call);
}

v1::EstimateReply Client::estimate(const v1::EstimateRequest& request, const CallOptions& call) {
  return unary(*impl_, call, Retry::safe, &Stub::Estimate, request);
}

v1::SystemInfo Client::prepare(const v1::Setup& setup, const CallOptions& call,
                               const std::function<void(const std::string& stage, double fraction)>& on_progress) {
  v1::PrepareRequest request;
  *request.mutable_setup() = setup;
  return with_retries(*impl_, call, Retry::safe, [&](Attempt& attempt, const RunContext&) {
    const auto stream = impl_->stub->Prepare(&attempt.context, request);
    std::optional<v1::SystemInfo> system;
    v1::PrepareReply reply;
    while (stream->Read(&reply)) {
      if (reply.has_progress() && on_progress) on_progress(reply.progress().stage(), reply.progress().fraction());
      if (reply.has_system()) system = std::move(*reply.mutable_system());
    }
    attempt.check(stream->Finish());
    if (!system) throw Error(ErrorCode::data_loss, "prepare: the reply has no system");
    return *system;
  });
}

v1::SystemInfo Client::get_system(const std::string& id, const CallOptions& call) {
  v1::GetSystemRequest request;
  request.set_id(id);
  return unary(*impl_, call, Retry::safe, &Stub::GetSystem, request);
}

std::vector<v1::SystemInfo> Client::list_systems(const CallOptions& call) {
  std::vector<v1::SystemInfo> all;
  for_each_page([&](const std::string& token) {
    v1::ListSystemsRequest request;
    request.set_page_token(token);
    auto page = unary(*impl_, call, Retry::safe, &Stub::ListSystems, request);
    std::move(page.mutable_systems()->begin(), page.mutable_systems()->end(), std::back_inserter(all));
    return page.next_page_token();
  });
  return all;
}

v1::ReleaseSystemReply Client::release_system(const v1::ReleaseSystemRequest& request, const CallOptions& call) {
  return unary(*impl_, call, request.forget() ? Retry::when_refused : Retry::safe, &Stub::ReleaseSystem, request);
}

v1::ServerInfo Client::server_info(const CallOptions& call) {
  return unary(*impl_, call, Retry::safe, &Stub::GetServerInfo, v1::GetServerInfoRequest());
}

std::unique_ptr<Session> Client::open_session(const CallOptions& call) {
  return std::unique_ptr<Session>(new Session(std::make_unique<Session::Impl>(impl_, call)));
}

}  // namespace deform::client
