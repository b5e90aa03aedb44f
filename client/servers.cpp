// SPDX-License-Identifier: Apache-2.0
#include "client/servers.h"

#include <algorithm>
#include <cstdint>
#include <string_view>
#include <utility>

namespace deform::client {

namespace {

constexpr std::chrono::seconds avoidance{1};

/// FNV-1a and the finalizer of splitmix64: the same on every machine.
std::uint64_t weight(std::string_view key, std::string_view address) {
  std::uint64_t hash = 0xcbf29ce484222325ull;
  const auto add = [&](unsigned char byte) { hash = (hash ^ byte) * 0x100000001b3ull; };
  for (const char c : key) add(static_cast<unsigned char>(c));
  add(0);
  for (const char c : address) add(static_cast<unsigned char>(c));
  hash = (hash ^ (hash >> 30)) * 0xbf58476d1ce4e5b9ull;
  hash = (hash ^ (hash >> 27)) * 0x94d049bb133111ebull;
  return hash ^ (hash >> 31);
}

}  // namespace

Server::Server(std::string address_in, std::shared_ptr<grpc::ChannelInterface> channel_in)
    : address(std::move(address_in)), channel(std::move(channel_in)), stub(v1::DeformService::NewStub(channel)) {}

void Server::avoid() { avoided_until_ = (Clock::now() + avoidance).time_since_epoch().count(); }

bool Server::usable() {
  const Clock::rep until = avoided_until_;
  if (until == 0) return true;
  const bool connected = channel->GetState(true) == GRPC_CHANNEL_READY;  // asks gRPC to connect where it is not
  if (!connected || Clock::now().time_since_epoch().count() < until) return false;
  avoided_until_ = 0;
  return true;
}

Servers::Servers(std::vector<std::unique_ptr<Server>> servers) : servers_(std::move(servers)) {}

std::vector<Server*> Servers::ranked(const std::string& key) const {
  std::vector<std::pair<std::uint64_t, Server*>> weighted;
  for (const auto& server : servers_) weighted.emplace_back(key.empty() ? 0 : weight(key, server->address), server.get());
  std::stable_sort(weighted.begin(), weighted.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<Server*> order;
  order.reserve(weighted.size());
  for (const auto& entry : weighted) order.push_back(entry.second);
  if (several()) std::stable_partition(order.begin(), order.end(), [](Server* server) { return server->usable(); });
  return order;
}

}  // namespace deform::client
