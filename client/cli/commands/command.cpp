// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/commands/command.h"

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/TypeTools.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string_view>
#include <vector>

#include "client/cli/output/error_json.h"
#include "client/cli/output/printable_stream.h"
#include "client/cli/output/result_json.h"
#include "client/cli/run.h"
#include "client/setup/contexts.h"
#include "core/base/commit/commit.h"
#include "core/base/text.h"

namespace deform::cli {

namespace {

/// A finite number that `fits`, else `wanted` is said.
CLI::Validator number_that(const char* wanted, const char* type, bool (*fits)(double)) {
  const auto check = [wanted, fits](const std::string& text) {
    double value = 0;
    const bool read = CLI::detail::lexical_cast(text, value) && std::isfinite(value);
    return read && fits(value) ? std::string() : text + ", expected " + wanted;
  };
  return {check, type};
}

/// What a context says and no option nor variable does. With an address by hand, the context in use is nobody's: its token would
/// go to another server.
CommonOptions with_context(CommonOptions common) {
  const auto given = [&](const char* option) { return common.given.contains(option); };
  if (common.context.empty() && given("--server")) return common;
  const auto contexts = client::read_contexts(client::contexts_file());
  const std::string name = common.context.empty() ? contexts.current : common.context;
  if (name.empty()) return common;
  const client::Context& context = contexts.find(name);
  if (!given("--server") && !context.server.empty()) common.server = context.server;
  if (!given("--replicas")) common.replicas = context.replicas;
  if (!given("--tls")) common.tls = context.tls;
  if (!given("--ca")) common.tls_options.ca = context.ca;
  if (!given("--cert") && !given("--key")) {
    common.tls_options.cert = context.cert;
    common.tls_options.key = context.key;
  }
  if (!given("--server-name")) common.tls_options.server_name = context.server_name;
  if (!given("--token-file")) common.token_file = context.token_file;
  return common;
}

}  // namespace

CLI::Validator not_negative() {
  return number_that("a finite number of at least 0", "NONNEGATIVE", [](double value) { return value >= 0; });
}

CLI::Validator positive() {
  return number_that("a finite number above 0", "POSITIVE", [](double value) { return value > 0; });
}

client::ClientOptions CommonOptions::client_options() const {
  const CommonOptions used = with_context(*this);
  const client::TlsOptions& files = used.tls_options;
  client::ClientOptions options;
  options.address = used.server;
  options.replicas = used.replicas;
  if (used.tls || !files.ca.empty() || !files.cert.empty() || !files.key.empty() || !files.server_name.empty())
    options.tls = files;
  options.token_file = used.token_file;
  return options;
}

client::CallOptions CommonOptions::call_options() const {
  client::CallOptions options;
  if (timeout_seconds > 0) {
    options.timeout = std::chrono::milliseconds(static_cast<std::int64_t>(std::ceil(timeout_seconds * 1e3)));
  }
  return options;
}

ExitCode exit_code_of(const Error& error) {
  switch (error.code()) {
    case ErrorCode::cancelled:
      return exit_interrupted;
    case ErrorCode::unavailable:
    case ErrorCode::deadline_exceeded:
      return exit_unreachable;
    case ErrorCode::out_of_budget:  // with a hint the same request may succeed later, without one only another request can
      return error.retry_after_ms() > 0 ? exit_unreachable : exit_failed;
    default:
      return exit_failed;
  }
}

namespace {

std::string one_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  std::string line;
  for (const char c : text) line += c == '\n' ? std::string("; ") : std::string(1, c);
  return line;
}

}  // namespace

void complain(const std::string& message) { std::cerr << "deform: " << printable(one_line(message)) << std::endl; }

void warn(const std::string& message) { complain("warning: " + message); }

namespace {

constexpr char main_footer[] = R"(A first round, with deformd running on this machine:
  deform sample -o ahmed.obj                 write a reference car body
  deform inspect ahmed.obj                   what is in it
  deform prepare setup.yaml                  register and factorize once
  deform apply setup.yaml --set roof_up=0.03 -o out.obj
  deform sweep setup.yaml --designs designs.csv -o results/

Exit codes: 0 done; 1 wrong input, also of some rows of a sweep; 2 wrong usage; 3 server unreachable, deadline passed, or
still refused after all attempts; 4 a gate or verdict failed: --fail-on, inverted cells, missed exact constraints, a split
that did not arrive; 130 interrupted by Ctrl-C (the server stops working on the request too), or cancelled by the server's
operator. One line on stderr says why;
with --json there is {"error": {"code", "message", "field"}} on stdout, too, and "request_id" of a call that was sent: the
server's log has it as client_request.
The environment variables DEFORM_SERVER, DEFORM_REPLICAS, DEFORM_TLS, DEFORM_CA, DEFORM_CERT, DEFORM_KEY,
DEFORM_SERVER_NAME and DEFORM_TOKEN_FILE stand for the options of these names, DEFORM_CONTEXT for --context (deform context --help).)";

