// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/log.h"

#include <spdlog/details/file_helper.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <mutex>
#include <utility>

#include "core/base/text.h"

namespace deform::server {

namespace {

constexpr std::size_t id_digits = 12;
constexpr std::size_t text_limit = 300;

/// In quotes, with those inside escaped: of text that escaped() or printable() made.
std::string quoted_text(const std::string& value) {
  std::string out = "\"";
  for (const char c : value) {
    if (c == '"') out += '\\';
    out += c;
  }
  return out + '"';
}

/// "key=value" fields. Text in quotes when it is the user's.
class TextFields {
 public:
  void word(const char* key, const std::string& value) { add(key, value); }
  void name(const char* key, const std::string& value) {
    const bool plain =
        std::all_of(value.begin(), value.end(), [](unsigned char c) { return c > ' ' && c < 127 && c != '"' && c != '\\'; });
    add(key, plain ? value : quoted_text(escaped(value, text_limit)));
  }
  void id(const char* key, const std::string& value) {
    const bool plain = value.find_first_not_of("0123456789abcdef") == std::string::npos;
    add(key, plain ? value : quoted_text(escaped(value, text_limit)));
  }
  void text(const char* key, const std::string& value) { add(key, quoted_text(escaped(value, text_limit))); }
  void count(const char* key, std::uint64_t value) { add(key, std::to_string(value)); }
  void milliseconds(const char* key, double value) { add(key, fmt::format("{:.3f}", value)); }
  std::string take() { return std::move(out_); }

 private:
  void add(const char* key, const std::string& value) { out_ += (out_.empty() ? "" : " ") + std::string(key) + '=' + value; }

  std::string out_;
};

/// A JSON string of what was logged: printable, so that only quotes and backslashes are left to escape.
std::string json_string(std::string_view value) {
  std::string out = "\"";
  for (const char c : printable(value)) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

/// "key":value members.
class JsonFields {
 public:
  void word(const char* key, const std::string& value) { text(key, value); }
  void name(const char* key, const std::string& value) { text(key, value); }
  void id(const char* key, const std::string& value) { text(key, value); }
  void text(const char* key, const std::string& value) { add(key, json_string(shortened(value))); }
  void count(const char* key, std::uint64_t value) { add(key, std::to_string(value)); }
  void milliseconds(const char* key, double value) { add(key, fmt::format("{:.3f}", value)); }
  std::string take() { return std::move(out_); }

 private:
  static std::string_view shortened(const std::string& value) { return std::string_view(value).substr(0, text_limit); }
  void add(const char* key, const std::string& value) {
    out_ += (out_.empty() ? "\"" : ",\"") + std::string(key) + "\":" + value;
  }

  std::string out_;
};

/// Every field that applies, in order.
template <typename Fields>
std::string fields_of(const CallRecord& record) {
  Fields out;
  const auto count = [&](const char* key, std::uint64_t value) {
    if (value != 0) out.count(key, value);
  };
  const auto milliseconds = [&](const char* key, double value) {
    if (value > 0) out.milliseconds(key, value);
  };
  const auto id = [&](const char* key, const std::string& value) {
    if (!value.empty()) out.id(key, value.substr(0, id_digits));
  };
  out.word("method", record.method);
  out.word("client", escaped(record.client, text_limit));
  if (!record.host.empty()) out.word("host", record.host);
  if (!record.identity.empty()) out.name("identity", record.identity);
  if (!record.tenant.empty()) out.name("tenant", record.tenant);
  if (record.request_id) out.count("request", *record.request_id);
  if (!record.trace.empty()) out.word("trace", record.trace);
  if (!record.client_request.empty()) out.name("client_request", record.client_request);
  id("geometry", record.geometry);
  id("system", record.system);
  if (!record.name.empty()) out.text("name", record.name);
  count("points", record.points);
  count("designs", record.designs);
  count("messages_in", record.messages_in);
  count("messages_out", record.messages_out);
  count("bytes_in", record.bytes_in);
  count("bytes_out", record.bytes_out);
  milliseconds("queue_ms", record.queue_ms);
  milliseconds("prepare_ms", record.prepare_ms);
  milliseconds("solve_ms", record.solve_ms);
  milliseconds("encode_ms", record.encode_ms);
  milliseconds("stream_ms", record.stream_ms);
  milliseconds("wall_ms", record.wall_ms);
  out.word("status", record.error ? to_string(record.error->code()) : "ok");
  if (record.error) out.text("message", record.error->what());
  return out.take();
}

/// The logger of calls where records are JSON objects: its formatter takes the members as they are.
constexpr char calls_logger[] = "deformd.calls";

/// The budgets of the process, which has one logger.
struct LineBudgets {
  explicit LineBudgets(std::uint32_t lines_per_second) : calls(lines_per_second), library(lines_per_second) {}
  LineBudget calls, library;
};
std::shared_ptr<LineBudgets>& line_budgets() {
  static auto budgets = std::make_shared<LineBudgets>(0);
  return budgets;
}

/// Whatever is logged, one record is one line, and nothing in it acts on the terminal that shows it.
class PrintableFormatter : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& to) override {
    const std::string payload = printable({message.payload.data(), message.payload.size()});
    spdlog::details::log_msg shown = message;
    shown.payload = payload;
    pattern_.format(shown, to);
  }
  std::unique_ptr<spdlog::formatter> clone() const override { return std::make_unique<PrintableFormatter>(); }

