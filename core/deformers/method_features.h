// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string_view>

namespace deform {

/// The properties of a method that others ask for: the parts of a setup that it supports, and what is said of its designs.
struct MethodFeatures {
  bool symmetry = false;     ///< symmetry planes of its own; other methods deform the model with its images, see MirroredSystem
  bool constraints = false;  ///< geometric constraints
  /// Its functions depend on samples of the model, which are not mirror images of each other where the model is. Exact
  /// constraints in half models are refused: the mean over the images leaves the shapes by as much.
  bool sampled = false;
  /// The effect of a large condition on the points is part of the estimated error: residuals are taken with twice the digits from
  /// the exact matrix, and show whether its factor has digits left. The matrices of energies are rounded when they are
  /// assembled, which their residuals do not show, and the errors of lattices and cages are bounds.
  bool measures_condition = false;
  bool control_points = false;  ///< its system has control points; others have centres, or no functions of their own
  std::string_view more_of{};   ///< what more of lets its functions meet constraints better, "samples"; empty if nothing does
};

}  // namespace deform
