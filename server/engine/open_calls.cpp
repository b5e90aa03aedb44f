// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/engine/open_calls.h"

#include <utility>

#include "core/base/number_text.h"

namespace deform::server {

namespace {

/// The longest text that is kept of what clients write: ids are no longer.
constexpr std::size_t longest_id = 64;

std::uint64_t milliseconds(OpenCall::Clock::duration time) {
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::milliseconds>(time).count());
}

std::shared_ptr<OpenCall> opened(const OpenCallBookPtr& book, OpenCall::About about, std::stop_source stop) {
  const std::lock_guard lock(book->mutex);
  const std::uint64_t id = ++book->last_id;
  auto call = std::make_shared<OpenCall>(book, id, std::move(about), std::move(stop));
  book->calls.emplace(id, call);
  return call;
}

}  // namespace

// ---- OpenCall ----

OpenCall::OpenCall(OpenCallBookPtr book, std::uint64_t id, About about, std::stop_source stop)
    : book_(std::move(book)), id_(id), about_(std::move(about)), stop_(std::move(stop)) {}

OpenCall::~OpenCall() { answered(); }

void OpenCall::answered() {
  const std::lock_guard lock(book_->mutex);
  book_->calls.erase(id_);
}

std::shared_ptr<OpenCall> OpenCall::open_request(std::uint64_t number, std::stop_source stop) const {
  About request = about_;
  request.stream = id_;
  request.stream_request = number;
  return opened(book_, std::move(request), std::move(stop));
}

void OpenCall::enter(v1::CallState state) {
  const std::lock_guard lock(mutex_);
  if (state == state_) return;
  state_ = state;
  state_since_ = Clock::now();
}

void OpenCall::set_cost(double cost) {
  const std::lock_guard lock(mutex_);
  cost_ = cost;
}

void OpenCall::set_subject(const std::string& geometry, const std::string& system) {
  const std::lock_guard lock(mutex_);
  if (!geometry.empty()) geometry_ = geometry.substr(0, longest_id);
  if (!system.empty()) system_ = system.substr(0, longest_id);
}

void OpenCall::set_request_bytes(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  request_bytes_ = bytes;
}

void OpenCall::set_result_bytes(std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  result_bytes_ = bytes;
}

void OpenCall::await(Client what) { awaited_since_[static_cast<std::size_t>(what)] = Clock::now().time_since_epoch().count(); }

void OpenCall::came(Client what) { awaited_since_[static_cast<std::size_t>(what)] = 0; }

bool OpenCall::end(const Error& why) {
  std::function<void()> action;
  {
    const std::lock_guard lock(mutex_);
    if (ended_) return false;
    ended_ = why;
    action = std::move(on_end_);
  }
  stop_.request_stop();  // after the error is there: who stops looks for it
  if (action) action();
  return true;
}

std::optional<Error> OpenCall::ended() const {
  const std::lock_guard lock(mutex_);
  return ended_;
}

void OpenCall::on_end(std::function<void()> action) {
  {
    const std::lock_guard lock(mutex_);
    if (!ended_) {
      on_end_ = std::move(action);
      return;
    }
  }
  action();
}

void OpenCall::describe(v1::CallInfo& info, Clock::time_point now) const {
  info.set_id(id_);
  info.set_method(about_.method);
  info.set_milliseconds(milliseconds(now - since_));
  info.set_identity(about_.identity);
  info.set_tenant(about_.tenant);
  info.set_peer(about_.peer);
  info.set_request(about_.request);
  info.set_trace(about_.trace);
  info.set_stream(about_.stream);
  info.set_stream_request(about_.stream_request);
  const std::lock_guard lock(mutex_);
  info.set_state(state_);
  info.set_state_milliseconds(milliseconds(now - state_since_));
  info.set_cost(cost_);
  info.set_geometry(geometry_);
  info.set_system(system_);
  info.set_bytes_held(request_bytes_ + result_bytes_);
}

// ---- OpenCalls ----

std::shared_ptr<OpenCall> OpenCalls::open(OpenCall::About about, std::stop_source stop) {
  return opened(book_, std::move(about), std::move(stop));
}

std::vector<std::shared_ptr<OpenCall>> OpenCalls::all() const {
  std::vector<std::shared_ptr<OpenCall>> open;
  const std::lock_guard lock(book_->mutex);
  for (const auto& [id, weak] : book_->calls) {
    if (auto call = weak.lock()) open.push_back(std::move(call));
  }
  return open;
}

void OpenCalls::end_stalled(std::chrono::milliseconds longest) {
  const OpenCall::Clock::rep limit = (OpenCall::Clock::now() - longest).time_since_epoch().count();
  for (const auto& call : all()) {
    for (const auto what : {OpenCall::Client::sends, OpenCall::Client::takes}) {
      const OpenCall::Clock::rep since = call->awaited_since_[static_cast<std::size_t>(what)];
      if (since == 0 || since > limit) continue;
      call->end(stalled(what, longest));
    }
  }
}

Error OpenCalls::stalled(OpenCall::Client what, std::chrono::milliseconds longest) {
  const std::string time = number_digits(std::chrono::duration<double>(longest).count()) + " s (--stall-timeout)";
  if (what == OpenCall::Client::takes) return {ErrorCode::unavailable, "the client took nothing of the answer for " + time};
  return {ErrorCode::deadline_exceeded, "the client sent nothing more for " + time};
}

v1::ListCallsReply OpenCalls::list(const std::optional<std::string>& tenant, std::uint64_t but, std::size_t limit) const {
  const std::vector<std::shared_ptr<OpenCall>> open = all();
  v1::ListCallsReply reply;
  std::uint64_t waiting = 0;
  const auto now = OpenCall::Clock::now();
  for (const auto& call : open) {
    if (call->id() == but) continue;
    v1::CallInfo info;
    call->describe(info, now);
    if (info.state() == v1::CALL_WAITING) info.set_ahead(waiting++);
    if (tenant && call->about().tenant != *tenant) continue;
    if (static_cast<std::size_t>(reply.calls_size()) == limit) {
      reply.set_left_out(reply.left_out() + 1);
    } else {
      *reply.add_calls() = std::move(info);
    }
  }
  return reply;
}

v1::CallInfo OpenCalls::end(std::uint64_t id, const std::optional<std::string>& tenant, const Error& why) {
  std::shared_ptr<OpenCall> call;
  {
    const std::lock_guard lock(book_->mutex);
    const auto found = book_->calls.find(id);
    if (found != book_->calls.end()) call = found->second.lock();
  }
  if (!call || (tenant && call->about().tenant != *tenant)) {
    throw Error(ErrorCode::not_found, "call " + std::to_string(id) + ": there is no such call, or it has ended");
  }
  v1::CallInfo info;
  call->describe(info, OpenCall::Clock::now());
  call->end(why);
  return info;
}

std::size_t OpenCalls::size() const {
  const std::lock_guard lock(book_->mutex);
  return book_->calls.size();
}

}  // namespace deform::server
