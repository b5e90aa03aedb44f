// SPDX-License-Identifier: GPL-3.0-or-later
// The line of a call.
#include "server/rpc/log.h"

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <iterator>
#include <regex>

namespace deform::server::log_test {
namespace {

TEST(Log, OneLineTellsTheCall) {
  CallRecord record;
  record.method = "Deform";
  record.client = "ipv4:127.0.0.1:4242";
  record.system = "0123456789abcdef0123456789abcdef";
  record.designs = 2;
  record.points = 50'000;
  record.messages_in = 1;
  record.messages_out = 7;
  record.bytes_in = 120;
  record.bytes_out = 1'200'000;
  record.queue_ms = 0.25;
  record.solve_ms = 1.5;
  record.encode_ms = 2;
  record.stream_ms = 3;
  record.wall_ms = 6.125;
  EXPECT_EQ(
      to_line(record),
      "method=Deform client=ipv4:127.0.0.1:4242 system=0123456789ab points=50000 designs=2 messages_in=1 messages_out=7 "
      "bytes_in=120 bytes_out=1200000 queue_ms=0.250 solve_ms=1.500 encode_ms=2.000 stream_ms=3.000 wall_ms=6.125 status=ok");
}

TEST(Log, WhatUsersWriteCannotForgeLinesOrFields) {
  CallRecord record;
  record.method = "GetGeometry";
  record.geometry = "x\" status=ok\n2026 info";
  record.name = std::string("car\0\x1b[31m \"my\"", 14);
  record.error = Error(ErrorCode::not_found, "no geometry \"x\ny\"");
  EXPECT_EQ(to_line(record),
            "method=GetGeometry client= geometry=\"x\\\" status=ok\" name=\"car\\x00\\x1b[31m \\\"my\\\"\" status=not_found "
            "message=\"no geometry \\\"x\\x0ay\\\"\"");
}

TEST(Log, WhoCalledAndWhoWasNotLetIn) {
  CallRecord record;
  record.method = "DeleteGeometry";
  record.client = "ipv4:10.0.0.7:4242";
  record.identity = "alice";
  record.error = Error(ErrorCode::permission_denied, "no");
  EXPECT_EQ(to_line(record),
            "method=DeleteGeometry client=ipv4:10.0.0.7:4242 identity=alice status=permission_denied message=\"no\"");
  record.identity = "spiffe://x y\"=";
  EXPECT_NE(to_line(record).find(" identity=\"spiffe://x y\\\"=\" status"), std::string::npos) << to_line(record);
}

TEST(Log, HasWhatClientsAreNotTold) {
  CallRecord record;
  record.method = "Prepare";
  record.client = "ipv4:10.0.0.7:4242";
  record.error = Error(ErrorCode::unavailable, "cannot write /srv/data/tmp/1a").with_public_message("cannot write tmp/1a");
  EXPECT_EQ(to_line(record),
            "method=Prepare client=ipv4:10.0.0.7:4242 status=unavailable message=\"cannot write /srv/data/tmp/1a\"");
}

TEST(Log, NoRecordActsOnTerminalsOrMakesLines) {
  const auto before = spdlog::default_logger();
  const auto file = std::filesystem::temp_directory_path() / ("deform_log_test_" + std::to_string(::getpid()));
  start_logging({spdlog::level::info, file});
  spdlog::info("{}", "a\n2026 error forged\x1b]0;owned\x07\u202e \xff Gr\u00f6\u00dfe");
  spdlog::set_default_logger(before);
  std::ifstream in(file);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  std::filesystem::remove(file);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1);
  const std::string record = " info a\\x0a2026 error forged\\x1b]0;owned\\x07\\u{202e} \\xff Gr\u00f6\u00dfe\n";
  ASSERT_GT(text.size(), record.size());
  EXPECT_EQ(text.substr(text.size() - record.size()), record);
}

TEST(Log, RecordsCanBeJson) {
  const auto before = spdlog::default_logger();
  const auto file = std::filesystem::temp_directory_path() / ("deform_log_json_" + std::to_string(::getpid()));
  start_logging({spdlog::level::info, file, LogFormat::json});
  spdlog::info("{}", "a \"b\" \\ c\nd");
  CallRecord record;
  record.method = "Deform";
  record.client = "ipv4:127.0.0.1:4242";
  record.identity = "alice";
  record.request_id = 7;
  record.name = "x\"},{\"status\":\"ok";
  record.designs = 2;
  record.wall_ms = 6.125;
  record.error = Error(ErrorCode::internal, "no \\ luck");
  log_call(record);
  start_logging({spdlog::level::info, file, LogFormat::text});
  log_call(record);
  spdlog::set_default_logger(before);
  std::ifstream in(file);
  std::string lines[3];
  for (std::string& line : lines) std::getline(in, line);
  std::filesystem::remove(file);
  const std::string time = R"(\{"time":"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9:.]+[+-][0-9:]+",)";
  EXPECT_TRUE(std::regex_match(lines[0], std::regex(time + R"("level":"info","message":"a \\"b\\" \\\\ c\\\\x0ad"\})")))
      << lines[0];
  EXPECT_TRUE(std::regex_match(
      lines[1], std::regex(time + R"("level":"error","method":"Deform","client":"ipv4:127.0.0.1:4242","identity":"alice",)" +
                           R"("request":7,"name":"x\\"\},\{\\"status\\":\\"ok","designs":2,"wall_ms":6.125,)" +
                           R"("status":"internal","message":"no \\\\ luck"\})")))
      << lines[1];
  EXPECT_NE(lines[2].find(" error method=Deform client="), std::string::npos) << "text again: " << lines[2];
}

