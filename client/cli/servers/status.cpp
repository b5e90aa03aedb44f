// SPDX-License-Identifier: GPL-3.0-or-later
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <chrono>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "client/address.h"
#include "client/cli/commands/command.h"
#include "client/cli/output/error_json.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "client/client.h"

namespace deform::cli {

namespace {

constexpr std::chrono::milliseconds patience{15'000};  ///< with a busy machine

/// What an operator should look at; empty when there is nothing.
std::string store_text(const v1::ServerInfo& info) {
  if (!info.has_store()) return {};  // a server of 0.1
  const v1::StoreInfo& store = info.store();
  std::string text;
  if (!store.writable()) text += "\n    NOTHING CAN BE ADDED: " + store.reason();
  if (store.damaged_files() > 0) text += "\n    " + std::to_string(store.damaged_files()) + " damaged files in damaged/";
  if (store.unclaimed_files() > 0) text += "\n    " + std::to_string(store.unclaimed_files()) + " foreign files in unclaimed/";
  return text;
}

void print_status(const v1::ServerInfo& info, const std::string& server) {
  std::cout << "deformd " << info.version() << " at " << server << ", " << (info.draining() ? "DRAINING" : "serving")
            << ", up for " << duration_text(static_cast<double>(info.uptime_ms()) * 1e-3) << '\n'
            << "  work: " << info.running() << " running on " << info.workers() << " workers, " << info.queue_length()
            << " waiting (limit " << info.queue_limit() << "), " << info.designs_served() << " designs served\n"
            << "  memory: " << bytes_text(info.memory_in_use()) << " in use of " << bytes_text(info.memory_budget())
            << ", process " << bytes_text(info.resident_set_bytes()) << '\n'
            << "  systems: " << info.systems_resident() << " in memory, " << bytes_text(info.cache_bytes()) << " of "
            << bytes_text(info.cache_budget()) << "; " << info.cache_hits() << " hits, " << info.cache_misses() << " misses, "
            << info.cache_evictions() << " evictions\n"
            << "  store: " << info.geometries() << " geometries, " << info.setups() << " setups" << store_text(info) << std::endl;
}

const Error draining(ErrorCode::unavailable, "the server is draining and takes no new work; use another one");

v1::ServerInfo ask(client::ClientOptions options, client::CallOptions call) {
  options.max_attempts = 2;  // the answer is about now; the second one is for what gRPC takes for a failure (see status.cpp)
  if (!call.timeout) call.timeout = patience;
  options.connect_timeout = std::max(options.connect_timeout, *call.timeout);
  return client::Client(options).server_info(call);
}

ExitCode show_one(const client::ClientOptions& options, const CommonOptions& common) {
  const auto info = ask(options, common.call_options());
  if (common.style() == Style::json) {
    auto json = to_json(info);
    if (info.draining()) json["error"] = error_json(draining.code(), draining.what());
    print(json);
  } else {
    print_status(info, options.address);
  }
  if (!info.draining()) return exit_ok;
  complain(draining.what());
  return exit_code_of(draining);
}

/// One after the other; those that do not answer do not keep the others from being shown.
ExitCode show_several(client::ClientOptions options, const std::vector<std::string>& addresses, const CommonOptions& common) {
  auto servers = nlohmann::ordered_json::array();
  ExitCode code = exit_ok;
  for (const std::string& address : addresses) {
    options.address = address;
    nlohmann::ordered_json json = {{"address", address}};
    const auto failed = [&](const Error& error) {
      json["error"] = error_json(error);
      complain(address + ": " + error.what());
      if (code == exit_ok) code = exit_code_of(error);
    };
    try {
      const auto info = ask(options, common.call_options());
      json.update(to_json(info));
      if (common.style() != Style::json) print_status(info, address);
      if (info.draining()) failed(draining);
    } catch (const Error& error) {
      failed(error);
    }
    servers.push_back(std::move(json));
  }
  if (common.style() == Style::json) print({{"servers", servers}});
  return code;
}

ExitCode run_status(const CommonOptions& common) {
  const client::ClientOptions options = common.client_options();
  const auto addresses = client::addresses_of(options.address);
  return addresses.size() == 1 ? show_one(options, common) : show_several(options, addresses, common);
}

}  // namespace

void add_status_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  auto* command = app.add_subcommand("status", "Show how the server is; exit code 0 only when it serves, or all of several do");
  command->footer("Waits at most 15 seconds for each server unless --timeout says otherwise. Fits a container's health check.");
  command->callback([&common, &chosen] { chosen = [&common] { return run_status(common); }; });
}

}  // namespace deform::cli
