// SPDX-License-Identifier: Apache-2.0
#include "client/client.h"

#include <grpc/grpc.h>
#include <grpcpp/create_channel.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <exception>
#include <future>
#include <iterator>
#include <limits>
#include <set>
#include <utility>

#include "client/address.h"
#include "client/connection.h"
#include "client/credentials.h"
#include "client/decoder.h"
#include "client/evaluation.h"
#include "client/large_setups.h"
#include "client/session.h"
#include "client/unfinished_designs.h"
#include "client/upload.h"

namespace deform::client {

namespace {

using Stub = v1::DeformService::StubInterface;

void check_range(const char* name, std::int64_t value, std::int64_t least, std::int64_t most) {
  if (value >= least && value <= most) return;
  throw Error(ErrorCode::invalid_argument, std::string("client option ") + name + ": " + std::to_string(value) + ", expected " +
                                               std::to_string(least) + " to " + std::to_string(most));
}

/// With another server to go to, one that does not answer is left soon: one that is stopped, without power, or cut off.
constexpr std::chrono::milliseconds longest_connect{2000}, silence{10'000}, silence_after_ping{5'000};

std::shared_ptr<grpc::ChannelInterface> make_channel(const ClientOptions& options, bool several) {
  grpc::ChannelArguments arguments;
  const auto connect = several ? std::min(options.connect_timeout, longest_connect) : options.connect_timeout;
  const auto connect_ms = static_cast<int>(connect.count());
  if (several) {
    arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, static_cast<int>(silence.count()));
    arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, static_cast<int>(silence_after_ping.count()));
    arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);  // no limit: a system may be prepared for minutes
  }
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, connect_ms);  // gRPC's name for the time of one attempt
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2000);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);  // every Client has a connection of its own
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);          // proxies of the environment are for the web
  if (options.tls && !options.tls->server_name.empty()) arguments.SetSslTargetNameOverride(options.tls->server_name);
  return grpc::CreateCustomChannel(checked_address(options.address), channel_credentials(options), arguments);
}

std::vector<std::unique_ptr<Server>> servers_of(const ClientOptions& options) {
  options.validate();
  std::vector<std::unique_ptr<Server>> servers;
  ClientOptions one = options;
  const auto addresses = addresses_of(options.address);
  for (const std::string& address : addresses) {
    one.address = address;
    servers.push_back(std::make_unique<Server>(address, make_channel(one, addresses.size() > 1)));
  }
  return servers;
}

std::vector<std::unique_ptr<Server>> one_server(std::shared_ptr<grpc::ChannelInterface> channel, const ClientOptions& options) {
  options.validate();
  std::vector<std::unique_ptr<Server>> servers;
  servers.push_back(std::make_unique<Server>(options.address, std::move(channel)));
  return servers;
}

/// All items of the list of one server, page by page.
template <typename Item, typename Request, typename Reply>
void add_pages(Connection& connection, Server& server, const CallOptions& call, UnaryMethod<Request, Reply> method,
               google::protobuf::RepeatedPtrField<Item>* (Reply::*items)(), Request request, std::vector<Item>& all) {
  do {
    Reply page = unary(connection, on_server(server), call, Retry::safe, method, request);
    if (!page.next_page_token().empty() && page.next_page_token() == request.page_token()) {
      throw Error(ErrorCode::data_loss, "list: the server repeats its page token");
    }
    request.set_page_token(page.next_page_token());
    auto& more = *(page.*items)();
    std::move(more.begin(), more.end(), std::back_inserter(all));
  } while (!request.page_token().empty());
}

/// What the servers have together, each id once.
template <typename Item, typename Request, typename Reply>
std::vector<Item> all_pages(Connection& connection, const CallOptions& call, UnaryMethod<Request, Reply> method,
                            google::protobuf::RepeatedPtrField<Item>* (Reply::*items)(), const Request& request) {
  const RunContext limits = limits_of(call);
  std::vector<Item> all;
  for (const auto& server : connection.servers.all()) {
    add_pages(connection, *server, remaining(limits), method, items, request, all);
  }
  if (!connection.servers.several()) return all;
  std::set<std::string> seen;
  std::erase_if(all, [&](const Item& item) { return !seen.insert(item.id()).second; });
  return all;
}

