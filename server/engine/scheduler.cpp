// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/scheduler.h"

#include <algorithm>
#include <utility>

#include "core/base/error.h"

namespace deform::server {

namespace {

constexpr std::uint32_t retry_queue_ms = 200;
constexpr std::size_t places_per_free = 4;  // what a client may have, for each that is free

}  // namespace

Scheduler::Place& Scheduler::Place::operator=(Place&& other) noexcept {
  if (this != &other) {
    leave();
    scheduler_ = std::exchange(other.scheduler_, nullptr);
    queue_ = other.queue_;
    client_ = std::move(other.client_);
  }
  return *this;
}

void Scheduler::Place::leave() {
  if (scheduler_ != nullptr) std::exchange(scheduler_, nullptr)->leave_place(queue_, client_);
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

Scheduler::Scheduler(const Options& options) : options_(options), queue_limit_(options.queue_limit) {
  for (int i = 0; i < options.workers; ++i) threads_.emplace_back([this] { run_worker(); });
  for (int i = 0; i < options.preparation_workers; ++i) threads_.emplace_back([this] { run_preparations(false); });
  threads_.emplace_back([this] { run_preparations(true); });
}

Scheduler::~Scheduler() { stop(); }

Scheduler::Place Scheduler::enter(const std::string& client, Queue queue) {
  const std::lock_guard lock(mutex_);
  std::size_t& waiting = waiting_in(queue);
  const std::string full = queue == Queue::workers ? "the queue is full" : "the queue for preparations is full";
  if (waiting >= queue_limit_) {
    throw Error(ErrorCode::out_of_budget,
                full + ": " + std::to_string(waiting) + " requests wait, the limit is " + std::to_string(queue_limit_) +
                    "; try again later",
                retry_queue_ms)
        .refused_for(Refusal::queue);
  }
  const auto it = places_.find({queue, client});
  const std::size_t own = it == places_.end() ? 0 : it->second, left = queue_limit_ - waiting;
  if (own > places_per_free * left) {
    throw Error(ErrorCode::out_of_budget,
                full + " for this client: " + std::to_string(own) + " of its requests wait, the last " + std::to_string(left) +
                    " of " + std::to_string(queue_limit_) + " places are kept for others; try again later",
                retry_queue_ms)
        .refused_for(Refusal::queue);
  }
  ++places_[{queue, client}];
  ++waiting;
  return Place(this, queue, client);
}

void Scheduler::start(const std::string& client, const void* owner, double cost, std::function<void(Slot)> work) {
  const std::lock_guard lock(mutex_);
  starts_.push(client, owner, cost, std::move(work));
  work_available_.notify_one();
}

void Scheduler::step(const void* owner, Work work) {
  const std::lock_guard lock(mutex_);
  steps_.push_back({owner, std::move(work)});
  work_available_.notify_one();
}

void Scheduler::prepare(const std::string& client, const void* owner, double seconds, Work work) {
  const std::lock_guard lock(mutex_);
  FairQueue<Work>& queue = seconds <= short_seconds ? short_preparations_ : preparations_;
  queue.push(client, owner, std::max(seconds, least_seconds), std::move(work));
  preparation_available_.notify_all();  // not all of them take it
}

Scheduler::Slot Scheduler::resume() {
  const std::lock_guard lock(mutex_);
  ++load_.running;
  return Slot(this);
}

void Scheduler::remove(const void* owner) {
  // Destroyed after the lock: they may own what calls back into here.
  std::deque<Piece> pieces;
  std::vector<std::function<void(Slot)>> starts;
  std::vector<Work> preparations, short_preparations;
  const std::lock_guard lock(mutex_);
  for (auto it = steps_.begin(); it != steps_.end();) {
    if (it->owner == owner) {
      pieces.push_back(std::move(*it));
      it = steps_.erase(it);
    } else {
      ++it;
    }
  }
  starts = starts_.remove(owner);
  preparations = preparations_.remove(owner);
  short_preparations = short_preparations_.remove(owner);
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

void Scheduler::set_queue_limit(std::size_t requests) {
  const std::lock_guard lock(mutex_);
  queue_limit_ = requests;
}

std::size_t Scheduler::queue_limit() const {
  const std::lock_guard lock(mutex_);
  return queue_limit_;
}

bool Scheduler::take_step(Work& work) {
  if (steps_.empty()) return false;
  work = std::move(steps_.front().work);
  steps_.pop_front();
  return true;
}

// Takes the slot too.
bool Scheduler::take_start(std::function<void(Slot)>& work) {
  if (load_.running >= options_.running_limit) return false;
  if (!starts_.pop(work)) return false;
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

void Scheduler::run_preparations(bool only_short) {
  std::unique_lock lock(mutex_);
  for (;;) {
    Work work;
    const bool found = (!only_short && preparations_.pop(work)) || short_preparations_.pop(work);
    if (!found) {
      if (stopping_) return;
      preparation_available_.wait(lock);
      continue;
    }
    ++load_.preparations;
    lock.unlock();
    work();
    work = nullptr;
    lock.lock();
    --load_.preparations;
  }
}

void Scheduler::leave_place(Queue queue, const std::string& client) {
  const std::lock_guard lock(mutex_);
  --waiting_in(queue);
  const auto it = places_.find({queue, client});
  if (--it->second == 0) places_.erase(it);
}

void Scheduler::leave_slot() {
  const std::lock_guard lock(mutex_);
  --load_.running;
  work_available_.notify_one();
}

}  // namespace deform::server
