// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/server_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <fstream>
#include <stdexcept>
#include <thread>

namespace deform::bench {

namespace {

double cpu_seconds_of(clockid_t clock) {
  timespec time{};
  if (clock_gettime(clock, &time) != 0) throw std::runtime_error("cannot read the processor time of a process");
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

}  // namespace

ServerProcess::ServerProcess(const std::string& binary, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  const std::string port_file = folder / "port", data = folder / "data", log = folder / "deformd.log";
  std::filesystem::remove(port_file);
  const std::array<const char*, 10> arguments = {binary.c_str(), "--address",  "127.0.0.1:0", "--port-file", port_file.c_str(),
                                                 "--data-dir",   data.c_str(), "--log-level", "warning",     nullptr};
  pid_ = fork();
  if (pid_ == 0) {
    const int out = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    if (out >= 0) dup2(out, STDERR_FILENO);
    execv(binary.c_str(), const_cast<char* const*>(arguments.data()));
    _exit(127);
  }
  if (pid_ < 0) throw std::runtime_error("cannot start another process");
  wait_for_port(port_file);
}

void ServerProcess::wait_for_port(const std::filesystem::path& port_file) {
  for (int attempt = 0; attempt < 600; ++attempt) {
    int port = 0;
    if (std::ifstream(port_file) >> port) {
      address_ = "127.0.0.1:" + std::to_string(port);
      return;
    }
    if (waitpid(pid_, nullptr, WNOHANG) == pid_) {
      pid_ = 0;
      break;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  if (pid_ > 0) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  throw std::runtime_error("deformd did not start; see deformd.log in " + port_file.parent_path().string());
}

ServerProcess::~ServerProcess() {
  kill(pid_, SIGTERM);
  waitpid(pid_, nullptr, 0);
}

double ServerProcess::cpu_seconds() const {
  clockid_t clock{};
  if (clock_getcpuclockid(pid_, &clock) != 0) throw std::runtime_error("deformd is gone");
  return cpu_seconds_of(clock);
}

double ServerProcess::resident_bytes() const {
  std::ifstream statm("/proc/" + std::to_string(pid_) + "/statm");
  double total = 0, resident = 0;
  if (!(statm >> total >> resident)) throw std::runtime_error("deformd is gone");
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE));
}

double own_cpu_seconds() { return cpu_seconds_of(CLOCK_PROCESS_CPUTIME_ID); }

}  // namespace deform::bench
