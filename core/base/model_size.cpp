// SPDX-License-Identifier: Apache-2.0
#include "core/base/model_size.h"

#include <algorithm>
#include <cstddef>
#include <vector>

#include "core/base/number_text.h"
#include "core/base/vectors.h"

namespace deform {

ModelSize model_size(std::span<const Vec3> points) {
  constexpr std::size_t most = 100'000, fewest = 100;
  constexpr double far = 1e6;
  const double of_all = bounding_box(points).diagonal();
  if (points.size() < fewest) return {of_all, {}};
  const std::size_t step = 1 + (points.size() - 1) / most;
  Vec3 bulk{};
  std::vector<double> values;
  for (std::size_t k = 0; k < 3; ++k) {
    values.clear();
    for (std::size_t i = 0; i < points.size(); i += step) values.push_back(points[i][k]);
    const std::size_t cut = values.size() / 20;
    const auto low = values.begin() + static_cast<std::ptrdiff_t>(cut),
               high = values.end() - 1 - static_cast<std::ptrdiff_t>(cut);
    std::nth_element(values.begin(), low, values.end());
    std::nth_element(low + 1, high, values.end());
    bulk[k] = *high - *low;
  }
  const double of_most = norm(bulk);
  if (!(of_all > far * of_most)) return {of_all, {}};
  return {of_most, "most points lie within " + three_digits(of_most) + ", but the bounding box is " + three_digits(of_all) +
                       " long, and everything is computed in parts of it: remove points that have strayed"};
}

}  // namespace deform
