// SPDX-License-Identifier: Apache-2.0
#include "client/address.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <string_view>

#include "core/base/error.h"

namespace deform::client {

namespace {

[[noreturn]] void refuse(const std::string& address, const std::string& why) {
  throw Error(ErrorCode::invalid_argument,
              "server address \"" + address + "\": " + why + ", expected HOST:PORT such as 127.0.0.1:50051");
}

bool is_port(const std::string& text) {
  unsigned value = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
  return failure == std::errc() && end == text.data() + text.size() && value >= 1 && value <= 65535;
}

/// 127.a.b.c in decimal numbers up to 255.
bool is_ipv4_loopback(std::string_view host) {
  int numbers = 0;
  while (true) {
    unsigned value = 0;
    const auto [end, failure] = std::from_chars(host.data(), host.data() + host.size(), value);
    if (failure != std::errc() || value > 255 || (numbers == 0 && value != 127)) return false;
    ++numbers;
    host.remove_prefix(static_cast<std::size_t>(end - host.data()));
    if (host.empty()) return numbers == 4;
    if (host.front() != '.' || numbers == 4) return false;
    host.remove_prefix(1);
  }
}

std::string lower_case(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// Without brackets: [0:...:0:]:1 with any way to write the zeros, or ::ffff: and an IPv4 address.
bool is_ipv6_loopback(const std::string& host) {
  constexpr std::string_view mapped = "::ffff:";
  if (host.starts_with(mapped)) return is_ipv4_loopback(std::string_view(host).substr(mapped.size()));
  const auto last = host.rfind(':');
  if (last == std::string::npos || host.find_first_not_of("0:") <= last) return false;
  const std::string group = host.substr(last + 1);
  return group.size() <= 4 && group.ends_with('1') && group.find_first_not_of('0') == group.size() - 1;
}

bool is_host_character(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '.' || c == '-' || c == '_'; }

}  // namespace

std::string checked_address(const std::string& address) {
  if (address.empty()) refuse(address, "empty");
  if (address.starts_with("unix:")) {
    if (address.size() == 5) refuse(address, "no path after unix:");
    return address;
  }
  if (address.find("://") != std::string::npos) refuse(address, "takes no scheme");
  const auto colon = address.rfind(':');
  if (colon == std::string::npos) refuse(address, "has no port");
  const std::string host = address.substr(0, colon);
  if (!is_port(address.substr(colon + 1))) refuse(address, "the port must be a number from 1 to 65535");
  if (host.empty()) refuse(address, "has no host");
  if (host.front() == '[') {
    if (host.back() != ']' || host.size() < 4) refuse(address, "an IPv6 host stands in brackets, [::1]");
    return address;
  }
  if (host.find(':') != std::string::npos) refuse(address, "an IPv6 host needs brackets, [::1]:50051");
  if (!std::all_of(host.begin(), host.end(), is_host_character)) refuse(address, "the host has characters that no host name has");
  return address;
}

bool is_local(const std::string& address) {
  if (address.starts_with("unix:")) return true;
  const std::string host = lower_case(address.substr(0, address.rfind(':')));
  if (host.starts_with('[') && host.ends_with(']')) return is_ipv6_loopback(host.substr(1, host.size() - 2));
  return host == "localhost" || host == "localhost." || is_ipv4_loopback(host);
}

namespace {

/// The items of a list with commas, without the blanks around them.
std::vector<std::string> items_of(const std::string& list) {
  std::vector<std::string> items;
  for (std::size_t begin = 0; begin <= list.size();) {
    const std::size_t end = std::min(list.find(',', begin), list.size());
    const std::string item = list.substr(begin, end - begin);
    const auto first = item.find_first_not_of(' ');
    items.push_back(first == std::string::npos ? "" : item.substr(first, item.find_last_not_of(' ') + 1 - first));
    begin = end + 1;
  }
  return items;
}

}  // namespace

std::vector<std::string> addresses_of(const std::string& list) {
  std::vector<std::string> addresses;
  const auto items = items_of(list);
  for (const std::string& item : items) {
    if (item.empty() && items.size() > 1) refuse(list, "an item of the list is empty");
    addresses.push_back(checked_address(item));
    if (std::count(addresses.begin(), addresses.end(), addresses.back()) > 1) refuse(list, item + " stands there twice");
  }
  return addresses;
}

v1::Encoding encoding_for(const std::string& list) {
  const auto items = items_of(list);
  return std::all_of(items.begin(), items.end(), is_local) ? v1::RAW_F64 : v1::DELTA_ZSTD;
}

}  // namespace deform::client
