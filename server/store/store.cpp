// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/store.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <utility>

#include "core/base/error.h"

namespace deform::server {

namespace {

constexpr std::size_t id_digits = 64;
constexpr std::size_t shortest_prefix = 8;
constexpr std::size_t largest_page = 1000;

bool is_hexadecimal(const std::string& text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

void check_id(const char* what, const std::string& id) {
  if (id.size() >= shortest_prefix && id.size() <= id_digits && is_hexadecimal(id)) return;
  throw Error(ErrorCode::invalid_argument, std::string(what) + " id \"" + id.substr(0, id_digits + 8) +
                                               "\": expected 64 lower-case hexadecimal digits or the first 8 or more of them");
}

std::string only_one(const char* what, const std::string& id, const std::vector<std::string>& found) {
  if (found.empty()) throw Error(ErrorCode::not_found, std::string(what) + " " + id + ": unknown id");
  if (found.size() > 1) {
    throw Error(ErrorCode::invalid_argument, std::string(what) + " " + id + ": several ids start so (" + found[0].substr(0, 16) +
                                                 ", " + found[1].substr(0, 16) + "); give more digits");
  }
  return found[0];
}

}  // namespace

OwnedId Store::resolve_geometry(const std::string& tenant, const std::string& id) {
  check_id("geometry", id);
  return {tenant, only_one("geometry", id, catalog().geometry_ids(tenant, id, 2))};
}

OwnedId Store::resolve_setup(const std::string& tenant, const std::string& id) {
  check_id("system", id);
  return {tenant, only_one("system", id, catalog().setup_ids(tenant, id, 2))};
}

std::string page_token(std::int64_t created_ms, const std::string& id) { return std::to_string(created_ms) + ":" + id; }

std::optional<PageStart> parse_page_token(const std::string& token) {
  if (token.empty()) return std::nullopt;
  PageStart start;
  const std::size_t colon = token.find(':');
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), start.created_ms);
  if (colon == std::string::npos || error != std::errc() || end != token.data() + colon) {
    throw Error(ErrorCode::invalid_argument, "page_token: not one that a listing returned");
  }
  start.id = token.substr(colon + 1);
  if (start.id.size() != id_digits || !is_hexadecimal(start.id)) {
    throw Error(ErrorCode::invalid_argument, "page_token: not one that a listing returned");
  }
  return start;
}

std::size_t page_size(std::uint32_t requested) {
  if (requested > largest_page) {
    throw Error(ErrorCode::invalid_argument,
                "page_size: " + std::to_string(requested) + " is more than " + std::to_string(largest_page));
  }
  return requested == 0 ? largest_page : requested;
}

bool PageRoom::takes(std::size_t bytes) {
  constexpr std::size_t most = 1'000'000, around = 16;  // with its tag and length
  if (bytes_ > 0 && bytes_ + bytes + around > most) return false;
  bytes_ += bytes + around;
  return true;
}

std::int64_t unix_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace deform::server
