// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "deform/v1/admin.pb.h"
#include "server/store/tenant.h"

namespace deform::server {

class OpenCall;

/// Those that are not answered, by id; each call keeps it, so that it lasts as long as any of them.
struct OpenCallBook {
  std::mutex mutex;
  // under mutex
  std::map<std::uint64_t, std::weak_ptr<OpenCall>> calls;
  std::uint64_t last_id = 0;
};
using OpenCallBookPtr = std::shared_ptr<OpenCallBook>;

/// A call under way, or a request within a stream, as the operator of the server sees it, and how it is ended from outside.
/// Thread-safe.
class OpenCall {
 public:
  using Clock = std::chrono::steady_clock;

  /// Who calls what; does not change.
  struct About {
    std::string method, identity, tenant = default_tenant, peer, request, trace;
    std::uint64_t stream = 0;          ///< id of the call that it is a request of; 0: it is none
    std::uint64_t stream_request = 0;  ///< its number there
  };

  OpenCall(OpenCallBookPtr book, std::uint64_t id, About about, std::stop_source stop);
  ~OpenCall();
  OpenCall(const OpenCall&) = delete;
  OpenCall& operator=(const OpenCall&) = delete;

  /// A request of this call, which is a stream.
  std::shared_ptr<OpenCall> open_request(std::uint64_t number, std::stop_source stop) const;

  std::uint64_t id() const { return id_; }
  const About& about() const { return about_; }

  void enter(v1::CallState state);
  /// In points, as the queue counts.
  void set_cost(double cost);
  /// Empty: what was known stays.
  void set_subject(const std::string& geometry, const std::string& system);
  /// What its messages take, and what its results do.
  void set_request_bytes(std::size_t bytes);
  void set_result_bytes(std::size_t bytes);

  /// What a call may wait for that only its client does: that it sends the next message, or takes the one that was sent.
  enum class Client { sends, takes };
  /// It waits from now on, or no longer. For OpenCalls::end_stalled().
  void await(Client what);
  void came(Client what);

  /// Stops the call, which ends with this error; false when it has been asked to before.
  bool end(const Error& why);
  /// Why it was asked to end, if it was.
  std::optional<Error> ended() const;
  /// Called once by end(), at once when that has been.
  void on_end(std::function<void()> action);
  /// The answer is known and on its way: the call is listed no longer, and cannot be ended.
  void answered();

 private:
  friend class OpenCalls;
  void describe(v1::CallInfo& info, Clock::time_point now) const;

  const OpenCallBookPtr book_;
  const std::uint64_t id_;
  const About about_;
  const Clock::time_point since_ = Clock::now();
  std::stop_source stop_;
  std::array<std::atomic<Clock::rep>, 2> awaited_since_{};  ///< by Client; 0: not awaited
  mutable std::mutex mutex_;
  // under mutex_
  v1::CallState state_ = v1::CALL_OPEN;
  Clock::time_point state_since_ = since_;
  double cost_ = 0;
  std::string geometry_, system_;
  std::size_t request_bytes_ = 0, result_bytes_ = 0;
  std::optional<Error> ended_;
  std::function<void()> on_end_;
};

/// All of them. Thread-safe.
class OpenCalls {
 public:
  /// `stop` is asked to when the call is ended. It is listed until it is answered, or destroyed.
  std::shared_ptr<OpenCall> open(OpenCall::About about, std::stop_source stop);

  /// The oldest first, at most `limit`. `tenant`: of that one alone; `but`: without this one.
  v1::ListCallsReply list(const std::optional<std::string>& tenant, std::uint64_t but, std::size_t limit) const;
  /// How it was when it was asked to end. Throws Error(not_found); what is of another tenant does not exist.
  v1::CallInfo end(std::uint64_t id, const std::optional<std::string>& tenant, const Error& why);
  std::size_t size() const;
  /// Ends calls that wait for their clients for longer than this, by stalled().
  void end_stalled(std::chrono::milliseconds longest);
  /// Error(unavailable) for an answer that is not taken, which a client that goes on after all repeats; Error(deadline_exceeded)
  /// for a request that does not go on.
  static Error stalled(OpenCall::Client what, std::chrono::milliseconds longest);

 private:
  /// Let go of without the lock of the book, which the last owner of a call takes.
  std::vector<std::shared_ptr<OpenCall>> all() const;

  const OpenCallBookPtr book_ = std::make_shared<OpenCallBook>();
};

}  // namespace deform::server
