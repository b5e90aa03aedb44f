// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/connection_calls.h"

#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>
#include <grpc/grpc.h>
#include <grpc/support/alloc.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <string>

namespace deform::server {

namespace {

using google::protobuf::ListValue;
using google::protobuf::Struct;
using google::protobuf::Value;

/// What gRPC answered, which it gives as JSON only; empty for nullptr, its answer about what is gone.
Struct parsed(char* json) {
  const std::unique_ptr<char, void (*)(void*)> owned(json, gpr_free);
  Struct out;
  if (!json || !google::protobuf::util::JsonStringToMessage(json, &out).ok()) out.Clear();
  return out;
}

const Value& field(const Struct& from, const std::string& name) {
  const auto found = from.fields().find(name);
  return found != from.fields().end() ? found->second : Value::default_instance();
}

/// 64-bit numbers are strings in the JSON of Protobuf; 0 when it is left out.
std::int64_t number(const Struct& from, const std::string& name) {
  return std::strtoll(field(from, name).string_value().c_str(), nullptr, 10);
}

/// visit(reference) for each of a list that comes in pages; page(first id) is one of them.
template <typename Page, typename Visit>
void for_each(const Page& page, const char* list, const char* reference, const char* id, const Visit& visit) {
  std::int64_t next = 0;
  for (bool end = false; !end;) {
    const Struct answer = parsed(page(next));
    const ListValue& entries = field(answer, list).list_value();
    for (const Value& entry : entries.values()) {
      const Struct& about = *reference ? field(entry.struct_value(), reference).struct_value() : entry.struct_value();
      next = std::max(next, number(about, id) + 1);
      visit(number(about, id), field(about, "name").string_value());
    }
    end = field(answer, "end").bool_value() || entries.values().empty();
  }
}

}  // namespace

/// Connections that have ended stay known until there are twice as many as were open: then all are looked at again.
void ConnectionCalls::look_for_new() {
  constexpr std::size_t few = 1000;
  const bool all = sockets_.size() > 2 * known_ + few;
  if (all) sockets_.clear(), next_.clear();
  for_each([](std::int64_t first) { return grpc_channelz_get_servers(first); }, "server", "ref", "serverId",
           [&](std::int64_t server, const std::string&) {
             std::int64_t& next = next_[server];
             for_each([&](std::int64_t first) { return grpc_channelz_get_server_sockets(server, std::max(first, next), 0); },
                      "socketRef", "", "socketId",
                      [&](std::int64_t socket, const std::string& name) {
                        sockets_[name.substr(name.find(' ') + 1)] = socket;  // "chttp2 ipv4:127.0.0.1:4711"
                        next = socket + 1;
                      });
           });
  if (all) known_ = sockets_.size();
}

std::unordered_map<std::string, std::uint64_t> ConnectionCalls::of(const std::unordered_set<std::string>& peers) {
  const auto known = [this](const std::string& peer) { return sockets_.count(peer) != 0; };
  if (!std::all_of(peers.begin(), peers.end(), known)) look_for_new();
  std::unordered_map<std::string, std::uint64_t> out;
  for (const std::string& peer : peers) {
    const auto found = sockets_.find(peer);
    if (found == sockets_.end()) continue;
    const Struct answer = parsed(grpc_channelz_get_socket(found->second));
    const Struct& data = field(field(answer, "socket").struct_value(), "data").struct_value();
    if (answer.fields().empty()) sockets_.erase(found);  // it has ended; its port may be another's now
    const std::int64_t live = number(data, "streamsStarted") - number(data, "streamsSucceeded") - number(data, "streamsFailed");
    if (live > 0) out[peer] = static_cast<std::uint64_t>(live);
  }
  return out;
}

}  // namespace deform::server
