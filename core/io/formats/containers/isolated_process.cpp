// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/containers/isolated_process.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>

#include "core/base/error.h"

namespace deform::io {

namespace {

[[noreturn]] void fail(const std::string& program, int error) {
  throw Error(ErrorCode::failed_precondition, "cannot start " + program + ": " + std::strerror(error));
}

/// A descriptor above those of the standard streams, so that none of them is in the way while they are set.
class Descriptor {
 public:
  explicit Descriptor(int descriptor) : descriptor_(::fcntl(descriptor, F_DUPFD_CLOEXEC, 10)), error_(errno) {}
  ~Descriptor() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return descriptor_; }
  int error() const { return descriptor_ < 0 ? error_ : 0; }

 private:
  const int descriptor_, error_;
};

/// The arguments of posix_spawn().
class SpawnPlan {
 public:
  SpawnPlan(int request, int answer) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawnattr_init(&attributes_);
    posix_spawn_file_actions_adddup2(&actions_, request, STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&actions_, answer, STDOUT_FILENO);
    posix_spawn_file_actions_addopen(&actions_, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addclosefrom_np(&actions_, STDERR_FILENO + 1);
    // Whoever waits for Ctrl-C in a thread of its own has blocked it, which would be inherited.
    sigset_t none, broken_pipe;
    sigemptyset(&none);
    sigemptyset(&broken_pipe);
    sigaddset(&broken_pipe, SIGPIPE);
    posix_spawnattr_setsigmask(&attributes_, &none);
    posix_spawnattr_setsigdefault(&attributes_, &broken_pipe);
    posix_spawnattr_setflags(&attributes_, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  }
  ~SpawnPlan() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }
  SpawnPlan(const SpawnPlan&) = delete;
  SpawnPlan& operator=(const SpawnPlan&) = delete;

  int spawn(pid_t& process, const std::vector<std::string>& command) const {
    std::vector<char*> arguments;
    for (const std::string& argument : command) arguments.push_back(const_cast<char*>(argument.c_str()));
    arguments.push_back(nullptr);
    return posix_spawn(&process, command.front().c_str(), &actions_, &attributes_, arguments.data(), environ);
  }

 private:
  posix_spawn_file_actions_t actions_;
  posix_spawnattr_t attributes_;
};

}  // namespace

IsolatedProcess::IsolatedProcess(const std::vector<std::string>& command, int request) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) fail(command.front(), errno);
  answer_ = ends[0];
  int error = 0;
  {
    const Descriptor input(request), output(ends[1]);
    ::close(ends[1]);
    error = input.error() != 0 ? input.error() : output.error();
    if (error == 0) error = SpawnPlan(input.get(), output.get()).spawn(process_, command);
  }
  if (error != 0) {
    process_ = -1;
    ::close(answer_);
    fail(command.front(), error);
  }
  constexpr int wide = 1 << 20;
  ::fcntl(answer_, F_SETPIPE_SZ, wide);  // faster, where it is allowed
}

std::size_t IsolatedProcess::read(char* to, std::size_t size, const std::stop_token& stop) {
  constexpr int period_ms = 50;
  while (true) {
    if (stop.stop_requested()) throw Error(ErrorCode::cancelled, "interrupted");
    pollfd waiting{answer_, POLLIN, 0};
    if (::poll(&waiting, 1, period_ms) <= 0) continue;
    const ssize_t got = ::read(answer_, to, size);
    if (got >= 0) return static_cast<std::size_t>(got);
    if (errno != EINTR) return 0;
  }
}

std::optional<int> IsolatedProcess::end() {
  if (process_ < 0) return status_;
  // Does nothing to one that is ending by itself: how it ends is settled before its output is closed.
  ::kill(process_, SIGKILL);
  int status = 0;
  pid_t ended = 0;
  do {
    ended = ::waitpid(process_, &status, 0);
  } while (ended < 0 && errno == EINTR);
  if (ended == process_) status_ = status;
  process_ = -1;
  ::close(answer_);
  return status_;
}

}  // namespace deform::io
