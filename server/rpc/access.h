// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server_context.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/error.h"
#include "server/rpc/identities.h"
#include "server/rpc/revocations.h"

namespace deform::server {

/// A file as it was looked at last, to see that it changed without reading it. Absent files are all alike.
struct FileStamp {
  std::int64_t modified_ns = 0, size = -1, inode = 0, device = 0;
  bool operator==(const FileStamp&) const = default;
  static FileStamp of(const std::filesystem::path& path);
};

/// Who calls, and whether that caller may: asked once by every call, when it comes in (CallScope), whatever carries it.
/// Thread-safe.
class Access {
 public:
  struct Admission {
    std::string identity;                 ///< empty: nobody was asked for one
    std::string tenant = default_tenant;  ///< of the identity
    Quota quota = {};                     ///< of the tenant
    std::optional<Error> refusal;         ///< unauthenticated or permission_denied, when the call is not let in
    std::uint64_t generation = 0;         ///< of the file that decided
  };

  /// Whether clients can show certificates at all: with TLS and --tls-client-ca.
  enum class Certificates { asked_for, never_seen };

  struct Options {
    std::filesystem::path identities = {};                ///< who is known (Identities); empty: every call is let in
    Certificates certificates = Certificates::asked_for;  ///< never_seen: identities that have only one are warned of
    std::filesystem::path client_crl = {};                ///< revoked certificates (Revocations); empty: none
    std::filesystem::path client_ca = {};                 ///< whose authorities sign `client_crl`
  };

  /// Without identities a call goes under the name in its client certificate if it has one. Throws Error(invalid_argument) for
  /// a file that is missing or wrong.
  explicit Access(Options options);

  Admission admit(std::string_view method, Role needed, const grpc::ServerContextBase& context) const;

  /// Rereads what changed. A file that is missing or wrong is logged, and what was read before stays in force.
  void refresh();
  /// Grows when a file was reread: what was admitted before may be refused now.
  std::uint64_t generation() const { return generation_; }

 private:
  using IdentitiesPtr = std::shared_ptr<const Identities>;
  using RevocationsPtr = std::shared_ptr<const Revocations>;
  using Stamps = std::array<FileStamp, 3>;

  std::pair<IdentitiesPtr, RevocationsPtr> files() const;
  Stamps stamps() const;
  IdentitiesPtr read_identities() const;
  RevocationsPtr read_revocations() const;

  const Options options_;
  std::atomic<std::uint64_t> generation_{0};
  mutable std::mutex mutex_;
  // under mutex_
  Stamps stamps_;               ///< first: what is written while it is read is read again
  IdentitiesPtr identities_;    ///< null without a file
  RevocationsPtr revocations_;  ///< null without a file
};

}  // namespace deform::server
