// SPDX-License-Identifier: Apache-2.0
#include "client/route.h"

#include <utility>

#include "client/connection.h"
#include "client/status.h"

namespace deform::client {

Subject of_geometry(const std::string& id) {
  Subject subject;
  subject.geometry = id;
  return subject;
}

Subject of_system(const std::string& id) {
  Subject subject;
  subject.system = id;
  return subject;
}

Subject on_server(Server& server, const std::string& geometry) {
  Subject subject;
  subject.geometry = geometry;
  subject.elsewhere = false;
  subject.only = &server;
  return subject;
}

Route::Route(Connection& connection, Subject subject, Retry retry)
    : connection_(connection),
      subject_(std::move(subject)),
      geometry_(subject_.geometry.empty() ? connection.geometry_of.get(subject_.system).value_or("") : subject_.geometry),
      retry_(retry),
      policy_({connection.options.replicas ? 2 * connection.options.max_attempts : connection.options.max_attempts,
               connection.options.retry_seed + connection.calls++, retry, connection.patience()}) {
  begin_round();
}

void Route::begin_round() {
  const std::string& key = geometry_.empty() ? subject_.system : geometry_;
  order_ = subject_.only != nullptr ? std::vector<Server*>{subject_.only} : connection_.ranked(key);
  at_ = 0;
  unknown_ = false;
  unreachable_.clear();
}

void Route::go(const RunContext& limits) {
  const auto wait = std::exchange(wait_, std::chrono::milliseconds(0));
  if (Server* lost = std::exchange(returning_, nullptr)) {
    connection_.wait_for_return(*lost, wait, limits);
  } else if (wait.count() > 0) {
    RetryPolicy::wait(wait, limits);
  }
  if (Server* silent = std::exchange(connect_to_, nullptr)) connection_.wait_for_answer(*silent, limits);
  limits.check();
  if (!bring_) return;
  connection_.bring(server(), subject_, geometry_, limits);
  bring_ = false;
}

void Route::arrived() {
  connection_.answered = true;
  if (unknown_) connection_.found_at.keep(geometry_.empty() ? subject_.system : geometry_, &server());
}

bool Route::next_server() {
  bring_ = false;
  if (at_ + 1 == order_.size()) return false;
  ++at_;
  return true;
}

/// NOT_FOUND, which another one may not say.
bool Route::unknown_there() {
  const int most = connection_.options.replicas ? connection_.options.max_attempts : 1;  // the next one may be another one
  if (subject_.bring && connection_.holds(subject_, geometry_) && brought_[&server()]++ < most) return bring_ = true;
  unknown_ = true;
  // A proxy has nothing to choose by, and asks another one next time.
  if (connection_.options.replicas && geometry_.empty() && ++guesses_ < connection_.options.max_attempts) return true;
  return next_server();
}

/// UNAVAILABLE from one of several.
bool Route::out_of_reach(const Error& error) {
  server().avoid();
  brought_.erase(&server());  // it may come back empty
  unreachable_ += (unreachable_.empty() ? "" : ", ") + server().address;
  const bool sent = dynamic_cast<const NotConnected*>(&error) == nullptr;
  return (retry_ == Retry::safe || !sent) && next_server();
}

void Route::failed(const Error& error, const RunContext& limits, Repeat repeat) {
  const bool several = order_.size() > 1;
  const bool unknown = connection_.keeps_copies() && subject_.elsewhere && error.code() == ErrorCode::not_found;
  const bool lost = several && error.code() == ErrorCode::unavailable;
  if (repeat == Repeat::no) throw;
  if (repeat == Repeat::afresh) policy_.start_afresh();
  if ((unknown && unknown_there()) || (lost && out_of_reach(error))) return;
  const bool partly = (unknown || lost) && unknown_ && !unreachable_.empty();
  const Error both(ErrorCode::unavailable,
                   (geometry_.empty() ? "system " + subject_.system : "geometry " + geometry_) +
                       ": the servers that answer do not know it, and these cannot be reached: " + unreachable_);
  const auto wait = policy_.next_wait(partly ? both : error);
  if (!wait || (limits.deadline && RunContext::Clock::now() + *wait >= *limits.deadline)) {
    if (partly) throw both;
    throw;
  }
  wait_ = *wait;
  if (connection_.options.on_wait && error.code() == ErrorCode::unavailable) connection_.options.on_wait(error);
  const auto* none = dynamic_cast<const NotConnected*>(&error);
  connect_to_ = none != nullptr && none->silent() ? &server() : nullptr;
  if (partly || lost) begin_round();
  returning_ = error.code() == ErrorCode::unavailable && connect_to_ == nullptr ? &server() : nullptr;
}

}  // namespace deform::client
