// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/setup/contexts.h"

#include <gmock/gmock-matchers.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "core/base/error.h"

namespace deform::client::contexts_test {
namespace {

using testing::HasSubstr;

class ContextsFile : public testing::Test {
 protected:
  Contexts read(const std::string& text) {
    std::ofstream(file_) << text;
    return read_contexts(file_);
  }
  std::string error(const std::string& text) {
    try {
      read(text);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::invalid_argument);
      return error.what();
    }
    return {};
  }

  void TearDown() override { std::filesystem::remove(file_); }

  const std::filesystem::path folder_ = std::filesystem::temp_directory_path();
  const std::filesystem::path file_ = folder_ / ("contexts_test_" + std::to_string(getpid()) + "_contexts.yaml");
};

TEST_F(ContextsFile, IsReadAsItWasWritten) {
  Contexts contexts;
  contexts.current = "yes";  // a word of YAML
  contexts.known["yes"] = {"a.example.org:1", false, true, "/ca #1.pem", "/c: d.pem", "/k\"e'y.pem", "name", "/to ken"};
  contexts.known["0.1"] = {"unix:/run/socket", true, false, "", "", "", "", ""};
  contexts.file = file_;
  const Contexts back = read(to_yaml(contexts));
  EXPECT_EQ(back.current, contexts.current);
  EXPECT_EQ(back.known, contexts.known);
  EXPECT_EQ(back.find("yes").token_file, "/to ken");
  EXPECT_TRUE(back.find("0.1").replicas);
  EXPECT_THROW(back.find("no"), Error);
}

TEST_F(ContextsFile, MayBeMissingOrEmpty) {
  EXPECT_TRUE(read_contexts(file_).known.empty());
  EXPECT_TRUE(read_contexts({}).known.empty());
  EXPECT_TRUE(read("").known.empty());
  EXPECT_TRUE(read("contexts:\n").known.empty());
}

TEST_F(ContextsFile, FilesStartAtItsFolder) {
  const Contexts contexts = read("contexts: {a: {server: 'b:1', ca: sub/../ca.pem, token_file: /elsewhere/token}}");
  EXPECT_EQ(contexts.find("a").ca, (folder_ / "ca.pem").string());
  EXPECT_EQ(contexts.find("a").token_file, "/elsewhere/token");
}

TEST_F(ContextsFile, SaysWhatIsWrongAndWhere) {
  EXPECT_THAT(error("contexts:\n  a: {servre: x}\n"),
              HasSubstr("contexts.yaml:2: unknown key \"servre\"; did you mean \"server\""));
  EXPECT_THAT(error("contexts:\n  a: {}\n  a: {}\n"), HasSubstr(":3: \"a\" is there twice"));
  EXPECT_THAT(error("contexts: {a: {tls: maybe}}"), HasSubstr("tls: expected true or false"));
  EXPECT_THAT(error("contexts: {a: {replicas: 3}}"), HasSubstr("replicas: expected true or false"));
  EXPECT_THAT(error("contexts: {a: {ca: [x]}}"), HasSubstr("ca: expected a text"));
  EXPECT_THAT(error("contexts: {'a b': {}}"), HasSubstr("\"a b\" is no name"));
  EXPECT_THAT(error("current: b\ncontexts: {a: {}}"), HasSubstr("there is no context \"b\""));
  EXPECT_THAT(error("{"), HasSubstr("contexts.yaml:1: "));
  EXPECT_THAT(error("- a"), HasSubstr("expected a mapping"));
}

}  // namespace
}  // namespace deform::client::contexts_test
