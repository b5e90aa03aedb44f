// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace deform::server {

class MemoryBudget;

/// Bytes in use, shared by a budget and its charges.
class MemoryMeter {
 public:
  explicit MemoryMeter(std::size_t total) : total_(total) {}
  std::size_t total() const { return total_; }
  std::size_t in_use() const;
  /// False when so many are not free.
  bool try_take(std::size_t bytes);
  /// The same, but when nothing is in use beside what the caller holds already any number may be taken.
  bool try_take_alone(std::size_t bytes, std::size_t held = 0);
  /// The same, but what is in use may come to `limit` at most, whatever the total.
  bool try_take_up_to(std::size_t limit, std::size_t bytes);
  /// Takes them whether they are free or not.
  void take(std::size_t bytes);
  void give_back(std::size_t bytes);

 private:
  const std::size_t total_;
  mutable std::mutex mutex_;
  std::size_t in_use_ = 0;  // guarded by mutex_
};

/// What one tenant may hold at once in its requests, uploads and answers, all together. Copies count together.
struct TenantShare {
  /// More of the tenant never keeps requests as small as this one from being answered: they are counted only.
  static constexpr std::size_t small = 64 << 10;

  std::string tenant;
  std::shared_ptr<MemoryMeter> meter;  ///< null: nobody counts
  std::size_t limit = 0;               ///< 0: none

  /// Throws Error(out_of_budget), with a retry hint unless so many are more than the limit. `what` needs them.
  void take(std::size_t bytes, const std::string& what) const;
};

/// The meters of all tenants. Thread-safe.
class TenantMeters {
 public:
  std::shared_ptr<MemoryMeter> of(const std::string& tenant);

 private:
  std::mutex mutex_;
  std::map<std::string, std::shared_ptr<MemoryMeter>> meters_;  // under mutex_
};

/// A number of bytes taken from a budget, given back on destruction. Movable; one owner at a time. May outlive its budget.
class Charge {
 public:
  Charge() = default;
  Charge(Charge&& other) noexcept;
  Charge& operator=(Charge&& other) noexcept;
  Charge(const Charge&) = delete;
  Charge& operator=(const Charge&) = delete;
  ~Charge();

  std::size_t bytes() const { return bytes_; }
  /// Gives back what is above `bytes`.
  void shrink(std::size_t bytes);
  /// What it is taken for outlives the call or the upload: it no longer counts as theirs.
  void outlive_call();

 private:
  friend class MemoryBudget;
  Charge(std::shared_ptr<MemoryMeter> meter, std::size_t bytes) : meter_(std::move(meter)), bytes_(bytes) {}
  /// As many bytes that were taken elsewhere become ours: they are given back together.
  void join(Charge&& same);
  /// Its bytes are added to ours, which are counted in the same meters.
  void absorb(Charge&& more);

  std::shared_ptr<MemoryMeter> meter_;
  std::vector<std::shared_ptr<MemoryMeter>> also_;  // of its tenant, of all calls or of all uploads
  std::size_t bytes_ = 0;
};

/// What a charge is for: words of the refusal.
struct ChargePurpose {
  std::string what;                ///< "preparing system 1a2b3c4d"
  std::string advice;              ///< what the caller can change so that it needs less
  std::size_t held_alongside = 0;  ///< bytes already charged that this work needs at the same time
};

/// Admission by estimate: bytes are taken before they are allocated. Thread-safe.
class MemoryBudget {
 public:
  explicit MemoryBudget(std::size_t total)
      : meter_(std::make_shared<MemoryMeter>(total)),
        of_calls_(std::make_shared<MemoryMeter>(total / 2)),
        of_uploads_(std::make_shared<MemoryMeter>(total / 4)) {}

  /// Takes bytes, asking the reclaimers for help first. Throws Error(out_of_budget) with needed, available and what to change;
  /// with a retry hint only when the bytes would fit into an idle server.
  Charge charge(std::size_t bytes, const ChargePurpose& purpose);

  /// The same for a call, which may have to wait for its reader while it holds them. All calls together hold at most half of the
  /// budget, unless one alone needs more; those that need less than a 256th come first and may use the rest. So whoever asks for
  /// little is answered while others hold much.
  Charge charge_call(std::size_t bytes, const ChargePurpose& purpose, const TenantShare& share = {});

  /// The same for bytes that are added to a charge (an empty one becomes one of this budget).
  void grow(Charge& charge, std::size_t bytes, const ChargePurpose& purpose);

  /// The same for an upload, whose client decides how long it lasts. All uploads together hold at most a quarter of the budget,
  /// unless there is one alone; those that have no more than a 4096th come first and may use the rest. So uploads that never end
  /// leave room for designs, and for small meshes.
  void grow_upload(Charge& charge, std::size_t bytes, const ChargePurpose& purpose, const TenantShare& share = {});

  /// A reclaimer gives back about `bytes` of idle memory. Called without a lock held, in the order of registration. Register all
  /// before the first charge.
  void add_reclaimer(std::function<void(std::size_t bytes)> reclaimer) { reclaimers_.push_back(std::move(reclaimer)); }

  std::size_t total() const { return meter_->total(); }
  std::size_t in_use() const { return meter_->in_use(); }

 private:
  static Charge charge_tenant(std::size_t bytes, const ChargePurpose& purpose, const TenantShare& share);

  const std::shared_ptr<MemoryMeter> meter_;
  const std::shared_ptr<MemoryMeter> of_calls_, of_uploads_;
  std::vector<std::function<void(std::size_t)>> reclaimers_;
};

/// Bytes of memory this process may use: of the machine or, where smaller, of its cgroup (version 2 or 1).
std::size_t available_memory();
/// The memory budget that is meant: of 0, 80 % of available_memory().
std::size_t memory_budget_of(std::size_t option);

/// Called where so many bytes have been freed. Once 16 MiB have come together in this process, by one call or by many, the
/// allocator gives what is free back to the system, which it otherwise keeps for later; true when it did. Any thread.
bool return_freed_memory(std::size_t bytes);
inline constexpr std::size_t freed_bytes_worth_returning = std::size_t{16} << 20;

/// Sets the allocator of this process so that what is freed can be given back. malloc_trim() leaves the free end of every
/// thread's heap as it is, which malloc() on its own lets grow to 64 MiB; a 256th of the memory budget may stay of each, from 8
/// to 64 MiB. Less would cost designs their time, which need the same memory again and again. Before threads allocate.
void limit_retained_memory(std::size_t budget);

/// Bytes of memory this process occupies now.
std::size_t resident_set_bytes();

}  // namespace deform::server
