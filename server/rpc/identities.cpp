// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/identities.h"

#include <openssl/crypto.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/codec/geometry_id.h"
#include "server/rpc/option_text.h"

namespace deform::server {

namespace {

constexpr std::string_view blanks = " \t\r";
constexpr std::string_view hash_prefix = "sha256:";
constexpr std::string_view certificate_prefix = "certificate:";
constexpr std::string_view tenant_option = "tenant=";
constexpr std::string_view tenant_line = "tenant:";
constexpr const char* other_tenants = "*";
constexpr std::size_t hash_digits = 64;
constexpr std::pair<const char*, Role> role_names[] = {
    {"reader", Role::read}, {"user", Role::use}, {"owner", Role::own}, {"operator", Role::operate}};

/// Takes the first word from a line; empty at its end.
std::string_view take_word(std::string_view& line) {
  line.remove_prefix(std::min(line.find_first_not_of(blanks), line.size()));
  const std::string_view word = line.substr(0, line.find_first_of(blanks));
  line.remove_prefix(word.size());
  return word;
}

std::string shown(std::string_view text) { return "\"" + escaped(text, Identities::max_name) + "\""; }

/// Where in the file an error is.
struct Place {
  const std::string& source;
  std::size_t line;

  Error error(const std::string& what) const {
    return {ErrorCode::invalid_argument, source + ":" + std::to_string(line) + ": " + what};
  }
};

std::string parse_name(std::string_view word, const Place& place) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-' ||
           c == '@';
  };
  if (word.size() > Identities::max_name) {
    throw place.error("the name has " + std::to_string(word.size()) + " bytes, at most " + std::to_string(Identities::max_name) +
                      " are allowed");
  }
  if (!std::all_of(word.begin(), word.end(), allowed)) {
    throw place.error("the name " + shown(word) + " has other characters than letters, digits and . _ - @");
  }
  return std::string(word);
}

Role parse_role(std::string_view word, const Place& place) {
  for (const auto& [name, role] : role_names) {
    if (word == name) return role;
  }
  throw place.error("the role " + shown(word) + " is none of reader, user, owner, operator");
}

std::string parse_hash(std::string_view digits, const Place& place) {
  std::string hash = lower_case(digits);
  if (hash.size() != hash_digits || hash.find_first_not_of("0123456789abcdef") != std::string::npos) {
    throw place.error("after sha256: " + std::to_string(hash_digits) + " hexadecimal digits were expected");
  }
  return hash;
}

std::string parse_tenant(std::string_view word, const Place& place) {
  if (is_tenant_name(std::string(word))) return std::string(word);
  throw place.error("the tenant " + shown(word) +
                    " is not 1 to 64 lower-case letters, digits and . _ -, the first of them a "
                    "letter or digit");
}

std::uint64_t parse_limit(std::string_view name, std::string_view value, const Place& place) {
  try {
    const std::uint64_t limit = parse_bytes(std::string(value));
    if (limit > 0) return limit;
  } catch (const Error&) {
  }
  throw place.error(std::string(name) + ": " + shown(value) + " is no limit such as 100 or 20GiB; to have none, leave it out");
}

/// What comes after "tenant:NAME" on a line.
Quota parse_quota(std::string_view line, const Place& place) {
  const std::pair<const char*, std::uint64_t Quota::*> limits[] = {{"stored-bytes", &Quota::stored_bytes},
                                                                   {"geometries", &Quota::geometries},
                                                                   {"calls", &Quota::calls},
                                                                   {"preparations", &Quota::preparations},
                                                                   {"bytes-in-flight", &Quota::bytes_in_flight},
                                                                   {"requests-per-second", &Quota::requests_per_second}};
  Quota quota;
  for (std::string_view word = take_word(line); !word.empty(); word = take_word(line)) {
    const std::size_t sign = word.find('=');
    const auto known = std::find_if(std::begin(limits), std::end(limits),
                                    [&](const auto& limit) { return word.substr(0, sign) == limit.first; });
    if (sign == std::string_view::npos || known == std::end(limits)) {
      throw place.error(shown(word) +
                        " is none of stored-bytes=SIZE, geometries=N, calls=N, preparations=N, bytes-in-flight=SIZE, "
                        "requests-per-second=N");
    }
    std::uint64_t& limit = quota.*(known->second);
    if (limit != 0) throw place.error(std::string(known->first) + " stands twice on this line");
    limit = parse_limit(known->first, word.substr(sign + 1), place);
  }
  return quota;
}

}  // namespace

const char* to_string(Role role) {
  for (const auto& [name, value] : role_names) {
    if (value == role) return name;
  }
  return "";
}

