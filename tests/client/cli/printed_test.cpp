// SPDX-License-Identifier: GPL-3.0-or-later
// What the command line prints: errors as JSON, streams that do not act on terminals, what became of a design.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "client/cli/commands/command.h"
#include "client/cli/commands/workspace.h"
#include "client/cli/output/apply_report.h"
#include "client/cli/output/error_json.h"
#include "client/cli/output/format.h"
#include "client/cli/output/printable_stream.h"
#include "client/cli/output/result_json.h"

namespace deform::printed_test {
namespace {

TEST(ErrorJson, NamesTheFieldThatTheMessageStartsWith) {
  EXPECT_EQ(cli::field_of("designs[3].variables[0] (\"roof_up\"): 1 is outside of its bounds"), "designs[3].variables[0]");
  EXPECT_EQ(cli::field_of("method.rbf.tolerance: 1 is out of range"), "method.rbf.tolerance");
  EXPECT_EQ(cli::field_of("fixed[0]: its region contains no point"), "fixed[0]");
  EXPECT_EQ(cli::field_of("cars/a b.yaml:3: handles[0].name: expected a text"), "handles[0].name");
  EXPECT_EQ(cli::field_of("setup:1: variables[1].lower: expected"), "variables[1].lower");
  for (const char* message :
       {"ahmed.obj: no faces", "setup.yaml: geometry: missing", "fixed.obj: no faces", "designs[x]: bad", "designs[]: bad",
        "handle \"roof\": its region contains no point", "cannot open x", "", "fixed", "--set a: b"}) {
    EXPECT_EQ(cli::field_of(message), "") << message;
  }
}

TEST(ErrorJson, HasCodeMessageAndField) {
  const auto json = cli::error_json(ErrorCode::out_of_budget, "output.tolerance: too small");
  EXPECT_EQ(json.dump(), R"({"code":"RESOURCE_EXHAUSTED","message":"output.tolerance: too small","field":"output.tolerance"})");
  const Error failed(ErrorCode::internal, "output.tolerance: odd");
  EXPECT_FALSE(cli::error_json(failed).contains("request_id"));
  EXPECT_EQ(cli::error_json(client::CallError(failed, "c-7")).dump(),
            R"({"code":"INTERNAL","message":"output.tolerance: odd","field":"output.tolerance","request_id":"c-7"})");
  EXPECT_EQ(cli::usage_error_json("a").at("code"), "USAGE");
  EXPECT_EQ(cli::verdict_error_json("a").at("code"), "VERDICT");
}

TEST(ExitCodes, TellWhoseFaultItIs) {
  EXPECT_EQ(cli::exit_code_of({ErrorCode::invalid_argument, ""}), cli::exit_failed);
  EXPECT_EQ(cli::exit_code_of({ErrorCode::out_of_budget, ""}), cli::exit_failed) << "only another request can succeed";
  EXPECT_EQ(cli::exit_code_of({ErrorCode::out_of_budget, "", 100}), cli::exit_unreachable) << "refused until no attempt was left";
  EXPECT_EQ(cli::exit_code_of({ErrorCode::unavailable, ""}), cli::exit_unreachable);
  EXPECT_EQ(cli::exit_code_of({ErrorCode::deadline_exceeded, ""}), cli::exit_unreachable);
  EXPECT_EQ(cli::exit_code_of({ErrorCode::cancelled, ""}), cli::exit_interrupted);
}

TEST(PrintableStream, EscapesWhateverIsPrinted) {
  std::ostringstream out;
  {
    const cli::PrintableStream printable(out);
    out << "a\tb\x1b" << 'c' << "\n\u202e";
    EXPECT_EQ(out.str(), "a\tb\\x1bc\n") << "whole lines at once";
    out << "d\xe2" << std::flush << "\xff";
    EXPECT_EQ(out.str(), "a\tb\\x1bc\n\\u{202e}d\\xe2");
  }
  EXPECT_EQ(out.str(), "a\tb\\x1bc\n\\u{202e}d\\xe2\\xff") << "nothing is lost at the end";
  out << '\x1b';
  EXPECT_EQ(out.str().back(), '\x1b') << "the stream is what it was";
}

TEST(PrintableStream, KeepsCharactersThatComeInPieces) {
  std::ostringstream out;
  const cli::PrintableStream printable(out);
  for (const char c : std::string("Gr\xc3\xb6\xc3\x9f"
                                  "e\n")) {
    out << c;
  }
  EXPECT_EQ(out.str(),
            "Gr\xc3\xb6\xc3\x9f"
            "e\n");
}

TEST(SetupText, HoldsNoControlsAndCanBeReadAgain) {
  v1::Setup setup;
  setup.set_geometry("\u202e\x7f\u009b Gr\u00f6\u00dfe");
  const std::string text = cli::setup_text(setup);
  EXPECT_NE(text.find("\\u202e\\u007f\\u009b Gr\u00f6\u00dfe"), std::string::npos) << text;
  EXPECT_EQ(nlohmann::json::parse(text).at("geometry"), setup.geometry());
}

TEST(Dates, AreIsoAndNothingWhenUnknown) {
  EXPECT_EQ(cli::date_text(0), "-");
  const std::string date = cli::date_text(1'700'000'000'000);
  EXPECT_EQ(date.size(), std::string("2023-11-14T22:13:20+00:00").size());
  EXPECT_EQ(date.substr(0, 9), "2023-11-1");
}

TEST(Groups, TellThePointsThatTheySelect) {
  v1::GroupInfo group;
  group.set_faces(20);
  EXPECT_EQ(cli::group_size_text(group), "20 faces") << "registered by 0.1, which has not counted the corners of faces";
  group.set_all_points(12);
  EXPECT_EQ(cli::group_size_text(group), "12 points, 20 faces");
  group = {};
  group.set_points(3);
  EXPECT_EQ(cli::group_size_text(group), "3 points, 0 faces");
}

cli::Applied applied() {
  cli::Applied applied;
  applied.file = "out.obj";
  applied.result.set_max_displacement(0.03);
  applied.result.set_prescribed_displacement(0.03);
  applied.result.mutable_faces()->set_faces(19948);
  return applied;
}

std::string printed(const cli::Applied& applied) {
  std::ostringstream out;
  cli::print_applied(applied, out);
  return out.str();
}

TEST(Applied, TellsTheDisplacementBesideThePrescribedOne) {
  cli::Applied design = applied();
  EXPECT_NE(printed(design).find("  largest displacement 0.03 (prescribed 0.03, ratio 1)\n"), std::string::npos)
      << printed(design);
  EXPECT_EQ(cli::applied_json(design)["report"]["displacement_ratio"], 1);
  EXPECT_TRUE(cli::warnings_of(design.result).empty());
  design.result.set_prescribed_displacement(0);  // a server of 0.1 does not tell
  EXPECT_NE(printed(design).find("  largest displacement 0.03\n"), std::string::npos);
  EXPECT_TRUE(cli::warnings_of(design.result).empty());
  EXPECT_FALSE(cli::applied_json(design)["report"].contains("displacement_ratio"));
}

TEST(Applied, WarnsOfPointsThatMoveMuchFartherThanAnyWasTold) {
  cli::Applied design = applied();
  design.result.set_max_displacement(0.0449);
  EXPECT_TRUE(cli::warnings_of(design.result).empty());
  design.result.set_max_displacement(0.06);
  ASSERT_EQ(cli::warnings_of(design.result).size(), 1u);
  EXPECT_NE(cli::warnings_of(design.result)[0].find("0.06, 2 times"), std::string::npos);
  EXPECT_NE(printed(design).find("  WARNING: a point moves 0.06"), std::string::npos);
  design.result.add_warnings("The server says it better.");
  EXPECT_EQ(cli::warnings_of(design.result), std::vector<std::string>{"The server says it better."});
  EXPECT_EQ(cli::applied_json(design)["warnings"].size(), 1u);
}

TEST(Applied, TellsFlippedFacesWorstFirst) {
  cli::Applied design = applied();
  EXPECT_NE(printed(design).find("  none of 19948 faces flipped\n"), std::string::npos);
  design.result.mutable_faces()->set_flipped(2);
  design.result.mutable_faces()->add_flipped_ids(17);
  design.result.mutable_faces()->add_flipped_ids(4);
  EXPECT_NE(printed(design).find("  2 of 19948 faces flipped: 17, 4, worst first\n"), std::string::npos) << printed(design);
  design.result.mutable_faces()->set_flipped(1200);
  for (std::uint32_t id = 100; id < 198; ++id) design.result.mutable_faces()->add_flipped_ids(id);
  EXPECT_NE(
      printed(design).find("  1200 of 19948 faces flipped: 17, 4, 100, 101, 102, 103, 104, 105, 106, 107, ..., worst first\n"),
      std::string::npos)
      << printed(design);
  const auto report = cli::applied_json(design)["report"];
  EXPECT_EQ(report["flipped_faces"], 1200);
  EXPECT_EQ(report["flipped"].size(), 100u);
  EXPECT_EQ(report["flipped"][0], 17);
}

TEST(Applied, MarksReasonsThatAreNotForTheVerdict) {
  cli::Applied design = applied();
  design.result.set_verdict(v1::VERDICT_BAD);
  design.result.add_reasons("2 of 50 cells are inverted");
  design.result.add_reasons("2 of 100 faces are flipped");
  design.result.set_reasons_of_verdict(1);
  design.result.add_notes("the condition of the system is 3e+13");
  const std::string text = printed(design);
  EXPECT_NE(text.find(": bad\n    2 of 50 cells are inverted\n    doubtful besides: 2 of 100 faces are flipped\n"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("  note: the condition of the system is 3e+13\n"), std::string::npos) << text;
  EXPECT_EQ(cli::applied_json(design)["report"]["notes"].back(), "the condition of the system is 3e+13");
  design.result.set_verdict(v1::VERDICT_DOUBTFUL);
  design.result.set_reasons_of_verdict(2);
  EXPECT_NE(printed(design).find(": doubtful\n    2 of 50 cells are inverted\n    2 of 100 faces are flipped\n"),
            std::string::npos);
}

TEST(Applied, SaysWhyItFailedAndWhetherItWasWritten) {
  cli::Applied design = applied();
  EXPECT_FALSE(cli::applied_json(design).contains("error"));
  design.failures = {"2 of 50 cells are inverted", "flipped_faces>0: it is 12"};
  EXPECT_EQ(cli::failure_text(design), "out.obj: 2 of 50 cells are inverted; flipped_faces>0: it is 12");
  EXPECT_EQ(printed(design).rfind("wrote out.obj: ", 0), 0u);
  EXPECT_EQ(cli::applied_json(design)["error"]["message"], cli::failure_text(design));
  design.written = false;
  EXPECT_EQ(cli::failure_text(design),
            "out.obj was not written: 2 of 50 cells are inverted; flipped_faces>0: it is 12; --keep-bad writes it all the same");
  EXPECT_EQ(printed(design).rfind("did NOT write out.obj: ", 0), 0u);
  EXPECT_EQ(cli::applied_json(design)["written"], false);
}

}  // namespace
}  // namespace deform::printed_test