/// The replies of the servers that know the id. All are asked, and then the first error is thrown; NOT_FOUND where no server
/// knows it.
template <typename Request, typename Reply>
std::vector<Reply> from_all(Connection& connection, const CallOptions& call, Retry retry, UnaryMethod<Request, Reply> method,
                            const Request& request, const std::string& geometry) {
  const RunContext limits = limits_of(call);
  std::vector<Reply> replies;
  std::exception_ptr unknown, error;
  for (const auto& server : connection.servers.all()) {
    try {
      replies.push_back(unary(connection, on_server(*server, geometry), remaining(limits), retry, method, request));
    } catch (const Error& thrown) {
      auto& first = thrown.code() == ErrorCode::not_found ? unknown : error;
      if (!first) first = std::current_exception();
    }
  }
  if (error) std::rethrow_exception(error);
  if (replies.empty()) std::rethrow_exception(unknown);
  return replies;
}

std::vector<codec::GroupView> group_views(const GeometryArrays& arrays) { return {arrays.groups.begin(), arrays.groups.end()}; }

}  // namespace

void ClientOptions::validate() const {
  check_range("connect_timeout (ms)", connect_timeout.count(), 1, 3'600'000);
  check_range("max_attempts", max_attempts, 1, 100);
  if (patience) check_range("patience (ms)", patience->count(), 0, 7ll * 24 * 3'600'000);
  check_range("decode_threads", decode_threads, 0, 1024);
  check_range("max_in_flight", max_in_flight, 1, 10'000);
  check_range("encoding", encoding, v1::Encoding_MIN, v1::Encoding_MAX);
}

Client::Client(const ClientOptions& options) : impl_(std::make_shared<Impl>(servers_of(options), options)) {
  impl_->own_channel = true;
}

Client::Client(std::shared_ptr<grpc::ChannelInterface> channel, const ClientOptions& options)
    : impl_(std::make_shared<Impl>(one_server(std::move(channel), options), options)) {}

Client::~Client() = default;
Client::Client(Client&&) noexcept = default;
Client& Client::operator=(Client&&) noexcept = default;

// ---- geometries ----

v1::GeometryInfo Client::register_geometry(const GeometryArrays& arrays, const CallOptions& call,
                                           const std::function<void(double)>& on_progress) {
  const std::string id =
      codec::geometry_id({arrays.points, arrays.face_sizes, arrays.face_points, group_views(arrays), arrays.cells});
  const RunContext limits = limits_of(call);
  Subject subject = of_geometry(id);
  subject.elsewhere = false;  // it shall be where its systems will be
  v1::GeometryInfo info;
  v1::GetGeometryRequest request;
  request.set_id(id);
  bool known = false;
  try {
    info = unary(*impl_, subject, call, Retry::safe, &Stub::GetGeometry, request);
    known = info.damage().empty();  // what is damaged there is mended by uploading it again
    info.set_existed(known);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::not_found) throw;
  }
  if (!known) {
    info = with_retries(*impl_, subject, remaining(limits), Retry::safe,
                        [&](Attempt& attempt, const RunContext&) { return upload(attempt, arrays, id, on_progress); });
  }
  if (!impl_->points.has(id)) impl_->points.keep(id, std::make_shared<const Points>(arrays.points.begin(), arrays.points.end()));
  if (impl_->keeps_copies() && !impl_->held.geometry(id)) {
    impl_->held.keep_geometry(id, std::make_shared<const HeldGeometry>(arrays));
  }
  return info;
}

v1::GeometryInfo Client::get_geometry(const std::string& id, const CallOptions& call) {
  v1::GetGeometryRequest request;
  request.set_id(id);
  Subject subject = of_geometry(id);
  subject.bring = false;
  return unary(*impl_, subject, call, Retry::safe, &Stub::GetGeometry, request);
}

std::vector<v1::GeometryInfo> Client::list_geometries(const CallOptions& call) {
  return all_pages(*impl_, call, &Stub::ListGeometries, &v1::ListGeometriesReply::mutable_geometries,
                   v1::ListGeometriesRequest());
}

