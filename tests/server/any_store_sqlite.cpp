// SPDX-License-Identifier: GPL-3.0-or-later
#include "server/store/geometry_store.h"
#include "tests/server/any_store.h"

namespace deform::server {
namespace {

std::unique_ptr<Store> open_geometry_store(const std::filesystem::path& folder) {
  return std::make_unique<GeometryStore>(folder);
}

INSTANTIATE_TEST_SUITE_P(Sqlite, AnyStore, testing::Values(StoreKind{"geometry_store", open_geometry_store}),
                         [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace deform::server
