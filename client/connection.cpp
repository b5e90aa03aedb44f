// SPDX-License-Identifier: Apache-2.0
#include "client/connection.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <random>
#include <string_view>
#include <utility>

#include "client/address.h"
#include "client/call_error.h"
#include "client/credentials.h"
#include "client/large_setups.h"
#include "client/upload.h"

namespace deform::client {

namespace {

using Stub = v1::DeformService::StubInterface;

constexpr std::chrono::milliseconds longest_probe{2000};
constexpr std::chrono::milliseconds patience_after_an_answer{30'000};
constexpr std::chrono::milliseconds look_around{50};  ///< how soon a stop or a deadline ends waiting for a connection

/// All its digits, so that nothing else of what a caller gives goes into metadata.
bool is_id(const std::string& text) {
  const auto digit = [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); };
  return text.size() == 64 && std::all_of(text.begin(), text.end(), digit);
}

/// Nothing where it is no value of metadata: gRPC would end the process.
std::string environment_trace() {
  const char* value = std::getenv("TRACEPARENT");
  const std::string_view text = value == nullptr ? "" : value;
  const bool printable = std::all_of(text.begin(), text.end(), [](unsigned char c) { return c >= ' ' && c < 127; });
  return printable ? std::string(text) : std::string();
}

/// 12 hexadecimal digits.
std::string random_id() {
  std::random_device random;
  std::string id;
  for (int i = 0; i < 12; ++i) id += "0123456789abcdef"[random() % 16];
  return id;
}

ClientOptions with_encoding(ClientOptions options) {
  if (options.encoding == v1::ENCODING_DEFAULT) options.encoding = encoding_for(options.address);
  return options;
}

}  // namespace

Connection::Connection(std::vector<std::unique_ptr<Server>> servers_in, const ClientOptions& options_in)
    : options(with_encoding(options_in)),
      servers(std::move(servers_in)),
      traceparent(environment_trace()),
      client_id(random_id()),
      pool(options_in.decode_threads) {}

v1::DeformRequest Connection::named(v1::DeformRequest request) const {
  if (request.output().encoding() == v1::ENCODING_DEFAULT) request.mutable_output()->set_encoding(options.encoding);
  return request;
}

v1::Encoding Connection::named(v1::Encoding encoding) const {
  return encoding == v1::ENCODING_DEFAULT ? options.encoding : encoding;
}

void Connection::wait_for_answer(Server& server, const RunContext& limits) const {
  const auto end = RunContext::Clock::now() + options.connect_timeout;
  while (RunContext::Clock::now() < end) {
    const grpc_connectivity_state state = server.channel->GetState(true);
    if (state == GRPC_CHANNEL_READY) return;
    limits.check();
    server.channel->WaitForStateChange(state, std::chrono::system_clock::now() + look_around);
  }
}

void Connection::wait_for_return(Server& server, std::chrono::milliseconds longest, const RunContext& limits) const {
  const auto end = RunContext::Clock::now() + longest;
  bool was_away = false;
  while (RunContext::Clock::now() < end) {
    const grpc_connectivity_state state = server.channel->GetState(true);
    if (state == GRPC_CHANNEL_READY && was_away) break;
    was_away = was_away || state != GRPC_CHANNEL_READY;
    limits.check();
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - RunContext::Clock::now());
    server.channel->WaitForStateChange(state, std::chrono::system_clock::now() + std::min(left, look_around));
  }
  limits.check();
}

std::chrono::milliseconds Connection::patience() const {
  return options.patience.value_or(answered ? patience_after_an_answer : std::chrono::milliseconds(0));
}

RunContext limits_of(const CallOptions& options) {
  RunContext limits;
  limits.stop = options.stop;
  if (options.timeout) limits.deadline = RunContext::Clock::now() + *options.timeout;
  return limits;
}

CallOptions remaining(const RunContext& limits) {
  CallOptions options;
  options.stop = limits.stop;
  if (limits.deadline) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(*limits.deadline - RunContext::Clock::now());
    options.timeout = std::max(std::chrono::milliseconds(1), left);
  }
  return options;
}

