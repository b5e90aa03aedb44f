// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Geom_Surface.hxx>
#include <array>
#include <optional>
#include <vector>

#include "core/cad/correspondence.h"
#include "core/cad/edge_map.h"
#include "core/cad/face_warp.h"
#include "core/cad/model.h"
#include "core/cad/thin_plate.h"

namespace deform::cad {

/// The map of a face to its partner that does not depend on how (u, v) run on the partner: the old surface is shifted by r^2 log
/// r and {x, y, 1} of its (u, v) in metric lengths, in space, so that its boundary is that of the partner, and goes along its
/// normals until it meets it. The identity where a face is written with other (u, v). Immutable.
class NormalWarp {
 public:
  /// As boundary_pairs().
  NormalWarp(const Model& before, const Model& after, const Correspondence& partners, int face, const std::vector<EdgeMap>& edges,
             const std::vector<int>& samples);
  /// (u, v) on the partner, found from `near` on; nothing where the normal does not meet it.
  std::optional<Parameters> operator()(const Parameters& uv, const Parameters& near) const;

 private:
  Handle(Geom_Surface) from_, to_;
  std::array<double, 2> scale_{1, 1};
  std::array<double, 4> box_{};  ///< of the partner: u and v, least and largest
  double size_ = 0;              ///< of the partner
  ThinPlate shift_;              ///< in space
};

}  // namespace deform::cad
