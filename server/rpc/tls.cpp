// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/tls.h"

#include <grpc/grpc.h>
#include <grpc/grpc_security.h>
#include <openssl/x509.h>
#include <spdlog/spdlog.h>

#include <array>
#include <ctime>
#include <mutex>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/codec/pem.h"
#include "server/rpc/access.h"

namespace deform::server {

namespace {

/// "2027-01-31T12:00:00Z".
std::string time_text(const ASN1_TIME* time) {
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return "an unreadable date";
  char text[32];
  return {text, std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%SZ", &parts)};
}

/// The contents of TlsFiles.
struct Material {
  std::string certificate, key, client_ca;
};

Material read_material(const TlsFiles& files) {
  codec::PemFile certificate = codec::read_pem_file("option tls-cert", files.certificate);
  codec::PemFile key = codec::read_pem_file("option tls-key", files.key);
  codec::check_key_pair(certificate, key);
  Material out{std::move(certificate.text), std::move(key.text), {}};
  if (files.client_ca.empty()) return out;
  codec::PemFile authorities = codec::read_pem_file("option tls-client-ca", files.client_ca);
  codec::check_certificates(authorities);
  out.client_ca = std::move(authorities.text);
  return out;
}

void log_certificate(const TlsFiles& files, const Material& material) {
  const codec::Certificate certificate = codec::first_certificate(material.certificate);
  const ASN1_TIME* end = X509_get0_notAfter(certificate.get());
  spdlog::info("tls: certificate of {} from {}, valid until {}", codec::name_text(*X509_get_subject_name(certificate.get())),
               escaped(files.certificate.string(), 300), time_text(end));
  if (X509_cmp_current_time(X509_get0_notBefore(certificate.get())) > 0) {
    spdlog::warn("tls: this certificate is not valid yet; clients will refuse it");
  } else if (X509_cmp_current_time(end) < 0) {
    spdlog::warn("tls: this certificate has expired; clients will refuse it");
  }
}

/// Files that are looked at again and again. Thread-safe.
class WatchedFiles {
 public:
  explicit WatchedFiles(TlsFiles files) : files_(std::move(files)), seen_(stamps()), material_(read_material(files_)) {
    log_certificate(files_, material_);
  }

  /// What gRPC asks for at its start and at every handshake.
  static grpc_ssl_certificate_config_reload_status fetch(void* self, grpc_ssl_server_certificate_config** config) {
    return static_cast<WatchedFiles*>(self)->answer(config);
  }

 private:
  using Stamps = std::array<FileStamp, 3>;

  Stamps stamps() const {
    return {FileStamp::of(files_.certificate), FileStamp::of(files_.key), FileStamp::of(files_.client_ca)};
  }

  grpc_ssl_certificate_config_reload_status answer(grpc_ssl_server_certificate_config** config) {
    const std::lock_guard lock(mutex_);
    reread();
    if (!std::exchange(fresh_, false)) return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_UNCHANGED;
    const grpc_ssl_pem_key_cert_pair pair{material_.key.c_str(), material_.certificate.c_str()};
    // gRPC 1.51 wants authorities even where no client is asked for a certificate; they are not used then.
    const std::string& authorities = files_.client_ca.empty() ? material_.certificate : material_.client_ca;
    *config = grpc_ssl_server_certificate_config_create(authorities.c_str(), &pair, 1);
    return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_NEW;
  }

  void reread() {
    const Stamps now = stamps();  // before they are read: what is written meanwhile is read again
    if (now == seen_) return;
    seen_ = now;
    try {
      material_ = read_material(files_);
      fresh_ = true;
      log_certificate(files_, material_);
    } catch (const std::exception& error) {
      spdlog::error("tls: the certificate and key read before stay in force: {}", error.what());
    }
  }

  const TlsFiles files_;
  std::mutex mutex_;
  // under mutex_
  Stamps seen_;
  Material material_;
  bool fresh_ = true;  ///< gRPC has not got it yet
};

/// gRPC's own watcher of files takes a certificate that does not fit its key and then serves nobody; its credentials with a
/// callback keep what they had. Only its C interface has those.
class TlsCredentials final : public grpc::ServerCredentials {
 public:
  explicit TlsCredentials(const TlsFiles& files)
      : files_(files),
        credentials_(
            grpc_ssl_server_credentials_create_with_options(grpc_ssl_server_credentials_create_options_using_config_fetcher(
                files.client_ca.empty() ? GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE
                                        : GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY,
                WatchedFiles::fetch, &files_))) {}
  ~TlsCredentials() override { grpc_server_credentials_release(credentials_); }
  TlsCredentials(const TlsCredentials&) = delete;
  TlsCredentials& operator=(const TlsCredentials&) = delete;

  /// Not used: callers are asked by Access, over plain text as well.
  void SetAuthMetadataProcessor(const std::shared_ptr<grpc::AuthMetadataProcessor>&) override {}

 private:
  int AddPortToServer(const std::string& address, grpc_server* server) override {
    return grpc_server_add_http2_port(server, address.c_str(), credentials_);
  }

  WatchedFiles files_;
  grpc_server_credentials* const credentials_;
};

}  // namespace

void TlsFiles::validate() const {
  const auto missing = [](const char* given, const char* wanted) {
    return Error(ErrorCode::invalid_argument, std::string("option ") + given + ": needs " + wanted + ", too");
  };
  if (!certificate.empty() && key.empty()) throw missing("tls-cert", "--tls-key");
  if (certificate.empty() && !key.empty()) throw missing("tls-key", "--tls-cert");
  if (certificate.empty() && !client_ca.empty()) throw missing("tls-client-ca", "--tls-cert and --tls-key");
  if (client_ca.empty() && !client_crl.empty()) throw missing("tls-client-crl", "--tls-client-ca");
}

std::shared_ptr<grpc::ServerCredentials> tls_credentials(const TlsFiles& files) {
  return std::make_shared<TlsCredentials>(files);
}

}  // namespace deform::server
