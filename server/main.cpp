// SPDX-License-Identifier: GPL-3.0-or-later
#include <semaphore.h>
#include <signal.h>
#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <mutex>
#include <string_view>
#include <thread>
#include <vector>

#include "core/base/commit/commit.h"
#include "core/base/text.h"
#include "core/numerics/dense/blas_kernels.h"
#include "server/engine/memory.h"
#include "server/options.h"
#include "server/rpc/log.h"
#include "server/rpc/server.h"
#include "server/store_cli.h"

namespace {

using deform::Error;
using deform::ErrorCode;

enum ExitCode { exit_ok = 0, exit_failed = 1, exit_usage = 2 };

/// Ends the process now. The store is durable at any moment, so nothing registered is lost.
[[noreturn]] void give_up(const char* why) {
  spdlog::error("{}", why);
  std::fprintf(stderr, "deformd: %s\n", why);
  std::_Exit(exit_failed);
}

// A signal handler reaches nothing but file scope. Blocking the signals and sigwait() would not need one, but libraries
// (OpenBLAS) start threads before main(), which do not inherit the mask and would die of the signal.
sem_t signals_seen;
std::atomic<int> last_stop{0};
std::atomic<int> reloads_asked{0};
static_assert(std::atomic<int>::is_always_lock_free);

/// SIGTERM and SIGINT, which stop the server, and SIGHUP, which has it reload, counted by a semaphore. With handlers installed it
/// works as process 1, too.
class Signals {
 public:
  Signals() {
    sem_init(&signals_seen, 0, 0);
    struct sigaction action {};
    action.sa_handler = [](int number) {
      if (number == SIGHUP) {
        ++reloads_asked;
      } else {
        last_stop = number;
      }
      sem_post(&signals_seen);
    };
    action.sa_flags = SA_RESTART;
    sigaction(SIGTERM, &action, nullptr);
    sigaction(SIGINT, &action, nullptr);
    sigaction(SIGHUP, &action, nullptr);
    signal(SIGPIPE, SIG_IGN);
  }
  /// The next of them; SIGHUP before what stops.
  int wait() const {
    while (sem_wait(&signals_seen) != 0) {
    }
    if (reloads_asked > 0) {
      --reloads_asked;
      return SIGHUP;
    }
    return last_stop;
  }
  /// From now on a signal ends the process at once.
  void give_up_at_the_next() const {
    std::thread([this] {
      while (wait() == SIGHUP) {
      }
      give_up("asked to stop a second time: ending at once");
    }).detach();
  }
};

/// Ends the process when it is not destroyed in time.
class Watchdog {
 public:
  explicit Watchdog(std::chrono::milliseconds limit)
      : thread_([this, limit] {
          std::unique_lock lock(mutex_);
          if (!stopped_.wait_for(lock, limit, [this] { return done_; })) give_up("did not stop in twice the grace time");
        }) {}
  ~Watchdog() {
    {
      const std::lock_guard lock(mutex_);
      done_ = true;
    }
    stopped_.notify_one();
    thread_.join();
  }