v1::DeleteGeometryReply Client::delete_geometry(const v1::DeleteGeometryRequest& request, const CallOptions& call) {
  impl_->held.forget_geometry(request.id());  // also when the call fails: some server may have done it
  const auto replies = from_all(*impl_, call, Retry::when_refused, &Stub::DeleteGeometry, request, request.id());
  impl_->points.forget(request.id());
  // The same setups on every server that has them.
  const auto fewer = [](const auto& a, const auto& b) { return a.setups_deleted() < b.setups_deleted(); };
  return *std::max_element(replies.begin(), replies.end(), fewer);
}

Points Client::get_points(const std::string& geometry_id, const CallOptions& call) {
  return *impl_->registered_points(geometry_id, limits_of(call));
}

void Client::keep_points(const std::string& geometry_id, std::shared_ptr<const Points> points) {
  if (!points) throw Error(ErrorCode::invalid_argument, "keep_points: no points given");
  impl_->points.keep(geometry_id, std::move(points));
}

void Client::share_copies(const Client& from) {
  if (&from == this) return;
  impl_->points.keep_all(from.impl_->points);
  impl_->held.keep_all(from.impl_->held);
  impl_->geometry_of.keep_all(from.impl_->geometry_of);
}

// ---- systems ----

v1::EstimateReply Client::estimate(const v1::Setup& setup, const CallOptions& call) {
  v1::EstimateRequest request;
  *request.mutable_setup() = setup;
  return estimate(request, call);
}

v1::EstimateReply Client::estimate(const v1::EstimateRequest& request, const CallOptions& call) {
  return with_retries(
      *impl_, of_geometry(request.setup().geometry()), call, Retry::safe,
      [&](Attempt& attempt, const RunContext& limits) { return client::estimate(*impl_, attempt, limits, request); });
}

v1::SystemInfo Client::prepare(const v1::Setup& setup, const CallOptions& call,
                               const std::function<void(const std::string& stage, double fraction)>& on_progress,
                               SetupInInfo in_info) {
  const RunContext total = limits_of(call);
  auto system =
      with_retries(*impl_, of_geometry(setup.geometry()), call, Retry::safe, [&](Attempt& attempt, const RunContext& limits) {
        return client::prepare(*impl_, attempt, limits, setup, in_info, on_progress);
      });
  impl_->note(system, setup);
  complete(*impl_, system, in_info, remaining(total));
  return system;
}

v1::SystemInfo Client::get_system(const std::string& id, const CallOptions& call, SetupInInfo in_info) {
  const RunContext total = limits_of(call);
  const auto needed = impl_->keeps_copies() ? SetupInInfo::include : in_info;
  v1::GetSystemRequest request;
  request.set_id(id);
  request.set_omit_setup(needed == SetupInInfo::omit);
  Subject subject = of_system(id);
  subject.bring = false;
  auto system = unary(*impl_, subject, call, Retry::safe, &Stub::GetSystem, request);
  complete(*impl_, system, needed, remaining(total));
  impl_->note(system, system.setup());
  complete(*impl_, system, in_info, remaining(total));
  return system;
}

v1::Setup Client::get_setup(const std::string& system_id, const CallOptions& call) {
  return fetch_setup(*impl_, system_id, call);
}

std::vector<v1::SystemInfo> Client::list_systems(const CallOptions& call, SetupInInfo in_info) {
  const RunContext total = limits_of(call);
  v1::ListSystemsRequest request;
  request.set_omit_setup(in_info == SetupInInfo::omit);
  auto systems = all_pages(*impl_, call, &Stub::ListSystems, &v1::ListSystemsReply::mutable_systems, request);
  for (auto& system : systems) complete(*impl_, system, in_info, remaining(total));
  return systems;
}

v1::ReleaseSystemReply Client::release_system(const v1::ReleaseSystemRequest& request, const CallOptions& call) {
  if (request.forget()) impl_->held.forget_setup(request.id());
  const auto geometry = impl_->geometry_of.get(request.id()).value_or("");
  const auto retry = request.forget() ? Retry::when_refused : Retry::safe;
  const auto replies = from_all(*impl_, call, retry, &Stub::ReleaseSystem, request, geometry);
  v1::ReleaseSystemReply all;
  for (const auto& reply : replies) all.set_bytes_released(all.bytes_released() + reply.bytes_released());
  return all;
}

// ---- deformations ----

