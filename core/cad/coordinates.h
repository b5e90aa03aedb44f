// SPDX-License-Identifier: GPL-3.0-or-later
// Points and unit vectors of OpenCASCADE as ours; points in the units of the model.
#pragma once

#include <gp_Dir.hxx>
#include <gp_Pnt.hxx>
#include <gp_XYZ.hxx>

#include "core/base/types.h"

namespace deform::cad {

inline Vec3 coordinates(const gp_XYZ& p) { return {p.X(), p.Y(), p.Z()}; }
inline Vec3 coordinates(const gp_Pnt& p) { return coordinates(p.XYZ()); }
inline Vec3 coordinates(const gp_Dir& d) { return coordinates(d.XYZ()); }

}  // namespace deform::cad
