// SPDX-License-Identifier: GPL-3.0-or-later
// What a sweep leaves behind, whenever it is cut short: folders, archives and their manifests.
#include "client/cli/sweep/sweep_output.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <iterator>

#include "client/cli/sweep/tar.h"
#include "tests/support/expect_error.h"

namespace deform::sweep_output_test {
namespace {

namespace fs = std::filesystem;
using cli::ExpectedResult;
using test::expect_error;

std::string content(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void write(const fs::path& path, const std::string& text) { std::ofstream(path, std::ios::binary) << text; }

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + with.size())) {
    text.replace(at, what.size(), with);
  }
  return text;
}

class SweepOutput : public testing::Test {
 protected:
  using Expected = std::vector<ExpectedResult>;

  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("deform_sweep_" + std::to_string(::getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::unique_ptr<cli::SweepOutput> open(const fs::path& path, const Expected& expected) const {
    return cli::open_sweep_output(folder_ / path, ".obj", expected);
  }
  /// Runs a sweep whose results are their hashes, 700 times; what is there already is not computed. Returns what was.
  std::vector<std::string> sweep(const fs::path& path, const Expected& expected) const {
    const auto output = open(path, expected);
    std::vector<std::string> computed;
    for (const auto& result : expected) {
      if (output->find(result)) continue;
      output->put(result, {}, bytes_of(result));
      computed.push_back(result.name);
    }
    output->finish();
    return computed;
  }
  static std::string bytes_of(const ExpectedResult& result) { return replaced(std::string(700, '.'), ".", result.hash); }
  /// Names and contents of the entries of an archive, as another reader of tar files sees them.
  std::vector<std::pair<std::string, std::string>> entries(const fs::path& path) const {
    const std::string bytes = content(folder_ / path);
    std::vector<std::pair<std::string, std::string>> found;
    for (std::size_t at = 0; at + 512 <= bytes.size() && bytes[at] != '\0';) {
      const std::size_t size = std::stoul(bytes.substr(at + 124, 11), nullptr, 8);
      found.emplace_back(bytes.substr(at).c_str(), bytes.substr(at + 512, size));
      at += cli::tar_entry_bytes(size);
    }
    return found;
  }
  void expect_holds(const fs::path& path, const Expected& expected) const {
    auto found = entries(path);
    std::sort(found.begin(), found.end());
    std::vector<std::pair<std::string, std::string>> wanted;
    for (const auto& result : expected) wanted.emplace_back(result.name + ".obj", bytes_of(result));
    std::sort(wanted.begin(), wanted.end());
    EXPECT_EQ(found, wanted);
  }

  fs::path folder_;
};

TEST_F(SweepOutput, FolderKnowsWhatIsThere) {
  const fs::path path = folder_ / "results";
  open("results", {{"a", "1"}})->put({"a", "1"}, {}, "content");
  EXPECT_EQ(content(path / "a.obj"), "content");
  {
    const auto again = open("results", {{"a", "1"}, {"b", "1"}});
    EXPECT_TRUE(again->find({"a", "1"}));
    EXPECT_FALSE(again->find({"a", "2"}));
    EXPECT_FALSE(again->find({"b", "1"}));
  }
  write(path / "a.obj", "cut");  // another size: not the recorded one
  EXPECT_FALSE(open("results", {})->find({"a", "1"}));
}

TEST_F(SweepOutput, ForeignFilesInTheFolderAreLeftAlone) {
  const fs::path path = folder_ / "results";
  fs::create_directories(path);
  write(path / "b.obj", "mine");
  write(path / "c.obj", "mine");
  expect_error(ErrorCode::invalid_argument, {"results/b.obj", "not of this sweep", "1 more"}, [&] {
    open("results", {{"a", "1"}, {"b", "2"}, {"c", "3"}});
  });
  EXPECT_EQ(content(path / "b.obj"), "mine");
  EXPECT_FALSE(fs::exists(path / "sweep.manifest")) << "nothing was begun";
  EXPECT_EQ(sweep("results", {{"a", "1"}}), std::vector<std::string>{"a"}) << "the others are no hindrance";
  EXPECT_EQ(content(path / "c.obj"), "mine");
}

TEST_F(SweepOutput, AForeignManifestIsLeftAlone) {
  fs::create_directories(folder_ / "results");
  for (const char* text : {"a cargo of bananas\n", "no end of line", "{\"name\":\"other\"}\n"}) {
    write(folder_ / "results/sweep.manifest", text);
    expect_error(ErrorCode::invalid_argument, {"sweep.manifest", "not the manifest of a sweep"}, [&] {
      sweep("results", {{"a", "1"}});
    });
    EXPECT_EQ(content(folder_ / "results/sweep.manifest"), text);
  }
}

TEST_F(SweepOutput, AChangedRowIsComputedAloneInAFolder) {
  sweep("results", {{"a", "1"}, {"b", "2"}});
  EXPECT_EQ(sweep("results", {{"b", "2"}, {"a", "3"}, {"c", "4"}}), (std::vector<std::string>{"a", "c"}));
  EXPECT_EQ(content(folder_ / "results/a.obj"), bytes_of({"a", "3"}));
  EXPECT_EQ(sweep("results", {{"a", "3"}, {"b", "2"}, {"c", "4"}}), std::vector<std::string>());
}

TEST_F(SweepOutput, AFileThatWasBeingReplacedIsOursAndNotFinished) {
  sweep("results", {{"a", "1"}});
  const fs::path manifest = folder_ / "results/sweep.manifest";
  // Killed after the file got its name and before its entry: of the same size as before.
  write(manifest, content(manifest) + "{\"writing\":\"a.obj\"}\n");
  write(folder_ / "results/a.obj", bytes_of({"a", "2"}));
  EXPECT_FALSE(open("results", {{"a", "1"}})->find({"a", "1"}));
  EXPECT_EQ(sweep("results", {{"a", "1"}}), std::vector<std::string>{"a"});
  EXPECT_EQ(content(folder_ / "results/a.obj"), bytes_of({"a", "1"}));
}

TEST_F(SweepOutput, TornFilesAreRemovedForeignOnesAreNot) {
  sweep("results", {{"a", "1"}});
  for (const char* name : {"b.obj.sweep.part", "b.obj.71.0.part", "b.obj.mine.part", "c.obj.71.0.part"}) {
    write(folder_ / "results" / name, "half");
  }
  open("results", {{"a", "1"}, {"b", "2"}});
  EXPECT_FALSE(fs::exists(folder_ / "results/b.obj.sweep.part"));
  EXPECT_FALSE(fs::exists(folder_ / "results/b.obj.71.0.part"));
  EXPECT_TRUE(fs::exists(folder_ / "results/b.obj.mine.part"));
  EXPECT_TRUE(fs::exists(folder_ / "results/c.obj.71.0.part"));
}

TEST_F(SweepOutput, ManifestCutAnywhereTellsTheTruth) {
  const Expected expected{{"a", "1"}, {"b", "2"}, {"c", "3"}};
  {
    const auto output = open("results", expected);
    for (const auto& result : expected) output->put(result, {}, bytes_of(result));
  }
  const fs::path manifest = folder_ / "results/sweep.manifest";
  const std::string whole = content(manifest);
  std::size_t before = 0;
  for (std::size_t cut = 0; cut <= whole.size(); ++cut) {
    write(manifest, whole.substr(0, cut));
    std::size_t known = 0;
    try {
      const auto output = open("results", expected);
      for (const auto& result : expected) known += output->find(result) ? 1 : 0;
    } catch (const Error& error) {  // the files that it does not name any more
      EXPECT_NE(std::string(error.what()).find("not of this sweep"), std::string::npos) << error.what();
      continue;
    }
    EXPECT_GE(known, before);
    before = known;
  }
  EXPECT_EQ(before, 3u);
}

TEST_F(SweepOutput, ALineThatIsNoneHidesNoOther) {
  sweep("results", {{"a", "1"}, {"b", "2"}});
  const fs::path manifest = folder_ / "results/sweep.manifest";
  std::string text = content(manifest);
  const std::size_t second = text.find('\n') + 1;
  text.insert(second, "{\"name\":7,\"hash\":\"x\"}\nnothing\n");
  write(manifest, text);
  EXPECT_EQ(sweep("results", {{"a", "1"}, {"b", "2"}}), std::vector<std::string>());
}

TEST_F(SweepOutput, TwoSweepsDoNotWriteToOnePlace) {
  for (const char* path : {"results", "out.tar"}) {
    const auto first = open(path, {{"a", "1"}});
    expect_error(ErrorCode::failed_precondition, {"manifest", "another sweep is writing"}, [&] { open(path, {{"a", "1"}}); });
  }
}

TEST_F(SweepOutput, FailuresAreRecordedUntilTheDesignIsThere) {
  for (const fs::path path : {"results", "out.tar"}) {
    const fs::path file = folder_ / (path == "results" ? "results/sweep.manifest" : "out.tar.manifest");
    {
      const auto output = open(path, {{"a", "1"}, {"b", "2"}});
      output->put({"a", "1"}, {}, "x");
      output->fail("b", {"d.csv:3: why \"so\""});
      output->fail("d.csv:4", {"d.csv:4: no name"});
      output->finish();
    }
    EXPECT_NE(content(file).find("{\"failed\":\"d.csv:3: why \\\"so\\\"\",\"name\":\"b\"}\n"), std::string::npos);
    EXPECT_NE(content(file).find("d.csv:4: no name"), std::string::npos);
    EXPECT_EQ(sweep(path, {{"a", "1"}, {"b", "2"}}), std::vector<std::string>{"b"}) << "tried again";
    EXPECT_EQ(content(file).find("failed"), std::string::npos) << content(file);
  }
}

TEST_F(SweepOutput, VerdictsAreKnownToTheNextRun) {
  const cli::ResultVerdicts verdicts{
      {"2 cells are inverted"}, 0.25, {{"flipped_faces>0", ""}, {"missed>0", "it is 1"}}, {"steep"}, {"far"}};
  for (const char* path : {"results", "out.tar"}) {
    const auto first = open(path, {{"a", "1"}, {"b", "2"}});
    first->put({"a", "1"}, verdicts, "x");
    first->put({"b", "2"}, {}, "x");
    first->finish();
  }
  for (const char* path : {"results", "out.tar"}) {
    const auto found = open(path, {{"a", "1"}, {"b", "2"}})->find({"a", "1"});
    ASSERT_TRUE(found);
    EXPECT_EQ(found->reasons, verdicts.reasons);
    EXPECT_EQ(found->safe_amplitude, verdicts.safe_amplitude);
    EXPECT_EQ(found->gates, verdicts.gates);
    EXPECT_EQ(found->doubts, verdicts.doubts);
    EXPECT_EQ(found->warnings, verdicts.warnings);
  }
}

TEST_F(SweepOutput, ABadDesignThatWasNotWrittenIsKnownToTheNextRuns) {
  const cli::ResultVerdicts verdicts{.reasons = {"the split did not arrive"}, .reached = 0.625};
  for (const char* path : {"results", "out.tar"}) {
    const Expected expected{{"a", "1"}, {"b", "2"}, {"c", "3"}};
    const auto first = open(path, expected);
    first->fail("a", {"bad", "1", verdicts});
    first->fail("b", {"no server"});
    first->put({"c", "3"}, {}, "x");
    first->finish();
  }
  for (int run = 0; run < 2; ++run) {
    for (const char* path : {"results", "out.tar"}) {
      const auto again = open(path, {{"a", "1"}, {"b", "2"}, {"c", "3"}});
      const auto found = again->find_failure({"a", "1"});
      ASSERT_TRUE(found) << path << run;
      EXPECT_EQ(found->reason, "bad");
      EXPECT_EQ(found->verdicts.reasons, verdicts.reasons);
      EXPECT_EQ(found->verdicts.reached, 0.625);
      EXPECT_FALSE(again->find_failure({"a", "other values"}));
      EXPECT_FALSE(again->find_failure({"b", "2"})) << "to be tried again";
      EXPECT_FALSE(again->find_failure({"c", "3"}));
      again->finish();
    }
  }
}

TEST_F(SweepOutput, ArchiveGoesOnWhereItStopped) {
  const Expected expected{{"a", "1"}, {"b", "2"}};
  open("out.tar", expected)->put(expected[0], {}, bytes_of(expected[0]));
  EXPECT_FALSE(fs::exists(folder_ / "out.tar"));
  std::ofstream(folder_ / "out.tar.part", std::ios::app) << "half an entry";
  EXPECT_EQ(sweep("out.tar", expected), std::vector<std::string>{"b"});
  sweep("whole.tar", expected);
  EXPECT_EQ(content(folder_ / "out.tar"), content(folder_ / "whole.tar"));
  EXPECT_EQ(fs::file_size(folder_ / "out.tar"), 2 * cli::tar_entry_bytes(700) + cli::tar_end_bytes);
  EXPECT_FALSE(fs::exists(folder_ / "out.tar.part"));
}

TEST_F(SweepOutput, ForeignArchivesAreLeftAlone) {
  const Expected expected{{"a", "1"}};
  const auto refused = [&](const char* file, std::vector<const char*> says) {
    const std::string before = content(folder_ / file);
    expect_error(ErrorCode::invalid_argument, says, [&] { sweep("out.tar", expected); });
    EXPECT_EQ(content(folder_ / file), before);
    EXPECT_FALSE(before.empty());
  };
  write(folder_ / "out.tar", "precious");
  refused("out.tar", {"out.tar", "not of this sweep", "no out.tar.manifest"});
  EXPECT_FALSE(fs::exists(folder_ / "out.tar.manifest"));
  write(folder_ / "out.tar.manifest", "precious, too\n");
  refused("out.tar.manifest", {"not the manifest of a sweep"});
  fs::remove(folder_ / "out.tar.manifest");
  fs::rename(folder_ / "out.tar", folder_ / "out.tar.part");
  refused("out.tar.part", {"out.tar.part", "not of this sweep"});
  fs::remove(folder_ / "out.tar.part");

  sweep("out.tar", expected);
  const std::string whole = content(folder_ / "out.tar");
  write(folder_ / "out.tar", whole.substr(0, whole.size() - 512));
  refused("out.tar", {"not what its manifest says"});
  write(folder_ / "out.tar", replaced(whole, "a.obj", "b.obj"));
  refused("out.tar", {"not what its manifest says"});
  write(folder_ / "out.tar", whole);
  EXPECT_EQ(sweep("out.tar", expected), std::vector<std::string>());
  fs::remove(folder_ / "out.tar");
  fs::create_directories(folder_ / "out.tar");
  expect_error(ErrorCode::invalid_argument, {"no plain file"}, [&] { sweep("out.tar", expected); });
}

TEST_F(SweepOutput, AChangedRowIsComputedAloneInAnArchive) {
  sweep("out.tar", {{"a", "1"}, {"b", "2"}, {"c", "3"}});
  const std::vector<std::pair<Expected, std::vector<std::string>>> rounds{
      {{{"a", "1"}, {"b", "4"}, {"c", "3"}}, {"b"}},                   // changed
      {{{"c", "3"}, {"a", "1"}, {"b", "4"}}, {}},                      // in another order
      {{{"c", "3"}, {"a", "1"}}, {}},                                  // one less
      {{{"c", "3"}, {"d", "5"}, {"a", "1"}, {"e", "6"}}, {"d", "e"}},  // two more
      {{{"f", "1"}}, {"f"}},                                           // all others
  };
  for (const auto& [expected, computed] : rounds) {
    EXPECT_EQ(sweep("out.tar", expected), computed);
    expect_holds("out.tar", expected);
    EXPECT_EQ(sweep("out.tar", expected), std::vector<std::string>());
    EXPECT_FALSE(fs::exists(folder_ / "out.tar.part"));
    EXPECT_FALSE(fs::exists(folder_ / "out.tar.part.new"));
  }
}

TEST_F(SweepOutput, AnArchiveIsThereUntilTheNewOneIsComplete) {
  const Expected before{{"a", "1"}, {"b", "2"}}, after{{"a", "1"}, {"b", "3"}, {"c", "4"}};
  sweep("out.tar", before);
  {
    const auto output = open("out.tar", after);
    output->put(after[1], {}, bytes_of(after[1]));
    expect_holds("out.tar", before);
  }
  EXPECT_EQ(sweep("out.tar", before), std::vector<std::string>()) << "the old rows came back";
  expect_holds("out.tar", before);
  {
    const auto output = open("out.tar", after);
    output->put(after[2], {}, bytes_of(after[2]));
  }
  EXPECT_EQ(sweep("out.tar", after), std::vector<std::string>{"b"});
  expect_holds("out.tar", after);
}

/// Killed while the new archive took the place of the old one: before and after the rename.
TEST_F(SweepOutput, ACrashAroundTheRenameLosesNothing) {
  const Expected before{{"a", "1"}, {"b", "2"}}, after{{"a", "1"}, {"b", "3"}};
  const fs::path tar = folder_ / "out.tar", manifest = folder_ / "out.tar.manifest", part = folder_ / "out.tar.part";
  for (const bool first : {true, false}) {
    SCOPED_TRACE(first ? "the part becomes the archive" : "it is put together");
    for (const auto& file : {tar, manifest, part}) fs::remove(file);
    if (!first) sweep("out.tar", before);
    {
      const auto output = open("out.tar", after);
      for (const auto& result : after) {
        if (!output->find(result)) output->put(result, {}, bytes_of(result));
      }
    }
    const std::string old_tar = content(tar), old_part = content(part), old_manifest = content(manifest);
    EXPECT_EQ(sweep("out.tar", after), std::vector<std::string>());
    const std::string new_tar = content(tar), lines = content(manifest);
    const std::string announced =
        old_manifest + replaced(lines.substr(lines.find('\n') + 1), "\"name\"", "\"in\":\"next\",\"name\"");
    for (const bool renamed : {false, true}) {
      SCOPED_TRACE(renamed ? "after the rename" : "before the rename");
      write(manifest, announced);
      write(tar, renamed ? new_tar : old_tar);
      if (!renamed && old_tar.empty()) fs::remove(tar);
      write(part, old_part);
      if (renamed && first) fs::remove(part);
      EXPECT_EQ(sweep("out.tar", after), std::vector<std::string>()) << "nothing is computed again";
      expect_holds("out.tar", after);
      EXPECT_EQ(content(manifest), lines);
      EXPECT_FALSE(fs::exists(part));
    }
  }
}

/// 0.1 wrote entries without saying in which file, and made its archive the part to go on with it.
TEST_F(SweepOutput, WhatVersion01LeftIsTakenOver) {
  const Expected expected{{"a", "1"}, {"b", "2"}};
  sweep("out.tar", {{"a", "1"}});
  const std::string lines = content(folder_ / "out.tar.manifest");
  write(folder_ / "out.tar.manifest", lines.substr(lines.find('\n') + 1));
  EXPECT_EQ(sweep("out.tar", expected), std::vector<std::string>{"b"});
  const std::string both = content(folder_ / "out.tar.manifest");
  write(folder_ / "out.tar.manifest", both.substr(both.find('\n') + 1));
  fs::rename(folder_ / "out.tar", folder_ / "out.tar.part");
  EXPECT_EQ(sweep("out.tar", expected), std::vector<std::string>());
  expect_holds("out.tar", expected);
}

TEST_F(SweepOutput, APartThatLostItsEndIsCutToWhatIsWhole) {
  const Expected expected{{"a", "1"}, {"b", "2"}, {"c", "3"}};
  {
    const auto output = open("out.tar", expected);
    output->put(expected[0], {}, bytes_of(expected[0]));
    output->put(expected[1], {}, bytes_of(expected[1]));
  }
  fs::resize_file(folder_ / "out.tar.part", cli::tar_entry_bytes(700) + 600);
  EXPECT_EQ(sweep("out.tar", expected), (std::vector<std::string>{"b", "c"}));
  expect_holds("out.tar", expected);
}

TEST_F(SweepOutput, OnlyFailuresMakeNoArchive) {
  const auto output = open("out.tar", {{"a", "1"}});
  output->fail("a", {"why"});
  output->finish();
  EXPECT_FALSE(fs::exists(folder_ / "out.tar"));
  EXPECT_FALSE(fs::exists(folder_ / "out.tar.part"));
}

}  // namespace
}  // namespace deform::sweep_output_test