namespace {

struct Decoding {
  std::shared_ptr<ReplyDecoder> decoder;
  std::future<DeformOutcome> done;
};

Decoding start_decoding(ReplyDecoder::Options options, Attempt& attempt, ThreadPool& pool) {
  auto promise = std::make_shared<std::promise<DeformOutcome>>();
  Decoding result;
  result.done = promise->get_future();
  options.on_failed = [&attempt] { attempt.context.TryCancel(); };
  options.on_done = [promise](DeformOutcome&& outcome, const std::exception_ptr& error) {
    error ? promise->set_exception(error) : promise->set_value(std::move(outcome));
  };
  result.decoder = std::make_shared<ReplyDecoder>(std::move(options), pool);
  return result;
}

/// A running reply stream of Deform or JacobianVector, read to its end into a decoder.
DeformOutcome read_replies(Attempt& attempt, grpc::ClientReaderInterface<v1::DeformReply>& stream, Decoding decoding) {
  try {
    read_all<v1::DeformReply>(attempt, stream, [&](v1::DeformReply&& reply) { decoding.decoder->add(std::move(reply)); });
    if (!decoding.decoder->complete()) throw Error(ErrorCode::data_loss, "reply of the server: it ends before its summary");
  } catch (...) {
    decoding.decoder->fail(std::current_exception());
  }
  return decoding.done.get();
}

}  // namespace

v1::Encoding Client::encoding() const { return impl_->options.encoding; }

DeformOutcome Client::deform(const v1::DeformRequest& given, const CallOptions& call, const DesignSink& sink,
                             const DesignMemory& memory) {
  const v1::DeformRequest request = impl_->named(given);
  const auto start = RunContext::Clock::now();
  UnfinishedDesigns unfinished(request, sink, memory);
  const bool large = request.ByteSizeLong() > message_payload;
  auto outcome = with_retries(
      *impl_, of_system(request.system_id()), call, Retry::safe,
      [&](Attempt& attempt, const RunContext& limits) {
        return unfinished.ask([&](const v1::DeformRequest& part, const DesignSink& to, const DesignMemory& in) {
          if (large) {
            const auto geometry = impl_->geometry_of.get(part.system_id()).value_or("");
            StreamSession session(impl_, attempt.server(), remaining(limits), geometry);
            auto future = session.submit(part, to, in);
            session.finish();
            return future.get();
          }
          ReplyDecoder::Options options;
          options.designs = static_cast<std::size_t>(part.designs_size());
          options.encoding = part.output().encoding();
          options.failures = part.failures();
          options.sink = to;
          options.memory = in;
          options.points_of = [&](const std::string& id) { return impl_->registered_points(id, limits); };
          Decoding decoding = start_decoding(std::move(options), attempt, impl_->pool);
          return read_replies(attempt, *attempt.stub().Deform(&attempt.context, part), std::move(decoding));
        });
      },
      [&] { return unfinished.repeat(); });
  outcome.wall_ms = std::chrono::duration<double, std::milli>(RunContext::Clock::now() - start).count();
  return outcome;
}

Points Client::jacobian_vector(const v1::JacobianVectorRequest& request, const CallOptions& call) {
  return with_retries(*impl_, of_system(request.system_id()), call, Retry::safe, [&](Attempt& attempt, const RunContext& limits) {
    ReplyDecoder::Options options;
    options.encoding = v1::RAW_F64;
    options.points_of = [&](const std::string& id) { return impl_->registered_points(id, limits); };
    Decoding decoding = start_decoding(std::move(options), attempt, impl_->pool);
    DeformOutcome outcome = read_replies(attempt, *attempt.stub().JacobianVector(&attempt.context, request), std::move(decoding));
    return std::move(outcome.designs.at(0).points);
  });
}

v1::EvaluateResult Client::evaluate(const v1::EvaluateHeader& given, std::span<const Vec3> points, std::span<Vec3> out,
                                    const CallOptions& call) {
  if (out.size() != points.size()) {
    throw Error(ErrorCode::invalid_argument,
                "evaluate: room for " + std::to_string(out.size()) + " of " + std::to_string(points.size()) + " points");
  }
  // In the memory of the points, another attempt would find moved ones.
  const bool apart = out.data() + out.size() <= points.data() || points.data() + points.size() <= out.data();
  bool written = false;
  v1::EvaluateHeader header = given;
  header.mutable_output()->set_encoding(impl_->named(header.output().encoding()));
  return with_retries(
      *impl_, of_system(header.system_id()), call, Retry::safe,
      [&](Attempt& attempt, const RunContext&) {
        std::size_t sent = 0;
        const auto source = [&](std::span<Vec3> block) {
          const std::size_t count = std::min(block.size(), points.size() - sent);
          std::copy_n(points.begin() + static_cast<std::ptrdiff_t>(sent), count, block.begin());
          sent += count;
          return count;
        };
        const auto sink = [&](std::uint64_t first, std::span<const Vec3> block) {
          written = true;
          std::copy(block.begin(), block.end(), out.begin() + static_cast<std::ptrdiff_t>(first));
        };
        return EvaluationCall(attempt, header).run(source, sink);
      },
      [&] { return apart || !written ? Repeat::yes : Repeat::no; });
}

