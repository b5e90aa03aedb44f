// SPDX-License-Identifier: Apache-2.0
#include "client/retry.h"

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <mutex>

#include "client/status.h"

namespace deform::client {

double RetryPolicy::random() {
  // splitmix64
  random_ += 0x9e3779b97f4a7c15ull;
  std::uint64_t z = random_;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  z ^= z >> 31;
  return static_cast<double>(z >> 11) * 0x1p-53;
}

std::optional<std::chrono::milliseconds> RetryPolicy::next_wait(const Error& error) {
  ++failed_attempts_;
  const auto now = RunContext::Clock::now();
  if (!first_failure_) first_failure_ = now;
  const bool refused = error.code() == ErrorCode::out_of_budget && error.retry_after_ms() > 0;
  const bool sent = dynamic_cast<const NotConnected*>(&error) == nullptr;
  const bool lost = error.code() == ErrorCode::unavailable && (options_.retry == Retry::safe || !sent);
  if (!refused && !lost) return std::nullopt;
  const bool patient = now - *first_failure_ < options_.patience;
  if (failed_attempts_ >= options_.max_attempts && !patient) return std::nullopt;
  const double backoff = 100.0 * std::pow(2.0, std::min(failed_attempts_ - 1, 6)) * (0.5 + random());
  const double hint = static_cast<double>(error.retry_after_ms()) * (1.0 + 0.5 * random());
  return std::chrono::milliseconds(static_cast<std::int64_t>(refused ? hint : std::max(backoff, hint)));
}

void RetryPolicy::wait(std::chrono::milliseconds duration, const RunContext& context) {
  auto end = RunContext::Clock::now() + duration;
  if (context.deadline) end = std::min(end, *context.deadline);
  std::mutex mutex;
  std::condition_variable_any stopped;
  std::unique_lock lock(mutex);
  stopped.wait_until(lock, context.stop, end, [] { return false; });
  context.check();
}

}  // namespace deform::client
