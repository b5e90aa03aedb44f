// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/access.h"

#include <grpc/grpc_security_constants.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <iterator>
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

Access::Access(std::filesystem::path identities, Certificates certificates)
    : file_(std::move(identities)), certificates_(certificates) {
  if (!file_.empty()) load();
}

std::shared_ptr<const Identities> Access::identities() const {
  const std::lock_guard lock(mutex_);
  return identities_;
}

Access::Admission Access::admit(std::string_view method, Role needed, const grpc::ServerContextBase& context) const {
  Admission admission;
  admission.generation = generation_;  // before the file is looked at: a change meanwhile is noticed later
  const auto known = identities();
  if (!known) {
    const std::vector<std::string> names = certificate_names(context);
    if (!names.empty()) admission.identity = names.front();
    return admission;
  }
  const auto who = caller(*known, context, admission.refusal);
  if (!who) return admission;
  admission.identity = who->name;
  if (who->role < needed) {
    admission.refusal = Error(ErrorCode::permission_denied, std::string(method) + " needs the role " + to_string(needed) +
                                                                ", \"" + who->name + "\" has " + to_string(who->role));
  }
  return admission;
}

void Access::load() {
  const FileStamp stamp = FileStamp::of(file_);  // before it is read: what is written meanwhile is read again
  {
    const std::lock_guard lock(mutex_);
    stamp_ = stamp;
  }
  auto fresh = std::make_shared<const Identities>(
      Identities::parse(read_small_file(file_, "option identities"), "option identities: " + file_.string()));
  spdlog::info("identities: {} tokens and {} names of certificates from {}", fresh->tokens(), fresh->certificates(),
               escaped(file_.string(), 300));
  if (certificates_ == Certificates::never_seen && fresh->certificates() > 0) {
    spdlog::warn(
        "identities: {} of {} are known by \"certificate:NAME\" alone, but without --tls-client-ca no client is asked for a "
        "certificate: nobody can call under these names. Give --tls-client-ca with --tls-cert and --tls-key, or tokens "
        "(sha256:HASH)",
        fresh->certificates(), fresh->certificates() + fresh->tokens());
  }
  {
    const std::lock_guard lock(mutex_);
    identities_ = std::move(fresh);
  }
  ++generation_;
}

void Access::refresh() {
  if (file_.empty()) return;
  const FileStamp now = FileStamp::of(file_);
  {
    const std::lock_guard lock(mutex_);
    if (now == stamp_) return;
  }
  try {
    load();
  } catch (const std::exception& error) {
    spdlog::error("identities: those read before stay in force: {}", error.what());
  }
}

}  // namespace deform::server