v1::EvaluateResult Client::evaluate(const v1::EvaluateHeader& given, const PointSource& source, const PointSink& sink,
                                    const CallOptions& call) {
  v1::EvaluateHeader header = given;
  header.mutable_output()->set_encoding(impl_->named(header.output().encoding()));
  std::atomic<bool> begun{false};
  const PointSource watched = [&](std::span<Vec3> block) {
    begun = true;
    return source(block);
  };
  return with_retries(
      *impl_, of_system(header.system_id()), call, Retry::safe,
      [&](Attempt& attempt, const RunContext&) { return EvaluationCall(attempt, header).run(watched, sink); },
      [&] { return begun ? Repeat::no : Repeat::yes; });
}

std::vector<double> Client::vector_jacobian(const std::string& system_id, std::span<const double> variables,
                                            std::span<const Vec3> cotangent, const CallOptions& call) {
  return vector_jacobians(system_id, variables, cotangent, 1, call);
}

std::vector<double> Client::vector_jacobians(const std::string& system_id, std::span<const double> variables,
                                             std::span<const Vec3> cotangent, std::size_t count, const CallOptions& call) {
  if (count == 0) return {};
  if (cotangent.size() % count != 0 || count > std::numeric_limits<std::uint32_t>::max()) {
    throw Error(ErrorCode::invalid_argument, "cotangents: " + std::to_string(cotangent.size()) + " vectors are no " +
                                                 std::to_string(count) + " fields of equal size");
  }
  return with_retries(*impl_, of_system(system_id), call, Retry::safe, [&](Attempt& attempt, const RunContext&) {
    v1::VectorJacobianReply reply;
    const auto stream = attempt.stub().VectorJacobian(&attempt.context, &reply);
    constexpr std::size_t points = message_payload / sizeof(Vec3);
    bool header = true;
    std::size_t first = 0;
    write_all(attempt, *stream, [&](v1::VectorJacobianRequest& message) {
      if (std::exchange(header, false)) {
        message.mutable_header()->set_system_id(system_id);
        message.mutable_header()->mutable_variables()->Add(variables.begin(), variables.end());
        if (count > 1) message.mutable_header()->set_cotangents(static_cast<std::uint32_t>(count));
        return true;
      }
      const auto piece = cotangent.subspan(first, std::min(points, cotangent.size() - first));
      message.mutable_cotangent()->assign(reinterpret_cast<const char*>(piece.data()), piece.size_bytes());
      first += piece.size();
      return !piece.empty();
    });
    return std::vector<double>(reply.gradient().begin(), reply.gradient().end());
  });
}

v1::BasisHeader Client::get_basis(const std::string& system_id, const std::function<void(std::span<const std::byte>)>& sink,
                                  const CallOptions& call) {
  v1::GetBasisRequest request;
  request.set_system_id(system_id);
  return get_basis(request, sink, call);
}

v1::BasisHeader Client::get_basis(const v1::GetBasisRequest& request, const std::function<void(std::span<const std::byte>)>& sink,
                                  const CallOptions& call) {
  bool delivered = false;
  return with_retries(
      *impl_, of_system(request.system_id()), call, Retry::safe,
      [&](Attempt& attempt, const RunContext&) {
        std::optional<v1::BasisHeader> header;
        std::uint64_t bytes = 0;
        const auto stream = attempt.stub().GetBasis(&attempt.context, request);
        read_all<v1::BasisReply>(attempt, *stream, [&](v1::BasisReply&& reply) {
          if (reply.has_header() == header.has_value()) {
            throw Error(ErrorCode::data_loss, header ? "basis: a second header" : "basis: the reply has no header");
          }
          if (reply.has_header()) {
            header = std::move(*reply.mutable_header());
            return;
          }
          bytes += reply.records().size();
          if (bytes > header->bytes()) throw Error(ErrorCode::data_loss, "basis: more bytes than announced arrived");
          delivered = true;
          sink(std::as_bytes(std::span(reply.records())));
        });
        if (!header || bytes != header->bytes()) {
          throw Error(ErrorCode::data_loss, "basis: " + std::to_string(bytes) + " of " +
                                                std::to_string(header ? header->bytes() : 0) + " bytes arrived");
        }
        return *header;
      },
      [&] { return delivered ? Repeat::no : Repeat::yes; });
}

