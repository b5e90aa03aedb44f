// SPDX-License-Identifier: GPL-3.0-or-later
// Admission by estimate.
#include "server/engine/memory.h"

#include <gtest/gtest.h>

#include <thread>
#include <utility>
#include <vector>

#include "core/base/error.h"

namespace deform::server::memory_test {
namespace {

const ChargePurpose purpose{"preparing", "use fewer centres", 0};

TEST(MemoryBudget, charges_are_given_back) {
  MemoryBudget budget(100);
  {
    Charge a = budget.charge(60, purpose);
    EXPECT_EQ(budget.in_use(), 60u);
    Charge b = std::move(a);
    EXPECT_EQ(budget.in_use(), 60u);
    b.shrink(25);
    EXPECT_EQ(budget.in_use(), 25u);
    b.shrink(40);  // never grows
    EXPECT_EQ(b.bytes(), 25u);
    b = budget.charge(75, purpose);
    EXPECT_EQ(budget.in_use(), 75u);
  }
  EXPECT_EQ(budget.in_use(), 0u);
}

TEST(MemoryBudget, what_never_fits_is_refused_without_a_hint) {
  MemoryBudget budget(100u << 20);
  try {
    budget.charge(200u << 20, purpose);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_EQ(error.retry_after_ms(), 0u);
    EXPECT_EQ(error.refusal(), Refusal::memory);
    const std::string text = error.what();
    EXPECT_NE(text.find("200.0 MiB"), std::string::npos) << text;
    EXPECT_NE(text.find("100.0 MiB"), std::string::npos) << text;
    EXPECT_NE(text.find("fewer centres"), std::string::npos) << text;
  }
}

TEST(MemoryBudget, what_would_fit_later_is_refused_with_a_hint) {
  MemoryBudget budget(100);
  const Charge other = budget.charge(60, purpose);
  try {
    budget.charge(50, purpose);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_GT(error.retry_after_ms(), 0u);
    EXPECT_EQ(error.refusal(), Refusal::memory);
  }
  EXPECT_EQ(budget.in_use(), 60u);
}

TEST(MemoryBudget, what_is_held_alongside_counts) {
  MemoryBudget budget(100);
  ChargePurpose alongside = purpose;
  alongside.held_alongside = 60;
  const Charge held = budget.charge(60, purpose);
  try {
    budget.charge(50, alongside);  // 50 + 60 never fit together
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.retry_after_ms(), 0u);
    EXPECT_EQ(error.refusal(), Refusal::memory);
  }
}

TEST(MemoryBudget, reclaimers_help_in_order_and_only_as_far_as_needed) {
  MemoryBudget budget(100);
  std::vector<Charge> idle;
  idle.push_back(budget.charge(40, purpose));
  idle.push_back(budget.charge(40, purpose));
  std::vector<std::size_t> asked;
  budget.add_reclaimer([&](std::size_t bytes) {
    asked.push_back(bytes);
    idle.pop_back();
  });
  budget.add_reclaimer([&](std::size_t) { ADD_FAILURE() << "the first one was enough"; });
  const Charge charge = budget.charge(50, purpose);
  EXPECT_EQ(asked, std::vector<std::size_t>{30});
  EXPECT_EQ(budget.in_use(), 90u);
}

TEST(MemoryBudget, grow_adds_to_a_charge_or_leaves_it_as_it_was) {
  MemoryBudget budget(100);
  Charge charge;
  budget.grow(charge, 30, purpose);
  budget.grow(charge, 30, purpose);
  EXPECT_EQ(charge.bytes(), 60u);
  EXPECT_THROW(budget.grow(charge, 41, purpose), Error);
  EXPECT_EQ(budget.in_use(), 60u);
}

TEST(MemoryBudget, large_calls_hold_half_of_it_and_small_ones_the_rest) {
  MemoryBudget budget(1024);
  Charge half = budget.charge_call(500, purpose);
  try {
    budget.charge_call(13, purpose);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_GT(error.retry_after_ms(), 0u);
    EXPECT_EQ(error.refusal(), Refusal::memory);
    EXPECT_NE(std::string(error.what()).find("half of the memory budget"), std::string::npos) << error.what();
  }
  EXPECT_EQ(budget.in_use(), 500u) << "what was refused is given back";
  Charge more = budget.charge_call(12, purpose);
  std::vector<Charge> small;
  for (int i = 0; i < 10; ++i) small.push_back(budget.charge_call(4, purpose));
  Charge system = budget.charge(400, purpose);  // not a call's
  EXPECT_EQ(budget.in_use(), 952u);
  small.clear();
  more = {};
  half.shrink(100);
  more = budget.charge_call(412, purpose);
  system = {};
  more = {};
  half = {};
  Charge all = budget.charge_call(1024, purpose);  // alone
  EXPECT_EQ(budget.in_use(), 1024u);
}

TEST(MemoryBudget, large_uploads_hold_a_quarter_of_it_and_small_ones_the_rest) {
  MemoryBudget budget(40960);
  Charge first, second, small;
  budget.grow_upload(first, 9000, purpose);
  budget.grow_upload(first, 9000, purpose);  // alone
  try {
    budget.grow_upload(second, 11, purpose);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_GT(error.retry_after_ms(), 0u);
    EXPECT_NE(std::string(error.what()).find("a quarter of the memory budget"), std::string::npos) << error.what();
  }
  budget.grow_upload(small, 5, purpose);
  budget.grow_upload(small, 5, purpose);
  EXPECT_THROW(budget.grow_upload(small, 1, purpose), Error) << "it is no longer small";
  EXPECT_THROW(budget.grow_upload(first, 1, purpose), Error) << "nor alone";
  EXPECT_EQ(budget.in_use(), 18010u) << "what was refused is given back";
  const Charge designs = budget.charge_call(20480, purpose);
  EXPECT_EQ(designs.bytes(), 20480u) << "uploads are not calls that compute";
  first.outlive_call();  // its mesh is kept
  EXPECT_EQ(budget.in_use(), 38490u);
  EXPECT_THROW(budget.grow_upload(second, 5000, purpose), Error) << "more than is left of the budget";
  budget.grow_upload(second, 2000, purpose);
  second = {};
  first = {};
  EXPECT_EQ(budget.in_use(), 20490u);
  budget.grow_upload(second, 10230, purpose);  // what was refused or given back is not counted as an upload's
  EXPECT_THROW(budget.grow_upload(first, 11, purpose), Error);
}

TEST(TenantShare, requests_uploads_and_answers_of_a_tenant_count_together) {
  constexpr std::size_t kib = 1024, mib = kib * kib;
  MemoryBudget budget(1024 * mib);
  TenantMeters meters;
  const TenantShare acme{"acme", meters.of("acme"), 100 * mib}, again{"acme", meters.of("acme"), 100 * mib};
  const TenantShare other{"b", meters.of("b"), 100 * mib}, unlimited{"c", meters.of("c"), 0};
  Charge answer = budget.charge_call(40 * mib, purpose, acme);
  Charge upload;
  budget.grow_upload(upload, 20 * mib, purpose, again);
  budget.grow_upload(upload, 20 * mib, purpose, again);
  EXPECT_EQ(acme.meter->in_use(), 80 * mib);
  try {
    budget.charge_call(21 * mib, purpose, acme);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_GT(error.retry_after_ms(), 0u);
    EXPECT_EQ(error.refusal(), Refusal::quota);
    const std::string why = error.what();
    for (const char* part : {"quota bytes-in-flight of tenant \"acme\"", "21.0 MiB", "80.0 MiB", "100.0 MiB"}) {
      EXPECT_NE(why.find(part), std::string::npos) << why;
    }
  }
  EXPECT_THROW(budget.grow_upload(upload, 21 * mib, purpose, acme), Error);
  EXPECT_EQ(upload.bytes(), 40 * mib);
  EXPECT_EQ(budget.in_use(), 80 * mib) << "what is refused holds nothing";
  EXPECT_EQ(acme.meter->in_use(), 80 * mib);
  // Others have their own, and what the budget refuses is not counted either.
  Charge of_other = budget.charge_call(21 * mib, purpose, other), of_any = budget.charge_call(300 * mib, purpose, unlimited);
  EXPECT_THROW(budget.charge_call(160 * mib, purpose, {"b", other.meter, 1024 * mib}), Error) << "calls hold half of the budget";
  EXPECT_EQ(other.meter->in_use(), 21 * mib);
  // Small ones are always answered.
  Charge rest = budget.charge_call(20 * mib, purpose, acme), small = budget.charge_call(64 * kib, purpose, acme);
  EXPECT_THROW(budget.charge_call(65 * kib, purpose, acme), Error);
  EXPECT_EQ(acme.meter->in_use(), 100 * mib + 64 * kib);
  upload.outlive_call();  // its mesh is kept for everybody
  answer.shrink(10 * mib);
  EXPECT_EQ(acme.meter->in_use(), 30 * mib + 64 * kib);
  answer = {};
  rest = {};
  small = {};
  upload = {};
  EXPECT_EQ(acme.meter->in_use(), 0u);
  EXPECT_EQ(budget.in_use(), 321 * mib);
}

TEST(TenantShare, what_can_never_fit_is_not_to_be_tried_again) {
  MemoryBudget budget(1 << 30);
  TenantMeters meters;
  try {
    budget.charge_call(1 << 20, purpose, {"acme", meters.of("acme"), 1 << 19});
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
    EXPECT_EQ(error.retry_after_ms(), 0u);
  }
  EXPECT_EQ(budget.in_use(), 0u);
}

TEST(TenantShare, a_lowered_limit_keeps_what_there_is_and_adds_nothing) {
  MemoryBudget budget(1 << 30);
  TenantMeters meters;
  const Charge held = budget.charge_call(1 << 20, purpose, {"acme", meters.of("acme"), 1 << 21});
  EXPECT_THROW(budget.charge_call(1 << 17, purpose, {"acme", meters.of("acme"), 1 << 19}), Error);
  EXPECT_EQ(meters.of("acme")->in_use(), std::size_t{1} << 20);
}

TEST(MemoryBudget, a_charge_may_outlive_its_budget) {
  Charge charge;
  {
    MemoryBudget budget(100);
    charge = budget.charge(10, purpose);
  }
  charge.shrink(0);
  EXPECT_EQ(charge.bytes(), 0u);
}

TEST(MemoryBudget, many_threads_never_exceed_it) {
  MemoryBudget budget(100);
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 500; ++i) {
        try {
          const Charge charge = budget.charge(30, purpose);
          EXPECT_LE(budget.in_use(), 100u);
        } catch (const Error& error) {
          EXPECT_GT(error.retry_after_ms(), 0u);
        }
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(budget.in_use(), 0u);
}

TEST(Memory, of_this_process_and_machine) {
  EXPECT_GT(available_memory(), std::size_t{64} << 20);
  EXPECT_GT(resident_set_bytes(), std::size_t{1} << 20);
  EXPECT_LT(resident_set_bytes(), available_memory());
}

TEST(Memory, small_pieces_that_are_freed_add_up) {
  const auto returned = [](std::size_t pieces) {
    const std::size_t piece = freed_bytes_worth_returning / pieces;
    int calls = 1;
    while (!return_freed_memory(piece)) ++calls;
    return calls;
  };
  EXPECT_EQ(returned(1), 1);  // nothing is left over from before
  EXPECT_EQ(returned(4), 4);
  EXPECT_EQ(returned(1), 1);
}

}  // namespace
}  // namespace deform::server::memory_test
