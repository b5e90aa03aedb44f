// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/flood_guard.h"

#include <utility>

namespace deform::server {

void FloodGuard::note_reset(const std::string& peer) {
  {
    const std::lock_guard lock(mutex_);
    const auto now = Clock::now();
    if (now - began_ >= std::chrono::seconds(1)) {
      resets_.clear();
      began_ = now;
    }
    if (++resets_[peer] != most_resets) return;
  }
  if (action_) action_(peer);
}

}  // namespace deform::server
