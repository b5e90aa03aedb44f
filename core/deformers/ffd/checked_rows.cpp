// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/ffd/checked_rows.h"

#include <functional>

namespace deform {

namespace {

/// The mean of the rows of the images of each point, times a factor for each image.
SparseRows mean_rows(const FunctionRows& rows, std::span<const PointId> points, std::size_t images,
                     const std::function<PointId(PointId, std::size_t)>& image,
                     const std::function<double(std::size_t)>& factor) {
  std::vector<Eigen::Triplet<double, std::int64_t>> entries;
  for (std::size_t p = 0; p < points.size(); ++p) {
    for (std::size_t g = 0; g < images; ++g) {
      const double share = factor(g) / static_cast<double>(images);
      rows.for_each(image(points[p], g), [&](std::int64_t column, double value) {
        entries.emplace_back(static_cast<std::int64_t>(p), column, share * value);
      });
    }
  }
  SparseRows result(static_cast<Eigen::Index>(points.size()), rows.cols());
  result.setFromTriplets(entries.begin(), entries.end());
  return result;
}

}  // namespace

CheckedRows checked_rows(const FunctionRows& rows, std::span<const PointId> points, const MirroredMesh* images) {
  CheckedRows result;
  result.points = points.size();
  if (images == nullptr) {
    const auto itself = [](PointId id, std::size_t) { return id; };
    result.kinds.push_back(mean_rows(rows, points, 1, itself, [](std::size_t) { return 1.0; }));
    for (std::size_t k = 0; k < 3; ++k) result.terms[k] = {{0, k}};
    return result;
  }
  const Symmetry& symmetry = images->symmetry();
  for (std::size_t k = 0; k < 3; ++k) {
    Vec3 unit{};
    unit[k] = 1;
    result.axes[k] = symmetry.from_frame(unit);
  }
  const auto image = [&](PointId id, std::size_t g) { return images->image(id, g); };
  const auto add = [&](const std::function<double(std::size_t)>& factor) {
    result.kinds.push_back(mean_rows(rows, points, images->images(), image, factor));
  };
  if (!symmetry.is_sector()) {
    // The component along a normal is odd in its plane, the others are even.
    for (std::size_t k = 0; k < 3; ++k) {
      const bool across = k < symmetry.planes();
      if (across || k == symmetry.planes()) add([&](std::size_t g) { return across && (g >> k & 1u) != 0 ? -1.0 : 1.0; });
      result.terms[k] = {{result.kinds.size() - 1, k}};
    }
    return result;
  }
  // Across the axis components are turned back into each other.
  const auto turned = [&](std::size_t g) { return symmetry.sector().turned({0, 1, 0}, g); };
  add([](std::size_t) { return 1.0; });
  add([&](std::size_t g) { return turned(g)[1]; });
  add([&](std::size_t g) { return turned(g)[2]; });
  result.terms = {{{{0, 0}}, {{1, 1}, {2, 2}}, {{1, 2}, {2, 1}}}};
  return result;
}

}  // namespace deform
