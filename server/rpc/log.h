// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <spdlog/common.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

#include "core/base/error.h"

namespace deform::server {

/// One line per record either way.
enum class LogFormat {
  text,  ///< "2026-11-23T12:00:00.000+00:00 info method=Deform ..."
  json   ///< {"time": "...", "level": "info", "method": "Deform", ...}; {"time", "level", "message"} for what is no call
};

struct LogOptions {
  spdlog::level::level_enum level = spdlog::level::info;
  std::filesystem::path file;  ///< appended to; empty: standard error
  LogFormat format = LogFormat::text;
  std::uint32_t calls_per_second = 1000;  ///< lines of calls; 0: any number
};

/// Sets up the process-wide logger (spdlog's default one), while nothing is logged. Throws Error(invalid_argument) when the file
/// cannot be opened.
void start_logging(const LogOptions& options);

/// What follows goes to the file of that name as it is now: after the log was renamed by whoever rotates it. When it cannot be
/// opened, to the one before. Nothing without a file. Thread-safe.
void reopen_log();
/// Thread-safe.
void set_log_level(spdlog::level::level_enum level);

/// What is logged about one call, or about one request of a DeformStream. Fields that do not apply stay empty and are left out.
struct CallRecord {
  std::string method;
  std::string client;                       ///< the peer
  std::string host;                         ///< who calls, as a trusted proxy says; empty: the peer itself
  std::string identity;                     ///< whose call it is; empty: nobody was asked for one
  std::string tenant;                       ///< of the identity; empty: the default one
  std::optional<std::uint64_t> request_id;  ///< of a DeformStream
  std::string trace;                        ///< trace id of the metadata traceparent (W3C), 32 digits
  std::string client_request;               ///< metadata x-request-id, as the client wrote it
  std::string geometry;                     ///< as the client wrote it
  std::string system;
  std::string name;
  std::uint64_t points = 0;
  std::uint64_t designs = 0;
  std::uint64_t messages_in = 0, messages_out = 0;
  std::uint64_t bytes_in = 0, bytes_out = 0;
  double queue_ms = 0;
  double prepare_ms = 0;
  double solve_ms = 0;
  double encode_ms = 0;
  double stream_ms = 0;  ///< writes under way
  double wall_ms = 0;
  std::optional<Error> error;
};

/// "method=Deform client=... system=0123456789ab designs=1 ... status=ok": one line, user's strings escaped, ids cut to 12
/// digits.
std::string to_line(const CallRecord& record);

/// The members of the same in a JSON object, without braces: "method":"Deform","client":"...", ...
std::string to_json_members(const CallRecord& record);

/// The trace id of a traceparent of the W3C's recommendation Trace Context ("00-TRACE-PARENT-FLAGS"); empty when it is none.
std::string trace_id(std::string_view traceparent);

/// How many lines of calls may be logged: so many in each second, the others are counted. Thread-safe.
class LineBudget {
 public:
  using Clock = std::chrono::steady_clock;
  explicit LineBudget(std::uint32_t lines_per_second) : most_(lines_per_second) {}

  struct Answer {
    bool logged = true;          ///< this line has room
    std::uint64_t left_out = 0;  ///< lines of the seconds before that had none, reported once
  };
  /// For one more line.
  Answer next(Clock::time_point now);

 private:
  const std::uint32_t most_;  ///< 0: any number
  std::mutex mutex_;
  // under mutex_
  Clock::time_point second_{};  ///< when the one under way began
  std::uint32_t lines_ = 0;
  std::uint64_t left_out_ = 0;
};

/// Logs the line, unless the budget of start_logging() is spent: info, or error when the fault is ours (internal, data_loss).
/// The next line that has room follows the number of those that had none.
void log_call(const CallRecord& record);

/// Logs a line of gRPC, which writes as many as its peers cause: as many in a second as log_call() does, in a budget of their
/// own, so that neither takes from the other. Those of a level that is not logged take no room.
void log_library(spdlog::level::level_enum level, const std::string& line);

}  // namespace deform::server