 private:
  spdlog::pattern_formatter pattern_{"%Y-%m-%dT%H:%M:%S.%e%z %l %v"};
};

/// One JSON object per line.
class JsonFormatter : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& to) override {
    const std::string_view payload(message.payload.data(), message.payload.size());
    const bool call = std::string_view(message.logger_name.data(), message.logger_name.size()) == calls_logger;
    const std::string line = call ? std::string(payload) : "\"message\":" + json_string(payload);
    spdlog::details::log_msg shown = message;
    shown.payload = line;
    pattern_.format(shown, to);
  }
  std::unique_ptr<spdlog::formatter> clone() const override { return std::make_unique<JsonFormatter>(); }

 private:
  spdlog::pattern_formatter pattern_{R"({"time":"%Y-%m-%dT%H:%M:%S.%e%z","level":"%l",%v})"};
};

/// Appends to a file that may be opened anew.
class LogFileSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit LogFileSink(std::string path) : path_(std::move(path)), file_(opened(path_)) {}

  /// Throws spdlog::spdlog_ex, and the file before stays.
  void reopen() {
    auto fresh = opened(path_);
    const std::lock_guard lock(mutex_);
    file_.swap(fresh);
  }

 private:
  static std::unique_ptr<spdlog::details::file_helper> opened(const std::string& path) {
    auto file = std::make_unique<spdlog::details::file_helper>();
    file->open(path);
    return file;
  }
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    file_->write(line);
  }
  void flush_() override { file_->flush(); }

  const std::string path_;
  std::unique_ptr<spdlog::details::file_helper> file_;  // under mutex_
};

std::shared_ptr<spdlog::logger> make_logger(const char* name, const spdlog::sink_ptr& sink, const LogOptions& options) {
  auto logger = std::make_shared<spdlog::logger>(name, sink);
  logger->set_level(options.level);
  logger->flush_on(spdlog::level::info);
  return logger;
}

}  // namespace

