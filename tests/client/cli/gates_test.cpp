// SPDX-License-Identifier: GPL-3.0-or-later
// Gates on designs, and the verdicts that need none.
#include "client/cli/output/gates.h"

#include <gtest/gtest.h>

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <cmath>
#include <limits>

#include "tests/support/expect_error.h"

namespace deform::gates_test {
namespace {

using test::expect_error;

v1::DesignResult good_result() {
  v1::DesignResult result;
  result.set_max_displacement(0.3);
  result.set_prescribed_displacement(0.2);
  result.mutable_faces()->set_faces(100);
  result.mutable_cells()->set_cells(50);
  result.mutable_cells()->set_safe_amplitude(1);
  return result;
}

/// What a command with these gates says of the result: the texts of the gates that fail.
std::vector<std::string> failures(std::vector<std::string> conditions, const v1::DesignResult& result) {
  CLI::App app;
  cli::DesignGates gates;
  gates.add_to(app);
  std::vector<std::string> reversed;  // as CLI11 takes them
  for (auto condition = conditions.rbegin(); condition != conditions.rend(); ++condition) {
    reversed.push_back(*condition);
    reversed.push_back("--fail-on");
  }
  app.parse(reversed);
  std::vector<std::string> texts;
  for (const auto& failed : gates.failed(result)) texts.push_back(cli::to_text(failed));
  return texts;
}

TEST(Gates, AreNameSignAndNumber) {
  const cli::Gate gate = cli::parse_gate("flipped_faces> 1e1");
  EXPECT_EQ(gate.name, "flipped_faces");
  EXPECT_EQ(gate.limit, 10);
  EXPECT_TRUE(gate.holds_for(11));
  EXPECT_FALSE(gate.holds_for(10));
  const cli::Gate missed = cli::parse_gate("missed");
  EXPECT_TRUE(missed.name == "missed" && missed.holds_for(1) && !missed.holds_for(0));
  EXPECT_TRUE(cli::parse_gate("a<0").holds_for(-1));
  EXPECT_FALSE(cli::parse_gate("a<0").holds_for(0));
  for (const char* text : {"a", ">1", "a>", "a>b", "a>1>2", "a=1"}) {
    expect_error(ErrorCode::invalid_argument, {"--fail-on", text}, [&] { cli::parse_gate(text); });
  }
}

TEST(Gates, FailOnWhatIsNoNumber) {
  EXPECT_TRUE(cli::parse_gate("a<0").holds_for(std::nan("")));
  EXPECT_TRUE(cli::parse_gate("a>0").holds_for(std::nan("")));
}

TEST(Gates, TellEachThatFailsInOrder) {
  v1::DesignResult result = good_result();
  EXPECT_TRUE(failures({"flipped_faces>0", "inverted_cells>0", "safe_amplitude<1", "displacement_ratio>1.5", "missed>0"}, result)
                  .empty());
  result.mutable_faces()->set_flipped(12);
  result.mutable_cells()->set_safe_amplitude(0.25);
  EXPECT_EQ(failures({"flipped_faces>0", "max_displacement>1", "safe_amplitude<1"}, result),
            (std::vector<std::string>{"flipped_faces>0: it is 12", "safe_amplitude<1: it is 0.25"}));
}

TEST(Gates, KnowTheLeastDeterminant) {
  v1::DesignResult result = good_result();
  result.mutable_cells()->set_least_determinant(0.02);
  EXPECT_EQ(failures({"least_determinant<0.05"}, result), std::vector<std::string>{"least_determinant<0.05: it is 0.02"});
  EXPECT_TRUE(failures({"least_determinant<0.01"}, result).empty());
  result.mutable_split()->set_least_determinant(0.3);  // of what was delivered, not of one step
  EXPECT_TRUE(failures({"least_determinant<0.05"}, result).empty());
}

TEST(Gates, FailOnWhatWasNotMeasured) {
  v1::DesignResult result = good_result();
  result.clear_faces();
  const auto texts = failures({"flipped_faces>0"}, result);
  ASSERT_EQ(texts.size(), 1u);
  EXPECT_NE(texts[0].find("not measured"), std::string::npos);
}

TEST(Gates, WithUnknownNamesAreErrorsOfUsageThatListTheNames) {
  try {
    failures({"flipped_face>0"}, good_result());
    FAIL() << "taken";
  } catch (const CLI::ValidationError& error) {
    EXPECT_NE(std::string(error.what()).find("flipped_faces, newly_intersecting_faces, points_across_symmetry"),
              std::string::npos)
        << error.what();
    EXPECT_NE(std::string(error.what()).find("--fail-on flipped_face>0"), std::string::npos) << error.what();
  }
}

TEST(Gates, KnowAllMeasuresOfADesign) {
  v1::DesignResult result = good_result();
  result.mutable_cells()->set_inverted_at_rest(3);
  result.set_interpolation_residual(1e-9);
  result.set_max_error(1e-7);
  result.mutable_constraints()->add_residuals()->set_missed(true);
  EXPECT_EQ(cli::design_measure("inverted_at_rest", result), 3);
  EXPECT_EQ(cli::design_measure("newly_intersecting_faces", result), std::nullopt) << "not looked for";
  result.mutable_faces()->set_intersecting(4);
  result.set_points_across_symmetry(2);
  EXPECT_EQ(cli::design_measure("points_across_symmetry", result), 2);
  EXPECT_EQ(cli::design_measure("newly_intersecting_faces", result), 4);
  EXPECT_EQ(cli::design_measure("interpolation_residual", result), 1e-9);
  EXPECT_EQ(cli::design_measure("max_error", result), 1e-7);
  EXPECT_EQ(cli::design_measure("missed", result), 1);
  EXPECT_NEAR(cli::design_measure("displacement_ratio", result).value(), 1.5, 1e-12);
  for (const auto& name : cli::design_measures()) EXPECT_TRUE(cli::design_measure(name, result)) << name;
}

TEST(Gates, HaveNoRatioToNothing) {
  v1::DesignResult result = good_result();
  result.set_prescribed_displacement(0);
  EXPECT_FALSE(cli::design_measure("displacement_ratio", result));
  result.set_max_displacement(0);
  EXPECT_EQ(cli::design_measure("displacement_ratio", result), 1);
}

TEST(Verdicts, HaveTheReasonsOfTheServer) {
  v1::DesignResult result = good_result();
  EXPECT_TRUE(cli::bad_reasons(result).empty());
  EXPECT_EQ(cli::verdict_name(result.verdict()), "unknown");
  result.set_verdict(v1::VERDICT_DOUBTFUL);
  result.add_reasons("2 of 100 faces are flipped");
  EXPECT_TRUE(cli::bad_reasons(result).empty());
  EXPECT_EQ(cli::verdict_name(result.verdict()), "doubtful");
  result.set_verdict(v1::VERDICT_BAD);
  EXPECT_EQ(cli::bad_reasons(result), std::vector<std::string>{"2 of 100 faces are flipped"});
  EXPECT_EQ(cli::verdict_name(result.verdict()), "bad");
}

// Reasons that would have made a bad design doubtful are not those for which it is bad.
TEST(Verdicts, TellDoubtsApart) {
  v1::DesignResult result = good_result();
  EXPECT_TRUE(cli::doubts(result).empty());
  result.set_verdict(v1::VERDICT_BAD);
  for (const char* reason : {"2 of 50 cells are inverted", "2 of 100 faces are flipped", "3 edges are torn"})
    result.add_reasons(reason);
  EXPECT_EQ(cli::bad_reasons(result).size(), 3u) << "of a server that does not say which";
  EXPECT_TRUE(cli::doubts(result).empty());
  result.set_reasons_of_verdict(1);
  EXPECT_EQ(cli::bad_reasons(result), std::vector<std::string>{"2 of 50 cells are inverted"});
  EXPECT_EQ(cli::doubts(result), (std::vector<std::string>{"2 of 100 faces are flipped", "3 edges are torn"}));
  result.set_reasons_of_verdict(7);
  EXPECT_EQ(cli::bad_reasons(result).size(), 3u);
  result.set_verdict(v1::VERDICT_DOUBTFUL);
  result.set_reasons_of_verdict(3);
  EXPECT_EQ(cli::doubts(result).size(), 3u);
}

}  // namespace
}  // namespace deform::gates_test