 private:
  std::mutex mutex_;
  std::condition_variable stopped_;
  bool done_ = false;  // under mutex_
  std::thread thread_;
};

/// Readers of the file see nothing or the whole number.
void write_port_file(const std::filesystem::path& path, int port) {
  const std::filesystem::path part = path.string() + ".part";
  {
    std::ofstream out(part);
    out << port << '\n';
    if (!out.flush()) throw Error(ErrorCode::invalid_argument, "option port-file: cannot write " + part.string());
  }
  std::filesystem::rename(part, path);
}

void log_configuration(const deform::server::Configuration& configuration) {
  for (const auto& [name, value, source] : configuration.effective) {
    spdlog::info("option {}={} ({})", name, deform::escaped(value, 300), deform::escaped(source, 300));
  }
  for (const std::string& doubt : configuration.doubts) spdlog::warn("{}", deform::escaped(doubt, 300));
}

/// Every connection is an open file, and the usual soft limit of 1,024 is kept for programs that use select(), which this does
/// not.
void raise_open_files() {
  struct rlimit limit {};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  const rlim_t before = limit.rlim_cur;
  limit.rlim_cur = limit.rlim_max;
  if (before == limit.rlim_cur) return;
  if (setrlimit(RLIMIT_NOFILE, &limit) == 0) {
    spdlog::info("open files: at most {}, raised from {}", limit.rlim_cur, before);
  } else {
    spdlog::warn("open files: at most {}; the limit cannot be raised to {}", before, limit.rlim_max);
  }
}

/// What an option says now, to a server that runs.
void take_over(deform::server::RunningServer& server, const deform::server::Configuration::Effective& fresh,
               deform::server::Configuration::Effective& now) {
  const std::string value = deform::escaped(fresh.value, 300);
  try {
    const auto before = server.take_over(fresh.name, fresh.value);
    if (before) {
      // Not below warning: the level may be what has changed.
      spdlog::warn("option {}={} ({}) is taken over, before {}", fresh.name, value, deform::escaped(fresh.source, 300), *before);
      now = fresh;
    } else {
      spdlog::warn("option {}={} takes a restart; it stays {}", fresh.name, value, deform::escaped(now.value, 300));
    }
  } catch (const Error& error) {
    spdlog::error("option {}={} is not taken over, it stays: {}", fresh.name, value, deform::escaped(error.what(), 2000));
  }
}

/// Opens the log anew and takes over what the options say now, as far as that goes without a restart: limits that the operator
/// changes, too, unless the options are as they were when they were last read. Certificates and identities are reread by
/// themselves.
void reload(const deform::server::CommandLine& command_line, deform::server::RunningServer& server,
            deform::server::Configuration& configuration) {
  deform::server::reopen_log();
  spdlog::info("SIGHUP: the log is opened anew, options are read again");
  try {
    auto read = deform::server::read_configuration(command_line);
    const auto& fresh = std::get<deform::server::Configuration>(read);
    for (std::size_t i = 0; i < fresh.effective.size(); ++i) {
      auto& now = configuration.effective.at(i);
      if (fresh.effective[i].value != now.value) take_over(server, fresh.effective[i], now);
    }
  } catch (const Error& error) {
    spdlog::error("options stay as they are: {}", deform::escaped(error.what(), 2000));
  }
}

/// What deform admin limits shows; paths and addresses are the machine's business.
bool is_limit(const std::string& name) {
  for (const char* start : {"max-", "connection-", "keep-"}) {
    if (name.starts_with(start)) return true;
  }
  return name == "block-points" || name == "call-threads" || name == "grace" || name == "log-calls";
}

void serve(deform::server::Configuration configuration, const deform::server::CommandLine& command_line, const Signals& signals) {
  deform::server::start_logging(configuration.log);
  spdlog::info("{} starts, process {}", deform::version_line("deformd"), getpid());
  log_configuration(configuration);
  spdlog::info("dense systems by the kernels of OpenBLAS for {}", deform::lapack::kernels());
  raise_open_files();
  deform::server::limit_retained_memory(deform::server::memory_budget_of(configuration.server.engine.memory_budget));
  for (const auto& [name, value, source] : configuration.effective) {
    if (is_limit(name)) configuration.server.limits.emplace_back(name, value);
  }
  configuration.server.on_failure = [](const std::string& why) { give_up(why.c_str()); };
  const auto server = deform::server::start_server(configuration.server);
  if (!configuration.port_file.empty()) write_port_file(configuration.port_file, server->port());
  spdlog::info("listening on {}", server->address());

  int number = signals.wait();
  for (; number == SIGHUP; number = signals.wait()) reload(command_line, *server, configuration);
  spdlog::info("{}: stopping, what is under way has {} ms", number == SIGTERM ? "SIGTERM" : "SIGINT",
               configuration.grace.count());
  signals.give_up_at_the_next();
  const Watchdog watchdog(2 * configuration.grace + std::chrono::seconds(1));
  if (server->stop(configuration.grace)) {
    spdlog::info("stopped, everything under way was answered");
  } else {
    spdlog::warn("stopped, calls that took longer than the grace time were cancelled");
  }
}

std::optional<std::string> environment_variable(const std::string& name) {
  const char* value = std::getenv(name.c_str());
  return value == nullptr ? std::nullopt : std::optional<std::string>(value);
}

std::vector<std::string> environment_names() {
  std::vector<std::string> names;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    const std::string_view text(*variable);
    names.emplace_back(text.substr(0, text.find('=')));
  }
  return names;
}

}  // namespace

int main(int argc, char** argv) {
  deform::lapack::use_kernels_of_processor(argv);
  try {
    const deform::server::CommandLine command_line{{argv + 1, argv + argc}, environment_variable, environment_names()};
    if (const auto code = deform::server::run_store_command(command_line, std::cout)) return *code;
    static const Signals signals;  // outlives the thread that waits for the second one
    const auto configuration = deform::server::read_configuration(command_line);
    if (const auto* answer = std::get_if<deform::server::Answer>(&configuration)) {
      std::cout << answer->text << std::flush;
      return exit_ok;
    }
    serve(std::get<deform::server::Configuration>(configuration), command_line, signals);
    return exit_ok;
  } catch (const Error& error) {
    std::fprintf(stderr, "deformd: %s\n", deform::escaped(error.what(), 2000).c_str());
    return error.code() == ErrorCode::invalid_argument ? exit_usage : exit_failed;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "deformd: %s\n", deform::escaped(error.what(), 2000).c_str());
    return exit_failed;
  }
}
