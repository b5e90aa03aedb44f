// SPDX-License-Identifier: GPL-3.0-or-later
// What the server says about itself in figures.
#include "server/rpc/metrics.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <string>

namespace deform::server::metrics_test {
namespace {

using testing::HasSubstr;
using testing::Not;

CallRecord call(const char* method, double wall_ms) {
  CallRecord record;
  record.method = method;
  record.wall_ms = wall_ms;
  return record;
}

TEST(Metrics, CountsCallsByMethodAndStatus) {
  Metrics metrics;
  metrics.call_begins();
  metrics.call_begins();
  metrics.call_begins();
  CallRecord late = call("Deform", 2000);
  late.error = Error(ErrorCode::deadline_exceeded, "late");
  metrics.call_ends(call("Deform", 3));
  metrics.call_ends(late);
  const std::string text = metrics.text({});
  EXPECT_THAT(text, HasSubstr("deformd_calls_total{method=\"Deform\",status=\"ok\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("deformd_calls_total{method=\"Deform\",status=\"deadline_exceeded\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("deformd_calls_in_progress 1\n"));
}

TEST(Metrics, CallsThatWereNotLetInHaveTheStatusOfTheirRefusal) {
  Metrics metrics;
  CallRecord refused = call("DeleteGeometry", 1);
  refused.error = Error(ErrorCode::permission_denied, "no");
  metrics.call_begins();
  metrics.call_ends(refused);
  EXPECT_THAT(metrics.text({}), HasSubstr("deformd_calls_total{method=\"DeleteGeometry\",status=\"permission_denied\"} 1\n"));
}

TEST(Metrics, RefusalsAreCountedByReasonForCallsAndRequestsOfStreams) {
  Metrics metrics;
  EXPECT_THAT(metrics.text({}), HasSubstr("deformd_refusals_total{reason=\"draining\"} 0\n")) << "the first one is an increase";
  CallRecord refused = call("Deform", 1);
  for (const Refusal reason : {Refusal::queue, Refusal::queue, Refusal::rate, Refusal::none}) {
    refused.error = Error(ErrorCode::out_of_budget, "no").refused_for(reason);
    metrics.call_begins();
    metrics.call_ends(refused);
  }
  refused.error = Error(ErrorCode::out_of_budget, "no").refused_for(Refusal::held);
  metrics.request_ends(refused);
  Metrics::Levels levels;
  levels.refused_connections = 5;
  levels.open_connections = 6;
  const std::string text = metrics.text(levels);
  EXPECT_THAT(text, HasSubstr("deformd_refusals_total{reason=\"queue\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("deformd_refusals_total{reason=\"rate\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("deformd_refusals_total{reason=\"held\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("deformd_refusals_total{reason=\"memory\"} 0\n"));
  EXPECT_THAT(text, HasSubstr("deformd_refusals_total{reason=\"connections\"} 5\n"));
  EXPECT_THAT(text, HasSubstr("deformd_connections_open 6\n"));
  EXPECT_THAT(text, Not(HasSubstr("reason=\"none\"")));
}

TEST(Metrics, TimesOfTheDiskAreAHistogram) {
  Metrics::Levels levels;
  for (const double seconds : {0.0004, 0.001, 0.02, 0.3, 60.0}) levels.syncs.add(seconds);
  const std::string text = Metrics().text(levels);
  for (const char* line : {"bucket{le=\"0.001\"} 2", "bucket{le=\"0.0025\"} 2", "bucket{le=\"0.025\"} 3", "bucket{le=\"0.5\"} 4",
                           "bucket{le=\"10\"} 4", "bucket{le=\"+Inf\"} 5", "count 5"}) {
    EXPECT_THAT(text, HasSubstr(std::string("deformd_store_sync_seconds_") + line + "\n"));
  }
  EXPECT_THAT(text, HasSubstr("deformd_store_sync_seconds_sum 60.3214"));
}

TEST(Metrics, HistogramsCountInSecondsUpToEachBound) {
  Metrics metrics;
  for (const double wall_ms : {0.4, 0.5, 30.0, 700.0}) {
    metrics.call_begins();
    metrics.call_ends(call("Prepare", wall_ms));
  }
  const std::string text = metrics.text({});
  EXPECT_THAT(text, HasSubstr("deformd_call_seconds_bucket{method=\"Prepare\",le=\"0.0005\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("deformd_call_seconds_bucket{method=\"Prepare\",le=\"0.025\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("deformd_call_seconds_bucket{method=\"Prepare\",le=\"0.05\"} 3\n"));
  EXPECT_THAT(text, HasSubstr("deformd_call_seconds_bucket{method=\"Prepare\",le=\"1\"} 4\n"));
  EXPECT_THAT(text, HasSubstr("deformd_call_seconds_count{method=\"Prepare\"} 4\n"));
  const std::string sum = "deformd_call_seconds_sum{method=\"Prepare\"} ";
  EXPECT_NEAR(std::stod(text.substr(text.find(sum) + sum.size())), 0.7309, 1e-12);
}

TEST(Metrics, OnlyStagesThatACallHadAreCounted) {
  Metrics metrics;
  CallRecord record = call("Deform", 20);
  record.solve_ms = 12;
  metrics.call_begins();
  metrics.call_ends(record);
  const std::string text = metrics.text({});
  EXPECT_THAT(text, HasSubstr("deformd_stage_seconds_sum{stage=\"solve\"} 0.012\n"));
  EXPECT_THAT(text, Not(HasSubstr("stage=\"prepare\"")));
}

TEST(Metrics, RequestsOfAStreamAreCountedBesideIt) {
  Metrics metrics;
  metrics.call_begins();
  metrics.request_ends(call("DeformStream", 5));
  metrics.request_ends(call("DeformStream", 5));
  const std::string text = metrics.text({});
  EXPECT_THAT(text, HasSubstr("deformd_calls_total{method=\"DeformStream.request\",status=\"ok\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("deformd_calls_in_progress 1\n")) << "the stream itself goes on";
  EXPECT_THAT(text, Not(HasSubstr("method=\"DeformStream\"")));
}

TEST(Metrics, LevelsAreThoseOfTheMoment) {
  const Metrics metrics;
  Metrics::Levels levels;
  levels.server.set_version("1.2.3");
  levels.server.set_uptime_ms(2500);
  levels.server.set_memory_budget(1u << 20);
  levels.server.set_queue_length(12);
  levels.server.set_preparation_queue_length(5);
  levels.server.mutable_store()->set_free_bytes(4096);
  levels.bases = {11, 12, 13, 14, 15};
  levels.memory_full = true;
  levels.held_request_bytes = 12345;
  levels.refused_connections = 3;
  levels.cut_off_connections = 4;
  const std::string text = metrics.text(levels);
  EXPECT_THAT(text, HasSubstr("deformd_build_info{version=\"1.2.3\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("deformd_uptime_seconds 2.5\n"));
  EXPECT_THAT(text, HasSubstr("deformd_memory_budget_bytes 1048576\n"));
  EXPECT_THAT(text, HasSubstr("deformd_queue_length 7\n"));
  EXPECT_THAT(text, HasSubstr("deformd_preparation_queue_length 5\n"));
  EXPECT_THAT(text, HasSubstr("deformd_store_free_bytes 4096\n"));
  EXPECT_THAT(text, HasSubstr("deformd_store_writable 0\n"));
  EXPECT_THAT(text, HasSubstr("deformd_bases_restored_total 11\n"));
  EXPECT_THAT(text, HasSubstr("deformd_bases_refused_total 12\n"));
  EXPECT_THAT(text, HasSubstr("deformd_bases_written_total 13\n"));
  EXPECT_THAT(text, HasSubstr("deformd_bases_not_written_total 14\n"));
  EXPECT_THAT(text, HasSubstr("deformd_bases_bytes 15\n"));
  EXPECT_THAT(text, HasSubstr("deformd_memory_full 1\n"));
  EXPECT_THAT(text, HasSubstr("deformd_requests_held_bytes 12345\n"));
  EXPECT_THAT(text, HasSubstr("deformd_connections_refused_total 3\n"));
  EXPECT_THAT(text, HasSubstr("deformd_connections_cut_off_total 4\n"));
}

}  // namespace
}  // namespace deform::server::metrics_test
