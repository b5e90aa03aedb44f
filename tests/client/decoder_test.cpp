#include "client/decoder.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <future>
#include <thread>

#include "tests/client/scripted_service.h"
#include "tests/support/expect_error.h"

namespace deform {
namespace {

using client::DecodePool;
using client::DeformedDesign;
using client::DeformOutcome;
using client::ReplyDecoder;
using test::expect_error;
using test::ReplyScript;

/// Feeds replies to a decoder as a client does and returns its outcome or throws its error.
DeformOutcome decode(std::vector<v1::DeformReply> messages, const ReplyScript& script, client::DesignSink sink = {},
                     int threads = 2) {
  std::promise<DeformOutcome> promise;
  auto future = promise.get_future();
  DecodePool pool(threads);
  ReplyDecoder::Options options;
  options.designs = script.designs;
  options.encoding = script.encoding;
  options.sink = std::move(sink);
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

TEST(Decoder, AcceptsABlockThatFellBackToRaw) {
  ReplyScript script;
  script.encoding = v1::DRACO;
  script.tolerance = 1e-18;  // no integers are that fine
  const auto outcome = decode(test::replies(script), script);
  EXPECT_EQ(largest_difference(outcome.designs[0].points, test::deformed_points(script.points, 0)), 0);
}

}  // namespace
}  // namespace deform
