// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/server_context.h>

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "core/base/error.h"
#include "server/rpc/identities.h"

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
    std::string identity;          ///< empty: nobody was asked for one
    std::optional<Error> refusal;  ///< unauthenticated or permission_denied, when the call is not let in
    std::uint64_t generation = 0;  ///< of the file that decided
  };

  /// Whether clients can show certificates at all: with TLS and --tls-client-ca.
  enum class Certificates { asked_for, never_seen };

  /// Without a file every call is let in, under the name in its client certificate if it has one. Throws Error(invalid_argument)
  /// for a file that is missing or wrong. Where no certificate is ever seen, identities that have only one are warned of.
  explicit Access(std::filesystem::path identities, Certificates certificates = Certificates::asked_for);

  Admission admit(std::string_view method, Role needed, const grpc::ServerContextBase& context) const;

  /// Rereads the file when it changed. A file that is missing or wrong is logged, and the one before stays in force.
  void refresh();
  /// Grows when the file was reread: what was admitted before may be refused now.
  std::uint64_t generation() const { return generation_; }

 private:
  std::shared_ptr<const Identities> identities() const;
  void load();

  const std::filesystem::path file_;
  const Certificates certificates_;
  std::atomic<std::uint64_t> generation_{0};
  mutable std::mutex mutex_;
  // under mutex_
  std::shared_ptr<const Identities> identities_;  ///< null without a file
  FileStamp stamp_;
};

}  // namespace deform::server
