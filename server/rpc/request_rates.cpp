// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/request_rates.h"

#include <algorithm>
#include <cmath>

#include "core/base/error.h"

namespace deform::server {

void RequestRates::take(const std::string& tenant, std::uint64_t per_second, Clock::time_point now) {
  if (per_second == 0) return;
  const double rate = static_cast<double>(per_second);
  const std::lock_guard lock(mutex_);
  const auto [found, fresh] = buckets_.try_emplace(tenant, Bucket{rate, now});
  Bucket& bucket = found->second;
  if (!fresh) {
    const double seconds = std::max(0.0, std::chrono::duration<double>(now - bucket.filled).count());
    bucket = {std::min(rate, bucket.tokens + rate * seconds), std::max(now, bucket.filled)};
  }
  if (bucket.tokens >= 1) {
    bucket.tokens -= 1;
    return;
  }
  const auto wait = static_cast<std::uint32_t>(std::ceil((1 - bucket.tokens) / rate * 1000));
  throw Error(ErrorCode::out_of_budget,
              "quota requests-per-second of tenant \"" + tenant + "\": " + std::to_string(per_second) +
                  " were begun within a second, the limit is " + std::to_string(per_second) + "; try again later",
              std::max<std::uint32_t>(1, wait))
      .refused_for(Refusal::rate);
}

}  // namespace deform::server
