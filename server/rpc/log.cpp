// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/rpc/log.h"

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <iterator>

#include "core/base/text.h"

namespace deform::server {

namespace {

constexpr std::size_t id_digits = 12;
constexpr std::size_t text_limit = 300;

/// Appends "key=value" fields. Text in quotes when it is the user's.
class Line {
 public:
  explicit Line(std::string& out) : out_(out) {}
  void word(const char* key, const std::string& value) { add(key, value); }
  void id(const char* key, const std::string& value) {
    if (!value.empty()) add(key, quoted_if_odd(value.substr(0, id_digits)));
  }
  void name(const char* key, const std::string& value) {
    const bool plain =
        std::all_of(value.begin(), value.end(), [](unsigned char c) { return c > ' ' && c < 127 && c != '"' && c != '\\'; });
    add(key, plain ? value : quoted(value));
  }
  void text(const char* key, const std::string& value) {
    if (!value.empty()) add(key, quoted(value));
  }
  void count(const char* key, std::uint64_t value) {
    if (value != 0) add(key, std::to_string(value));
  }
  void milliseconds(const char* key, double value) {
    if (value > 0) add(key, fmt::format("{:.3f}", value));
  }

 private:
  void add(const char* key, const std::string& value) {
    if (!out_.empty()) out_ += ' ';
    out_ += key;
    out_ += '=';
    out_ += value;
  }
  static std::string quoted(const std::string& value) {
    std::string out = "\"";
    for (const char c : escaped(value, text_limit)) {
      if (c == '"') out += '\\';
      out += c;
    }
    return out + '"';
  }
  static std::string quoted_if_odd(const std::string& value) {
    const bool plain = value.find_first_not_of("0123456789abcdef") == std::string::npos;
    return plain ? value : quoted(value);
  }

  std::string& out_;
};

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

}  // namespace

void start_logging(const LogOptions& options) {
  std::shared_ptr<spdlog::sinks::sink> sink;
  try {
    if (options.file.empty()) {
      sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
    } else {
      sink = std::make_shared<spdlog::sinks::basic_file_sink_mt>(options.file.string());
    }
  } catch (const spdlog::spdlog_ex& error) {
    throw Error(ErrorCode::invalid_argument, "log_file: " + std::string(error.what()));
  }
  auto logger = std::make_shared<spdlog::logger>("deformd", std::move(sink));
  logger->set_formatter(std::make_unique<PrintableFormatter>());
  logger->set_level(options.level);
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
}

std::string to_line(const CallRecord& record) {
  std::string out;
  Line line(out);
  line.word("method", record.method);
  line.word("client", escaped(record.client, text_limit));
  if (!record.identity.empty()) line.name("identity", record.identity);
  if (record.request_id) line.word("request", std::to_string(*record.request_id));
  line.id("geometry", record.geometry);
  line.id("system", record.system);
  line.text("name", record.name);
  line.count("points", record.points);
  line.count("designs", record.designs);
  line.count("messages_in", record.messages_in);
  line.count("messages_out", record.messages_out);
  line.count("bytes_in", record.bytes_in);
  line.count("bytes_out", record.bytes_out);
  line.milliseconds("queue_ms", record.queue_ms);
  line.milliseconds("prepare_ms", record.prepare_ms);
  line.milliseconds("solve_ms", record.solve_ms);
  line.milliseconds("encode_ms", record.encode_ms);
  line.milliseconds("stream_ms", record.stream_ms);
  line.milliseconds("wall_ms", record.wall_ms);
  line.word("status", record.refusal != nullptr ? record.refusal : record.error ? to_string(record.error->code()) : "ok");
  if (record.error) line.text("message", record.error->what());
  return out;
}

void log_call(const CallRecord& record) {
  const bool ours = record.error && (record.error->code() == ErrorCode::internal || record.error->code() == ErrorCode::data_loss);
  spdlog::log(ours ? spdlog::level::err : spdlog::level::info, "{}", to_line(record));
}

}  // namespace deform::server
