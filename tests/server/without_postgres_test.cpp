// SPDX-License-Identifier: GPL-3.0-or-later
// What a deformd says that was built without libpq: server/store/without_postgres.cpp, whether this build has it or not.
#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "core/base/error.h"
#include "server/store/postgres_catalog.h"

namespace deform::server::without_postgres_test {
namespace {

TEST(WithoutPostgres, TheOptionSaysWhatBringsIt) {
  PostgresOptions options;
  options.uri = "postgresql://user:hush@db/x";
  const std::function<void()> uses[] = {[&] { check_catalog_uri(options.uri); }, [&] { open_postgres_catalog(options); }};
  for (const auto& use : uses) {
    try {
      use();
      FAIL();
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::invalid_argument);
      const std::string what = error.what();
      EXPECT_NE(what.find("libpq-dev"), std::string::npos) << what;
      EXPECT_NE(what.find("-DDEFORM_WITH_POSTGRES=ON"), std::string::npos) << what;
      EXPECT_EQ(what.find("hush"), std::string::npos) << what;
    }
  }
}

}  // namespace
}  // namespace deform::server::without_postgres_test
