// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/options.h"

#include <spdlog/spdlog.h>
#include <yaml-cpp/yaml.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <map>
#include <set>
#include <string_view>
#include <utility>

#include "core/base/commit/commit.h"
#include "core/base/text.h"
#include "server/store/postgres_catalog.h"

namespace deform::server {

namespace {

Error bad(const std::string& what) { return {ErrorCode::invalid_argument, what}; }

bool parse_switch(const std::string& text) {
  if (text == "true" || text == "1" || text == "yes" || text == "on") return true;
  if (text == "false" || text == "0" || text == "no" || text == "off") return false;
  throw bad("\"" + text + "\" is neither true nor false");
}

/// One option, wherever it is set.
struct Option {
  std::string name;   ///< --memory-budget, DEFORMD_MEMORY_BUDGET, memory_budget:
  std::string value;  ///< what kind of value, for the help; empty for a switch
  std::string help;
  std::function<void(Configuration&, const std::string&)> set;
  std::function<std::string(const Configuration&)> show;

  std::string key() const {
    std::string out = name;
    std::replace(out.begin(), out.end(), '-', '_');
    return out;
  }
  std::string variable() const {
    std::string out = "DEFORMD_" + key();
    std::transform(out.begin(), out.end(), out.begin(), [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    return out;
  }
};

/// field(configuration) -> reference to a number.
template <typename Field>
Option number(const char* name, const char* help, Field field) {
  using T = std::decay_t<decltype(field(std::declval<Configuration&>()))>;
  return {name, "N", help, [field](Configuration& c, const std::string& text) { field(c) = parse_number<T>(text); },
          [field](const Configuration& c) { return std::to_string(field(const_cast<Configuration&>(c))); }};
}

template <typename Field>
Option bytes(const char* name, const char* help, Field field) {
  return {name, "SIZE", help, [field](Configuration& c, const std::string& text) { field(c) = parse_bytes(text); },
          [field](const Configuration& c) { return to_text(field(const_cast<Configuration&>(c))); }};
}

template <typename Field>
Option path(const char* name, const char* help, Field field) {
  return {name, "PATH", help, [field](Configuration& c, const std::string& text) { field(c) = text; },
          [field](const Configuration& c) { return field(const_cast<Configuration&>(c)).string(); }};
}

template <typename Field>
Option whole_seconds(const char* name, const char* help, Field field) {
  return {name, "SECONDS", help,
          [field](Configuration& c, const std::string& text) {
            field(c) = std::chrono::duration_cast<std::chrono::seconds>(parse_seconds(text));
          },
          [field](const Configuration& c) { return to_seconds(field(const_cast<Configuration&>(c))); }};
}

void add_network_options(std::vector<Option>& all) {
  all.push_back({"address", "HOST:PORT", "where to listen; port 0 takes a free one; unix:PATH works too",
                 [](Configuration& c, const std::string& text) { c.server.address = text; },
                 [](const Configuration& c) { return c.server.address; }});
  all.push_back({"metrics-address", "HOST:PORT", "where /metrics, /livez and /readyz answer in plain HTTP; empty: nowhere",
                 [](Configuration& c, const std::string& text) { c.server.metrics_address = text; },
                 [](const Configuration& c) { return c.server.metrics_address; }});
  all.push_back(
      {"insecure", "", "listen beyond this machine without encryption: others can read, change and call everything",
       [](Configuration& c, const std::string& text) {
         c.server.security = parse_switch(text) ? TransportSecurity::insecure : TransportSecurity::loopback_only;
       },
       [](const Configuration& c) { return std::string(c.server.security == TransportSecurity::insecure ? "true" : "false"); }});
  all.push_back(path(
      "tls-cert", "certificate of the server, PEM, with those between it and its authority; turns TLS on. Reread when it changes",
      [](Configuration & c) -> auto& { return c.server.tls.certificate; }));
  all.push_back(path(
      "tls-key", "its private key, PEM without a passphrase", [](Configuration & c) -> auto& { return c.server.tls.key; }));
  all.push_back(path(
      "tls-client-ca", "authorities, PEM: every client must show a certificate of one of them",
      [](Configuration & c) -> auto& { return c.server.tls.client_ca; }));
  all.push_back(path(
      "tls-client-crl", "certificates that these authorities have revoked (CRL, PEM); reread, open connections included",
      [](Configuration & c) -> auto& { return c.server.tls.client_crl; }));
  all.push_back(path(
      "identities",
      "who may call: lines \"NAME reader|user|owner|operator sha256:HASH\" of tokens or \"... certificate:NAME\"; reread",
      [](Configuration & c) -> auto& { return c.server.service.access.identities; }));
  all.push_back({"trusted-proxies", "LIST",
                 "addresses and networks of proxies, with commas, whose x-forwarded-for says which host calls",
                 [](Configuration& c, const std::string& text) { c.server.service.proxies = TrustedProxies(text); },
                 [](const Configuration& c) { return c.server.service.proxies.text(); }});
  all.push_back({"reflection", "on|off", "whether clients may ask for the contract (gRPC server reflection)",
                 [](Configuration& c, const std::string& text) {
                   c.server.reflection = parse_switch(text) ? Reflection::on : Reflection::off;
                 },
                 [](const Configuration& c) { return std::string(c.server.reflection == Reflection::on ? "on" : "off"); }});
  all.push_back(path(
      "port-file", "write the port that is listened on to this file", [](Configuration & c) -> auto& { return c.port_file; }));
  all.push_back(whole_seconds(
      "keep-alive", "a connection silent for so long is asked whether it lives",
      [](Configuration & c) -> auto& { return c.server.keep_alive; }));
  all.push_back(whole_seconds(
      "keep-alive-timeout", "and closed when it does not answer for so long",
      [](Configuration & c) -> auto& { return c.server.keep_alive_timeout; }));
  all.push_back(number(
      "max-calls-per-connection", "calls open at once on one connection",
      [](Configuration & c) -> auto& { return c.server.max_calls_per_connection; }));
  all.push_back(number(
      "max-connections", "connections open at once; 0: what open files allow, at most 4096. More are closed at once",
      [](Configuration & c) -> auto& { return c.server.max_connections; }));
  all.push_back(whole_seconds(
      "connection-idle", "a connection without a call for so long is closed; 0: never",
      [](Configuration & c) -> auto& { return c.server.connection_idle; }));
  all.push_back(whole_seconds(
      "connection-age", "a connection so old takes no new calls, so that its client connects again; 0: never",
      [](Configuration & c) -> auto& { return c.server.connection_age; }));
  all.push_back(whole_seconds(
      "connection-age-grace", "and is cut off after so long; 0: never",
      [](Configuration & c) -> auto& { return c.server.connection_age_grace; }));
}

void add_engine_options(std::vector<Option>& all) {
  all.push_back(path(
      "data-dir", "where geometries and setups are kept; created when missing",
      [](Configuration & c) -> auto& { return c.server.engine.data_dir; }));
  all.push_back({"catalog", "URI",
                 "of a database of PostgreSQL, postgresql://HOST/NAME, for servers that share --data-dir; no password",
                 [](Configuration& c, const std::string& text) {
                   if (!text.empty()) check_catalog_uri(text);  // before it could be shown
                   c.server.engine.catalog = text;
                 },
                 [](const Configuration& c) { return c.server.engine.catalog; }});
  all.push_back(bytes(
      "keep-free", "room that stays free on the disk of --data-dir: with less, geometries and setups can only be deleted",
      [](Configuration & c) -> auto& { return c.server.engine.keep_free; }));
  all.push_back(bytes(
      "max-stored-bases",
      "disk for handle bases of prepared systems, from which designs are served at once after a restart; 0: none are kept",
      [](Configuration & c) -> auto& { return c.server.engine.max_stored_bases; }));
  all.push_back({"stored-bases-from", "SECONDS", "bases of preparations that took at least that long are kept there",
                 [](Configuration& c, const std::string& text) { c.server.engine.stored_from = parse_seconds(text); },
                 [](const Configuration& c) { return to_seconds(c.server.engine.stored_from); }});
  all.push_back(bytes(
      "memory-budget", "memory for systems and requests; 0: 80 % of what the machine or its cgroup has",
      [](Configuration & c) -> auto& { return c.server.engine.memory_budget; }));
  all.push_back(bytes(
      "cache-budget", "memory for systems that wait for their next use; 0: half of the memory budget",
      [](Configuration & c) -> auto& { return c.server.engine.cache_budget; }));
  all.push_back(number(
      "workers", "requests computed at once; 0: one per core of the machine or its cgroup",
      [](Configuration & c) -> auto& { return c.server.engine.workers; }));
  all.push_back(number(
      "queue-limit", "requests that may wait; more are refused with a retry hint",
      [](Configuration & c) -> auto& { return c.server.engine.queue_limit; }));
  all.push_back(number(
      "max-points", "points of a geometry", [](Configuration & c) -> auto& { return c.server.engine.max_points; }));
  all.push_back(number(
      "max-faces", "faces of a geometry", [](Configuration & c) -> auto& { return c.server.engine.max_faces; }));
  all.push_back(number(
      "max-groups", "groups of a geometry", [](Configuration & c) -> auto& { return c.server.engine.max_groups; }));
  all.push_back(number(
      "max-designs", "designs of a request", [](Configuration & c) -> auto& { return c.server.engine.max_designs; }));
  all.push_back(number(
      "max-handles", "handles of a setup", [](Configuration & c) -> auto& { return c.server.engine.max_handles; }));
  all.push_back(number(
      "max-setup-work", "regions of a setup times points of its geometry",
      [](Configuration & c) -> auto& { return c.server.engine.max_setup_work; }));
  all.push_back(number(
      "block-points", "points per block on the wire, 256 to 40000",
      [](Configuration & c) -> auto& { return c.server.engine.block_points; }));
}

void add_service_options(std::vector<Option>& all) {
  all.push_back(number(
      "max-open-requests", "open requests of one DeformStream",
      [](Configuration & c) -> auto& { return c.server.service.stream.open_requests; }));
  all.push_back(number(
      "max-running-requests", "of those, in the queue or computed at once",
      [](Configuration & c) -> auto& { return c.server.service.stream.running_requests; }));
  all.push_back(bytes(
      "max-setup-bytes", "size of a setup that comes in pieces, as all above 1 MiB do",
      [](Configuration & c) -> auto& { return c.server.service.max_setup_bytes; }));
  all.push_back(bytes(
      "max-buffered-bytes", "requests of one DeformStream held in memory before it stops reading",
      [](Configuration & c) -> auto& { return c.server.service.stream.buffered_bytes; }));
  all.push_back({"max-deadline", "SECONDS", "a call, or a request of a DeformStream, that takes longer is ended; 0: never",
                 [](Configuration& c, const std::string& text) { c.server.service.max_deadline = parse_seconds(text); },
                 [](const Configuration& c) { return to_seconds(c.server.service.max_deadline); }});
  all.push_back(
      {"stall-timeout", "SECONDS",
       "a call whose client sends nothing more of a request, or takes nothing of an answer, for so long is ended; 0: never",
       [](Configuration& c, const std::string& text) { c.server.service.stall_timeout = parse_seconds(text); },
       [](const Configuration& c) { return to_seconds(c.server.service.stall_timeout); }});
  all.push_back(number(
      "max-calls", "calls open at once, more are refused with a retry hint; 0: as many as take an eighth of the memory budget",
      [](Configuration & c) -> auto& { return c.server.service.max_calls; }));
  all.push_back(number(
      "call-threads", "threads for calls that wait for the disk: so many for questions, and as many for meshes and setups",
      [](Configuration & c) -> auto& { return c.server.service.call_threads; }));
  all.push_back(number(
      "max-waiting-calls", "calls that may wait for those; more are refused with a retry hint",
      [](Configuration & c) -> auto& { return c.server.service.waiting_calls; }));
}

void add_process_options(std::vector<Option>& all) {
  all.push_back({"grace", "SECONDS", "time for what is under way when the server is asked to stop",
                 [](Configuration& c, const std::string& text) { c.grace = parse_seconds(text); },
                 [](const Configuration& c) { return to_seconds(c.grace); }});
  all.push_back({"log-level", "LEVEL", "trace, debug, info, warning, error, critical or off",
                 [](Configuration& c, const std::string& text) { c.log.level = parse_level(text); },
                 [](const Configuration& c) { return to_text(c.log.level); }});
  all.push_back({"log-format", "text|json", "one line per record; json: an object with the fields of a call",
                 [](Configuration& c, const std::string& text) {
                   if (text != "text" && text != "json") throw bad("\"" + text + "\" is neither text nor json");
                   c.log.format = text == "json" ? LogFormat::json : LogFormat::text;
                 },
                 [](const Configuration& c) { return std::string(c.log.format == LogFormat::json ? "json" : "text"); }});
  all.push_back(number(
      "log-calls", "lines of calls in a second of the log, and of gRPC; those beyond are counted; 0: any number",
      [](Configuration & c) -> auto& { return c.log.calls_per_second; }));
  all.push_back(path(
      "log-file", "append the log to this file instead of standard error",
      [](Configuration & c) -> auto& { return c.log.file; }));
}

std::vector<Option> all_options() {
  std::vector<Option> all;
  add_network_options(all);
  add_engine_options(all);
  add_service_options(all);
  add_process_options(all);
  return all;
}

struct Given {
  std::string value;
  std::string source;
};
/// By name of the option.
using Values = std::map<std::string, Given>;

const Option* find_key(const std::vector<Option>& options, const std::string& key) {
  const auto found = std::find_if(options.begin(), options.end(), [&](const Option& o) { return o.key() == key; });
  return found == options.end() ? nullptr : &*found;
}

void read_entry(const std::vector<Option>& options, const std::string& file, const YAML::Node& key, const YAML::Node& value,
                Values& out) {
  const std::string place = file + ":" + std::to_string(key.Mark().line + 1);
  if (!key.IsScalar()) throw bad(place + ": an option name was expected");
  const Option* option = find_key(options, key.Scalar());
  if (option == nullptr) {
    std::vector<std::string> keys;
    for (const Option& o : options) keys.push_back(o.key());
    const std::string near = nearest_names(key.Scalar(), keys);
    throw bad(place + ": unknown option \"" + key.Scalar() + "\"" + (near.empty() ? "" : ", did you mean " + near + "?"));
  }
  if (!value.IsScalar()) throw bad(place + ": " + key.Scalar() + ": one value was expected");
  if (!out.emplace(option->name, Given{value.Scalar(), place}).second) throw bad(place + ": " + key.Scalar() + " is set twice");
}

Values read_file_values(const std::vector<Option>& options, const std::string& file) {
  Values out;
  try {
    const YAML::Node root = YAML::LoadFile(file);
    if (root.IsNull()) return out;
    if (!root.IsMap()) throw bad(file + ": lines of the form \"option: value\" were expected");
    for (const auto& entry : root) read_entry(options, file, entry.first, entry.second, out);
  } catch (const YAML::BadFile&) {
    throw bad("option --config: cannot read " + file);
  } catch (const YAML::Exception& error) {
    throw bad(file + ":" + std::to_string(error.mark.line + 1) + ": " + error.msg);
  }
  return out;
}

struct Flags {
  Values values;
  std::optional<std::string> config;
  std::optional<std::string> answer;
};

std::string description(const Option& option) { return option.help + " [" + option.variable() + "]"; }

/// The command line and what is read from it.
struct FlagReader {
  FlagReader(const std::vector<Option>& options, const Configuration& defaults);
  FlagReader(const FlagReader&) = delete;
  FlagReader& operator=(const FlagReader&) = delete;

  CLI::App app{"deformd: mesh deformation as a service", "deformd"};
  std::map<std::string, std::string> texts;
  std::map<std::string, bool> switches;
  std::string config;
};

FlagReader::FlagReader(const std::vector<Option>& options, const Configuration& defaults) {
  app.footer(
      "Every option can also be given as the environment variable in brackets or, with underscores, as a line of the YAML\n"
      "file of --config. A flag wins over the variable, the variable over the file, the file over the default.\n"
      "Sizes: 512MiB or 512M, 4GiB or 4G (powers of 1024), 1.5GB (powers of 1000) or plain bytes.\n"
      "\"deformd store check\", \"rebuild\", \"backup DIR\" and \"restore DIR\" look after the data directory: deformd store "
      "--help");
  for (const Option& option : options) {
    if (option.value.empty()) {
      app.add_flag("--" + option.name, switches[option.name], description(option));
    } else {
      const std::string shown = option.show(defaults);
      app.add_option("--" + option.name, texts[option.name], description(option))->type_name(option.value)->default_str(shown);
    }
  }
  app.add_option("--config", config, "YAML file with options [DEFORMD_CONFIG]")->type_name("PATH");
  app.add_flag("--version", switches["version"], "print the version");
}

Flags read_flags(const std::vector<Option>& options, std::vector<std::string> arguments, const Configuration& defaults) {
  FlagReader reader(options, defaults);
  CLI::App& app = reader.app;
  Flags out;
  try {
    std::reverse(arguments.begin(), arguments.end());  // as CLI11 wants them
    app.parse(std::move(arguments));
  } catch (const CLI::CallForHelp&) {
    out.answer = app.help();
    return out;
  } catch (const CLI::ParseError& error) {
    throw bad(std::string(error.what()) + " (deformd --help lists the options)");
  }
  if (app.count("--version") > 0) out.answer = version_line("deformd") + "\n";
  if (app.count("--config") > 0) out.config = reader.config;
  for (const Option& option : options) {
    if (app.count("--" + option.name) == 0) continue;
    out.values[option.name] = {option.value.empty() ? "true" : reader.texts[option.name], "flag"};
  }
  return out;
}

/// Kubernetes sets NAME_SERVICE_HOST, NAME_PORT and NAME_PORT_50051_TCP_ADDR, say, for a service of that name.
bool is_of_kubernetes(std::string_view name) {
  if (name.find("_SERVICE_HOST") != name.npos || name.find("_SERVICE_PORT") != name.npos || name.ends_with("_PORT")) return true;
  constexpr std::string_view port = "_PORT_";
  const std::size_t at = name.find(port), digit = at + port.size();
  return at != name.npos && digit < name.size() && name[digit] >= '0' && name[digit] <= '9';
}

/// Variables that no option reads but that look as if one should.
std::vector<std::string> misspelt_variables(const std::vector<Option>& options, const std::vector<std::string>& variables) {
  constexpr std::string_view prefix = "DEFORMD_";
  std::vector<std::string> names{"config"}, out;
  std::set<std::string> known{"DEFORMD_CONFIG"};
  for (const Option& option : options) {
    names.push_back(option.name);
    known.insert(option.variable());
  }
  for (const std::string& variable : variables) {
    if (!variable.starts_with(prefix) || known.contains(variable) || is_of_kubernetes(variable)) continue;
    std::string name = lower_case(variable.substr(prefix.size()));
    std::replace(name.begin(), name.end(), '_', '-');
    const std::string near = nearest_names(name, names);
    if (!near.empty()) out.push_back("environment " + variable + ": there is no such option; did you mean that of " + near + "?");
  }
  return out;
}

}  // namespace

void describe_command_line(const std::function<void(const CLI::App&)>& describe) {
  const FlagReader reader(all_options(), Configuration());
  describe(reader.app);
}

std::variant<Configuration, Answer> read_configuration(const CommandLine& command_line) {
  const std::vector<Option> options = all_options();
  Configuration out;
  out.server.engine.data_dir = "deformd-data";
  Flags flags = read_flags(options, command_line.arguments, out);
  if (flags.answer) return Answer{*flags.answer};

  Values values = std::move(flags.values);
  for (const Option& option : options) {
    if (auto text = command_line.environment(option.variable())) {
      values.emplace(option.name, Given{*text, "environment " + option.variable()});
    }
  }
  if (!flags.config) flags.config = command_line.environment("DEFORMD_CONFIG");
  if (flags.config) values.merge(read_file_values(options, *flags.config));

  for (const Option& option : options) {
    const auto given = values.find(option.name);
    if (given != values.end()) {
      try {
        option.set(out, given->second.value);
      } catch (const Error& error) {
        throw bad(given->second.source + ": " + option.name + ": " + error.what());
      }
    }
    out.effective.push_back({option.name, option.show(out), given == values.end() ? "default" : given->second.source});
  }
  out.server.validate();
  out.server.engine.validate();
  out.doubts = misspelt_variables(options, command_line.variables);
  return out;
}

}  // namespace deform::server