Identities Identities::parse(std::string_view text, const std::string& source) {
  Identities out;
  std::map<std::string, Identity> known;
  struct Line {
    std::size_t number;
    std::string name;
  };
  std::map<std::string, Line> credentials;
  for (Place place{source, 1}; !text.empty(); ++place.line) {
    std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(line.size() + 1, text.size()));
    line = line.substr(0, line.find('#'));
    const std::string_view name = take_word(line);
    if (name.empty()) continue;
    if (name.starts_with(tenant_line)) {
      const std::string_view tenant = name.substr(tenant_line.size());
      const std::string whose = tenant == other_tenants ? other_tenants : parse_tenant(tenant, place);
      if (!out.quotas_.emplace(whose, parse_quota(line, place)).second) {
        throw place.error("a second line of tenant " + shown(tenant));
      }
      if (out.quotas_.size() > max_entries) throw place.error("more than " + std::to_string(max_entries) + " tenants");
      continue;
    }
    const std::string_view role = take_word(line), credential = take_word(line), tenant = take_word(line);
    if (credential.empty() || (!tenant.empty() && !tenant.starts_with(tenant_option)) || !take_word(line).empty()) {
      throw place.error("expected: NAME ROLE CREDENTIAL [tenant=TENANT]");
    }

    Entry entry;
    entry.identity = {parse_name(name, place), parse_role(role, place)};
    if (!tenant.empty()) entry.identity.tenant = parse_tenant(tenant.substr(tenant_option.size()), place);
    const Identity& first = known.emplace(entry.identity.name, entry.identity).first->second;
    if (first.role != entry.identity.role) {
      throw place.error(shown(name) + " is " + to_string(entry.identity.role) + " here and " + to_string(first.role) +
                        " on a line before");
    }
    if (first.tenant != entry.identity.tenant) {
      throw place.error(shown(name) + " is of tenant " + shown(entry.identity.tenant) + " here and of " + shown(first.tenant) +
                        " on a line before");
    }
    const std::string key = credential.starts_with(hash_prefix) ? lower_case(credential) : std::string(credential);
    const Line& same = credentials.emplace(key, Line{place.line, entry.identity.name}).first->second;
    if (same.name != entry.identity.name) {
      throw place.error("the credential of " + shown(name) + " is that of " + shown(same.name) + " on line " +
                        std::to_string(same.number) + "; whoever calls with it can be only one of them");
    }
    if (credential.starts_with(hash_prefix)) {
      entry.credential = parse_hash(credential.substr(hash_prefix.size()), place);
      out.tokens_.push_back(std::move(entry));
    } else if (credential.starts_with(certificate_prefix) && credential.size() > certificate_prefix.size()) {
      entry.credential = credential.substr(certificate_prefix.size());
      out.certificates_.push_back(std::move(entry));
    } else {
      throw place.error("the credential is neither sha256:HASH nor certificate:NAME");
    }
    if (out.tokens() + out.certificates() > max_entries) {
      throw place.error("more than " + std::to_string(max_entries) + " lines");
    }
  }
  return out;
}

std::vector<std::string> Identities::quotas_of_nobody() const {
  std::vector<std::string> result;
  const auto belongs = [](const std::string& tenant) {
    return [&tenant](const Entry& entry) { return entry.identity.tenant == tenant; };
  };
  for (const auto& [tenant, quota] : quotas_) {
    if (tenant == other_tenants || std::any_of(tokens_.begin(), tokens_.end(), belongs(tenant)) ||
        std::any_of(certificates_.begin(), certificates_.end(), belongs(tenant))) {
      continue;
    }
    result.push_back(tenant);
  }
  return result;
}

Quota Identities::quota_of(const std::string& tenant) const {
  const auto own = quotas_.find(tenant);
  const auto found = own == quotas_.end() ? quotas_.find(other_tenants) : own;
  return found == quotas_.end() ? Quota() : found->second;
}

std::optional<Identities::Identity> Identities::of_token(std::string_view token) const {
  codec::Sha256 digest;
  digest.add(token.data(), token.size());
  const std::string hash = digest.hex();
  const Entry* found = nullptr;
  for (const Entry& entry : tokens_) {  // all of them, so that the time tells nothing
    if (CRYPTO_memcmp(entry.credential.data(), hash.data(), hash_digits) == 0) found = &entry;
  }
  return found == nullptr ? std::nullopt : std::optional(found->identity);
}

std::optional<Identities::Identity> Identities::of_certificate(std::span<const std::string> names) const {
  for (const Entry& entry : certificates_) {
    if (std::find(names.begin(), names.end(), entry.credential) != names.end()) return entry.identity;
  }
  return std::nullopt;
}

}  // namespace deform::server
