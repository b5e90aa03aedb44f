// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

namespace deform::server {

/// Whose everything is that nobody with a tenant of its own has stored, and all that was stored before there were tenants.
inline constexpr const char* default_tenant = "default";

/// What an id names depends on who asks: the same content may belong to several tenants, each of which knows only its own.
struct OwnedId {
  std::string tenant;
  std::string id;
  auto operator<=>(const OwnedId&) const = default;
};

/// 1 to 64 lower-case letters, digits and . _ - of which the first is a letter or digit: a part of the names of files.
bool is_tenant_name(const std::string& text);

/// Names of rows and files: the id alone for the default tenant, "ID.TENANT" for others.
std::string key_of(const OwnedId& owned);
/// Nothing for what is no such name.
std::optional<OwnedId> owned_id(const std::string& key);

/// 64 lower-case hexadecimal digits.
bool is_full_id(const std::string& text);

/// What a tenant may have at once; 0: any number.
struct Quota {
  std::uint64_t stored_bytes = 0;
  std::uint64_t geometries = 0;
  std::uint64_t calls = 0;                ///< that compute: waiting or running
  std::uint64_t preparations = 0;         ///< of systems that are not in memory: waiting or running
  std::uint64_t bytes_in_flight = 0;      ///< of requests, uploads and answers under way
  std::uint64_t requests_per_second = 0;  ///< of calls and of requests within streams, whatever they do
  bool operator==(const Quota&) const = default;
};

/// What is stored of a tenant. The same content counts in full for each of those who have it.
struct StoredAmount {
  std::size_t geometries = 0, setups = 0;
  std::uint64_t bytes = 0;  ///< of geometries and setups, without what the file system and the catalog add
};

/// Throws Error(out_of_budget) when a tenant that has so much, what is being stored included, may not add so much more.
void check_quota(const std::string& tenant, const StoredAmount& has, const StoredAmount& more, const Quota& quota);

}  // namespace deform::server
