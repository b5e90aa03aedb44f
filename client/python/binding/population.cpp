// SPDX-License-Identifier: Apache-2.0
#include "client/python/binding/population.h"

#include <algorithm>
#include <utility>

namespace deform::python {

Population::Population(client::Client& client, Options options)
    : client_(client), options_(std::move(options)), stop_(options_.stop) {
  const std::size_t batches = (options_.designs.size() + options_.batch - 1) / options_.batch;
  running_ = std::min(options_.requests, batches);
  for (std::size_t i = 0; i < running_; ++i) threads_.emplace_back([this] { run(); });
}

Population::~Population() {
  cancel();
  changed_.notify_all();
  for (auto& thread : threads_) thread.join();
}

std::optional<Population::Done> Population::next(std::chrono::milliseconds most) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, most, [this] { return !finished_.empty() || running_ == 0; });
  if (finished_.empty()) {
    if (running_ == 0 && error_) std::rethrow_exception(error_);
    return std::nullopt;
  }
  Done done = std::move(finished_.front());
  finished_.pop_front();
  ++taken_;
  lock.unlock();
  changed_.notify_all();
  return done;
}

bool Population::at_end() const {
  const std::lock_guard lock(mutex_);
  return taken_ == options_.designs.size();
}

bool Population::wait(std::chrono::milliseconds most) {
  std::unique_lock lock(mutex_);
  return changed_.wait_for(lock, most, [this] { return running_ == 0; });
}

bool Population::take_batch(std::size_t& first, std::size_t& end) {
  std::unique_lock lock(mutex_);
  const auto may_begin = [this] { return !options_.target.empty() || finished_.size() < options_.batch || error_; };
  changed_.wait(lock, stop_.get_token(), may_begin);  // stopped: the next request tells
  if (error_ || next_design_ == options_.designs.size()) return false;
  first = next_design_;
  end = next_design_ = std::min(first + options_.batch, options_.designs.size());
  return true;
}

void Population::run() {
  std::size_t first = 0, end = 0;
  try {
    while (take_batch(first, end)) evaluate(first, end);
  } catch (...) {
    const std::lock_guard lock(mutex_);
    if (!error_) error_ = std::current_exception();
  }
  {
    const std::lock_guard lock(mutex_);
    --running_;
    changed_.notify_all();
  }
}

void Population::evaluate(std::size_t first, std::size_t end) {
  v1::DeformRequest request = options_.request;
  for (std::size_t i = first; i < end; ++i) *request.add_designs() = options_.designs[i];
  client::CallOptions call = options_.call;
  call.stop = stop_.get_token();
  if (call.timeout) {
    const auto spent = std::chrono::duration_cast<std::chrono::milliseconds>(RunContext::Clock::now() - started_);
    call.timeout = std::max(std::chrono::milliseconds(1), *call.timeout - spent);
  }
  const auto sink = [&](std::size_t k, client::DeformedDesign&& deformed) { finish(first + k, std::move(deformed)); };
  client::DesignMemory memory;
  if (!options_.target.empty()) memory = [&](std::size_t k) { return memory_of(first + k); };
  client_.deform(request, call, sink, memory);
}

std::span<Vec3> Population::memory_of(std::size_t design) const {
  const std::size_t points = options_.target.size() / options_.designs.size();
  return options_.target.subspan(design * points, points);
}

void Population::finish(std::size_t design, client::DeformedDesign&& deformed) {
  const std::lock_guard lock(mutex_);
  finished_.push_back({design, std::move(deformed)});
  changed_.notify_all();
}

}  // namespace deform::python