Attempt::Attempt(Connection& connection, const RunContext& limits, Server& server, AttemptMarks marks)
    : connection_(connection),
      limits_(limits),
      server_(server),
      geometry_(std::move(marks.geometry)),
      request_id_(std::move(marks.request_id)),
      stopped_(limits.stop, [this] { cancel(); }) {
  if (const auto& file = connection.options.token_file; !file.empty()) {
    context.AddMetadata("authorization", "Bearer " + read_token(file));
  }
  if (!connection.traceparent.empty()) context.AddMetadata("traceparent", connection.traceparent);
  context.AddMetadata("x-request-id", request_id_);
  if (is_id(geometry_)) context.AddMetadata("x-geometry-id", geometry_);
  if (limits.deadline) {
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::duration_cast<std::chrono::system_clock::duration>(
                                                                *limits.deadline - RunContext::Clock::now()));
  }
}

void Attempt::cancel() {
  cancelled_ = true;
  context.TryCancel();
}

void Attempt::check(const grpc::Status& status) const {
  if (status.ok()) return;
  const bool bare = status.error_message().empty() || status.error_message() == "CANCELLED";
  if (status.error_code() == grpc::StatusCode::CANCELLED && bare && !cancelled_) {
    throw CallError(
        Error(ErrorCode::unavailable, "deformd at " + server_.address + " cut the call off, as it does when it shuts down"),
        request_id_);
  }
  const ClientOptions& options = connection_.options;
  if (connection_.own_channel && failed_handshake(status)) {
    const std::string why = tls_failure(server_.address, options.tls, std::min(options.connect_timeout, longest_probe));
    if (!why.empty()) throw Error(ErrorCode::failed_precondition, why);
  }
  throw_error(status, context, server_.address, request_id_);
}

namespace {

void append_points(const std::string& xyz, std::uint64_t expected, Points& points) {
  if (xyz.size() % sizeof(Vec3) != 0 || xyz.size() / sizeof(Vec3) > expected - points.size()) {
    throw Error(ErrorCode::data_loss, "registered points: a chunk of " + std::to_string(xyz.size()) + " bytes after " +
                                          std::to_string(points.size()) + " of " + std::to_string(expected) + " points");
  }
  const std::size_t before = points.size();
  points.resize(before + xyz.size() / sizeof(Vec3));
  if (!xyz.empty()) std::memcpy(points.data() + before, xyz.data(), xyz.size());
}

/// The number of points is the server's word: memory grows with what really arrives.
constexpr std::uint64_t largest_reserve = std::uint64_t{1} << 20;

std::shared_ptr<const Points> fetch_points(Connection& connection, const std::string& id, const CallOptions& options) {
  v1::GetGeometryRequest about;
  about.set_id(id);
  const auto info = unary(connection, of_geometry(id), options, Retry::safe, &Stub::GetGeometry, about);
  v1::GetPointsRequest request;
  request.set_id(id);
  return with_retries(connection, of_geometry(id), options, Retry::safe, [&](Attempt& attempt, const RunContext&) {
    auto points = std::make_shared<Points>();
    points->reserve(std::min(info.points(), largest_reserve));
    const auto stream = attempt.stub().GetPoints(&attempt.context, request);
    read_all<v1::PointChunk>(attempt, *stream,
                             [&](const v1::PointChunk& chunk) { append_points(chunk.xyz(), info.points(), *points); });
    if (points->size() != info.points()) {
      throw Error(ErrorCode::data_loss, "registered points: " + std::to_string(points->size()) + " arrived, the geometry has " +
                                            std::to_string(info.points()));
    }
    return std::shared_ptr<const Points>(std::move(points));
  });
}

}  // namespace

std::shared_ptr<const Points> Connection::registered_points(const std::string& geometry_id, const RunContext& limits) {
  return points.get(geometry_id, limits, [&] { return fetch_points(*this, geometry_id, remaining(limits)); });
}

