// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/setup/contexts.h"

#include <sys/stat.h>
#include <unistd.h>

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <filesystem>
#include <functional>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "client/address.h"
#include "client/cli/commands/command.h"
#include "client/cli/output/result_json.h"
#include "client/cli/sweep/durable_file.h"
#include "core/base/error.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

constexpr char context_footer[] =
    R"(A context is a server and how to be let in, under a name:
  deform context add cluster-a --server a.example.org:50051 --ca ca.pem --token-file alice.token
  deform context use cluster-a               from now on, for every command
  deform --context cluster-b status          this once
They are kept in deform/contexts.yaml of the folder for configurations (~/.config), or in the file DEFORM_CONFIG. Options of the
command line and variables of the environment go before what a context says; with --server or DEFORM_SERVER the context in
use is left out as a whole, so that its token goes to no other server.)";

client::Contexts contexts_of_user() {
  const auto file = client::contexts_file();
  if (file.empty()) {
    throw Error(ErrorCode::failed_precondition,
                "contexts: neither DEFORM_CONFIG nor XDG_CONFIG_HOME nor HOME says where they are");
  }
  return client::read_contexts(file);
}

/// Written whole or not at all, and readable by its owner only.
void write_contexts(const client::Contexts& contexts) {
  std::error_code failure;
  const auto folder = std::filesystem::absolute(contexts.file).parent_path();
  std::filesystem::create_directories(folder, failure);
  if (failure) throw Error(ErrorCode::failed_precondition, "cannot make " + folder.string() + ": " + failure.message());
  const auto part = contexts.file.string() + "." + std::to_string(getpid()) + ".part";
  std::filesystem::remove(part, failure);
  DurableFile file(part);
  ::chmod(part.c_str(), S_IRUSR | S_IWUSR);
  file.append(to_yaml(contexts));
  file.sync();
  file.rename(contexts.file);
}

nlohmann::ordered_json context_json(const std::string& name, const client::Context& context, const std::string& current) {
  nlohmann::ordered_json out = {{"name", name}, {"current", name == current}, {"server", context.server}};
  if (context.replicas) out["replicas"] = true;
  if (context.tls) out["tls"] = true;
  const std::pair<const char*, const std::string&> files[] = {{"ca", context.ca},
                                                              {"cert", context.cert},
                                                              {"key", context.key},
                                                              {"server_name", context.server_name},
                                                              {"token_file", context.token_file}};
  for (const auto& [key, value] : files) {
    if (!value.empty()) out[key] = value;
  }
  return out;
}

ExitCode list_contexts(const CommonOptions& common) {
  const auto contexts = contexts_of_user();
  if (common.style() == Style::json) {
    auto all = nlohmann::ordered_json::array();
    for (const auto& [name, context] : contexts.known) all.push_back(context_json(name, context, contexts.current));
    print({{"file", contexts.file.string()}, {"contexts", all}});
    return exit_ok;
  }
  for (const auto& [name, context] : contexts.known) {
    std::cout << (name == contexts.current ? "* " : "  ") << name << "  " << context.server
              << (context.token_file.empty() ? "" : "  token " + context.token_file) << '\n';
  }
  if (contexts.known.empty()) std::cout << "no contexts in " << contexts.file.string() << "; deform context add makes one\n";
  return exit_ok;
}

std::string absolute_name(const std::filesystem::path& file) {
  return file.empty() ? std::string() : std::filesystem::absolute(file).lexically_normal().string();
}

ExitCode add_context(const std::string& name, const CommonOptions& common) {
  client::check_context_name(name);
  auto contexts = contexts_of_user();
  client::Context context;
  client::addresses_of(common.server);  // says what is wrong with one now, not to whoever uses the context
  context.server = common.server;
  context.replicas = common.replicas;
  context.tls = common.tls;
  context.ca = absolute_name(common.tls_options.ca);
  context.cert = absolute_name(common.tls_options.cert);
  context.key = absolute_name(common.tls_options.key);
  context.server_name = common.tls_options.server_name;
  context.token_file = absolute_name(common.token_file);
  for (const std::string& file : {context.ca, context.cert, context.key, context.token_file}) {
    if (!file.empty() && !std::filesystem::exists(file)) throw Error(ErrorCode::not_found, "context: there is no file " + file);
  }
  contexts.known[name] = context;
  if (contexts.known.size() == 1) contexts.current = name;
  write_contexts(contexts);
  return list_contexts(common);
}

ExitCode use_context(const std::string& name, const CommonOptions& common) {
  auto contexts = contexts_of_user();
  contexts.find(name);
  contexts.current = name;
  write_contexts(contexts);
  return list_contexts(common);
}

ExitCode remove_context(const std::string& name, const CommonOptions& common) {
  auto contexts = contexts_of_user();
  contexts.find(name);
  contexts.known.erase(name);
  if (contexts.current == name) contexts.current.clear();
  write_contexts(contexts);
  return list_contexts(common);
}

/// A verb with the name of a context.
void add_verb(CLI::App& group, const char* verb, const char* help, const CommonOptions& common, Action& chosen,
              std::function<ExitCode(const std::string&, const CommonOptions&)> run) {
  auto name = std::make_shared<std::string>();
  auto* command = group.add_subcommand(verb, help);
  command->add_option("NAME", *name, "Name of the context")->required();
  command->callback(
      [name, &common, &chosen, run = std::move(run)] { chosen = [name, &common, run] { return run(*name, common); }; });
}

}  // namespace

void add_context_command(CLI::App& app, const CommonOptions& common, Action& chosen) {
  auto* group = app.add_subcommand("context", "Servers under names: list, add, use, remove");
  group->footer(context_footer);
  group->require_subcommand(1);
  auto* list = group->add_subcommand("list", "List them; the one in use has a star");
  list->callback([&common, &chosen] { chosen = [&common] { return list_contexts(common); }; });
  add_verb(*group, "add",
           "Add or replace one: what --server, --replicas, --tls, --ca, --cert, --key, --server-name and --token-file say",
           common, chosen, add_context);
  add_verb(*group, "use", "Use one from now on", common, chosen, use_context);
  add_verb(*group, "remove", "Forget one; its files stay", common, chosen, remove_context);
}

}  // namespace deform::cli
