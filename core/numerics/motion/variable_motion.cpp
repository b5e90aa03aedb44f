// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/numerics/motion/variable_motion.h"

#include <numbers>

namespace deform {

compiled::VariableMotion compiled_motion(const VariableMotion& motion) {
  using compiled::MotionKind;
  if (const auto* t = std::get_if<Translation>(&motion)) return {MotionKind::translation, t->direction, {}};
  if (const auto* r = std::get_if<Rotation>(&motion)) {
    return {MotionKind::rotation, r->axis, r->centre, r->unit == AngleUnit::degrees ? std::numbers::pi / 180 : 1};
  }
  const auto& s = std::get<Scaling>(motion);
  return {MotionKind::scaling, s.axis, s.centre};
}

Affine motion_at(const VariableMotion& motion, double v) { return compiled::motion_at(compiled_motion(motion), v); }

Affine motion_rate(const VariableMotion& motion, double v) { return compiled::motion_rate(compiled_motion(motion), v); }

}  // namespace deform
