// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/admin.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <chrono>
#include <functional>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "client/cli/commands/command.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/format.h"
#include "client/cli/output/result_json.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

constexpr char admin_footer[] =
    R"(For whoever looks after a server, one at a time: with several addresses in --server the first one is meant. Needs the role operator
where the server asks who calls. Whoever has it with tenant=NAME has calls, cancel and evict for that tenant alone. Every act is in
the log of the server with the identity of who did it. All but check and backup wait for at most 30 seconds unless --timeout says
otherwise. What takes a stopped server is done there:
  deformd store rebuild --data-dir data
  deformd store restore DIR --data-dir data)";

constexpr std::chrono::seconds admin_patience{30};

/// The server that is meant.
class AdminConnection {
 public:
  explicit AdminConnection(const CommonOptions& common) : common_(common), connection_(common), admin_(connection_.client()) {}
  client::Admin& admin() { return admin_; }
  /// A server that does not answer is what one wants to hear of soon.
  client::CallOptions call() const {
    client::CallOptions options = connection_.call();
    if (!options.timeout) options.timeout = admin_patience;
    return options;
  }
  /// For what reads the whole store.
  client::CallOptions long_call() const { return connection_.call(); }
  Style style() const { return common_.style(); }

 private:
  const CommonOptions& common_;
  Connection connection_;
  client::Admin admin_;
};

using Row = std::vector<std::string>;

/// Columns as wide as their widest cell, the first row above them; the last column is not filled up.
void print_table(const std::vector<Row>& rows) {
  std::vector<std::size_t> widths(rows.front().size());
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      const bool last = i + 1 == row.size();
      std::cout << row[i] << (last ? std::string() : std::string(widths[i] - row[i].size() + 2, ' '));
    }
    std::cout << '\n';
  }
  std::cout << std::flush;
}

std::string age_text(std::uint64_t milliseconds) { return duration_text(static_cast<double>(milliseconds) * 1e-3); }

/// "CALL_RUNNING" -> "running"
std::string state_text(const v1::CallInfo& call) {
  std::string name = v1::CallState_Name(call.state());
  if (const auto at = name.rfind('_'); at != std::string::npos) name = name.substr(at + 1);
  return lower_case(name);
}

/// The beginning of an id, or of what else a client wrote.
std::string short_id(const std::string& id) { return printable(id.substr(0, 16)); }

std::string dash_for_none(const std::string& text) { return text.empty() ? "-" : text; }

/// What it is about: of a call that waits also how many have waited longer.
Row row_of(const v1::CallInfo& call) {
  std::string method = printable(call.method());
  if (call.stream() != 0) method += " " + std::to_string(call.stream()) + "/" + std::to_string(call.stream_request());
  std::string state = state_text(call);
  if (call.state() == v1::CALL_WAITING) state += " after " + std::to_string(call.ahead());
  std::string who = dash_for_none(printable(call.identity()));
  if (call.tenant() != "default") who += " of " + printable(call.tenant());
  const std::string about = !call.system().empty()     ? "system " + short_id(call.system())
                            : !call.geometry().empty() ? "geometry " + short_id(call.geometry())
                                                       : "-";
  return {std::to_string(call.id()),
          method,
          state,
          age_text(call.milliseconds()),
          age_text(call.state_milliseconds()),
          bytes_text(call.bytes_held()),
          call.cost() > 0 ? number_text(call.cost()) : "-",
          who,
          dash_for_none(printable(call.peer())),
          about};
}

ExitCode show_calls(AdminConnection& server) {
  const auto reply = server.admin().calls(server.call());
  if (server.style() == Style::json) return print(to_json(reply)), exit_ok;
  std::vector<Row> rows = {{"ID", "METHOD", "STATE", "AGE", "IN STATE", "HOLDS", "COST", "WHO", "FROM", "ABOUT"}};
  for (const auto& call : reply.calls()) rows.push_back(row_of(call));
  if (rows.size() == 1) {
    std::cout << "no calls under way" << std::endl;
  } else {
    print_table(rows);
  }
  if (reply.left_out() > 0) std::cout << "and " << reply.left_out() << " more" << std::endl;
  return exit_ok;
}

ExitCode cancel_call(AdminConnection& server, std::uint64_t id, const std::string& reason) {
  const auto reply = server.admin().cancel(id, reason, server.call());
  if (server.style() == Style::json) return print(to_json(reply)), exit_ok;
  const v1::CallInfo& call = reply.call();
  std::cout << "cancelled " << printable(call.method()) << " of "
            << printable(call.identity().empty() ? call.peer() : call.identity()) << ", which was " << state_text(call)
            << " after " << age_text(call.milliseconds()) << std::endl;
  return exit_ok;
}

ExitCode drain(AdminConnection& server) {
  const auto reply = server.admin().drain(server.call());
  if (server.style() == Style::json) return print(to_json(reply)), exit_ok;
  std::cout << "draining: new work is refused, " << reply.calls() << " calls are under way; deform admin undrain ends it"
            << std::endl;
  return exit_ok;
}

ExitCode undrain(AdminConnection& server) {
  server.admin().undrain(server.call());
  if (server.style() == Style::json) return print(nlohmann::ordered_json::object()), exit_ok;
  std::cout << "work is taken again" << std::endl;
  return exit_ok;
}

ExitCode evict(AdminConnection& server, const std::string& id, bool all) {
  if (id.empty() != all) throw CLI::ValidationError("ID", "name a system, or give --all, and not both");
  const auto reply = all ? server.admin().evict_all(server.call()) : server.admin().evict(id, server.call());
  if (server.style() == Style::json) return print(to_json(reply)), exit_ok;
  std::cout << reply.systems() << " systems taken out of memory, " << bytes_text(reply.bytes());
  if (reply.in_use() > 0) std::cout << "; calls compute with " << reply.in_use() << " of them and keep these until they end";
  std::cout << std::endl;
  return exit_ok;
}

