// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/operations_port.h"

#include <httplib.h>

#include <algorithm>
#include <set>
#include <thread>
#include <utility>

#include "core/base/error.h"
#include "core/base/text.h"
#include "server/rpc/listener.h"

namespace deform::server {

namespace {

/// A scraper and a prober or two; a slow one must not keep the others waiting.
constexpr std::size_t answering_threads = 16;
constexpr int patience_seconds = 1;
constexpr std::size_t max_request_bytes = 1024;

void answer_checks(const std::vector<HealthCheck>& checks, const std::set<std::string>& excluded, httplib::Response& response) {
  bool all = true;
  std::string text;
  std::set<std::string> unknown = excluded;
  for (const HealthCheck& check : checks) {
    const bool counts = excluded.count(check.name) == 0;
    unknown.erase(check.name);
    all = all && (check.holds || !counts);
    text += check.holds ? "[+] " + check.name : "[-] " + check.name + ": " + printable(check.reason);
    text += counts ? "\n" : " (excluded)\n";
  }
  for (const std::string& name : unknown) text += "[!] exclude: there is no check \"" + printable(name) + "\"\n";
  response.status = all ? 200 : 503;
  response.set_content(text, "text/plain; charset=utf-8");
}

std::set<std::string> excluded_in(const httplib::Request& request) {
  std::set<std::string> out;
  const auto [first, last] = request.params.equal_range("exclude");
  for (auto it = first; it != last; ++it) out.insert(it->second);
  return out;
}

}  // namespace

class OperationsPort::Http {
 public:
  Http(const std::string& address, Answers answers) : answers_(std::move(answers)) {
    server_.new_task_queue = [] { return new httplib::ThreadPool(answering_threads); };
    server_.set_keep_alive_max_count(1);               // a connection that waits would hold a thread
    server_.set_keep_alive_timeout(patience_seconds);  // for the first request, too
    server_.set_read_timeout(patience_seconds);
    server_.set_write_timeout(patience_seconds);
    server_.set_payload_max_length(max_request_bytes);
    server_.Get("/metrics", [this](const httplib::Request&, httplib::Response& response) {
      response.set_content(answers_.metrics(), "text/plain; version=0.0.4; charset=utf-8");
    });
    server_.Get("/livez", [this](const httplib::Request& request, httplib::Response& response) {
      answer_checks(answers_.live(), excluded_in(request), response);
    });
    server_.Get("/readyz", [this](const httplib::Request& request, httplib::Response& response) {
      answer_checks(answers_.ready(), excluded_in(request), response);
    });
    // Without SO_REUSEPORT, which would let two servers share the port without a word.
    server_.set_socket_options([](socket_t socket) {
      const int yes = 1;
      setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    check_metrics_address(address);
    const HostPort wanted = split_address(address);
    port_ = wanted.port == 0 ? server_.bind_to_any_port(wanted.host)
                             : (server_.bind_to_port(wanted.host, wanted.port) ? wanted.port : -1);
    if (port_ <= 0) throw Error(ErrorCode::unavailable, "option metrics-address: cannot listen on " + address);
    thread_ = std::thread([this] { server_.listen_after_bind(); });
  }
  ~Http() {
    while (!server_.is_running()) std::this_thread::yield();  // stop() before that would be lost
    server_.stop();
    thread_.join();
  }
  int port() const { return port_; }

 private:
  const Answers answers_;
  httplib::Server server_;
  int port_ = 0;
  std::thread thread_;
};

void check_metrics_address(const std::string& address) {
  const HostPort parts = split_address(address);
  if (is_unix(address) || parts.host.empty() || parts.port < 0) {
    throw Error(ErrorCode::invalid_argument,
                "option metrics-address: \"" + address + "\" is not HOST:PORT or [IPV6]:PORT with a port of 0 to 65535");
  }
}

OperationsPort::OperationsPort(const std::string& address, Answers answers)
    : http_(std::make_unique<Http>(address, std::move(answers))) {}
OperationsPort::~OperationsPort() = default;
int OperationsPort::port() const { return http_->port(); }

}  // namespace deform::server
