// SPDX-License-Identifier: GPL-3.0-or-later
// The file of identities: what it may say, and whom it knows.
#include "server/rpc/identities.h"

#include <gtest/gtest.h>

#include "server/rpc/request_rates.h"
#include "tests/support/expect_error.h"

namespace deform::server::identities_test {
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

TEST(Identities, HaveTenantsAndTenantsHaveQuotas) {
  const auto known = Identities::parse(
      std::string("alice owner sha256:") + alice_hash +
          " tenant=acme\ntenant:acme stored-bytes=20GiB geometries=500 calls=32 "
          "preparations=4 bytes-in-flight=1GiB requests-per-second=100\nbob user certificate:bob\ntenant:* geometries=3\n"
          "tenant:b-2.x # no limits",
      "f");
  EXPECT_EQ(known.of_token("alice-token")->tenant, "acme");
  EXPECT_EQ(known.of_token("alice-token")->role, Role::own);
  const std::string names[] = {"bob"};
  EXPECT_EQ(known.of_certificate(names)->tenant, "default");
  EXPECT_EQ(known.quota_of("acme"), (Quota{std::uint64_t{20} << 30, 500, 32, 4, std::uint64_t{1} << 30, 100}));
  EXPECT_EQ(known.quota_of("default"), (Quota{.geometries = 3}));
  EXPECT_EQ(known.quotas_of_nobody(), std::vector<std::string>{"b-2.x"});
  EXPECT_EQ(known.quota_of("b-2.x"), Quota());
  EXPECT_EQ(Identities::parse("", "f").quota_of("acme"), Quota());
}

TEST(RequestRates, ABucketOfOneSecondIsFilledSteadily) {
  RequestRates rates;
  const RequestRates::Clock::time_point start{};
  const auto at = [&](double seconds) {
    return start + std::chrono::duration_cast<RequestRates::Clock::duration>(std::chrono::duration<double>(seconds));
  };
  const auto refused_for = [&](const std::string& tenant, double seconds) -> std::uint32_t {
    try {
      rates.take(tenant, 4, at(seconds));
      return 0;
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::out_of_budget);
      EXPECT_EQ(error.refusal(), Refusal::rate);
      return error.retry_after_ms();
    }
  };
  for (int i = 0; i < 4; ++i) EXPECT_EQ(refused_for("a", 10), 0u);
  EXPECT_EQ(refused_for("a", 10), 250u);
  EXPECT_EQ(refused_for("b", 10), 0u) << "each tenant has its own";
  EXPECT_EQ(refused_for("a", 10.1), 150u);
  EXPECT_EQ(refused_for("a", 10.25), 0u);
  EXPECT_EQ(refused_for("a", 10.25), 250u);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(refused_for("a", 100), 0u);
  EXPECT_EQ(refused_for("a", 100), 250u) << "an hour of rest is worth no more than a second";
  for (int i = 0; i < 1000; ++i) EXPECT_NO_THROW(rates.take("free", 0, at(0)));
}

TEST(Identities, MistakesNameTheLineAndNeverTheCredential) {
  const std::string hash = std::string(" sha256:") + alice_hash;
  const struct {
    std::string line;
    const char* says;
  } cases[] = {
      {"alice user", "NAME ROLE CREDENTIAL"},
      {"alice user" + hash + " more", "NAME ROLE CREDENTIAL [tenant=TENANT]"},
      {"alice user" + hash + " tenant=a more", "NAME ROLE CREDENTIAL [tenant=TENANT]"},
      {"alice user" + hash + " tenant=Acme", "the tenant \"Acme\" is not 1 to 64 lower-case"},
      {"alice user" + hash + " tenant=../x", "the tenant \"../x\""},
      {"alice user" + hash + " tenant=", "the tenant \"\""},
      {"alice user" + hash + " tenant=a\nalice user" + hash, "\"alice\" is of tenant \"default\" here and of \"a\""},
      {"tenant:a geometries=x", "geometries: \"x\" is no limit"},
      {"tenant:a geometries=0", "geometries: \"0\" is no limit"},
      {"tenant:a geometries=1 geometries=2", "geometries stands twice"},
      {"tenant:a colour=3", "\"colour=3\" is none of stored-bytes=SIZE"},
      {"tenant:a geometries", "\"geometries\" is none of"},
      {"tenant: geometries=1", "the tenant \"\""},
      {"tenant:a\ntenant:a", "a second line of tenant \"a\""},
      {"alice boss" + hash, "\"boss\" is none of reader, user, owner, operator"},
      {"al/ice user" + hash, "\"al/ice\""},
      {std::string(65, 'a') + " user" + hash, "65 bytes, at most 64"},
      {"alice user sha256:" + std::string(63, 'a'), "64 hexadecimal digits"},
      {"alice user sha256:" + std::string(64, 'g'), "64 hexadecimal digits"},
      {"alice user certificate:", "neither"},
      {"alice user secret-token", "neither"},
      {"alice user" + hash + "\nbob user" + hash, "the credential of \"bob\" is that of \"alice\" on line 2;"},
      {"a user certificate:x.org\nb user certificate:x.org", "the credential of \"b\" is that of \"a\" on line 2;"},
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
}  // namespace deform::server::identities_test
