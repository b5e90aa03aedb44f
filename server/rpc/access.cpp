// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/access.h"

#include <grpc/grpc_security_constants.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/small_file.h"
#include "core/base/text.h"

namespace deform::server {

namespace {

constexpr std::size_t max_token = 4096;
constexpr std::string_view bearer = "bearer ";

std::string_view view(const grpc::string_ref& text) { return {text.data(), text.size()}; }

/// The names of the peer's certificate, which the handshake has verified; none without one.
std::vector<std::string> certificate_names(const grpc::ServerContextBase& context) {
  std::vector<std::string> names;
  const auto peer = context.auth_context();
  if (!peer || !peer->IsPeerAuthenticated()) return names;
  for (const auto& name : peer->FindPropertyValues(GRPC_X509_SAN_PROPERTY_NAME)) names.emplace_back(view(name));
  return names;
}

/// The certificate of the peer and those it sent along, in PEM; empty without.
std::string certificate_chain(const grpc::ServerContextBase& context) {
  std::string chain;
  const auto peer = context.auth_context();
  if (!peer || !peer->IsPeerAuthenticated()) return chain;
  for (const char* property : {GRPC_X509_PEM_CERT_PROPERTY_NAME, GRPC_X509_PEM_CERT_CHAIN_PROPERTY_NAME}) {
    for (const auto& text : peer->FindPropertyValues(property)) chain.append(view(text)).append("\n");
  }
  return chain;
}

Error unknown(const std::string& message) { return {ErrorCode::unauthenticated, message}; }

/// The caller by its token, or else by its certificate: a wrong token is refused, not passed over.
std::optional<Identities::Identity> caller(const Identities& identities, const grpc::ServerContextBase& context,
                                           std::optional<Error>& refusal) {
  const auto [first, last] = context.client_metadata().equal_range("authorization");
  if (first == last) {
    const std::vector<std::string> names = certificate_names(context);
    auto found = identities.of_certificate(names);
    if (!found && names.empty()) {
      refusal = unknown(
          "this server asks who calls: send a token (deform: --token-file FILE; on the wire \"authorization: Bearer TOKEN\") or "
          "show a client certificate (--cert, --key)");
    } else if (!found) {
      refusal = unknown("no identity has the name of this client certificate, \"" + escaped(names.front(), 200) + "\"");
    }
    return found;
  }
  const std::string_view value = view(first->second);
  if (std::next(first) != last || lower_case(value.substr(0, bearer.size())) != bearer) {
    refusal = unknown("authorization: one value \"Bearer TOKEN\" was expected");
    return std::nullopt;
  }
  const std::string_view token = value.substr(bearer.size());
  auto found = token.size() <= max_token ? identities.of_token(token) : std::nullopt;
  if (!found) refusal = unknown("the token is not known to this server");
  return found;
}

}  // namespace

FileStamp FileStamp::of(const std::filesystem::path& path) {
  struct stat about {};
  if (::stat(path.c_str(), &about) != 0) return {};
  return {about.st_mtim.tv_sec * std::int64_t{1'000'000'000} + about.st_mtim.tv_nsec, about.st_size,
          static_cast<std::int64_t>(about.st_ino), static_cast<std::int64_t>(about.st_dev)};
}

Access::Access(Options options)
    : options_(std::move(options)), stamps_(stamps()), identities_(read_identities()), revocations_(read_revocations()) {}

Access::Stamps Access::stamps() const {
  const auto stamp = [](const std::filesystem::path& path) { return path.empty() ? FileStamp() : FileStamp::of(path); };
  return {stamp(options_.identities), stamp(options_.client_crl), stamp(options_.client_crl.empty() ? "" : options_.client_ca)};
}

std::pair<Access::IdentitiesPtr, Access::RevocationsPtr> Access::files() const {
  const std::lock_guard lock(mutex_);
  return {identities_, revocations_};
}

Access::Admission Access::admit(std::string_view method, Role needed, const grpc::ServerContextBase& context) const {
  Admission admission;
  admission.generation = generation_;  // before the files are looked at: a change meanwhile is noticed later
  const auto [known, revocations] = files();
  if (revocations) {
    if (const auto name = revocations->revoked(certificate_chain(context))) {
      admission.refusal = unknown("the certificate of " + *name + " has been revoked");
      return admission;
    }
  }
  if (!known) {
    const std::vector<std::string> names = certificate_names(context);
    if (!names.empty()) admission.identity = names.front();
    return admission;
  }
  const auto who = caller(*known, context, admission.refusal);
  if (!who) return admission;
  admission.identity = who->name;
  admission.tenant = who->tenant;
  admission.quota = known->quota_of(who->tenant);
  if (who->role < needed) {
    admission.refusal = Error(ErrorCode::permission_denied, std::string(method) + " needs the role " + to_string(needed) +
                                                                ", \"" + who->name + "\" has " + to_string(who->role));
  }
  return admission;
}

Access::IdentitiesPtr Access::read_identities() const {
  const std::filesystem::path& file = options_.identities;
  if (file.empty()) return nullptr;
  auto fresh = std::make_shared<const Identities>(
      Identities::parse(read_small_file(file, "option identities"), "option identities: " + file.string()));
  spdlog::info("identities: {} tokens and {} names of certificates from {}", fresh->tokens(), fresh->certificates(),
               escaped(file.string(), 300));
  if (options_.certificates == Certificates::never_seen && fresh->certificates() > 0) {
    spdlog::warn(
        "identities: {} of {} are known by \"certificate:NAME\" alone, but without --tls-client-ca no client is asked for a "
        "certificate: nobody can call under these names. Give --tls-client-ca with --tls-cert and --tls-key, or tokens "
        "(sha256:HASH)",
        fresh->certificates(), fresh->certificates() + fresh->tokens());
  }
  for (const std::string& tenant : fresh->quotas_of_nobody()) {
    spdlog::warn("identities: tenant {} has a quota, but no identity belongs to it (tenant={} on its line)", tenant, tenant);
  }
  return fresh;
}

Access::RevocationsPtr Access::read_revocations() const {
  if (options_.client_crl.empty()) return nullptr;
  auto fresh = std::make_shared<const Revocations>(Revocations::read(options_.client_crl, options_.client_ca));
  spdlog::info("revocations: {} certificates in {} lists from {}", fresh->certificates(), fresh->lists(),
               escaped(options_.client_crl.string(), 300));
  return fresh;
}

void Access::refresh() {
  const Stamps now = stamps();  // before they are read: what is written meanwhile is read again
  Stamps before;
  {
    const std::lock_guard lock(mutex_);
    before = std::exchange(stamps_, now);
  }
  const auto reread = [&](const char* what, auto& kept, const auto& read) {
    try {
      auto fresh = read();
      const std::lock_guard lock(mutex_);
      kept = std::move(fresh);
      ++generation_;
    } catch (const std::exception& error) {
      spdlog::error("{}: what was read before stays in force: {}", what, error.what());
    }
  };
  if (now[0] != before[0]) reread("identities", identities_, [this] { return read_identities(); });
  if (now[1] != before[1] || now[2] != before[2]) reread("revocations", revocations_, [this] { return read_revocations(); });
}

}  // namespace deform::server
