// SPDX-License-Identifier: Apache-2.0
#include "client/credentials.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <iterator>
#include <utility>
#include <vector>

#include "client/address.h"
#include "core/base/small_file.h"
#include "core/base/text.h"
#include "core/codec/pem.h"

namespace deform::client {

namespace {

template <auto* function>
struct FreeWith {
  template <typename T>
  void operator()(T* pointer) const {
    function(pointer);
  }
};
using Names = std::unique_ptr<GENERAL_NAMES, FreeWith<&GENERAL_NAMES_free>>;
using SslContext = std::unique_ptr<SSL_CTX, FreeWith<&SSL_CTX_free>>;
using SslConnection = std::unique_ptr<SSL, FreeWith<&SSL_free>>;

constexpr std::size_t max_token = 4096;

Error bad_token(const std::filesystem::path& path, const std::string& why) {
  return {ErrorCode::invalid_argument, "client option token_file: " + path.string() + ": " + why};
}

/// The contents of TlsOptions' files, looked through: gRPC would only say that a handshake failed.
grpc::SslCredentialsOptions read_files(const TlsOptions& tls) {
  grpc::SslCredentialsOptions out;
  if (!tls.ca.empty()) {
    codec::PemFile authorities = codec::read_pem_file("client option ca", tls.ca);
    codec::check_certificates(authorities);
    out.pem_root_certs = std::move(authorities.text);
  }
  if (tls.cert.empty() != tls.key.empty()) {
    throw Error(ErrorCode::invalid_argument, "client options cert and key: one needs the other");
  }
  if (tls.cert.empty()) return out;
  codec::PemFile certificate = codec::read_pem_file("client option cert", tls.cert);
  codec::PemFile key = codec::read_pem_file("client option key", tls.key);
  codec::check_key_pair(certificate, key);
  out.pem_cert_chain = std::move(certificate.text);
  out.pem_private_key = std::move(key.text);
  return out;
}

// ---- what a certificate says ----

std::string date_text(const std::tm& parts) {
  char text[40];
  return {text, std::strftime(text, sizeof(text), "%Y-%m-%d %H:%M UTC", &parts)};
}

std::string date_text(const ASN1_TIME* time) {
  std::tm parts{};
  return ASN1_TIME_to_tm(time, &parts) == 1 ? date_text(parts) : "an unreadable date";
}

std::string date_of_today() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  return date_text(parts);
}

std::string quoted_name(const X509_NAME* name) { return "\"" + codec::name_text(*name) + "\""; }

std::string address_text(const ASN1_OCTET_STRING& address) {
  char text[INET6_ADDRSTRLEN] = "?";
  const int size = ASN1_STRING_length(&address);
  if (size == 4 || size == 16) inet_ntop(size == 4 ? AF_INET : AF_INET6, ASN1_STRING_get0_data(&address), text, sizeof(text));
  return text;
}

/// The hosts that a certificate is for.
std::string host_names(const X509& certificate) {
  std::string out;
  const Names names(static_cast<GENERAL_NAMES*>(X509_get_ext_d2i(&certificate, NID_subject_alt_name, nullptr, nullptr)));
  for (int i = 0; i < sk_GENERAL_NAME_num(names.get()); ++i) {
    const GENERAL_NAME* name = sk_GENERAL_NAME_value(names.get(), i);
    std::string text;
    if (name->type == GEN_DNS) {
      const auto* bytes = reinterpret_cast<const char*>(ASN1_STRING_get0_data(name->d.dNSName));
      text = escaped({bytes, static_cast<std::size_t>(ASN1_STRING_length(name->d.dNSName))}, 100);
    } else if (name->type == GEN_IPADD) {
      text = address_text(*name->d.iPAddress);
    }
    if (!text.empty()) out += (out.empty() ? "" : ", ") + text;
  }
  return out.empty() ? "no host at all" : out;
}

// ---- a handshake that looks at everything ----

/// Everything about one attempt that a sentence can be made of.
struct Findings {
  std::vector<std::string> faults;  ///< of the server's certificate, "expired on ..."
  bool wants_certificate = false;   ///< the server asked for one
  std::string wanted_name;
  std::string ca;  ///< where authorities came from
};

Findings& findings_of(SSL* ssl) { return *static_cast<Findings*>(SSL_get_app_data(ssl)); }

std::string fault_text(int error, const X509* certificate, const Findings& findings) {
  switch (error) {
    case X509_V_ERR_CERT_HAS_EXPIRED:
      return "expired on " + date_text(X509_get0_notAfter(certificate)) + " (the clock here says " + date_of_today() + ")";
    case X509_V_ERR_CERT_NOT_YET_VALID:
      return "is not valid before " + date_text(X509_get0_notBefore(certificate)) + " (the clock here says " + date_of_today() +
             ")";
    case X509_V_ERR_HOSTNAME_MISMATCH:
    case X509_V_ERR_IP_ADDRESS_MISMATCH:
      return "is for " + host_names(*certificate) + ", not for " + findings.wanted_name +
             ": connect by a name it has, or say which one to expect (--server-name)";
    case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
    case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
    case X509_V_ERR_CERT_UNTRUSTED:
      return "is from the authority " + quoted_name(X509_get_issuer_name(certificate)) + ", which is not in " + findings.ca +
             " (--ca)";
    case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:  // follows one of those above
      return {};
    default:
      return std::string("cannot be verified: ") + X509_verify_cert_error_string(error);
  }
}

/// Notes what is wrong and goes on: nothing is sent over this connection.
int note_fault(int ok, X509_STORE_CTX* store) {
  if (ok == 1) return 1;
  auto* ssl = static_cast<SSL*>(X509_STORE_CTX_get_ex_data(store, SSL_get_ex_data_X509_STORE_CTX_idx()));
  Findings& findings = findings_of(ssl);
  std::string text = fault_text(X509_STORE_CTX_get_error(store), X509_STORE_CTX_get_current_cert(store), findings);
  if (!text.empty() && std::find(findings.faults.begin(), findings.faults.end(), text) == findings.faults.end()) {
    findings.faults.push_back(std::move(text));
  }
  return 1;
}

int note_request(SSL* ssl, void*) {
  findings_of(ssl).wants_certificate = true;
  return 1;
}

/// OpenSSL writes to sockets that the other side may have closed: the signal of that would end the program. For this thread
/// alone.
class WithoutBrokenPipes {
 public:
  WithoutBrokenPipes() {
    sigemptyset(&pipe_);
    sigaddset(&pipe_, SIGPIPE);
    sigset_t pending;
    sigpending(&pending);
    was_pending_ = sigismember(&pending, SIGPIPE) == 1;
    pthread_sigmask(SIG_BLOCK, &pipe_, &before_);
  }
  ~WithoutBrokenPipes() {
    const timespec at_once{0, 0};
    if (!was_pending_) sigtimedwait(&pipe_, nullptr, &at_once);
    pthread_sigmask(SIG_SETMASK, &before_, nullptr);
  }
  WithoutBrokenPipes(const WithoutBrokenPipes&) = delete;
  WithoutBrokenPipes& operator=(const WithoutBrokenPipes&) = delete;