// ---- detection ----

namespace {

void append(const std::string& bytes, std::vector<std::uint32_t>& ids) {
  if (bytes.size() % sizeof(std::uint32_t) != 0) throw Error(ErrorCode::data_loss, "detect: ids are cut off");
  const std::size_t before = ids.size();
  ids.resize(before + bytes.size() / sizeof(std::uint32_t));
  if (!bytes.empty()) std::memcpy(ids.data() + before, bytes.data(), bytes.size());
}

/// Puts replies together in the order of detection.proto.
class Collector {
 public:
  void take(v1::DetectReply& reply) {
    if (complete_) throw Error(ErrorCode::data_loss, "detect: something came after the summary");
    switch (reply.part_case()) {
      case v1::DetectReply::kPrimitive:
        detected_.primitives.push_back({std::move(*reply.mutable_primitive()), {}, {}});
        return;
      case v1::DetectReply::kEdge:
        detected_.edges.push_back({std::move(*reply.mutable_edge()), {}});
        return;
      case v1::DetectReply::kIds:
        return take_ids(reply.ids());
      case v1::DetectReply::kSummary:
        detected_.summary = std::move(*reply.mutable_summary());
        complete_ = true;
        return;
      case v1::DetectReply::PART_NOT_SET:
        return;  // of a newer server
    }
  }

  Detected result() {
    if (!complete_) throw Error(ErrorCode::data_loss, "detect: the reply has no summary");
    for (const auto& primitive : detected_.primitives) {
      check(primitive.about.name(), primitive.faces.size(), primitive.about.faces());
      check(primitive.about.name(), primitive.points.size(), primitive.about.points());
    }
    for (const auto& edge : detected_.edges) check(edge.about.name(), edge.points.size(), edge.about.points());
    return std::move(detected_);
  }

 private:
  void take_ids(const v1::DetectedIds& ids) {
    const bool faces = ids.of() == v1::DetectedIds::FACES;
    if (!detected_.edges.empty() && !faces) return append(ids.ids(), detected_.edges.back().points);
    if (detected_.primitives.empty() || !detected_.edges.empty()) {
      throw Error(ErrorCode::data_loss, "detect: ids of nothing");
    }
    append(ids.ids(), faces ? detected_.primitives.back().faces : detected_.primitives.back().points);
  }

  static void check(const std::string& name, std::size_t arrived, std::uint64_t announced) {
    if (arrived == announced) return;
    throw Error(ErrorCode::data_loss,
                "detect: " + std::to_string(arrived) + " of " + std::to_string(announced) + " ids of " + name + " arrived");
  }

  Detected detected_;
  bool complete_ = false;
};

}  // namespace

Detected Client::detect(const v1::DetectRequest& request, const CallOptions& call) {
  return with_retries(*impl_, of_geometry(request.geometry_id()), call, Retry::safe, [&](Attempt& attempt, const RunContext&) {
    const auto stream = attempt.stub().Detect(&attempt.context, request);
    Collector collector;
    read_all<v1::DetectReply>(attempt, *stream, [&](v1::DetectReply&& reply) { collector.take(reply); });
    return collector.result();
  });
}

// ---- the rest ----

v1::ServerInfo Client::server_info(const CallOptions& call) {
  return unary(*impl_, {}, call, Retry::safe, &Stub::GetServerInfo, v1::GetServerInfoRequest());
}

std::unique_ptr<Session> Client::open_session(const CallOptions& call) {
  return std::unique_ptr<Session>(new Session(open_requests(impl_, call)));
}

bool grpc_at_work() { return grpc_is_initialized() != 0; }

}  // namespace deform::client
