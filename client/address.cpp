// SPDX-License-Identifier: Apache-2.0
#include "client/address.h"

#include <algorithm>
#include <cctype>
#include <charconv>

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

}  // namespace deform::client