ExitCode show_connections(AdminConnection& server) {
  const auto reply = server.admin().connections(server.call());
  if (server.style() == Style::json) return print(to_json(reply)), exit_ok;
  std::vector<Row> rows = {{"FROM", "AGE", "CALLS", "WHO"}};
  for (const auto& connection : reply.connections()) {
    std::string who;
    for (const auto& identity : connection.identities()) who += (who.empty() ? "" : ", ") + printable(identity);
    rows.push_back({connection.peer().empty() ? "unix socket" : printable(connection.peer()), age_text(connection.milliseconds()),
                    std::to_string(connection.calls()), dash_for_none(who)});
  }
  print_table(rows);
  std::cout << reply.open() << " open, at most " << reply.limit() << "; " << reply.refused() << " refused and " << reply.cut_off()
            << " cut off since the start" << std::endl;
  return exit_ok;
}

ExitCode limits(AdminConnection& server, const std::vector<std::string>& changes) {
  std::vector<std::pair<std::string, std::string>> wanted;
  for (const auto& change : changes) {
    const auto at = change.find('=');
    if (at == 0 || at == std::string::npos) throw CLI::ValidationError("NAME=VALUE", "\"" + change + "\" is not NAME=VALUE");
    wanted.emplace_back(change.substr(0, at), change.substr(at + 1));
  }
  for (const auto& [name, value] : wanted) server.admin().set_limit(name, value, server.call());
  const auto reply = server.admin().limits(server.call());
  if (server.style() == Style::json) return print(to_json(reply)), exit_ok;
  std::vector<Row> rows = {{"LIMIT", "VALUE", "CHANGE"}};
  for (const auto& limit : reply.limits()) {
    const std::string how = limit.changed()      ? "changed, until a restart"
                            : limit.changeable() ? "while it runs"
                                                 : "takes a restart";
    rows.push_back({printable(limit.name()), printable(limit.value()), how});
  }
  print_table(rows);
  return exit_ok;
}

ExitCode print_report(AdminConnection& server, const v1::StoreReply& reply) {
  if (server.style() == Style::json) {
    print(to_json(reply));
  } else {
    for (const auto& line : reply.lines()) std::cout << printable(line) << '\n';
    std::cout << std::flush;
  }
  if (reply.well()) return exit_ok;
  complain("the store has faults");
  return exit_failed;
}

/// Adds a verb; `run` gets the connection.
CLI::App* add_verb(CLI::App& group, const char* verb, const char* help, const CommonOptions& common, Action& chosen,
                   std::function<ExitCode(AdminConnection&)> run) {
  auto* command = group.add_subcommand(verb, help);
  command->callback([&common, &chosen, run = std::move(run)] {
    chosen = [&common, run] {
      AdminConnection server(common);
      return run(server);
    };
  });
  return command;
}

struct AdminOptions {
  std::uint64_t call = 0;
  std::string reason, system, directory;
  bool all = false;
  std::vector<std::string> changes;
};

}  // namespace

void add_admin_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  const auto options = std::make_shared<AdminOptions>();
  auto* group = app.add_subcommand("admin", "Look after a running server: calls, drain, memory, connections, limits, store");
  group->footer(admin_footer);
  group->require_subcommand(1);
  add_verb(*group, "calls", "List the calls under way, the oldest first", common, chosen, show_calls)
      ->footer(
          "STATE: open (messages on their way, or waiting for a turn), waiting (in the queue, after so many who have waited "
          "longer),\n"
          "preparing (its system), running. HOLDS: bytes charged for this call alone. COST: its work as the queue counts it, in\n"
          "points. A request of a stream has the id of the stream's call and its number behind the method.");
  auto* cancel = add_verb(*group, "cancel", "End a call; its client gets an error, and does not repeat it", common, chosen,
                          [options](AdminConnection& server) { return cancel_call(server, options->call, options->reason); });
  cancel->add_option("ID", options->call, "Number of the call, as deform admin calls shows it")->required();
  cancel->add_option("--reason", options->reason, "Text that is added to the error of its client");
  add_verb(*group, "drain", "Refuse new work, so that clients go to another server; what runs is finished", common, chosen,
           drain);
  add_verb(*group, "undrain", "Take work again", common, chosen, undrain);
  auto* evicting = add_verb(*group, "evict", "Take systems out of memory; their next use prepares them again", common, chosen,
                            [options](AdminConnection& server) { return evict(server, options->system, options->all); });
  evicting->add_option("ID", options->system, "Id of a system, or its first digits (at least 8)");
  evicting->add_flag("--all", options->all, "All systems");
  add_verb(*group, "connections", "List open connections", common, chosen, show_connections)
      ->footer("CALLS and WHO are of the calls under way: a connection has no identity of its own.");
  add_verb(*group, "limits", "Show the limits in force, or change them until a restart", common, chosen,
           [options](AdminConnection& server) { return limits(server, options->changes); })
      ->add_option("NAME=VALUE", options->changes, "A limit and its new value, written as for the option of deformd");
  add_verb(*group, "check", "Read and verify every file of the store", common, chosen,
           [](AdminConnection& server) { return print_report(server, server.admin().check_store(server.long_call())); });
  add_verb(*group, "backup", "Make a folder of the server's machine a copy of the store", common, chosen,
           [options](AdminConnection& server) {
             return print_report(server, server.admin().backup_store(options->directory, server.long_call()));
           })
      ->add_option("DIR", options->directory, "New or empty, absolute, on the server's machine")
      ->required();
}

}  // namespace deform::cli
