// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/reactors.h"

#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <string>
#include <utility>

#include "core/base/text.h"
#include "proto/convert/base/error.h"
#include "server/rpc/option_text.h"
#include "server/rpc/peers.h"
#include "server/rpc/service_messages.h"
#include "server/rpc/status.h"

namespace deform::server {

namespace {

constexpr std::uint32_t full_memory_retry_ms = 1000;
constexpr std::uint32_t draining_retry_ms = 2000;
constexpr std::size_t longest_request_id = 128;
/// For a call whose time is over to say so itself.
constexpr std::chrono::milliseconds time_to_answer{500};
constexpr std::uint32_t busy_retry_ms = 200;
/// Bytes of an answer that gRPC hands to the system whether they are read or not: the first window of HTTP/2.
constexpr std::uint64_t taken_at_once = 65'535;

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

/// The first value of the client under this key; empty without.
std::string metadata_value(const grpc::CallbackServerContext& context, const char* key) {
  const auto found = context.client_metadata().find(key);
  return found == context.client_metadata().end() ? std::string() : std::string(found->second.data(), found->second.size());
}

/// A new call; throws Error(out_of_budget) with a retry hint when too many wait.
void let_in(ThreadPool& pool, ThreadPool::Task task) {
  if (pool.try_post(std::move(task))) return;
  throw Error(ErrorCode::out_of_budget,
              "too many calls are waiting (limit " + std::to_string(pool.queue_limit()) + "), try again later", busy_retry_ms)
      .refused_for(Refusal::queue);
}

}  // namespace

// ---- LiveCalls ----

void LiveCalls::enter(const std::string& client, Stop stop) {
  const std::lock_guard lock(mutex_);
  ++count_;
  if (stop == Stop::waits) ++awaited_;
  ++of_clients_[client];
}

void LiveCalls::leave(const std::string& client, Stop stop) {
  const std::lock_guard lock(mutex_);
  const auto own = of_clients_.find(client);
  if (--own->second == 0) of_clients_.erase(own);
  --count_;
  if (stop == Stop::waits && --awaited_ == 0) changed_.notify_all();
}

void LiveCalls::check(const std::string& client) const {
  constexpr std::size_t calls_per_free = 4;
  const std::lock_guard lock(mutex_);
  if (limit_ == 0) return;
  const auto found = of_clients_.find(client);
  const std::size_t own = found == of_clients_.end() ? 0 : found->second, left = limit_ - std::min(limit_, count_);
  if (count_ <= limit_ && own <= calls_per_free * left + 1) return;
  throw Error(ErrorCode::out_of_budget,
              "too many calls are open: " + std::to_string(own) + " of this client, " + std::to_string(count_) +
                  " of all, the limit is " + std::to_string(limit_) + " (--max-calls); try again later",
              busy_retry_ms)
      .refused_for(Refusal::queue);
}

bool LiveCalls::wait_for_none(std::chrono::steady_clock::time_point deadline) {
  std::unique_lock lock(mutex_);
  return changed_.wait_until(lock, deadline, [this] { return awaited_ == 0; });
}

// ---- CallScope ----

CallScope::CallScope(const char* method, const Incoming& incoming)
    : incoming_(incoming),
      started_(std::chrono::steady_clock::now()),
      admission_(incoming.access->admit(method, incoming.needed, *incoming.context)) {
  incoming_.metrics->call_begins();
  record.method = method;
  record.client = incoming.context->peer();
  record.identity = admission_.identity;
  record.trace = trace_id(metadata_value(*incoming.context, "traceparent"));
  record.client_request = metadata_value(*incoming.context, "x-request-id").substr(0, longest_request_id);
  call_.stop = stop_.get_token();
  OpenCall::About about{method, record.identity, admission_.tenant, record.client, record.client_request, record.trace};
  call_.open = incoming_.calls->open(std::move(about), stop_);
  call_.tenant = admission_.tenant;
  call_.quota = admission_.quota;
  call_.in_flight = incoming.in_flight->of(call_.tenant);
  if (call_.tenant != default_tenant) record.tenant = call_.tenant;
  const std::string host = incoming.proxies->host_of(*incoming.context);
  if (host != host_of(record.client)) record.host = host;
  call_.client = admission_.identity.empty() ? host : "identity " + admission_.identity;
  incoming_.live->enter(call_.client);
  // gRPC keeps wall-clock deadlines, "none" as the end of time.
  const auto deadline = incoming.context->deadline();
  const auto now = std::chrono::system_clock::now();
  if (deadline < now + std::chrono::hours(24 * 365)) {
    call_.deadline = started_ + std::chrono::duration_cast<std::chrono::steady_clock::duration>(deadline - now);
  }
  if (incoming.max_deadline.count() == 0) return;
  const auto limit = started_ + incoming.max_deadline;
  call_.deadline = std::min(limit, call_.deadline.value_or(limit));
  overdue_ = limit + time_to_answer;
  incoming_.overdue->watch(incoming_.context, *overdue_, too_long());
}

void CallScope::admit() {
  check_access();
  check_rate();
  check_draining();
  check_memory();
  if (incoming_.needed != Role::operate) incoming_.live->check(call_.client);
  if (incoming_.request == nullptr) return;
  held_.push_back(hold(*incoming_.request));
  call_.open->set_request_bytes(held_.back().bytes());
}

const google::protobuf::Descriptor& CallScope::request_type() const {
  const auto& pool = *google::protobuf::DescriptorPool::generated_pool();
  static const google::protobuf::ServiceDescriptor& service = *pool.FindServiceByName("deform.v1.DeformService");
  static const google::protobuf::ServiceDescriptor& admin = *pool.FindServiceByName("deform.v1.Admin");
  const auto* method = service.FindMethodByName(record.method);
  return *(method != nullptr ? method : admin.FindMethodByName(record.method))->input_type();
}

HeldRequests::Held CallScope::hold(const grpc::ByteBuffer& message) const {
  return incoming_.held->take(message, request_type(), share());
}

void CallScope::hold(std::size_t bytes) {
  held_.push_back(take(bytes));
  std::size_t all = 0;
  for (const auto& held : held_) all += held.bytes();
  call_.open->set_request_bytes(all);
}

void CallScope::check_draining() const {
  if (!*incoming_.draining || incoming_.needed != Role::use) return;
  throw Error(ErrorCode::unavailable, "the server is being drained and takes no new work; try another one, or again later",
              draining_retry_ms)
      .refused_for(Refusal::draining);
}

void CallScope::cut_off_soon() { cut_off_after(time_to_answer, given_up()); }

void CallScope::cut_off_when_stalled() {
  const auto time = incoming_.stall_timeout;
  if (time.count() > 0) cut_off_after(time, OpenCalls::stalled(OpenCall::Client::takes, time));
}

void CallScope::cut_off_after(std::chrono::milliseconds time, Error why) {
  const auto limit = std::chrono::steady_clock::now() + time;
  const std::lock_guard lock(admission_mutex_);
  if (left_ || cut_off_) return;
  cut_off_ = limit;
  incoming_.overdue->watch(incoming_.context, limit, std::move(why));
}

void CallScope::check_memory() const {
  if (!*incoming_.memory_full || incoming_.needed != Role::use) return;
  throw Error(ErrorCode::out_of_budget, "the process occupies more memory than --memory-budget allows for, try again later",
              full_memory_retry_ms)
      .refused_for(Refusal::memory);
}

void CallScope::check_access() {
  const std::lock_guard lock(admission_mutex_);
  if (admission_.generation != incoming_.access->generation()) {
    admission_ = incoming_.access->admit(record.method, incoming_.needed, *incoming_.context);
  }
  if (admission_.refusal) throw Error(*admission_.refusal);
  // What the call has begun with belongs to the tenant of then.
  if (admission_.tenant != call_.tenant) {
    throw Error(ErrorCode::unauthenticated, "\"" + admission_.identity + "\" belongs to another tenant now; call again");
  }
}

Quota CallScope::quota() const {
  const std::lock_guard lock(admission_mutex_);
  return admission_.quota;
}

void CallScope::check_rate() { incoming_.rates->take(call_.tenant, quota().requests_per_second); }

Error CallScope::too_long() const {
  return {ErrorCode::deadline_exceeded,
          "the call took longer than the " + to_seconds(incoming_.max_deadline) + " s that this server allows (--max-deadline)"};
}

Error CallScope::given_up() const {
  if (const auto ended = call_.open->ended()) return *ended;
  if (call_.deadline && std::chrono::steady_clock::now() >= *call_.deadline) {
    return {ErrorCode::deadline_exceeded, "the deadline of the call passed"};
  }
  return {ErrorCode::cancelled, "the call was cancelled"};
}

void CallScope::check() const {
  const bool late = call_.deadline && std::chrono::steady_clock::now() >= *call_.deadline;
  if (late || call_.stop.stop_requested()) throw given_up();
}

grpc::Status CallScope::finish(std::optional<Error> error) {
  call_.open->answered();  // whoever has the answer and asks for a list does not find the call there
  record.error = std::move(error);
  if (!record.error) return grpc::Status::OK;
  if (auto ended = call_.open->ended()) {
    record.error = std::move(ended);
  } else if (record.error->code() == ErrorCode::deadline_exceeded && overdue_ && call_.deadline == *overdue_ - time_to_answer) {
    record.error = too_long();
  }
  if (const std::uint32_t hint = record.error->retry_after_ms(); hint != 0) {
    incoming_.context->AddTrailingMetadata(convert::retry_after_key, std::to_string(hint));
  }
  return to_status(*record.error);
}

void CallScope::leave() {
  record.wall_ms = milliseconds_since(started_);
  if (overdue_) incoming_.overdue->forget(incoming_.context, *overdue_);
  std::optional<std::chrono::steady_clock::time_point> cut_off;
  {
    const std::lock_guard lock(admission_mutex_);
    left_ = true;
    cut_off = cut_off_;
  }
  if (cut_off) incoming_.overdue->forget(incoming_.context, *cut_off);
  caught([this] { incoming_.metrics->call_ends(record); });
  caught([this] { log_call(record); });
  held_.clear();
  if (incoming_.context->IsCancelled()) caught([this] { incoming_.floods->note_reset(record.client); });
  incoming_.live->leave(call_.client);
}

void note_stats(const CallStats& stats, CallRecord& record) {
  if (!stats.geometry_id.empty()) record.geometry = stats.geometry_id;
  if (!stats.system_id.empty()) record.system = stats.system_id;
  if (stats.designs != 0) record.designs = stats.designs;
  if (stats.points != 0) record.points = stats.points;
  record.queue_ms = stats.queue_ms;
  record.prepare_ms = stats.prepare_ms;
  record.solve_ms = stats.solve_ms;
  record.encode_ms = stats.encode_ms;
}

// ---- UnaryCall ----

UnaryCall::UnaryCall(const char* method, const Incoming& incoming, grpc::ByteBuffer* reply)
    : scope_(method, incoming), reply_(reply) {}

grpc::ServerUnaryReactor* UnaryCall::launch(ThreadPool& pool, const char* method, const Incoming& incoming,
                                            grpc::ByteBuffer* reply, Work work) {
  const std::shared_ptr<UnaryCall> call(new UnaryCall(method, incoming, reply));
  return enter(pool, call, [call, work = std::move(work)] { call->answer(work); });
}

grpc::ServerUnaryReactor* UnaryCall::launch_later(ThreadPool& pool, const char* method, const Incoming& incoming,
                                                  grpc::ByteBuffer* reply, Begin begin) {
  const std::shared_ptr<UnaryCall> call(new UnaryCall(method, incoming, reply));
  return enter(pool, call, [call, begin = std::move(begin)] {
    auto refused = caught([&] {
      call->scope_.check();
      begin(call->scope_, [call](const Work& work) { call->answer(work); });
    });
    if (refused) call->Finish(call->scope_.finish(std::move(refused)));
  });
}

grpc::ServerUnaryReactor* UnaryCall::enter(ThreadPool& pool, std::shared_ptr<UnaryCall> call, ThreadPool::Task task) {
  call->self_ = call;
  auto refused = caught([&] {
    call->scope_.admit();
    let_in(pool, std::move(task));
  });
  if (refused) call->Finish(call->scope_.finish(std::move(refused)));
  return call.get();
}

void UnaryCall::answer(const Work& work) {
  auto error = caught([&] {
    scope_.check();
    *reply_ = work(scope_);
    scope_.record.messages_out = 1;
    scope_.record.bytes_out = reply_->Length();
    scope_.hold(reply_->Length());  // until it is read
  });
  if (scope_.record.bytes_out > taken_at_once) scope_.cut_off_when_stalled();
  Finish(scope_.finish(std::move(error)));
}

void UnaryCall::OnDone() {
  scope_.leave();
  self_.reset();
}

// ---- ReplyWriter ----

template <typename Reactor>
Reactor* ReplyWriter<Reactor>::launch(std::shared_ptr<ReplyWriter> call) {
  call->self_ = call;
  call->watch_operator();
  if (auto refused = caught([&] { call->scope_.admit(); })) {
    call->end(std::move(refused));
  } else {
    call->run();
  }
  return call.get();
}

template <typename Reactor>
Reactor* ReplyWriter<Reactor>::launch(std::shared_ptr<ReplyWriter> call, ThreadPool& pool) {
  call->self_ = call;
  call->watch_operator();
  if (auto refused = caught([&] {
        call->scope_.admit();
        let_in(pool, [call] { call->run(); });
      })) {
    call->end(std::move(refused));
  }
  return call.get();
}

template <typename Reactor>
void ReplyWriter<Reactor>::watch_operator() {
  scope_.call().open->on_end([weak = this->weak_from_this()] {
    const auto self = weak.lock();
    if (!self) return;
    self->scope_.cut_off_soon();
    self->OnCancel();
  });
}

template <typename Reactor>
void ReplyWriter<Reactor>::run() {
  if (auto error = caught([this] { begin(); })) {
    end(std::move(error));
  } else {
    advance();
  }
}

template <typename Reactor>
void ReplyWriter<Reactor>::wake() {
  {
    const std::lock_guard lock(mutex_);
    if (state_ != State::idle) {
      asked_ = true;
      return;
    }
    state_ = State::working;
  }
  advance();
}

template <typename Reactor>
bool ReplyWriter<Reactor>::rest() {
  const std::lock_guard lock(mutex_);
  if (std::exchange(asked_, false)) return false;
  state_ = State::idle;
  return true;
}

template <typename Reactor>
void ReplyWriter<Reactor>::advance() {
  for (;;) {
    {
      const std::lock_guard lock(mutex_);
      asked_ = false;  // what was asked for so far is looked at now
    }
    if (given_up_) return end(scope_.given_up());
    Next step = Next::end;
    if (auto error = caught([&] { step = next(reply_); })) return end(std::move(error));
    if (step == Next::end) return end(std::nullopt);
    if (step == Next::wait) {
      if (rest()) return;
      continue;
    }
    scope_.record.messages_out += 1;
    scope_.record.bytes_out += reply_.Length();
    write_started_ = std::chrono::steady_clock::now();
    {
      const std::lock_guard lock(mutex_);
      state_ = State::writing;
    }
    scope_.await(OpenCall::Client::takes);
    this->StartWrite(&reply_);
    return;
  }
}

template <typename Reactor>
void ReplyWriter<Reactor>::end(std::optional<Error> error) {
  {
    const std::lock_guard lock(mutex_);
    state_ = State::finished;
  }
  if (error) stop();
  this->Finish(scope_.finish(std::move(error)));
}

template <typename Reactor>
void ReplyWriter<Reactor>::OnWriteDone(bool ok) {
  scope_.came(OpenCall::Client::takes);
  if (!ok) given_up_ = true;
  scope_.record.stream_ms += milliseconds_since(write_started_);
  {
    const std::lock_guard lock(mutex_);
    state_ = State::working;
  }
  advance();
}

template <typename Reactor>
void ReplyWriter<Reactor>::OnCancel() {
  scope_.cancel();
  given_up_ = true;
  stop();
  wake();
}

template <typename Reactor>
void ReplyWriter<Reactor>::OnDone() {
  // Whoever called Finish has left the lock when it is ours.
  { const std::lock_guard lock(mutex_); }
  done();
  scope_.leave();
  self_.reset();
}

template class ReplyWriter<grpc::ServerWriteReactor<grpc::ByteBuffer>>;
template class ReplyWriter<grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>>;

// ---- RequestStream ----

RequestStream::RequestStream(const char* method, const Incoming& incoming, grpc::ByteBuffer* reply, ThreadPool& pool)
    : scope_(method, incoming), pool_(pool), reply_(reply) {}

grpc::ServerReadReactor<grpc::ByteBuffer>* RequestStream::launch(std::shared_ptr<RequestStream> call) {
  call->self_ = call;
  if (auto refused = caught([&] { call->scope_.admit(); })) {
    call->answer(std::move(refused), nullptr);
  } else {
    call->state_ = State::reading;
    call->scope_.await(OpenCall::Client::sends);
    call->StartRead(&call->request_);
    call->watch_operator();
  }
  return call.get();
}

void RequestStream::watch_operator() {
  scope_.call().open->on_end([weak = weak_from_this()] {
    const auto self = weak.lock();
    if (!self) return;
    self->scope_.cancel();
    self->scope_.cut_off_soon();
    {
      const std::lock_guard lock(self->mutex_);
      if (self->state_ != State::waiting && self->state_ != State::reading) return;  // who is handling looks for it afterwards
      self->state_ = State::finished;
    }
    self->Finish(self->scope_.finish(self->scope_.given_up()));
  });
}

void RequestStream::OnReadDone(bool ok) {
  scope_.came(OpenCall::Client::sends);
  {
    const std::lock_guard lock(mutex_);
    if (state_ == State::finished) return;  // answered while it was read
    state_ = State::handling;
  }
  if (ok) {
    pool_.post([self = shared_from_this()] { self->handle(Came::message); });
  } else {
    StartSendInitialMetadata();
  }
}

/// A client that has said all and one that is lost in the middle end the reading alike, and OnCancel may be late. What was read
/// so far may look complete. But nothing can be sent any more to a client that is lost.
void RequestStream::OnSendInitialMetadataDone(bool ok) {
  pool_.post([self = shared_from_this(), ok] { self->handle(ok ? Came::all : Came::lost); });
}

void RequestStream::handle(Came what) {
  Then then = Then::later;
  auto error = caught([&] {
    scope_.check_access();  // the caller may have been struck out since the stream was opened
    scope_.check();
    if (what == Came::lost) throw Error(ErrorCode::cancelled, "the client left before it had sent all");
    if (what == Came::all) return half_closed();
    scope_.record.messages_in += 1;
    scope_.record.bytes_in += request_.Length();
    const auto held = scope_.hold(request_);
    then = message(request_);
    request_.Clear();  // the next one may never come, and this one is charged no longer
  });
  if (error) return answer(std::move(error), nullptr);
  {
    const std::lock_guard lock(mutex_);
    if (state_ != State::handling) return;                       // answered already
    const bool ended = scope_.call().open->ended().has_value();  // by the operator, who left the end to us
    state_ = then == Then::read && !ended ? State::reading : State::waiting;
    if (ended) then = Then::later;
  }
  if (then == Then::read) {
    scope_.await(OpenCall::Client::sends);
    StartRead(&request_);
  } else if (scope_.call().stop.stop_requested()) {
    answer(scope_.given_up(), nullptr);  // OnCancel came while we were handling and left the end to us
  }
}

void RequestStream::answer(std::optional<Error> error, const google::protobuf::Message* reply, const CallStats& stats) {
  {
    const std::lock_guard lock(mutex_);
    if (state_ == State::finished) return;
    state_ = State::finished;
  }
  note_stats(stats, scope_.record);
  if (!error && reply != nullptr) {
    error = caught([&] {
      *reply_ = serialized(*reply);
      scope_.record.messages_out = 1;
      scope_.record.bytes_out = reply_->Length();
      scope_.hold(reply_->Length());  // until it is read
    });
  }
  if (scope_.record.bytes_out > taken_at_once) scope_.cut_off_when_stalled();
  Finish(scope_.finish(std::move(error)));
}

void RequestStream::OnCancel() {
  scope_.cancel();
  bool waiting = false;
  {
    const std::lock_guard lock(mutex_);
    waiting = state_ == State::waiting;
  }
  // A read in flight ends by itself, and who is handling looks at the token afterwards.
  if (waiting) answer(scope_.given_up(), nullptr);
}

void RequestStream::OnDone() {
  { const std::lock_guard lock(mutex_); }
  scope_.leave();
  self_.reset();
}

}  // namespace deform::server