 private:
  sigset_t pipe_, before_;
  bool was_pending_;
};

/// A file descriptor that is closed.
class Socket {
 public:
  explicit Socket(int fd = -1) : fd_(fd) {}
  ~Socket() {
    if (fd_ >= 0) close(fd_);
  }
  Socket(Socket&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Socket& operator=(Socket&&) = delete;
  int fd() const { return fd_; }

 private:
  int fd_;
};

/// fd -1 unless somebody listens there.
Socket connected(int family, const sockaddr* address, socklen_t size, std::chrono::milliseconds timeout) {
  Socket out(socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const auto ms = timeout.count();
  const timeval limit{static_cast<time_t>(ms / 1000), static_cast<suseconds_t>(ms % 1000 * 1000)};
  setsockopt(out.fd(), SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
  setsockopt(out.fd(), SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof(limit));  // of connect(), too
  return connect(out.fd(), address, size) == 0 ? std::move(out) : Socket();
}

std::string host_of(const std::string& address) {
  std::string host = address.substr(0, address.rfind(':'));
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  return host;
}

Socket connected(const std::string& address, std::chrono::milliseconds timeout) {
  if (address.starts_with("unix:")) {
    sockaddr_un path{};
    path.sun_family = AF_UNIX;
    const std::string name = address.substr(5);
    if (name.size() >= sizeof(path.sun_path)) return Socket();
    std::memcpy(path.sun_path, name.data(), name.size());
    return connected(AF_UNIX, reinterpret_cast<const sockaddr*>(&path), sizeof(path), timeout);
  }
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (getaddrinfo(host_of(address).c_str(), address.substr(address.rfind(':') + 1).c_str(), &hints, &found) != 0) return Socket();
  const std::unique_ptr<addrinfo, FreeWith<&freeaddrinfo>> owner(found);
  for (const addrinfo* one = found; one != nullptr; one = one->ai_next) {
    Socket out = connected(one->ai_family, one->ai_addr, one->ai_addrlen, timeout);
    if (out.fd() >= 0) return out;
  }
  return Socket();
}

bool is_number(const std::string& host) {
  unsigned char bytes[16];
  return inet_pton(AF_INET, host.c_str(), bytes) == 1 || inet_pton(AF_INET6, host.c_str(), bytes) == 1;
}

SslConnection make_connection(SSL_CTX* context, const Socket& socket, Findings& findings) {
  SslConnection ssl(SSL_new(context));
  SSL_set_app_data(ssl.get(), &findings);
  SSL_set_fd(ssl.get(), socket.fd());
  if (is_number(findings.wanted_name)) {
    X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(ssl.get()), findings.wanted_name.c_str());
  } else {
    SSL_set1_host(ssl.get(), findings.wanted_name.c_str());
    SSL_set_tlsext_host_name(ssl.get(), findings.wanted_name.c_str());
  }
  return ssl;
}

/// As gRPC would connect.
SslContext make_context(const TlsOptions& tls) {
  SslContext context(SSL_CTX_new(TLS_client_method()));
  SSL_CTX_set_min_proto_version(context.get(), TLS1_2_VERSION);
  const unsigned char h2[] = {2, 'h', '2'};
  SSL_CTX_set_alpn_protos(context.get(), h2, sizeof(h2));
  if (tls.ca.empty()) {
    SSL_CTX_set_default_verify_paths(context.get());
  } else {
    SSL_CTX_load_verify_locations(context.get(), tls.ca.c_str(), nullptr);
  }
  if (!tls.cert.empty()) {
    SSL_CTX_use_certificate_chain_file(context.get(), tls.cert.c_str());
    SSL_CTX_set_default_passwd_cb(context.get(), codec::no_passphrase);
    SSL_CTX_use_PrivateKey_file(context.get(), tls.key.c_str(), SSL_FILETYPE_PEM);
  }
  SSL_CTX_set_verify(context.get(), SSL_VERIFY_PEER, note_fault);
  SSL_CTX_set_cert_cb(context.get(), note_request, nullptr);
  return context;
}

/// The server took part in the handshake and then ended the connection.
std::string client_refused(const TlsOptions& tls) {
  if (tls.cert.empty()) return "wants a client certificate: give one, with its key (--cert, --key)";
  const std::string file = tls.cert.string();
  const codec::Certificate certificate = codec::first_certificate(read_small_file(tls.cert, "client option cert"));
  if (certificate && X509_cmp_current_time(X509_get0_notAfter(certificate.get())) < 0) {
    return "does not accept the client certificate in " + file + ", which expired on " +
           date_text(X509_get0_notAfter(certificate.get()));
  }
  if (!certificate) return "does not accept the client certificate in " + file;
  return "does not accept the client certificate in " + file + ", from the authority " +
         quoted_name(X509_get_issuer_name(certificate.get()));
}

/// What the server does, as the end of a sentence; empty when all is well or nothing is known.
std::string handshake_failure(const Socket& socket, const TlsOptions& tls, Findings& findings) {
  const SslContext context = make_context(tls);
  const SslConnection ssl = make_connection(context.get(), socket, findings);
  ERR_clear_error();
  const bool shaken = SSL_connect(ssl.get()) == 1;
  const unsigned long error = ERR_peek_last_error();
  if (!findings.faults.empty()) {
    std::string all = "has a certificate that ";
    for (std::size_t i = 0; i < findings.faults.size(); ++i) all += (i == 0 ? "" : "; and it ") + findings.faults[i];
    return all;
  }
  if (shaken) {
    char byte = 0;  // of the first frame; TLS 1.3 refuses a client only now
    if (SSL_read(ssl.get(), &byte, 1) > 0 || !findings.wants_certificate) return {};
    return client_refused(tls);
  }
  if (findings.wants_certificate) return client_refused(tls);
  if (ERR_GET_LIB(error) == ERR_LIB_SSL && ERR_GET_REASON(error) == SSL_R_WRONG_VERSION_NUMBER) {
    return "speaks plain text and no TLS: leave out --tls, --ca, --cert and --key, or use another port";
  }
  return {};
}

}  // namespace

std::string expected_name(const std::string& address, const TlsOptions& tls) {
  if (!tls.server_name.empty()) return tls.server_name;
  return address.starts_with("unix:") ? "localhost" : host_of(address);
}

std::shared_ptr<grpc::ChannelCredentials> channel_credentials(const ClientOptions& options) {
  if (options.tls) return grpc::SslCredentials(read_files(*options.tls));
  if (!options.token_file.empty() && !is_local(options.address)) {
    throw Error(ErrorCode::invalid_argument, "client option token_file: the token would travel to " + options.address +
                                                 " in plain text; use TLS (--tls, --ca)");
  }
  return grpc::InsecureChannelCredentials();
}

std::string read_token(const std::filesystem::path& file) {
  const std::string text = read_small_file(file, "client option token_file");
  const auto first = text.find_first_not_of(" \t\r\n");
  if (first == std::string::npos) throw bad_token(file, "is empty");
  std::string token = text.substr(first, text.find_last_not_of(" \t\r\n") - first + 1);
  if (token.size() > max_token) throw bad_token(file, "a token has at most " + std::to_string(max_token) + " bytes");
  if (!std::all_of(token.begin(), token.end(), [](char c) { return c > ' ' && c < '\x7f'; })) {
    throw bad_token(file, "one token was expected, of printable ASCII characters without blanks");
  }
  return token;
}

std::string tls_failure(const std::string& address, const std::optional<TlsOptions>& tls, std::chrono::milliseconds timeout) {
  const WithoutBrokenPipes guard;
  const Socket socket = connected(address, timeout);
  if (socket.fd() < 0) return {};
  const TlsOptions used = tls.value_or(TlsOptions());
  Findings findings;
  findings.wanted_name = expected_name(address, used);
  findings.ca = used.ca.empty() ? "those that this machine trusts" : used.ca.string();
  const std::string server = "the server at " + address + " ";
  if (tls) {
    const std::string failure = handshake_failure(socket, used, findings);
    return failure.empty() ? failure : server + failure;
  }
  const SslContext context = make_context(used);
  const SslConnection ssl = make_connection(context.get(), socket, findings);
  const bool shaken = SSL_connect(ssl.get()) == 1;
  if (!shaken && !findings.wants_certificate) return {};
  return server + "wants TLS: say so (--tls), and name its authority unless this machine trusts it (--ca)";
}

}  // namespace deform::client
