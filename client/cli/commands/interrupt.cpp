// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/commands/interrupt.h"

#include <time.h>
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
  stopping_ = true;
  thread_.join();
  pthread_sigmask(SIG_UNBLOCK, &signals_, nullptr);
}

void Interrupt::wait() {
  const timespec period{0, 20'000'000};
  while (!stopping_) {
    if (sigtimedwait(&signals_, nullptr, &period) < 0) continue;
    if (flag_.cancelled()) _exit(exit_interrupted);
    flag_.cancel();
  }
}

}  // namespace deform::cli
