// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/commands/interrupt.h"

#include <unistd.h>

#include "client/cli/commands/command.h"

namespace deform::cli {

Interrupt::Interrupt() {
  sigemptyset(&signals_);
  sigaddset(&signals_, SIGINT);
  sigaddset(&signals_, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
  thread_ = std::thread([this] { wait(); });
}

Interrupt::~Interrupt() {
  ended_ = true;
  pthread_kill(thread_.native_handle(), SIGTERM);  // of the thread alone: wakes it
  thread_.join();
  pthread_sigmask(SIG_UNBLOCK, &signals_, nullptr);
}

void Interrupt::wait() {
  int signal = 0;
  while (sigwait(&signals_, &signal) == 0 && !ended_) {
    if (!stop_.request_stop()) _exit(exit_interrupted);
  }
}

}  // namespace deform::cli
