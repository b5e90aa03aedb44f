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

/// The way of an affine motion from the identity: x -> s(t)(c + (1 + t (P - 1)) (x - c)), where R P is the polar decomposition of
/// its linear part and s(t) a screw by t times the angle of R and t times the shift along its axis. Motions that mirror or
/// collapse, and those that do not turn, go straight: 1 + t (M - 1).
class AffineWay {
 public:
  /// middle: c, which moves least where a motion both stretches and turns.
  AffineWay(const Affine& motion, const Vec3& middle);
  Affine at(double t) const;

 private:
  struct Screw {
    Vec3 axis{}, place{}, shift{};  ///< of unit length; a point of it; along it
    double angle = 0;
    Affine stretch{};  ///< P about c
  };

  const Affine motion_;
  std::optional<Screw> screw_;
};

/// The ways of the handles of a design: along its variables, of affine motions as AffineWay has it, of displacements straight.
class HandleWays {
 public:
  enum class Kind {
    natural,
    straight  ///< of all handles
  };
  /// The design has been bound before: it is right. setup and mesh must outlive it.
  HandleWays(const Setup& setup, const SelectedRegions& regions, const Mesh& mesh, const Design& design, Kind kind);

  /// Every handle goes straight to its place.
  bool straight() const { return straight_; }
  /// Per handle; nothing for one that is moved point by point.
  std::vector<std::optional<Affine>> motions(double t) const;
  /// What a system that was prepared at rest is to be asked for.
  Design design(double t) const;

 private:
  const Setup& setup_;
  const Design design_;
  std::vector<std::optional<AffineWay>> ways_;  ///< of the handles whose motion is given as such
  std::vector<Affine> ends_;                    ///< of those that variables move
  bool straight_ = true;
  Kind kind_;
};

}  // namespace deform
