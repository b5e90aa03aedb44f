// SPDX-License-Identifier: GPL-3.0-or-later
// A half of a sheet, and the whole one, made here face by face.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "core/base/vectors.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "tests/core/deformers/energy_cases.h"

namespace deform::test {

inline const SymmetryPlane plane_y{SymmetryPlane::Plane{{0.7, 0, 0.2}, {0, 2, 0}}};

/// A half of a sheet: its handle "end" touches the plane y = 0, "middle" does not.
inline deform::Setup half_setup(const decltype(deform::Setup::method)& method) {
  deform::Setup setup = sheet_setup();
  setup.method = method;
  setup.handles.push_back({"middle", box({0.9, 0.4, -1}, {1.1, 0.6, 1})});
  setup.variables.push_back({"up", "end", DesignVariable::Translate{{0.1, 0, 1}}});
  setup.variables.push_back({"turn", "end", DesignVariable::Rotate{{0, 1, 0}, {1.8, 0.5, 0}}});
  setup.variables.push_back({"grow", "middle", DesignVariable::Scale{{1, 0.5, 0}, {0, 1, 0.3}}});
  setup.variables.push_back({"roll", "middle", DesignVariable::Rotate{{1, 0.4, 0.2}, {1, 0.5, 0}}});
  setup.variables.back().also.push_back({"end", DesignVariable::Translate{{0.2, 0, -0.1}}});
  setup.symmetry = {plane_y};
  return setup;
}

inline const Design bent{{0.1, 0.8, 0.2, -0.6}, {}};

inline Vec3 across(const Vec3& v) { return {v[0], -v[1], v[2]}; }

/// The whole sheet, its images behind its points, and the motions of its handles as displacements.
struct WholeSheet {
  WholeSheet(const Mesh& half, const deform::Setup& of, const Design& at) : setup(of) {
    const SelectedRegions regions = validate(of, half);
    const std::vector<Affine> motions = handle_motions(of, at.variables);
    Mesh whole = half;
    for (std::size_t i = 0; i < half.point_count(); ++i) {
      image.push_back(half.points[i][1] == 0 ? static_cast<PointId>(i) : static_cast<PointId>(whole.points.size()));
      if (half.points[i][1] != 0) whole.points.push_back(across(half.points[i]));
    }
    std::size_t first = 0;
    for (const std::uint32_t size : half.face_sizes) {
      whole.face_sizes.push_back(size);
      for (std::size_t c = size; c-- > 0;) whole.face_points.push_back(image[half.face_points[first + c]]);
      first += size;
    }
    setup.symmetry.clear();
    setup.variables.clear();
    setup.fixed = {{Region::Ids{with_images(regions.fixed)}}};
    setup.handles.clear();
    for (std::size_t h = 0; h < regions.handles.size(); ++h) {
      // Those of the half, then their images: separate handles, as centres and samples may depend on what is one.
      std::vector<PointId> own;
      for (const PointId id : regions.handles[h]) {
        if (image[id] != id) own.push_back(image[id]);
      }
      setup.handles.push_back({of.handles[h].name, {Region::Ids{regions.handles[h]}}});
      design.motions.push_back({h, motions[h]});
      copies.push_back(own);
    }
    for (std::size_t h = 0; h < copies.size(); ++h) {
      std::vector<Vec3> moved;
      for (const PointId id : copies[h]) {
        const Vec3 x = across(whole.points[id]);
        moved.push_back(across(transformed(motions[h], x) - x));
      }
      design.motions.push_back({setup.handles.size(), std::move(moved)});
      setup.handles.push_back({"copy of " + of.handles[h].name, {Region::Ids{copies[h]}}});
    }
    mesh = shared(std::move(whole));
  }
  std::vector<PointId> with_images(std::vector<PointId> ids) const {
    const std::size_t count = ids.size();
    for (std::size_t i = 0; i < count; ++i) {
      if (image[ids[i]] != ids[i]) ids.push_back(image[ids[i]]);
    }
    return ids;
  }

  std::vector<PointId> image;
  std::vector<std::vector<PointId>> copies;
  std::shared_ptr<const Mesh> mesh;
  deform::Setup setup;
  Design design;
};

}  // namespace deform::test
