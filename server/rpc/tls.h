// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <filesystem>
#include <memory>

namespace deform::server {

/// Files in PEM. TLS is on when there is a certificate.
struct TlsFiles {
  std::filesystem::path certificate;  ///< of the server, and then those between it and its authority
  std::filesystem::path key;          ///< of that certificate, without a passphrase
  std::filesystem::path client_ca;    ///< when set, clients must show a certificate of one of these authorities
  std::filesystem::path client_crl;   ///< certificates that these authorities have revoked; asked by every call (Access)

  bool on() const { return !certificate.empty(); }
  /// Throws Error(invalid_argument) when some are set that make no sense without others.
  void validate() const;
};

/// Credentials that look at their files at every handshake: what was changed is in force with the next connection, and
/// connections that are open go on. A change that does not fit together, a certificate written before its key, is logged and
/// the files before stay in force. TLS 1.2 and 1.3. Throws Error(invalid_argument) naming the option and its file when the
/// first reading fails. Must outlive the server.
std::shared_ptr<grpc::ServerCredentials> tls_credentials(const TlsFiles& files);

}  // namespace deform::server
