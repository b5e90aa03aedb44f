// SPDX-License-Identifier: GPL-3.0-or-later
// deformd's options: flags over environment over file over defaults, and clear refusals.
#include "server/options.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <string>

#include "tests/support/in_process_server.h"

namespace deform::server::options_test {
namespace {

using testing::HasSubstr;

class Options : public testing::Test {
 protected:
  Configuration read(const std::vector<std::string>& arguments) {
    return std::get<Configuration>(read_configuration(command_line(arguments)));
  }
  std::string answer(const std::vector<std::string>& arguments) {
    return std::get<Answer>(read_configuration(command_line(arguments))).text;
  }
  std::string error(const std::vector<std::string>& arguments) {
    try {
      read(arguments);
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ErrorCode::invalid_argument);
      EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos) << "one line";
      return e.what();
    }
    return "no error";
  }
  std::string file(const std::string& text) {
    const auto path = folder.path() / "deformd.yaml";
    std::ofstream(path) << text;
    return path.string();
  }
  std::string source(const Configuration& configuration, const std::string& name) {
    for (const auto& entry : configuration.effective) {
      if (entry.name == name) return entry.source;
    }
    return "missing";
  }
  std::vector<std::string> variables() const {
    std::vector<std::string> names;
    for (const auto& [name, value] : environment) names.push_back(name);
    return names;
  }
  CommandLine command_line(const std::vector<std::string>& arguments) {
    return {arguments,
            [this](const std::string& name) {
              const auto found = environment.find(name);
              return found == environment.end() ? std::nullopt : std::optional<std::string>(found->second);
            },
            variables()};
  }

  std::map<std::string, std::string> environment;
  support::TemporaryFolder folder;
};

TEST_F(Options, DefaultsAreThoseOfTheStructs) {
  const Configuration c = read({});
  EXPECT_EQ(c.server.address, "127.0.0.1:50051");
  EXPECT_EQ(c.server.security, TransportSecurity::loopback_only);
  EXPECT_EQ(c.server.engine.queue_limit, EngineOptions().queue_limit);
  EXPECT_EQ(c.grace, std::chrono::seconds(30));
  for (const auto& entry : c.effective) EXPECT_EQ(entry.source, "default") << entry.name;
}

TEST_F(Options, FlagOverEnvironmentOverFileOverDefault) {
  const std::string path = file("workers: 2\nqueue_limit: 22\ngrace: 2.5\n");
  environment["DEFORMD_WORKERS"] = "3";
  environment["DEFORMD_QUEUE_LIMIT"] = "33";
  environment["DEFORMD_CONFIG"] = path;
  const Configuration c = read({"--workers", "4"});
  EXPECT_EQ(c.server.engine.workers, 4);
  EXPECT_EQ(source(c, "workers"), "flag");
  EXPECT_EQ(c.server.engine.queue_limit, 33u);
  EXPECT_EQ(source(c, "queue-limit"), "environment DEFORMD_QUEUE_LIMIT");
  EXPECT_EQ(c.grace, std::chrono::milliseconds(2500));
  EXPECT_EQ(source(c, "grace"), path + ":3");
  EXPECT_EQ(c.server.engine.max_points, EngineOptions().max_points);
  EXPECT_EQ(source(c, "max-points"), "default");
}

// Kubernetes sets the last four for services of such names.
TEST_F(Options, MisspeltVariablesAreDoubted) {
  for (const char* name : {"DEFORMD_MEMORY_BUGDET", "DEFORMD_CONFIGS", "DEFORMD_WORKERS", "HOME", "DEFORMD_SERVICE_HOST",
                           "DEFORMD_PORT", "DEFORMD_PORT_50051_TCP_ADDR", "DEFORMD_A_SERVICE_PORT_GRPC"}) {
    environment[name] = "2";
  }
  const std::vector<std::string> doubts = read({}).doubts;
  ASSERT_EQ(doubts.size(), 2u);
  EXPECT_EQ(doubts[0], "environment DEFORMD_CONFIGS: there is no such option; did you mean that of \"config\"?");
  EXPECT_EQ(doubts[1].find("environment DEFORMD_MEMORY_BUGDET: there is no such option; did you mean that of \"memory-budget\""),
            0u);
}

