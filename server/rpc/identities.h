// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace deform::server {

/// What a caller may do; each role includes the ones before it.
enum class Role {
  read,    ///< "reader": see what there is
  use,     ///< "user": register, prepare, deform
  operate  ///< "operator": delete and release what others may use
};

/// "reader", "user" or "operator".
const char* to_string(Role role);

/// Who is known to a server and by what. A line of the file has a name, a role and a credential; '#' starts a comment:
///
///   alice    user      sha256:2c26b46b68ffc68ff99b453c1d30413413422d706483bfa0f98a5e886266e7ae    # of alice's token
///   solver   user      certificate:solver.example.org                                              # a name in a certificate
///
/// A name may stand on several lines, with one role, so that a token can be replaced without a gap. Immutable.
class Identities {
 public:
  /// The name and the role of a caller.
  struct Identity {
    std::string name;
    Role role = Role::read;
  };

  static constexpr std::size_t max_entries = 10'000;
  static constexpr std::size_t max_name = 64;  ///< bytes

  /// `source` names the text in errors: Error(invalid_argument) "SOURCE:LINE: what is wrong". The credential is never repeated.
  static Identities parse(std::string_view text, const std::string& source);

  /// Of the bearer of a token, by its SHA-256. The time taken does not depend on how much of a hash agrees.
  std::optional<Identity> of_token(std::string_view token) const;
  /// Of the first line that names any of these subject alternative names of a verified certificate.
  std::optional<Identity> of_certificate(std::span<const std::string> names) const;

  std::size_t tokens() const { return tokens_.size(); }              ///< lines with a hash
  std::size_t certificates() const { return certificates_.size(); }  ///< lines with a name of certificates

 private:
  struct Entry {
    std::string credential;  ///< the hash in lower-case hexadecimal digits, or the name in a certificate
    Identity identity;
  };
  std::vector<Entry> tokens_, certificates_;
};

}  // namespace deform::server
