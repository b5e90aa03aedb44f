// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/decoder.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <future>
#include <thread>

#include "tests/client/scripted_service.h"
#include "tests/support/expect_error.h"

namespace deform::decoder_test {
namespace {

using client::DeformedDesign;
using client::DeformOutcome;
using client::ReplyDecoder;
using test::expect_error;
using test::ReplyScript;

/// Feeds replies to a decoder as a client does and returns its outcome or throws its error.
DeformOutcome decode(std::vector<v1::DeformReply> messages, const ReplyScript& script, client::DesignSink sink = {},
                     int threads = 2, v1::Failures failures = v1::FAILURES_DEFAULT, client::DesignMemory memory = {}) {
  std::promise<DeformOutcome> promise;
  auto future = promise.get_future();
  ThreadPool pool(threads);
  ReplyDecoder::Options options;
  options.designs = script.designs;
  options.encoding = script.encoding;
  options.failures = failures;
  options.sink = std::move(sink);
  options.memory = std::move(memory);
  options.points_of = [&](const std::string&) { return std::make_shared<const Points>(test::registered_points(script.points)); };
  options.on_done = [&](DeformOutcome&& outcome, const std::exception_ptr& error) {
    error ? promise.set_exception(error) : promise.set_value(std::move(outcome));
  };
  const auto decoder = std::make_shared<ReplyDecoder>(options, pool);
  try {
    for (auto& message : messages) decoder->add(std::move(message));
    if (!decoder->complete()) throw Error(ErrorCode::data_loss, "ends before its summary");
  } catch (...) {
    decoder->fail(std::current_exception());
  }
  return future.get();
}

double largest_difference(const Points& a, const Points& b) {
  double largest = a.size() == b.size() ? 0 : HUGE_VAL;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    for (std::size_t k = 0; k < 3; ++k) largest = std::max(largest, std::fabs(a[i][k] - b[i][k]));
  }
  return largest;
}

TEST(Decoder, GivesEveryDesignOfEveryEncoding) {
  for (const auto encoding : {v1::RAW_F64, v1::RAW_F32, v1::DRACO, v1::DELTA_ZSTD}) {
    ReplyScript script;
    script.designs = 3;
    script.encoding = encoding;
    const auto outcome = decode(test::replies(script), script);
    ASSERT_EQ(outcome.designs.size(), 3u);
    for (std::size_t d = 0; d < 3; ++d) {
      const double error = largest_difference(outcome.designs[d].points, test::deformed_points(script.points, d));
      EXPECT_LE(error, encoding == v1::RAW_F64 ? 0 : 1.01e-6) << v1::Encoding_Name(encoding);
      EXPECT_EQ(outcome.designs[d].result.design(), d);
    }
    EXPECT_GT(outcome.decode_ms, 0);
    EXPECT_GT(outcome.wall_ms, 0);
  }
}

TEST(Decoder, HandsDesignsToTheSinkOneAtATimeAndOnce) {
  ReplyScript script;
  script.designs = 20;
  std::atomic<int> inside{0};
  std::vector<int> seen(20, 0);
  const auto outcome = decode(
      test::replies(script), script,
      [&](std::size_t design, DeformedDesign&& deformed) {
        EXPECT_EQ(++inside, 1);
        EXPECT_EQ(largest_difference(deformed.points, test::deformed_points(script.points, design)), 0);
        ++seen[design];
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        --inside;
      },
      3);
  EXPECT_EQ(seen, std::vector<int>(20, 1));
  EXPECT_TRUE(outcome.designs.empty());
}

TEST(Decoder, PutsPointsIntoTheMemoryOfTheCaller) {
  ReplyScript script;
  script.designs = 5;
  std::vector<Points> memory(script.designs, Points(script.points, Vec3{-1, -1, -1}));
  const auto outcome = decode(test::replies(script), script, {}, 3, v1::FAILURES_DEFAULT,
                              [&](std::size_t design) { return std::span(memory[design]); });
  for (std::size_t d = 0; d < script.designs; ++d) {
    EXPECT_EQ(largest_difference(memory[d], test::deformed_points(script.points, d)), 0);
    EXPECT_TRUE(outcome.designs.at(d).points.empty());
    EXPECT_EQ(outcome.designs[d].result.design(), d);
  }
}

TEST(Decoder, RefusesMemoryOfAnotherSize) {
  ReplyScript script;
  script.designs = 2;
  Points memory(script.points - 1);
  const std::string sizes =
      "memory for " + std::to_string(script.points - 1) + " points, the registered geometry has " + std::to_string(script.points);
  expect_error(ErrorCode::invalid_argument, {sizes.c_str()}, [&] {
    decode(test::replies(script), script, {}, 2, v1::FAILURES_DEFAULT, [&](std::size_t) { return std::span(memory); });
  });
}

TEST(Decoder, ErrorOfTheSinkIsTheErrorOfTheCall) {
  ReplyScript script;
  script.designs = 4;
  int calls = 0;
  EXPECT_THROW(decode(test::replies(script), script,
                      [&](std::size_t, DeformedDesign&&) {
                        ++calls;
                        throw std::out_of_range("disk full");
                      }),
               std::out_of_range);
  EXPECT_EQ(calls, 1);
}

/// One thing wrong with an otherwise correct stream.
struct Corruption {
  const char* name;
  std::function<void(std::vector<v1::DeformReply>&)> corrupt;
  const char* message;
};

v1::Block& block(std::vector<v1::DeformReply>& messages, std::size_t index) { return *messages.at(1 + index).mutable_block(); }

TEST(Decoder, RefusesWhatBreaksTheContract) {
  const std::vector<Corruption> table = {
      {"no header", [](auto& m) { m.erase(m.begin()); }, "header does not come first"},
      {"two headers", [](auto& m) { m.insert(m.begin(), m[0]); }, "second header"},
      {"fewer points", [](auto& m) { m[0].mutable_header()->set_points(4999); }, "4999 points, the registered geometry has 5000"},
      {"hostile points", [](auto& m) { m[0].mutable_header()->set_points(std::uint64_t{1} << 62); },
       "the registered geometry has"},
      {"more designs", [](auto& m) { m[0].mutable_header()->set_designs(4'000'000'000u); }, "asked were 2"},
      {"flipped bit", [](auto& m) { (*block(m, 2).mutable_data())[100] ^= 1; }, "checksum does not match"},
      {"block checksum", [](auto& m) { block(m, 1).set_checksum(7); }, "checksum"},
      {"design checksum", [](auto& m) { m[m.size() - 2].mutable_result()->set_checksum(7); }, "checksum of design 1"},
      {"blocks swapped", [](auto& m) { std::swap(m[1], m[3]); }, "expected was block 0 at point 0"},
      {"block missing", [](auto& m) { m.erase(m.begin() + 3); }, "expected was block 1"},
      {"last block missing", [](auto& m) { m.erase(m.begin() + 5); }, "comes after 4096 of 5000 points"},
      {"block twice", [](auto& m) { m.insert(m.begin() + 1, m[1]); }, "expected was block 1"},
      {"hostile count", [](auto& m) { block(m, 0).set_count(4'000'000'000u); }, "a block has at most 65536"},
      {"count beyond the end", [](auto& m) { block(m, 4).set_count(905); }, "904 are left"},
      {"empty block", [](auto& m) { block(m, 0).set_count(0); }, "has 0 points"},
      {"hostile first", [](auto& m) { block(m, 0).set_first(~std::uint64_t{0}); }, "expected was block 0 at point 0"},
      {"unknown design", [](auto& m) { block(m, 0).set_design(2); }, "a block of design 2, asked were 2"},
      {"unasked encoding", [](auto& m) { block(m, 0).set_encoding(v1::RAW_F32); }, "is RAW_F32, asked was RAW_F64"},
      {"two offsets",
       [](auto& m) {
         block(m, 0).clear_offset();
         block(m, 0).add_offset(1);
       },
       "has 1 offsets"},
      {"short data", [](auto& m) { block(m, 0).mutable_data()->pop_back(); }, "expected 49152 bytes"},
      {"block after result", [](auto& m) { m.insert(m.end() - 1, m[1]); }, "after its result"},
      {"result twice", [](auto& m) { m.insert(m.end() - 1, m[m.size() - 2]); }, "after its result"},
      {"negative error", [](auto& m) { m[m.size() - 2].mutable_result()->set_max_error(-1); }, "not a distance"},
      {"result missing", [](auto& m) { m.erase(m.end() - 2); }, "before the result of design 1"},
      {"empty message", [](auto& m) { m.insert(m.begin() + 1, v1::DeformReply()); }, "an empty message"},
      {"after the summary", [](auto& m) { m.push_back(m[1]); }, ""},
      {"no summary", [](auto& m) { m.pop_back(); }, "ends before its summary"},
  };
  ReplyScript script;
  script.designs = 2;
  for (const auto& row : table) {
    SCOPED_TRACE(row.name);
    auto messages = test::replies(script);
    row.corrupt(messages);
    if (*row.message == '\0') {  // all had been delivered: what comes then cannot change it
      try {
        EXPECT_EQ(decode(messages, script).designs.size(), 2u);
      } catch (const Error& error) {
        EXPECT_EQ(error.code(), ErrorCode::data_loss);
      }
      continue;
    }
    expect_error(ErrorCode::data_loss, {row.message}, [&] { decode(messages, script); });
  }
}

/// The replies of a script in which a design has failed instead.
std::vector<v1::DeformReply> replies_without(const ReplyScript& script, std::uint32_t failed) {
  auto messages = test::replies(script);
  std::erase_if(messages, [&](const v1::DeformReply& m) { return m.has_block() && m.block().design() == failed; });
  for (auto& message : messages) {
    if (!message.has_result() || message.result().design() != failed) continue;
    message.mutable_result()->Clear();
    message.mutable_result()->set_design(failed);
    message.mutable_result()->mutable_error()->set_code(3);
    message.mutable_result()->mutable_error()->set_message("out of bounds");
  }
  return messages;
}

DeformOutcome decode_per_design(const std::vector<v1::DeformReply>& messages, const ReplyScript& script,
                                const client::DesignSink& sink = {}) {
  return decode(messages, script, sink, 2, v1::FAILURES_PER_DESIGN);
}

TEST(Decoder, ADesignMayHaveFailedAlone) {
  ReplyScript script;
  script.designs = 3;
  for (std::uint32_t failed = 0; failed < 3; ++failed) {
    const auto outcome = decode_per_design(replies_without(script, failed), script);
    std::vector<int> seen(3, 0);
    decode_per_design(replies_without(script, failed), script, [&](std::size_t d, DeformedDesign&& deformed) {
      EXPECT_EQ(deformed.error.has_value(), d == failed);
      ++seen[d];
    });
    EXPECT_EQ(seen, std::vector<int>(3, 1));
    for (std::size_t d = 0; d < 3; ++d) {
      const DeformedDesign& design = outcome.designs.at(d);
      if (d != failed) {
        EXPECT_FALSE(design.error);
        EXPECT_EQ(design.points, test::deformed_points(script.points, d));
        continue;
      }
      ASSERT_TRUE(design.error);
      EXPECT_EQ(design.error->code(), ErrorCode::invalid_argument);
      EXPECT_STREQ(design.error->what(), "out of bounds");
      EXPECT_TRUE(design.points.empty());
    }
  }
}

TEST(Decoder, AnErrorOfADesignThatWasNotAskedForDoesNotPass) {
  ReplyScript script;
  script.designs = 2;
  for (const auto failures : {v1::FAILURES_DEFAULT, v1::FAIL_REQUEST}) {
    expect_error(ErrorCode::data_loss, {"design 1 has an error", "out of bounds"},
                 [&] { decode(replies_without(script, 1), script, {}, 2, failures); });
  }
}

TEST(Decoder, RefusesAnErrorThatContradictsItself) {
  ReplyScript script;
  script.designs = 2;
  const auto result_of = [](auto& m, std::uint32_t design) -> v1::DesignResult& {
    for (auto& message : m) {
      if (message.has_result() && message.result().design() == design) return *message.mutable_result();
    }
    throw std::logic_error("no result");
  };
  const std::vector<Corruption> table = {
      {"blocks", [&](auto& m) { result_of(m, 0).mutable_error()->set_code(3); }, "design 0 has blocks and an error"},
      {"a block before",
       [&](auto& m) {
         auto message = test::replies(script)[1];
         message.mutable_block()->set_design(1);
         m.insert(m.begin() + 1, message);
       },
       "design 1 has blocks and an error"},
      {"a block behind",
       [&](auto& m) {
         auto message = test::replies(script)[1];
         message.mutable_block()->set_design(1);
         m.insert(m.end() - 1, message);
       },
       "after its result"},
      {"no code", [&](auto& m) { result_of(m, 1).mutable_error()->set_code(0); }, "without a code"},
      {"a checksum", [&](auto& m) { result_of(m, 1).set_checksum(1); }, "an error and findings"},
      {"cells", [&](auto& m) { result_of(m, 1).mutable_cells()->set_cells(1); }, "an error and findings"},
      {"twice", [&](auto& m) { m.insert(m.end() - 1, m[m.size() - 2]); }, "after its result"},
      {"neither blocks nor error", [&](auto& m) { result_of(m, 1).clear_error(); }, "comes after 0 of 5000 points"},
      {"unknown design", [&](auto& m) { result_of(m, 1).set_design(2); }, "a result of design 2, asked were 2"},
  };
  for (const auto& row : table) {
    SCOPED_TRACE(row.name);
    auto messages = replies_without(script, 1);
    row.corrupt(messages);
    expect_error(ErrorCode::data_loss, {row.message}, [&] { decode_per_design(messages, script); });
  }
}

TEST(Decoder, AcceptsABlockThatFellBackToRaw) {
  ReplyScript script;
  script.encoding = v1::DRACO;
  script.tolerance = 1e-18;  // no integers are that fine
  const auto outcome = decode(test::replies(script), script);
  EXPECT_EQ(largest_difference(outcome.designs[0].points, test::deformed_points(script.points, 0)), 0);
}

}  // namespace
}  // namespace deform::decoder_test