TEST(Log, TraceIdsAreThoseOfTheRecommendation) {
  const std::string trace = "0af7651916cd43dd8448eb211c80319c";
  EXPECT_EQ(trace_id("00-" + trace + "-b7ad6b7169203331-01"), trace);
  EXPECT_EQ(trace_id("cc-" + trace + "-b7ad6b7169203331-01-of the future"), trace);
  for (const std::string& wrong :
       std::vector<std::string>{std::string(), "00-" + trace + "-b7ad6b7169203331", "00-" + trace + "-b7ad6b7169203331-01-more",
                                "ff-" + trace + "-b7ad6b7169203331-01", "cc-" + trace + "-b7ad6b7169203331-01.",
                                "00-" + trace + "-0000000000000000-01", "00-00000000000000000000000000000000-b7ad6b7169203331-01",
                                "00-0AF7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01", "00_" + trace + "-b7ad6b7169203331-01",
                                "00-" + trace + "-b7ad6b716920333\n-01"}) {
    EXPECT_EQ(trace_id(wrong), "") << wrong;
  }
  CallRecord record;
  record.method = "Deform";
  record.client = "c";
  record.trace = trace;
  record.client_request = "study 7";
  EXPECT_EQ(to_line(record), "method=Deform client=c trace=" + trace + " client_request=\"study 7\" status=ok");
  record.host = "ipv4:10.0.0.7";
  EXPECT_EQ(to_line(record),
            "method=Deform client=c host=ipv4:10.0.0.7 trace=" + trace + " client_request=\"study 7\" status=ok");
}

TEST(Log, LinesOfCallsHaveABudgetForEachSecond) {
  LineBudget budget(3);
  const auto start = LineBudget::Clock::now();
  const auto at = [&](int ms) { return budget.next(start + std::chrono::milliseconds(ms)); };
  for (int ms : {0, 1, 998}) EXPECT_TRUE(at(ms).logged) << ms;
  for (int ms : {998, 999, 999, 999}) EXPECT_FALSE(at(ms).logged) << ms;
  const auto next = at(1000);
  EXPECT_TRUE(next.logged);
  EXPECT_EQ(next.left_out, 4u);
  EXPECT_EQ(at(1001).left_out, 0u) << "told once";
  LineBudget any(0);
  for (int k = 0; k < 10'000; ++k) ASSERT_TRUE(any.next(start).logged);
}

TEST(Log, LinesOfALibraryHaveABudgetOfTheirOwn) {
  const auto before = spdlog::default_logger();
  const std::filesystem::path file = std::filesystem::temp_directory_path() / ("deform-library-" + std::to_string(getpid()));
  constexpr std::uint32_t most = 3;
  start_logging({spdlog::level::info, file, LogFormat::text, most});
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 1000; ++i) log_library(spdlog::level::debug, "takes no room");
  for (int i = 0; i < 1000; ++i) log_library(spdlog::level::warn, "handshake failed");
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(std::chrono::steady_clock::now() - start).count();
  CallRecord record;
  record.method = "Deform";
  log_call(record);
  spdlog::set_default_logger(before);
  std::ifstream in(file);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  std::filesystem::remove(file);
  std::size_t lines = 0;
  const std::string line = "grpc: handshake failed";
  for (auto at = text.find(line); at != std::string::npos; at = text.find(line, at + 1)) ++lines;
  EXPECT_GE(lines, most);
  EXPECT_LE(lines, most * (static_cast<std::size_t>(seconds) + 2));
  EXPECT_EQ(text.find("takes no room"), std::string::npos);
  EXPECT_NE(text.find("method=Deform"), std::string::npos) << "calls have room of their own";
}

TEST(Log, LongTextIsCut) {
  CallRecord record;
  record.method = "GetGeometry";
  record.name = std::string(1'000'000, 'n');
  EXPECT_LT(to_line(record).size(), 500u);
}

}  // namespace
}  // namespace deform::server::log_test
