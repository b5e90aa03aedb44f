// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/engine/engine.h"

namespace deform::server {

/// What a caller may do; each role includes the ones before it.
enum class Role {
  read,    ///< "reader": see what there is
  use,     ///< "user": register, prepare, deform
  own,     ///< "owner": delete and release what others of the tenant may use
  operate  ///< "operator": look after the server itself, whoever uses it
};

/// "reader", "user", "owner" or "operator".
const char* to_string(Role role);

/// Who is known to a server and by what. A line of the file has a name, a role, a credential and may have a tenant (without: the
/// default one); a line that begins with "tenant:" has what a tenant may take, "tenant:*" what each has that has no such line.
/// '#' starts a comment:
///
///   alice    user      sha256:2c26b46b68ffc68ff99b453c1d30413413422d706483bfa0f98a5e886266e7ae    # of alice's token
///   solver   user      certificate:solver.example.org  tenant=acme                                 # a name in a certificate
///   tenant:acme        stored-bytes=20GiB geometries=500 calls=32 preparations=4 bytes-in-flight=1GiB requests-per-second=100
///
/// A name may stand on several lines, with one role and one tenant, so that a token can be replaced without a gap. A credential
/// belongs to one name. Immutable.
class Identities {
 public:
  /// The name and the role of a caller, and whose geometries and systems are its own.
  struct Identity {
    std::string name;
    Role role = Role::read;
    std::string tenant = default_tenant;
  };

  static constexpr std::size_t max_entries = 10'000;
  static constexpr std::size_t max_name = 64;  ///< bytes

  /// `source` names the text in errors: Error(invalid_argument) "SOURCE:LINE: what is wrong". The credential is never repeated.
  static Identities parse(std::string_view text, const std::string& source);

  /// The identity of the bearer of a token, by its SHA-256. The time taken does not depend on how much of a hash agrees.
  std::optional<Identity> of_token(std::string_view token) const;
  /// The identity of the first line that names any of these subject alternative names of a verified certificate.
  std::optional<Identity> of_certificate(std::span<const std::string> names) const;

  /// What a tenant may take.
  Quota quota_of(const std::string& tenant) const;

  /// Tenants that have a quota and to which no identity belongs: misspelt, or gone.
  std::vector<std::string> quotas_of_nobody() const;

  std::size_t tokens() const { return tokens_.size(); }              ///< lines with a hash
  std::size_t certificates() const { return certificates_.size(); }  ///< lines with a name of certificates

 private:
  struct Entry {
    std::string credential;  ///< the hash in lower-case hexadecimal digits, or the name in a certificate
    Identity identity;
  };
  std::vector<Entry> tokens_, certificates_;
  std::map<std::string, Quota> quotas_;  // "*": of those that are not named
};

}  // namespace deform::server