namespace {

/// The server's answer to an upload that was cut short. A request of a header alone has come as a whole when it is refused, so
/// that a proxy hands the answer on. Where the header is taken the rest was not, or the connection was lost.
v1::GeometryInfo ask_by_header(const Attempt& attempt, const grpc::Status& status, const v1::RegisterGeometryRequest& header) {
  Attempt asking = attempt.another();
  v1::GeometryInfo info;
  const auto stream = asking.stub().RegisterGeometry(&asking.context, &info);
  stream->Write(header, grpc::WriteOptions().set_last_message());
  const grpc::Status answer = stream->Finish();
  if (answer.error_code() == grpc::StatusCode::INVALID_ARGUMENT) attempt.check(status);
  asking.check(answer);
  return info;
}

}  // namespace

v1::GeometryInfo upload(Attempt& attempt, const GeometryArrays& arrays, const std::string& id,
                        const std::function<void(double)>& on_progress) {
  v1::GeometryInfo info;
  const auto stream = attempt.stub().RegisterGeometry(&attempt.context, &info);
  GeometryMessages messages(arrays, id);
  bool sent = false;
  const grpc::Status status = write_to_end(*stream, [&](v1::RegisterGeometryRequest& message) {
    if (on_progress && sent) on_progress(messages.fraction());
    return sent = messages.next(message);
  });
  if (cut_short(status)) {
    v1::RegisterGeometryRequest header;
    GeometryMessages(arrays, id).next(header);
    info = ask_by_header(attempt, status, header);
  } else {
    attempt.check(status);
  }
  if (info.id() != id) {
    throw Error(ErrorCode::data_loss, "geometry: the server stored id " + info.id() + ", the arrays have " + id);
  }
  return info;
}

// ---- several servers ----

void Connection::note(const v1::SystemInfo& system, v1::Setup setup) {
  geometry_of.keep(system.id(), system.geometry_id());
  if (!keeps_copies() || setup.geometry().empty()) return;
  setup.set_geometry(system.geometry_id());  // in place of a part of it
  held.keep_setup(system.id(), std::move(setup));
}

std::vector<Server*> Connection::ranked(const std::string& key) const {
  std::vector<Server*> order = servers.ranked(key);
  const auto found = found_at.get(key);
  if (!found || !(*found)->usable()) return order;
  std::stable_partition(order.begin(), order.end(), [&](const Server* server) { return server == *found; });
  return order;
}

bool Connection::holds(const Subject& subject, const std::string& geometry) const {
  return held.geometry(geometry) != nullptr || (!subject.system.empty() && held.setup(subject.system) != nullptr);
}

void Connection::bring(Server& server, const Subject& subject, const std::string& geometry, const RunContext& limits) {
  std::unique_lock lock(server.restoring, std::defer_lock);
  while (!lock.try_lock_for(look_around)) limits.check();
  const auto arrays = held.geometry(geometry);
  const auto setup = subject.system.empty() ? nullptr : held.setup(subject.system);
  if (arrays) {
    // Another call may have brought it meanwhile.
    v1::GetGeometryRequest request;
    request.set_id(geometry);
    v1::GeometryInfo info;
    Attempt look(*this, limits, server, {geometry, new_request_id()});
    const grpc::Status status = look.stub().GetGeometry(&look.context, request, &info);
    if (status.error_code() != grpc::StatusCode::NOT_FOUND) look.check(status);
    if (!status.ok() || !info.damage().empty()) {
      const auto own = points.get(geometry, limits, [&]() -> PointsCache::PointsPtr {
        throw Error(ErrorCode::not_found, "geometry " + geometry + ": it was deleted");
      });
      Attempt attempt(*this, limits, server, {geometry, new_request_id()});
      upload(attempt, arrays->arrays(*own), geometry, {});
    }
  }
  if (setup) {
    Attempt attempt(*this, limits, server, {geometry, new_request_id()});
    prepare(*this, attempt, limits, *setup, SetupInInfo::omit, {});
  }
}

}  // namespace deform::client
