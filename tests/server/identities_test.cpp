// SPDX-License-Identifier: GPL-3.0-or-later
// The file of identities: what it may say, and whom it knows.
#include "server/rpc/identities.h"

#include <gtest/gtest.h>

#include "tests/support/expect_error.h"

namespace deform::server {
namespace {

using test::expect_error;

// printf %s alice-token | sha256sum
constexpr char alice_hash[] = "9c220f200955d76c0a38d308225e0ef10c5f971acaf2f8d1d8f732affa5bd1dc";

std::string file(const std::string& lines) { return "# who may call\n" + lines; }

TEST(Identities, AreFoundByTokenAndByCertificate) {
  const auto known = Identities::parse(file(std::string("alice user sha256:") + alice_hash +
                                            "   # her laptop\r\n\n\t solver\treader certificate:spiffe://example.org/solver\n"
                                            "ops operator certificate:ops.example.org"),
                                       "f");
  EXPECT_EQ(known.tokens(), 1u);
  EXPECT_EQ(known.certificates(), 2u);
  const auto alice = known.of_token("alice-token");
  ASSERT_TRUE(alice);
  EXPECT_EQ(alice->name, "alice");
  EXPECT_EQ(alice->role, Role::use);
  const std::string names[] = {"other.example.org", "spiffe://example.org/solver"};
  const auto solver = known.of_certificate(names);
  ASSERT_TRUE(solver);
  EXPECT_EQ(solver->name, "solver");
  EXPECT_EQ(solver->role, Role::read);
  for (const char* wrong : {"", "alice-toke", "alice-token ", "Alice-token", alice_hash})
    EXPECT_FALSE(known.of_token(wrong)) << wrong;
  const std::string strangers[] = {"solver", "spiffe://example.org/solver/", "ops"};
  EXPECT_FALSE(known.of_certificate(strangers));
  EXPECT_FALSE(known.of_certificate({}));
}

TEST(Identities, ATokenIsReplacedByASecondLine) {
  std::string capitals = alice_hash;
  for (char& c : capitals) c = static_cast<char>(std::toupper(c));
  const auto known = Identities::parse("alice user sha256:" + std::string(64, '0') + "\nalice user sha256:" + capitals, "f");
  EXPECT_TRUE(known.of_token("alice-token"));
}

TEST(Identities, MistakesNameTheLineAndNeverTheCredential) {
  const std::string hash = std::string(" sha256:") + alice_hash;
  const struct {
    std::string line;
    const char* says;
  } cases[] = {
      {"alice user", "NAME ROLE CREDENTIAL"},
      {"alice user" + hash + " more", "NAME ROLE CREDENTIAL"},
      {"alice boss" + hash, "\"boss\" is none of reader, user, operator"},
      {"al/ice user" + hash, "\"al/ice\""},
      {std::string(65, 'a') + " user" + hash, "65 bytes, at most 64"},
      {"alice user sha256:" + std::string(63, 'a'), "64 hexadecimal digits"},
      {"alice user sha256:" + std::string(64, 'g'), "64 hexadecimal digits"},
      {"alice user certificate:", "neither"},
      {"alice user secret-token", "neither"},
      {"bob reader" + hash + "\nbob user" + hash, "\"bob\" is user here and reader on a line before"},
  };
  for (const auto& [line, says] : cases) {
    const std::string place = line.find('\n') == std::string::npos ? "f:2: " : "f:3: ";
    expect_error(ErrorCode::invalid_argument, {place.c_str(), says}, [&] { Identities::parse(file(line), "f"); });
  }
  try {
    Identities::parse("alice user secret-token", "f");
  } catch (const Error& error) {
    EXPECT_EQ(std::string(error.what()).find("secret"), std::string::npos);
  }
  std::string many;
  for (std::size_t i = 0; i <= Identities::max_entries; ++i) many += "a user certificate:b\n";
  expect_error(ErrorCode::invalid_argument, {"f:10001", "10000"}, [&] { Identities::parse(many, "f"); });
}

}  // namespace
}  // namespace deform::server
