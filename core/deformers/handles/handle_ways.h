// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "core/base/types.h"
#include "core/deformers/setup.h"
#include "core/deformers/system.h"
#include "core/mesh/mesh.h"

namespace deform {

/// A path from the identity to an affine motion: x -> s(t)(c + (1 + t (P - 1)) (x - c)), where R P is the polar decomposition of
/// its linear part and s(t) is a screw motion by t times the angle of R and t times the shift along its axis. Motions that
/// reflect, collapse or do not rotate have a straight path: 1 + t (M - 1).
class AffineWay {
 public:
  /// `middle` is c, the centre of the stretch.
  AffineWay(const Affine& motion, const Vec3& middle);
  Affine at(double t) const;

 private:
  struct Screw {
    Vec3 axis{}, place{}, shift{};  ///< unit axis, a point on it, translation along it
    double angle = 0;
    Affine stretch{};  ///< P about c
  };

  const Affine motion_;
  std::optional<Screw> screw_;
};

/// The paths of the handles of a design: handles with variables follow t times their values, affine motions an AffineWay, and
/// displacements straight lines.
class HandleWays {
 public:
  enum class Kind {
    natural,
    straight  ///< straight paths for all handles
  };
  /// The design must be valid, as checked by System::bind(). `setup` and `mesh` must outlive this object.
  HandleWays(const Setup& setup, const SelectedRegions& regions, const Mesh& mesh, const Design& design, Kind kind);

  /// Whether all paths are straight.
  bool straight() const { return straight_; }
  /// The motion of each handle at t; std::nullopt for handles moved point by point.
  std::vector<std::optional<Affine>> motions(double t) const;
  /// The design at t for a system prepared at rest.
  Design design(double t) const;

 private:
  const Setup& setup_;
  const Design design_;
  std::vector<std::optional<AffineWay>> ways_;  ///< paths of handles with a given motion
  std::vector<Affine> ends_;                    ///< motions at the end of handles moved by variables
  bool straight_ = true;
  Kind kind_;
};

}  // namespace deform
