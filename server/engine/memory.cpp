// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/memory.h"

#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <limits>
#include <utility>

#include "core/base/control_group.h"
#include "core/base/error.h"
#include "core/base/number_text.h"

namespace deform::server {

namespace {

constexpr std::uint32_t retry_memory_ms = 500;
constexpr std::uint32_t retry_quota_ms = 200;

}  // namespace

std::size_t MemoryMeter::in_use() const {
  const std::lock_guard lock(mutex_);
  return in_use_;
}

bool MemoryMeter::try_take(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  if (bytes > total_ - in_use_) return false;
  in_use_ += bytes;
  return true;
}

bool MemoryMeter::try_take_alone(std::size_t bytes, std::size_t held) {
  const std::lock_guard lock(mutex_);
  if (in_use_ != held && in_use_ + bytes > total_) return false;
  in_use_ += bytes;
  return true;
}

bool MemoryMeter::try_take_up_to(std::size_t limit, std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  if (bytes > limit - std::min(in_use_, limit)) return false;
  in_use_ += bytes;
  return true;
}

void MemoryMeter::take(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  in_use_ += bytes;
}

void MemoryMeter::give_back(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  in_use_ -= bytes;
}

void TenantShare::take(std::size_t bytes, const std::string& what) const {
  if (limit == 0 || bytes <= small) return meter->take(bytes);
  if (meter->try_take_up_to(limit, bytes)) return;
  const std::string quota = "quota bytes-in-flight of tenant \"" + tenant + "\": ";
  if (bytes > limit) {
    throw Error(ErrorCode::out_of_budget, quota + what + " needs " + mebibytes(bytes) + ", the limit is " + mebibytes(limit) +
                                              "; ask the operator of the server for more")
        .refused_for(Refusal::quota);
  }
  throw Error(ErrorCode::out_of_budget,
              quota + what + " needs " + mebibytes(bytes) + ", requests and answers under way hold " +
                  mebibytes(meter->in_use()) + ", the limit is " + mebibytes(limit) + "; try again later",
              retry_quota_ms)
      .refused_for(Refusal::quota);
}

std::shared_ptr<MemoryMeter> TenantMeters::of(const std::string& tenant) {
  const std::lock_guard lock(mutex_);
  auto& meter = meters_[tenant];
  if (!meter) meter = std::make_shared<MemoryMeter>(std::numeric_limits<std::size_t>::max());
  return meter;
}

Charge::Charge(Charge&& other) noexcept
    : meter_(std::move(other.meter_)), also_(std::move(other.also_)), bytes_(std::exchange(other.bytes_, 0)) {}

Charge& Charge::operator=(Charge&& other) noexcept {
  if (this != &other) {
    shrink(0);
    meter_ = std::move(other.meter_);
    also_ = std::move(other.also_);
    bytes_ = std::exchange(other.bytes_, 0);
  }
  return *this;
}

Charge::~Charge() { shrink(0); }

void Charge::shrink(std::size_t bytes) {
  if (bytes >= bytes_) return;
  if (meter_) meter_->give_back(bytes_ - bytes);
  for (const auto& meter : also_) meter->give_back(bytes_ - bytes);
  bytes_ = bytes;
}

void Charge::outlive_call() {
  for (const auto& meter : also_) meter->give_back(bytes_);
  also_.clear();
}

void Charge::join(Charge&& same) {
  if (same.meter_) also_.push_back(std::move(same.meter_));
  same.bytes_ = 0;
}

void Charge::absorb(Charge&& more) {
  meter_ = std::move(more.meter_);
  also_ = std::move(more.also_);
  bytes_ += std::exchange(more.bytes_, 0);
}

Charge MemoryBudget::charge(std::size_t bytes, const ChargePurpose& purpose) {
  const std::size_t total = meter_->total();
  const std::size_t ceiling = total - std::min(total, purpose.held_alongside);
  if (bytes > ceiling) {
    throw Error(ErrorCode::out_of_budget, purpose.what + ": needs " + mebibytes(bytes) + ", at most " + mebibytes(ceiling) +
                                              " can ever be available (memory budget " + mebibytes(total) + "); " +
                                              purpose.advice)
        .refused_for(Refusal::memory);
  }
  if (meter_->try_take(bytes)) return {meter_, bytes};
  for (const auto& reclaim : reclaimers_) {
    const std::size_t free = total - meter_->in_use();
    reclaim(bytes - std::min(bytes, free));
    if (meter_->try_take(bytes)) return {meter_, bytes};
  }
  throw Error(ErrorCode::out_of_budget,
              purpose.what + ": needs " + mebibytes(bytes) + ", " + mebibytes(total - meter_->in_use()) + " of " +
                  mebibytes(total) + " are available now; try again later, or " + purpose.advice,
              retry_memory_ms)
      .refused_for(Refusal::memory);
}

Charge MemoryBudget::charge_call(std::size_t bytes, const ChargePurpose& purpose, const TenantShare& share) {
  constexpr std::size_t small_share = 256;
  Charge own = charge_tenant(bytes, purpose, share);
  Charge result = charge(bytes, purpose);
  if (bytes <= meter_->total() / small_share) {
    of_calls_->take(bytes);
  } else if (!of_calls_->try_take_alone(bytes)) {
    throw Error(ErrorCode::out_of_budget,
                purpose.what + ": needs " + mebibytes(bytes) + ", but calls hold " + mebibytes(of_calls_->in_use()) +
                    " already and may hold " + mebibytes(of_calls_->total()) +
                    ", half of the memory budget; try again later, or " + purpose.advice,
                retry_memory_ms)
        .refused_for(Refusal::memory);
  }
  result.join({of_calls_, bytes});
  result.join(std::move(own));
  return result;
}

void MemoryBudget::grow(Charge& charge, std::size_t bytes, const ChargePurpose& purpose) {
  ChargePurpose all = purpose;
  all.held_alongside += charge.bytes();
  charge.absorb(this->charge(bytes, all));
}

void MemoryBudget::grow_upload(Charge& charge, std::size_t bytes, const ChargePurpose& purpose, const TenantShare& share) {
  constexpr std::size_t small_share = 4096;
  Charge own = charge_tenant(bytes, purpose, share);
  if (charge.bytes() + bytes <= meter_->total() / small_share) {
    of_uploads_->take(bytes);
  } else if (!of_uploads_->try_take_alone(bytes, charge.bytes())) {
    throw Error(ErrorCode::out_of_budget,
                purpose.what + ": needs " + mebibytes(bytes) + " more, but uploads under way hold " +
                    mebibytes(of_uploads_->in_use()) + " already and may hold " + mebibytes(of_uploads_->total()) +
                    ", a quarter of the memory budget; try again later, or " + purpose.advice,
                retry_memory_ms)
        .refused_for(Refusal::memory);
  }
  Charge of_uploads(of_uploads_, bytes);
  ChargePurpose all = purpose;
  all.held_alongside += charge.bytes();
  Charge more = this->charge(bytes, all);
  more.join(std::move(of_uploads));
  more.join(std::move(own));
  charge.absorb(std::move(more));
}

Charge MemoryBudget::charge_tenant(std::size_t bytes, const ChargePurpose& purpose, const TenantShare& share) {
  if (share.meter) share.take(bytes, purpose.what);
  return {share.meter, bytes};
}

std::size_t available_memory() {
  std::size_t bytes = static_cast<std::size_t>(sysconf(_SC_PHYS_PAGES)) * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  if (const auto limit = ControlGroup::read().memory; limit && *limit > 0) bytes = std::min<std::size_t>(bytes, *limit);
  return bytes;
}

bool return_freed_memory(std::size_t bytes) {
  static std::atomic<std::size_t> freed{0};
  if (freed.fetch_add(bytes) + bytes < freed_bytes_worth_returning) return false;
  freed = 0;
  malloc_trim(0);
  return true;
}

std::size_t memory_budget_of(std::size_t option) { return option != 0 ? option : available_memory() / 5 * 4; }

void limit_retained_memory(std::size_t budget) {
  constexpr int largest_in_heap = 32 << 20;  // malloc() would come to this by itself, were the end of the heaps not limited
  const std::size_t kept_per_heap = std::clamp<std::size_t>(budget / 256, 8 << 20, 64 << 20);
  mallopt(M_MMAP_THRESHOLD, largest_in_heap);
  mallopt(M_TRIM_THRESHOLD, static_cast<int>(kept_per_heap));
}

std::size_t resident_set_bytes() {
  std::ifstream file("/proc/self/statm");
  std::size_t pages = 0, resident = 0;
  file >> pages >> resident;
  return resident * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
}

}  // namespace deform::server
