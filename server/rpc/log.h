// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <spdlog/common.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

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
};

/// Sets up the process-wide logger (spdlog's default one). Throws Error(invalid_argument) when the file cannot be opened.
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
  std::string identity;                     ///< whose call it is; empty: nobody was asked for one
  std::optional<std::uint64_t> request_id;  ///< of a DeformStream
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

/// Logs the line: info, or error when the fault is ours (internal, data_loss).
void log_call(const CallRecord& record);

}  // namespace deform::server
