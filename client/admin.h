// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "client/client.h"
#include "deform/v1/admin.pb.h"

namespace deform::client {

/// What the operator of a server does while it runs (proto/deform/v1/admin.proto), over the connection of a client. Of several
/// servers the first that is named is meant: with an address of its own for each. Thread-safe; all errors are deform::Error.
class Admin {
 public:
  /// The client must outlive it.
  explicit Admin(Client& client) : client_(client) {}

  /// Calls under way, the oldest first.
  v1::ListCallsReply calls(const CallOptions& call = {});
  /// Ends a call with an error that names the reason to its client. Throws Error(not_found).
  v1::CancelCallReply cancel(std::uint64_t id, const std::string& reason, const CallOptions& call = {});
  /// New work is refused from now on.
  v1::DrainReply drain(const CallOptions& call = {});
  /// It is taken again.
  void undrain(const CallOptions& call = {});
  /// Takes a system out of memory, by its id or a prefix of at least 8 digits. Throws Error(not_found).
  v1::EvictReply evict(const std::string& system_id, const CallOptions& call = {});
  /// The same with all of them.
  v1::EvictReply evict_all(const CallOptions& call = {});
  /// Open connections, the oldest first.
  v1::ListConnectionsReply connections(const CallOptions& call = {});
  /// The limits in force.
  v1::ListLimitsReply limits(const CallOptions& call = {});
  /// Changes one until a restart.
  v1::SetLimitReply set_limit(const std::string& name, const std::string& value, const CallOptions& call = {});
  /// Reads and verifies every file of the store.
  v1::StoreReply check_store(const CallOptions& call = {});
  /// Copies the store to a new or empty folder of the server's machine.
  v1::StoreReply backup_store(const std::string& directory, const CallOptions& call = {});

 private:
  Client& client_;
};

}  // namespace deform::client