TEST_F(Options, EveryOptionCanBeSetInEveryWay) {
  // value per option, different from its default; the same list must serve flag, variable and file
  const std::map<std::string, std::string> values = {{"address", "127.0.0.2:1"},
                                                     {"insecure", "true"},
                                                     {"metrics-address", "127.0.0.1:9464"},
                                                     {"tls-cert", "c"},
                                                     {"tls-key", "k"},
                                                     {"tls-client-ca", "a"},
                                                     {"tls-client-crl", "r"},
                                                     {"identities", "i"},
                                                     {"trusted-proxies", "10.0.0.5,10.1.0.0/16"},
                                                     {"reflection", "off"},
                                                     {"port-file", "p"},
                                                     {"keep-alive", "11"},
                                                     {"keep-alive-timeout", "12"},
                                                     {"max-calls-per-connection", "13"},
                                                     {"max-connections", "25"},
                                                     {"connection-idle", "26"},
                                                     {"connection-age", "27"},
                                                     {"connection-age-grace", "28"},
                                                     {"data-dir", "d"},
                                                     {"catalog", DEFORM_WITH_POSTGRES ? "postgresql://db/x" : ""},
                                                     {"keep-free", "9MiB"},
                                                     {"max-stored-bases", "7GiB"},
                                                     {"stored-bases-from", "32"},
                                                     {"memory-budget", "8GiB"},
                                                     {"cache-budget", "3GiB"},
                                                     {"workers", "5"},
                                                     {"queue-limit", "14"},
                                                     {"max-points", "15"},
                                                     {"max-faces", "16"},
                                                     {"max-groups", "17"},
                                                     {"max-designs", "18"},
                                                     {"max-handles", "19"},
                                                     {"max-setup-work", "34"},
                                                     {"block-points", "1024"},
                                                     {"max-open-requests", "20"},
                                                     {"max-running-requests", "21"},
                                                     {"max-setup-bytes", "6MiB"},
                                                     {"max-buffered-bytes", "5MiB"},
                                                     {"max-calls", "35"},
                                                     {"call-threads", "22"},
                                                     {"max-waiting-calls", "23"},
                                                     {"grace", "24"},
                                                     {"log-level", "debug"},
                                                     {"max-deadline", "29"},
                                                     {"stall-timeout", "33"},
                                                     {"log-format", "json"},
                                                     {"log-calls", "31"},
                                                     {"log-file", "l"}};
  std::vector<std::string> flags;
  std::map<std::string, std::string> variables;
  std::string yaml;
  for (const auto& [name, value] : values) {
    flags.push_back("--" + name);
    if (name != "insecure") flags.push_back(value);
    std::string key = name;
    std::string variable = "DEFORMD_";
    for (char& c : key) {
      if (c == '-') c = '_';
      variable.push_back(static_cast<char>(std::toupper(c)));
    }
    variables[variable] = value;
    yaml.append(key).append(": \"").append(value).append("\"\n");
  }
  const auto check = [&](const Configuration& c) {
    EXPECT_EQ(c.effective.size(), values.size()) << "an option that this test does not know";
    for (const auto& entry : c.effective) {
      EXPECT_EQ(entry.value, values.at(entry.name)) << entry.name;
      EXPECT_NE(entry.source, "default") << entry.name;
    }
  };
  check(read(flags));
  check(read({"--config", file(yaml)}));
  environment = variables;
  check(read({}));
}

TEST_F(Options, HelpShowsEveryOptionWithDefaultAndVariable) {
  const std::string help = answer({"--help"});
  for (const auto& entry : read({}).effective) EXPECT_THAT(help, HasSubstr("--" + entry.name));
  EXPECT_THAT(help, HasSubstr("127.0.0.1:50051"));
  EXPECT_THAT(help, HasSubstr("DEFORMD_MEMORY_BUDGET"));
  EXPECT_THAT(help, HasSubstr("64MiB"));
  EXPECT_THAT(answer({"--version"}), testing::MatchesRegex("deformd [0-9.]+ \\(commit [a-z0-9-]+\\)\n"));
}

TEST_F(Options, MistakesNameTheOptionAndThePlace) {
  EXPECT_THAT(error({"--wrokers", "3"}), HasSubstr("--wrokers"));
  EXPECT_THAT(error({"stray"}), HasSubstr("stray"));
  EXPECT_THAT(error({"--workers", "many"}), HasSubstr("workers: \"many\""));
  EXPECT_THAT(error({"--workers", "99999999999"}), HasSubstr("workers"));
  EXPECT_THAT(error({"--workers", "-1"}), HasSubstr("workers"));
  EXPECT_THAT(error({"--queue-limit", "0"}), HasSubstr("queue_limit: 0"));
  EXPECT_THAT(error({"--block-points", "100000"}), HasSubstr("block_points"));
  EXPECT_THAT(error({"--memory-budget", "4 bananas"}), HasSubstr("memory-budget: \"4 bananas\""));
  EXPECT_THAT(error({"--memory-budget", "1GiB", "--cache-budget", "2GiB"}), HasSubstr("cache_budget"));
  EXPECT_THAT(error({"--grace", "-1"}), HasSubstr("grace"));
  EXPECT_THAT(error({"--grace", "nan"}), HasSubstr("grace"));
  EXPECT_THAT(error({"--log-level", "loud"}), HasSubstr("loud"));
  EXPECT_THAT(error({"--call-threads", "0"}), HasSubstr("call_threads"));
  EXPECT_THAT(error({"--max-buffered-bytes", "1"}), HasSubstr("max_buffered_bytes"));
  EXPECT_THAT(error({"--max-setup-bytes", "1"}), HasSubstr("max_setup_bytes"));
  EXPECT_THAT(error({"--tls-cert", "c"}), HasSubstr("--tls-key"));
  EXPECT_THAT(error({"--tls-key", "k"}), HasSubstr("--tls-cert"));
  EXPECT_THAT(error({"--tls-client-ca", "a"}), HasSubstr("--tls-cert"));
  EXPECT_THAT(error({"--tls-client-crl", "r"}), HasSubstr("--tls-client-ca"));
  EXPECT_THAT(error({"--log-format", "xml"}), HasSubstr("xml"));
  EXPECT_THAT(error({"--reflection", "perhaps"}), HasSubstr("perhaps"));
  environment["DEFORMD_INSECURE"] = "maybe";
  EXPECT_THAT(error({}), HasSubstr("DEFORMD_INSECURE"));
}