/// Whoever looks after the server is no help with what is wrong with the input.
bool is_of_input(const nlohmann::ordered_json& error) {
  for (const char* code : {"INVALID_ARGUMENT", "NOT_FOUND", "ALREADY_EXISTS", "FAILED_PRECONDITION", "CANCELLED"}) {
    if (error.at("code") == code) return true;
  }
  return false;
}

/// The line for people, and with --json the same for machines.
ExitCode fail(ExitCode code, const nlohmann::ordered_json& error, Style style) {
  std::string message = error.at("message");
  if (error.contains("request_id") && !is_of_input(error)) message += " (request id " + std::string(error["request_id"]) + ")";
  complain(message);
  if (style == Style::json) print({{"error", error}});
  return code;
}

ExitCode run_action(const Action& action, Style style) {
  try {
    return action();
  } catch (const Error& error) {
    return fail(exit_code_of(error), error_json(error), style);
  } catch (const CLI::ParseError& error) {  // what is wrong with the command line can depend on the files it names
    return fail(exit_usage, usage_error_json(error.what()), style);
  } catch (const std::bad_alloc&) {
    return fail(exit_failed, error_json(ErrorCode::out_of_budget, "not enough memory on this machine for this mesh"), style);
  } catch (const std::exception& error) {
    return fail(exit_failed, error_json(ErrorCode::internal, error.what()), style);
  }
}

/// "; did you mean "apply"?", or `otherwise` where no candidate is near.
std::string hint(const std::string& name, const std::vector<std::string>& candidates, const std::string& otherwise) {
  const std::string near = nearest_names(name, candidates);
  return near.empty() ? otherwise : "; did you mean " + near + "?";
}

bool is_option(const std::string& argument) {
  return argument.size() > 1 && argument[0] == '-' && std::string_view("0123456789.").find(argument[1]) == std::string_view::npos;
}

/// The application and the commands within it that were chosen, outermost first.
std::vector<const CLI::App*> chain_of(const CLI::App& app) {
  std::vector<const CLI::App*> chain{&app};
  for (auto within = app.get_subcommands(); !within.empty(); within = within.front()->get_subcommands()) {
    chain.push_back(within.front());
  }
  return chain;
}

