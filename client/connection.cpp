// SPDX-License-Identifier: Apache-2.0
#include "client/connection.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <string_view>
#include <utility>

#include "client/address.h"
#include "client/credentials.h"

namespace deform::client {

namespace {

constexpr std::chrono::milliseconds longest_probe{2000};
constexpr std::chrono::milliseconds look_around{50};  ///< how soon a stop or a deadline ends waiting for a connection

/// Nothing where it is no value of metadata: gRPC would end the process.
std::string environment_trace() {
  const char* value = std::getenv("TRACEPARENT");
  const std::string_view text = value == nullptr ? "" : value;
  const bool printable = std::all_of(text.begin(), text.end(), [](unsigned char c) { return c >= ' ' && c < 127; });
  return printable ? std::string(text) : std::string();
}

ClientOptions with_encoding(ClientOptions options) {
  if (options.encoding == v1::ENCODING_DEFAULT) options.encoding = encoding_for(options.address);
  return options;
}

}  // namespace

Connection::Connection(std::shared_ptr<grpc::ChannelInterface> channel_in, const ClientOptions& options_in)
    : options(with_encoding(options_in)),
      channel(std::move(channel_in)),
      stub(v1::DeformService::NewStub(channel)),
      traceparent(environment_trace()),
      pool(options_in.decode_threads) {}

v1::DeformRequest Connection::named(v1::DeformRequest request) const {
  if (request.output().encoding() == v1::ENCODING_DEFAULT) request.mutable_output()->set_encoding(options.encoding);
  return request;
}

v1::Encoding Connection::named(v1::Encoding encoding) const {
  return encoding == v1::ENCODING_DEFAULT ? options.encoding : encoding;
}

void Connection::wait_for_answer(const RunContext& limits) const {
  const auto end = RunContext::Clock::now() + options.connect_timeout;
  while (RunContext::Clock::now() < end) {
    const grpc_connectivity_state state = channel->GetState(true);
    if (state == GRPC_CHANNEL_READY) return;
    limits.check();
    channel->WaitForStateChange(state, std::chrono::system_clock::now() + look_around);
  }
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

Attempt::Attempt(Connection& connection, const RunContext& limits)
    : connection_(connection), stopped_(limits.stop, [this] { context.TryCancel(); }) {
  if (const auto& file = connection.options.token_file; !file.empty()) {
    context.AddMetadata("authorization", "Bearer " + read_token(file));
  }
  if (!connection.traceparent.empty()) context.AddMetadata("traceparent", connection.traceparent);
  if (limits.deadline) {
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::duration_cast<std::chrono::system_clock::duration>(
                                                                *limits.deadline - RunContext::Clock::now()));
  }
}

void Attempt::check(const grpc::Status& status) const {
  if (status.ok()) return;
  const ClientOptions& options = connection_.options;
  if (connection_.own_channel && failed_handshake(status)) {
    const std::string why = tls_failure(options.address, options.tls, std::min(options.connect_timeout, longest_probe));
    if (!why.empty()) throw Error(ErrorCode::failed_precondition, why);
  }
  throw_error(status, context, options.address);
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
  const auto info = unary(connection, options, Retry::safe, &v1::DeformService::StubInterface::GetGeometry, about);
  v1::GetPointsRequest request;
  request.set_id(id);
  return with_retries(connection, options, Retry::safe, [&](Attempt& attempt, const RunContext&) {
    auto points = std::make_shared<Points>();
    points->reserve(std::min(info.points(), largest_reserve));
    const auto stream = connection.stub->GetPoints(&attempt.context, request);
    read_all(attempt, *stream, [&](const v1::PointChunk& chunk) { append_points(chunk.xyz(), info.points(), *points); });
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

}  // namespace deform::client