TEST_F(Options, MistakesInTheFileNameTheLine) {
  EXPECT_THAT(error({"--config", "/nowhere/at-all.yaml"}), HasSubstr("/nowhere/at-all.yaml"));
  EXPECT_THAT(error({"--config", file("# c\nworkers: 2\nqueue_limitt: 3\n")}),
              testing::AllOf(HasSubstr("deformd.yaml:3"), HasSubstr("queue_limitt"), HasSubstr("did you mean \"queue_limit\"")));
  EXPECT_THAT(error({"--config", file("workers: 2\nworkers: 3\n")}), HasSubstr("deformd.yaml:2"));
  EXPECT_THAT(error({"--config", file("workers: x\n")}), HasSubstr("deformd.yaml:1: workers"));
  EXPECT_THAT(error({"--config", file("workers: [1, 2]\n")}), HasSubstr("deformd.yaml:1"));
  EXPECT_THAT(error({"--config", file("- workers\n")}), HasSubstr("deformd.yaml"));
  EXPECT_THAT(error({"--config", file("workers: 1\n  queue: {\n")}), HasSubstr("deformd.yaml:"));
  EXPECT_EQ(read({"--config", file("")}).server.engine.workers, 0);
}

TEST_F(Options, ListeningBeyondThisMachineMustBeWanted) {
  for (const char* address : {"0.0.0.0:1", "[::]:1", "192.168.1.5:50051", "example.org:1", "127.example.org:1", "*:1"}) {
    EXPECT_THAT(error({"--address", address}), HasSubstr("--insecure")) << address;
    EXPECT_EQ(read({"--address", address, "--insecure"}).server.address, address);
  }
  for (const char* address : {"0.0.0.0:1", "example.org:1"}) {
    EXPECT_EQ(read({"--address", address, "--tls-cert", "c", "--tls-key", "k"}).server.address, address);
    EXPECT_THAT(error({"--address", address, "--insecure", "--identities", "i"}), HasSubstr("plain text"));
    EXPECT_EQ(read({"--address", address, "--identities", "i", "--tls-cert", "c", "--tls-key", "k"}).server.address, address);
  }
  EXPECT_EQ(read({"--address", "unix:/tmp/socket", "--identities", "i"}).server.service.access.identities, "i");
  for (const char* address : {"127.0.0.1:0", "127.1.2.3:1", "[::1]:50051", "localhost:50051", "unix:/tmp/socket"}) {
    EXPECT_EQ(read({"--address", address}).server.address, address);
  }
  for (const char* address : {"127.0.0.1", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:70000", ":1", "127.0.0.1:-1"}) {
    EXPECT_THAT(error({"--address", address}), HasSubstr("address")) << address;
  }
}

TEST(Bytes, AreReadWithUnits) {
  EXPECT_EQ(parse_bytes("0"), 0u);
  EXPECT_EQ(parse_bytes("123456"), 123456u);
  EXPECT_EQ(parse_bytes("4GiB"), std::size_t{4} << 30);
  EXPECT_EQ(parse_bytes("512 MiB"), std::size_t{512} << 20);
  EXPECT_EQ(parse_bytes("1.5GB"), 1'500'000'000u);
  EXPECT_EQ(parse_bytes("0.5KiB"), 512u);
  EXPECT_EQ(parse_bytes("6G"), std::size_t{6} << 30);
  EXPECT_EQ(parse_bytes("512m"), std::size_t{512} << 20);
  EXPECT_EQ(parse_bytes("2K"), 2048u);
  EXPECT_EQ(parse_bytes("1T"), std::size_t{1} << 40);
  for (const char* bad :
       {"", "GiB", "-1", "4gib", "4 G iB", "1e3", "1..5", "0x10", "1.5", "0.5B", "9999999999TiB", "nan", "inf"}) {
    EXPECT_THROW(parse_bytes(bad), Error) << bad;
  }
}

TEST(Bytes, AreShownExactly) {
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{1000}, std::size_t{1024}, std::size_t{5} << 20, (std::size_t{1} << 40) + 1}) {
    EXPECT_EQ(parse_bytes(to_text(size)), size);
  }
  EXPECT_EQ(to_text(std::size_t{64} << 20), "64MiB");
}

}  // namespace
}  // namespace deform::server::options_test