/// Adds the long options of a command, those in groups included.
void add_options(const CLI::App& command, std::vector<std::string>& names) {
  for (const CLI::Option* option : command.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  for (const CLI::App* group : command.get_subcommands([](const CLI::App* within) { return within->get_name().empty(); })) {
    add_options(*group, names);
  }
}

/// The unknown options among the arguments, as they were typed, each with those that are near.
std::string unknown_options(const std::vector<const CLI::App*>& chain, const std::vector<std::string>& unknown) {
  std::vector<std::string> known;
  for (const CLI::App* command : chain) add_options(*command, known);
  std::vector<std::string> said;
  for (const std::string& argument : unknown) {
    if (!is_option(argument)) continue;
    const std::string name = argument.substr(0, argument.find('='));
    const std::string near = nearest_names(name, known);
    said.push_back("\"" + name + "\"" + (near.empty() ? "" : " (did you mean " + near + "?)"));
  }
  std::string all;
  for (const std::string& each : said) all += (all.empty() ? "" : ", ") + each;
  return all.empty() ? all : (said.size() == 1 ? "unknown option " : "unknown options ") + all;
}

std::string usage_error(const CLI::App& app, const CLI::ParseError& error) {
  const std::vector<const CLI::App*> chain = chain_of(app);
  const auto unknown = app.remaining(true);
  std::string command;
  for (std::size_t i = 1; i < chain.size(); ++i) command += chain[i]->get_name() + " ";
  const std::string help = "; see deform " + command + "--help";
  const CLI::App& last = *chain.back();
  if (!unknown.empty() && !is_option(unknown.front()) && last.get_require_subcommand_min() > 0) {
    std::vector<std::string> names;
    for (const CLI::App* each : last.get_subcommands({})) names.push_back(each->get_name());
    return "there is no command \"" + command + unknown.front() + "\"" + hint(unknown.front(), names, help);
  }
  // An option that is required may be missing because it is one of the unknown ones.
  const auto kind = static_cast<CLI::ExitCodes>(error.get_exit_code());
  if (kind == CLI::ExitCodes::ExtrasError || kind == CLI::ExitCodes::RequiredError) {
    const std::string options = unknown_options(chain, unknown);
    if (!options.empty()) return options + help;
  }
  if (kind == CLI::ExitCodes::ExtrasError) {
    std::string all;
    for (const std::string& argument : unknown) all += (all.empty() ? "\"" : ", \"") + argument + "\"";
    return (unknown.size() == 1 ? "unexpected argument " : "unexpected arguments ") + all + help;
  }
  return error.what() + help;
}

void add_common_options(CLI::App& app, CommonOptions& common) {
  app.add_option("--server", common.server, "Address of deformd, HOST:PORT; several with commas")
      ->envname("DEFORM_SERVER")
      ->capture_default_str();
  app.add_flag("--replicas", common.replicas, "The address stands for several servers: bring to each what it lacks")
      ->envname("DEFORM_REPLICAS");
  app.add_flag("--tls", common.tls, "Encrypt, and trust the authorities that this machine trusts")->envname("DEFORM_TLS");
  app.add_option("--ca", common.tls_options.ca, "Encrypt, and trust the authorities in this file, PEM")->envname("DEFORM_CA");
  app.add_option("--cert", common.tls_options.cert, "Certificate to show to the server, PEM; with --key")->envname("DEFORM_CERT");
  app.add_option("--key", common.tls_options.key, "Its private key, PEM without a passphrase")->envname("DEFORM_KEY");
  app.add_option("--server-name", common.tls_options.server_name,
                 "Name that the server's certificate must have, if not the host of --server")
      ->envname("DEFORM_SERVER_NAME");
  app.add_option("--token-file", common.token_file, "File with the token that says who calls")->envname("DEFORM_TOKEN_FILE");
  app.add_option("--context", common.context, "Server and credentials that `deform context add` has named")
      ->envname("DEFORM_CONTEXT");
  app.add_option("--timeout", common.timeout_seconds, "Seconds that one call to the server may take; 0: no limit")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app.add_flag("--json", common.json, "Print results as JSON, for machines");
}

}  // namespace

void define_command_line(CLI::App& app, CommonOptions& common, Action& chosen) {
  app.name("deform");
  app.description("deform: client of deformd, deformation of meshes for shape optimization");
  app.set_version_flag("--version", version_line("deform"));
  app.footer(main_footer);
  app.fallthrough();
  app.require_subcommand(1);
  app.get_formatter()->column_width(38);
  add_common_options(app, common);
  for (const auto add :
       {add_sample_command,       add_inspect_command,  add_quality_command,   add_register_command,    add_detect_command,
        add_context_command,      add_prepare_command,  add_compile_command,   add_apply_command,       add_sweep_command,
        add_evaluate_command,     add_compare_command,  add_list_command,      add_show_command,        add_remove_command,
        add_status_command,       add_admin_command,    add_bench_command,     add_regions_command,     add_lattice_command,
        add_cage_command,         add_cad_move_command, add_cad_apply_command, add_cad_regions_command, add_schema_command,
        add_read_isolated_command}) {
    add(app, common, chosen);
  }
}

int run(int argc, const char* const* argv) {
  const PrintableStream out(std::cout), err(std::cerr);
  setenv("GRPC_VERBOSITY", "NONE", 0);  // errors are printed in one line, by us
  CommonOptions common;
  common.arguments.assign(argv, argv + argc);
  Action chosen;
  CLI::App app;
  define_command_line(app, common, chosen);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    app.exit(help);
    return exit_ok;
  } catch (const CLI::ParseError& error) {
    // Reading the command line may have ended before --json.
    const bool json = std::any_of(argv, argv + argc, [](const char* argument) { return std::string(argument) == "--json"; });
    return fail(exit_usage, usage_error_json(usage_error(app, error)), json ? Style::json : Style::text);
  }
  for (const CLI::Option* option : app.get_options()) {
    if (option->count() > 0) common.given.insert(option->get_name());
  }
  const ExitCode code = run_action(chosen, common.style());
  std::cout.flush();
  if (std::cout.good()) return code;
  complain("standard output cannot be written: what was to be printed is lost");
  return code == exit_ok ? exit_failed : code;
}

}  // namespace deform::cli
