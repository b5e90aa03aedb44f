// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "client/cli/setup/reading.h"
#include "core/base/types.h"
#include "deform/v1/deformation.pb.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli {

/// Shown by --help.
inline constexpr char motion_formats[] =
    "CSV with a header line, one of\n"
    "  handle,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23   one line per handle: x' = M x, M = 3x4, row by row\n"
    "  handle,point,dx,dy,dz                                    one line per point of the handle: x' = x + d\n"
    "  handle,point,x,y,z                                       the same: x' = (x, y, z)\n"
    "  handle,x,y,z,dx,dy,dz                                    the same, the point named by its place at rest: the nearest one "
    "of\n"
    "                                                           the handle, at most --match-tolerance away\n"
    "Points are point ids from 0, in any order, every point of the handle exactly once.";

/// Ascending point ids of a handle; throws for a name that is no handle.
using HandlePoints = std::function<std::vector<PointId>(const std::string& handle)>;

/// Where points are at rest.
struct RestPlaces {
  std::span<const Vec3> points;  ///< n x 3
  double tolerance = 0;          ///< for points named by their place, model units; > 0
};

/// The motions of a file. Throws Error(invalid_argument) with file and line: unknown columns or handle, repeated handle or point,
/// a point that is not in the handle, a place without a point, missing points, no number.
std::vector<v1::Motion> read_motions(const Csv& csv, const HandlePoints& handle_points, const RestPlaces& rest);

/// "name=value" settings into one value per design variable of the setup, 0 for those not set; none when there are no settings.
/// Throws Error(invalid_argument): form, unknown name (with the nearest ones), a name set twice, no number.
std::vector<double> parse_settings(const std::vector<std::string>& settings, const v1::Setup& setup);

/// Position of a design variable; `where` stands in the error.
std::size_t variable_index(const v1::Setup& setup, const std::string& name, const std::string& where);

}  // namespace deform::cli
