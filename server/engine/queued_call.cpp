// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/queued_call.h"

#include <algorithm>
#include <utility>

namespace deform::server {

template <typename Reply>
QueuedCall<Reply>::QueuedCall(const QueueParts& parts, const std::string& system_id, SystemCache::Source source,
                              std::size_t designs, CallContext context, std::function<void()> on_ready)
    : Call(std::move(context)), queue_(parts), source_(std::move(source)), on_ready_(std::move(on_ready)) {
  stats_.system_id = system_id;
  stats_.designs = designs;
}

template <typename Reply>
std::size_t QueuedCall<Reply>::share() const {
  return std::max<std::size_t>(
      1, static_cast<std::size_t>(queue_.scheduler->workers()) / std::max<std::size_t>(1, queue_.scheduler->load().running));
}

template <typename Reply>
void QueuedCall<Reply>::begin() {
  if (const auto error = overdue(accepted_)) throw *error;
  place_ = queue_.scheduler->enter(
      context().client, queue_.cache->would_find(key(), source_) ? Scheduler::Queue::workers : Scheduler::Queue::preparations);
  queue_.calls->add(shared_from_this());
  try {
    ask();
  } catch (...) {
    queue_.calls->remove(this);
    throw;
  }
}

template <typename Reply>
void QueuedCall<Reply>::ask() {
  if (context().open) context().open->set_subject("", stats_.system_id);
  enter(v1::CALL_PREPARING);
  SystemCache::Asker asker;
  asker.client = context().client;
  asker.tenant = context().tenant;
  asker.most_preparations = context().quota.preparations;
  asker.on_done = [call = self()](SystemCache::Handle system, const std::optional<Error>& error) {
    call->on_system(std::move(system), error);
  };
  auto [system, ticket] = queue_.cache->acquire(key(), source_, std::move(asker));
  if (system) return enqueue(std::move(system));
  const std::lock_guard lock(mutex_);
  if (!ended_) ticket_ = std::move(ticket);  // otherwise it leaves here
}

template <typename Reply>
void QueuedCall<Reply>::on_system(SystemCache::Handle system, const std::optional<Error>& error) {
  if (error) return fail(*error);
  {
    const std::lock_guard lock(mutex_);
    prepared_again_ = system->extent == ResidentSystem::Extent::whole;
    stats_.prepare_ms = elapsed_ms(accepted_);
  }
  enqueue(std::move(system));
}

template <typename Reply>
void QueuedCall<Reply>::enqueue(SystemCache::Handle system) {
  const std::lock_guard lock(mutex_);
  if (ended_) return;
  system_ = std::move(system);
  const double cost = static_cast<double>(stats_.designs) * system_->design_work();
  enter(v1::CALL_WAITING);
  if (context().open) {
    context().open->set_cost(cost);
    context().open->set_subject(system_->info.geometry_id(), "");
  }
  queue_.scheduler->start(context().client, this, cost, [call = self()](Scheduler::Slot slot) { call->take(std::move(slot)); });
}

template <typename Reply>
void QueuedCall<Reply>::take(Scheduler::Slot slot) {
  SystemCache::Handle system;
  {
    const std::lock_guard lock(mutex_);
    if (ended_) return;
    place_.leave();
    slot_ = std::move(slot);
    stats_.queue_ms = elapsed_ms(accepted_);
    enter(v1::CALL_RUNNING);
    system = system_;
  }
  start(system);
}

template <typename Reply>
DeformJob::Poll QueuedCall<Reply>::poll(Reply& reply) {
  const std::lock_guard lock(mutex_);
  if (!replies_.empty()) {
    reply = std::move(replies_.front());
    replies_.pop_front();
    on_taken(reply);
    if (replies_.empty() && produced_) end();
    return DeformJob::Poll::reply;
  }
  if (ended_) return DeformJob::Poll::done;
  reader_waits_ = true;
  return DeformJob::Poll::pending;
}

template <typename Reply>
void QueuedCall<Reply>::fail(const Error& error) {
  stop();
  Notice notice(*this);
  std::deque<Reply> dropped;  // destroyed after the lock
  const std::lock_guard lock(mutex_);
  if (ended_) return;
  error_ = reason(error);
  dropped.swap(replies_);
  end();
  notice.check();
}

template <typename Reply>
void QueuedCall<Reply>::end() {
  ended_ = true;
  drop();
  place_.leave();
  slot_.leave();
  ticket_.leave();
  system_.reset();
  queue_.scheduler->remove(this);
  queue_.calls->remove(this);
}

template <typename Reply>
std::optional<Error> QueuedCall<Reply>::error() const {
  const std::lock_guard lock(mutex_);
  return error_;
}

template <typename Reply>
CallStats QueuedCall<Reply>::stats() const {
  const std::lock_guard lock(mutex_);
  return stats_;
}

template class QueuedCall<v1::DeformReply>;
template class QueuedCall<v1::EvaluateReply>;

}  // namespace deform::server