void start_logging(const LogOptions& options) {
  std::shared_ptr<spdlog::sinks::sink> sink;
  try {
    if (options.file.empty()) {
      sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
    } else {
      sink = std::make_shared<LogFileSink>(options.file.string());
    }
  } catch (const spdlog::spdlog_ex& error) {
    throw Error(ErrorCode::invalid_argument, "log_file: " + std::string(error.what()));
  }
  std::unique_ptr<spdlog::formatter> formatter = std::make_unique<PrintableFormatter>();
  if (options.format == LogFormat::json) formatter = std::make_unique<JsonFormatter>();
  sink->set_formatter(std::move(formatter));
  line_budgets() = std::make_shared<LineBudgets>(options.calls_per_second);
  spdlog::set_default_logger(make_logger("deformd", sink, options));
  spdlog::drop(calls_logger);
  if (options.format == LogFormat::json) spdlog::register_logger(make_logger(calls_logger, sink, options));
}

void reopen_log() {
  for (const auto& sink : spdlog::default_logger()->sinks()) {
    const auto file = std::dynamic_pointer_cast<LogFileSink>(sink);
    if (!file) continue;
    try {
      file->reopen();
    } catch (const spdlog::spdlog_ex& error) {
      spdlog::error("log_file: {}; the one before is kept", error.what());
    }
  }
}

void set_log_level(spdlog::level::level_enum level) {
  spdlog::default_logger()->set_level(level);
  if (const auto calls = spdlog::get(calls_logger)) calls->set_level(level);
}

std::string to_line(const CallRecord& record) { return fields_of<TextFields>(record); }

std::string to_json_members(const CallRecord& record) { return fields_of<JsonFields>(record); }

std::string trace_id(std::string_view traceparent) {
  // 00-<32 digits>-<16 digits>-<2 digits>; later versions may go on after that.
  constexpr std::size_t shape[] = {2, 35, 52};
  constexpr std::size_t size = 55;
  const bool longer = traceparent.size() > size && traceparent.substr(0, 2) != "00" && traceparent[size] == '-';
  if (traceparent.size() != size && !longer) return {};
  for (std::size_t i = 0; i < size; ++i) {
    const char c = traceparent[i];
    const bool dash = std::find(std::begin(shape), std::end(shape), i) != std::end(shape);
    if (dash ? c != '-' : !((c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'))) return {};
  }
  const std::string_view trace = traceparent.substr(3, 32), parent = traceparent.substr(36, 16);
  const auto zero = [](std::string_view digits) { return digits.find_first_not_of('0') == std::string_view::npos; };
  if (traceparent.substr(0, 2) == "ff" || zero(trace) || zero(parent)) return {};
  return std::string(trace);
}

LineBudget::Answer LineBudget::next(Clock::time_point now) {
  if (most_ == 0) return {};
  const std::lock_guard lock(mutex_);
  if (now - second_ >= std::chrono::seconds(1)) {
    second_ = now;
    lines_ = 0;
  }
  if (lines_ == most_) {
    ++left_out_;
    return {false, 0};
  }
  ++lines_;
  return {true, std::exchange(left_out_, 0)};
}

void log_call(const CallRecord& record) {
  const LineBudget::Answer answer = line_budgets()->calls.next(LineBudget::Clock::now());
  if (!answer.logged) return;
  if (answer.left_out != 0) {
    spdlog::warn("{} calls are not in this log: more ended than --log-calls allows in a second", answer.left_out);
  }
  const bool ours = record.error && (record.error->code() == ErrorCode::internal || record.error->code() == ErrorCode::data_loss);
  const auto level = ours ? spdlog::level::err : spdlog::level::info;
  if (const auto calls = spdlog::get(calls_logger)) {
    calls->log(level, to_json_members(record));
  } else {
    spdlog::log(level, "{}", to_line(record));
  }
}

void log_library(spdlog::level::level_enum level, const std::string& line) {
  if (!spdlog::should_log(level)) return;
  const LineBudget::Answer answer = line_budgets()->library.next(LineBudget::Clock::now());
  if (!answer.logged) return;
  if (answer.left_out != 0) {
    spdlog::warn("{} lines of gRPC are not in this log: it wrote more than --log-calls allows in a second", answer.left_out);
  }
  spdlog::log(level, "grpc: {}", line);
}

}  // namespace deform::server
