// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/local_functions.h"

#include <algorithm>
#include <vector>

#include "core/base/vectors.h"

namespace deform {

std::size_t local_function_bytes(std::size_t centres) {
  constexpr std::size_t node = 32;  // of the tree, for a centre
  return 256 + centres * (sizeof(Vec3) + node);
}

MlsFunctions::MlsFunctions(std::span<const Vec3> samples, double radius, const MlsBasis::Options& options, const UnitBox& box)
    : basis_(samples, radius, options), box_(box) {}

SpaceFunctions::Outside MlsFunctions::rows(std::span<const Vec3> places, std::uint64_t, const Use& use) const {
  MlsBasis::Row row;
  for (std::size_t i = 0; i < places.size(); ++i) {
    basis_.evaluate(box_.to_unit(places[i]), MlsBasis::Order::values, row);
    for (std::size_t s = 0; s < row.samples.size(); ++s) use(i, row.samples[s], row.values[s]);
  }
  return {};
}

LocalKernelFunctions::LocalKernelFunctions(const RadialKernel& kernel, double reach, std::span<const Vec3> centres,
                                           const UnitBox& box, std::optional<Vec3> mean)
    : kernel_(kernel), reach_(reach), box_(box), tree_(centres), mean_(mean) {}

SpaceFunctions::Outside LocalKernelFunctions::rows(std::span<const Vec3> places, std::uint64_t, const Use& use) const {
  std::vector<PointTree::Near> near;
  const auto centres = static_cast<std::int64_t>(tree_.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Vec3 x = box_.to_unit(places[i]);
    tree_.within(x, reach_ * reach_, near);
    std::sort(near.begin(), near.end(), [](const auto& a, const auto& b) { return a.point < b.point; });
    for (const PointTree::Near& centre : near) use(i, centre.point, value(kernel_, centre.square));
    if (!mean_) continue;
    const Vec3 from = x - *mean_;
    use(i, centres, 1);
    for (int c = 0; c < 3; ++c) use(i, centres + 1 + c, from[static_cast<std::size_t>(c)]);
  }
  return {};
}

}  // namespace deform
