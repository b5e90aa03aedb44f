// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/scheduler.h"

#include <algorithm>
#include <utility>

#include "core/base/error.h"

namespace deform::server {

namespace {

constexpr std::uint32_t retry_queue_ms = 200;

template <typename Queue>
void remove_from(Queue& queue, const void* owner, Queue& removed) {
  for (auto it = queue.begin(); it != queue.end();) {
    if (it->owner == owner) {
      removed.push_back(std::move(*it));
      it = queue.erase(it);
    } else {
      ++it;
    }
  }
}

}  // namespace

Scheduler::Place& Scheduler::Place::operator=(Place&& other) noexcept {
  if (this != &other) {
    leave();
    scheduler_ = std::exchange(other.scheduler_, nullptr);
  }
  return *this;
}

void Scheduler::Place::leave() {
  if (scheduler_ != nullptr) std::exchange(scheduler_, nullptr)->leave_place();
}

Scheduler::Slot& Scheduler::Slot::operator=(Slot&& other) noexcept {
  if (this != &other) {
    leave();
    scheduler_ = std::exchange(other.scheduler_, nullptr);
  }
  return *this;
}

void Scheduler::Slot::leave() {
  if (scheduler_ != nullptr) std::exchange(scheduler_, nullptr)->leave_slot();
}

Scheduler::Scheduler(const Options& options) : options_(options) {
  for (int i = 0; i < options.workers; ++i) threads_.emplace_back([this] { run_worker(); });
  for (int i = 0; i < options.preparation_workers; ++i) threads_.emplace_back([this] { run_preparations(); });
}

Scheduler::~Scheduler() { stop(); }

Scheduler::Place Scheduler::enter() {
  const std::lock_guard lock(mutex_);
  if (load_.waiting >= options_.queue_limit) {
    throw Error(ErrorCode::out_of_budget,
                "the queue is full: " + std::to_string(load_.waiting) + " requests wait, the limit is " +
                    std::to_string(options_.queue_limit) + "; try again later",
                retry_queue_ms);
  }
  ++load_.waiting;
  return Place(this);
}

void Scheduler::start(const std::string& client, const void* owner, std::function<void(Slot)> work) {
  const std::lock_guard lock(mutex_);
  starts_[client].push_back({owner, std::move(work)});
  work_available_.notify_one();
}

void Scheduler::step(const void* owner, Work work) {
  const std::lock_guard lock(mutex_);
  steps_.push_back({owner, std::move(work)});
  work_available_.notify_one();
}

void Scheduler::prepare(const void* owner, Work work) {
  const std::lock_guard lock(mutex_);
  preparations_.push_back({owner, std::move(work)});
  preparation_available_.notify_one();
}

Scheduler::Slot Scheduler::resume() {
  const std::lock_guard lock(mutex_);
  ++load_.running;
  return Slot(this);
}

void Scheduler::remove(const void* owner) {
  std::deque<Piece> pieces;  // destroyed after the lock: they may own what calls back into here
  std::deque<Start> starts;
  const std::lock_guard lock(mutex_);
  remove_from(steps_, owner, pieces);
  remove_from(preparations_, owner, pieces);
  for (auto it = starts_.begin(); it != starts_.end();) {
    remove_from(it->second, owner, starts);
    it = it->second.empty() ? starts_.erase(it) : std::next(it);
  }
}

void Scheduler::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    work_available_.notify_all();
    preparation_available_.notify_all();
  }
  for (auto& thread : threads_) thread.join();
  threads_.clear();
}

Scheduler::Load Scheduler::load() const {
  const std::lock_guard lock(mutex_);
  return load_;
}

bool Scheduler::take_step(Work& work) {
  if (steps_.empty()) return false;
  work = std::move(steps_.front().work);
  steps_.pop_front();
  return true;
}

// Takes the slot too.
bool Scheduler::take_start(std::function<void(Slot)>& work) {
  if (starts_.empty() || load_.running >= options_.running_limit) return false;
  auto next = starts_.upper_bound(last_client_);
  if (next == starts_.end()) next = starts_.begin();
  last_client_ = next->first;
  work = std::move(next->second.front().work);
  next->second.pop_front();
  if (next->second.empty()) starts_.erase(next);
  ++load_.running;
  return true;
}

void Scheduler::run_worker() {
  std::unique_lock lock(mutex_);
  for (;;) {
    Work step;
    std::function<void(Slot)> start;
    const bool found = step_next_ ? take_step(step) || take_start(start) : take_start(start) || take_step(step);
    if (!found) {
      if (stopping_) return;
      work_available_.wait(lock);
      continue;
    }
    step_next_ = static_cast<bool>(start);
    lock.unlock();
    if (start) {
      start(Slot(this));
    } else {
      step();
    }
    start = nullptr;  // what the work owned goes before the lock comes back
    step = nullptr;
    lock.lock();
  }
}

void Scheduler::run_preparations() {
  std::unique_lock lock(mutex_);
  for (;;) {
    preparation_available_.wait(lock, [&] { return stopping_ || !preparations_.empty(); });
    if (preparations_.empty()) return;
    Work work = std::move(preparations_.front().work);
    preparations_.pop_front();
    ++load_.preparations;
    lock.unlock();
    work();
    work = nullptr;
    lock.lock();
    --load_.preparations;
  }
}

void Scheduler::leave_place() {
  const std::lock_guard lock(mutex_);
  --load_.waiting;
}

void Scheduler::leave_slot() {
  const std::lock_guard lock(mutex_);
  --load_.running;
  work_available_.notify_one();
}

}  // namespace deform::server
