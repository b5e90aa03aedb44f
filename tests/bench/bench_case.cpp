// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/bench_case.h"

#include <algorithm>
#include <stdexcept>

#include "client/design.h"
#include "core/mesh/ahmed.h"

namespace deform::bench {

namespace {

/// `count` entries at even distances.
std::vector<PointId> spread(const std::vector<PointId>& ids, std::size_t first, std::size_t last, std::size_t count) {
  if (last - first < count) throw std::runtime_error("the mesh has too few points for so many centres");
  std::vector<PointId> out;
  for (std::size_t k = 0; k < count; ++k) out.push_back(ids[first + k * (last - first) / count]);
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace

Case make_case(const CaseSize& size) {
  Case out;
  AhmedOptions ahmed;
  ahmed.target_points = size.points;
  out.mesh = ahmed_body(ahmed);
  out.diagonal = bounding_box(out.mesh.points).diagonal();

  constexpr double above = 0.30, below = 0.055;  // metres: upper side, underbody with stilts
  std::vector<PointId> upper, lower;
  for (std::size_t i = 0; i < out.mesh.points.size(); ++i) {
    if (out.mesh.points[i][2] > above) upper.push_back(static_cast<PointId>(i));
    if (out.mesh.points[i][2] < below) lower.push_back(static_cast<PointId>(i));
  }
  std::sort(upper.begin(), upper.end(),
            [&](PointId a, PointId b) { return std::pair(out.mesh.points[a][0], a) < std::pair(out.mesh.points[b][0], b); });
  const std::size_t per_handle = size.centres / 2 / size.handles;
  for (std::size_t h = 0; h < size.handles; ++h) {
    out.handles.emplace_back("slice_" + std::to_string(h),
                             spread(upper, h * upper.size() / size.handles, (h + 1) * upper.size() / size.handles, per_handle));
  }
  out.fixed = spread(lower, 0, lower.size(), size.centres - per_handle * size.handles);
  return out;
}

v1::Setup make_setup(const Case& bench_case, const std::string& geometry_id) {
  v1::Setup setup;
  setup.set_geometry(geometry_id);
  setup.mutable_method()->mutable_rbf()->set_kernel(v1::TRIHARMONIC);
  setup.mutable_method()->mutable_rbf()->set_reduction(v1::REDUCTION_OFF);
  for (const auto& [name, ids] : bench_case.handles) {
    auto* handle = setup.add_handles();
    handle->set_name(name);
    handle->mutable_region()->mutable_ids()->Add(ids.begin(), ids.end());
  }
  setup.add_fixed()->mutable_ids()->Add(bench_case.fixed.begin(), bench_case.fixed.end());
  return setup;
}

std::vector<Affine> random_maps(const Case& bench_case, std::mt19937_64& random) {
  std::uniform_real_distribution<double> linear(-0.02, 0.02), shift(-0.01, 0.01);
  std::vector<Affine> maps;
  for (std::size_t h = 0; h < bench_case.handles.size(); ++h) {
    Affine map = identity_affine;
    for (std::size_t k = 0; k < map.size(); ++k) map[k] += k % 4 == 3 ? shift(random) : linear(random);
    maps.push_back(map);
  }
  return maps;
}

v1::Design make_design(const Case& bench_case, const std::vector<Affine>& maps) {
  v1::Design design;
  for (std::size_t h = 0; h < maps.size(); ++h) {
    *design.add_motions() = client::affine_motion(bench_case.handles[h].first, maps[h]);
  }
  return design;
}

}  // namespace deform::bench
