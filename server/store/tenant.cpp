// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/tenant.h"

#include <algorithm>

#include "core/base/error.h"
#include "core/base/number_text.h"

namespace deform::server {

namespace {

constexpr std::size_t digits_of_id = 64;
constexpr std::size_t longest_tenant = 64;

}  // namespace

bool is_tenant_name(const std::string& text) {
  const auto alphanumeric = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); };
  return !text.empty() && text.size() <= longest_tenant && alphanumeric(text.front()) &&
         std::all_of(text.begin(), text.end(), [&](char c) { return alphanumeric(c) || c == '.' || c == '_' || c == '-'; });
}

std::string key_of(const OwnedId& owned) { return owned.tenant == default_tenant ? owned.id : owned.id + "." + owned.tenant; }

std::optional<OwnedId> owned_id(const std::string& key) {
  OwnedId owned{default_tenant, key.substr(0, digits_of_id)};
  if (!is_full_id(owned.id)) return std::nullopt;
  if (key.size() == digits_of_id) return owned;
  owned.tenant = key.substr(digits_of_id + 1);
  // The default tenant has one name only: what is called otherwise is nobody's.
  if (key[digits_of_id] != '.' || !is_tenant_name(owned.tenant) || owned.tenant == default_tenant) return std::nullopt;
  return owned;
}

bool is_full_id(const std::string& text) {
  return text.size() == digits_of_id &&
         std::all_of(text.begin(), text.end(), [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

void check_quota(const std::string& tenant, const StoredAmount& has, const StoredAmount& more, const Quota& quota) {
  const char* advice = "; delete geometries or systems, or ask the operator of the server for more";
  if (quota.geometries != 0 && more.geometries != 0 && has.geometries + more.geometries > quota.geometries) {
    throw Error(ErrorCode::out_of_budget, "quota geometries of tenant \"" + tenant + "\": " + std::to_string(has.geometries) +
                                              " are registered, the limit is " + std::to_string(quota.geometries) + advice)
        .refused_for(Refusal::quota);
  }
  if (quota.stored_bytes != 0 && more.bytes != 0 && more.bytes > quota.stored_bytes - std::min(has.bytes, quota.stored_bytes)) {
    throw Error(ErrorCode::out_of_budget, "quota stored-bytes of tenant \"" + tenant + "\": " + mebibytes(has.bytes) +
                                              " are stored, " + mebibytes(more.bytes) + " more are wanted, the limit is " +
                                              mebibytes(quota.stored_bytes) + advice)
        .refused_for(Refusal::quota);
  }
}

}  // namespace deform::server
