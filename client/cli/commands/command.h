// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <functional>
#include <set>
#include <string>

#include "client/client.h"

namespace deform::cli {

enum ExitCode {
  exit_ok = 0,
  exit_failed = 1,        ///< wrong input, also of some rows of a sweep
  exit_usage = 2,         ///< the command line itself
  exit_unreachable = 3,   ///< no server, no answer in time, or refused until no attempt was left
  exit_verdict = 4,       ///< a gate or verdict failed: inverted cells, missed exact constraints, a split that did not arrive
  exit_interrupted = 130  ///< or cancelled by the operator of the server
};

/// The exit code of a command that ends with this error.
ExitCode exit_code_of(const Error& error);

/// One line on stderr: why the command fails.
void complain(const std::string& message);
/// One line on stderr about what the user should look at, although the command succeeds.
void warn(const std::string& message);

/// How results are printed.
enum class Style { text, json };

/// Options that stand before or after every command.
struct CommonOptions {
  std::string server = "127.0.0.1:50051";
  bool replicas = false;
  bool tls = false;  ///< also when any option of TLS is given
  client::TlsOptions tls_options;
  std::string token_file;
  std::string context;                 ///< named by hand; empty: the one in use, unless an address is given
  std::set<std::string> given;         ///< options that the command line or the environment sets, "--server"
  std::vector<std::string> arguments;  ///< of the process, its name first
  double timeout_seconds = 0;          ///< of every call; 0 = none
  bool json = false;

  Style style() const { return json ? Style::json : Style::text; }
  /// With what the context says. Throws the errors of client::read_contexts() and find().
  client::ClientOptions client_options() const;
  client::CallOptions call_options() const;
};

/// A finite number of at least 0; as CLI::NonNegativeNumber, which tells the largest double with all its 309 digits.
CLI::Validator not_negative();
/// A finite number above 0.
CLI::Validator positive();

/// What main runs after the command line was understood.
using Action = std::function<ExitCode()>;

/// Every command is one file with its options; it adds itself to the application and, when it is the chosen one, sets `chosen`.
/// The common options outlive all.
void add_sample_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_inspect_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_quality_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_register_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_detect_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_prepare_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_context_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_compile_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_apply_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_evaluate_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_compare_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_sweep_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_list_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_show_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_remove_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_status_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_admin_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_bench_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_regions_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_lattice_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_lattice_refine_command(CLI::App& lattice, const CommonOptions& common, Action& chosen);
void add_cage_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_cad_apply_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_cad_move_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_cad_regions_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_schema_command(CLI::App& app, const CommonOptions& common, Action& chosen);
void add_read_isolated_command(CLI::App& app, const CommonOptions& common, Action& chosen);

/// The whole command line: common options and commands. They and `chosen` outlive the application.
void define_command_line(CLI::App& app, CommonOptions& common, Action& chosen);

}  // namespace deform::cli
