// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace deform::server {

/// Throws Error(invalid_argument) for what is no HOST:PORT or [IPV6]:PORT.
void check_metrics_address(const std::string& address);

/// One thing that must hold for the server to live or to be ready.
struct HealthCheck {
  std::string name;
  bool holds = true;
  std::string reason;  ///< why not
};

/// Plain HTTP for those who look after the server, on an address of its own:
///
///   /metrics  figures in the text format of Prometheus
///   /livez    200 while the server works, else 503: restart it
///   /readyz   200 while it should get new work, else 503; ?exclude=NAME leaves a check out, as often as it is given
///
/// The last two answer one line per check, "[+] NAME" or "[-] NAME: reason". They contain nothing about callers, geometries or
/// setups.
class OperationsPort {
 public:
  /// Called by threads of the port, several at once.
  struct Answers {
    std::function<std::string()> metrics;
    std::function<std::vector<HealthCheck>()> live;
    std::function<std::vector<HealthCheck>()> ready;
  };

  /// HOST:PORT or [IPV6]:PORT; port 0 takes a free one. Throws Error(invalid_argument) for another address, Error(unavailable)
  /// when it is taken.
  OperationsPort(const std::string& address, Answers answers);
  /// Waits for answers under way.
  ~OperationsPort();
  OperationsPort(const OperationsPort&) = delete;
  OperationsPort& operator=(const OperationsPort&) = delete;

  int port() const;

 private:
  class Http;
  const std::unique_ptr<Http> http_;
};

}  // namespace deform::server
