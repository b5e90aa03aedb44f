// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "core/base/types.h"

namespace deform {

/// Limits of the coordinates of a mesh in its unit of length: of their size, and of the longest side of their bounding box,
/// unless all points coincide. Sixth powers of lengths, as in products of volumes, are then finite and normal numbers, also those
/// of cells that are 1e-9 of the box long.
inline constexpr double most_coordinate = 1e40, least_extent = 1e-40;

/// Throws Error(invalid_argument) for finite points (n x 3) beyond these limits: "FIELD[I]: coordinate x is 1e+308, the limit is
/// ...". Any thread.
void check_coordinates(std::span<const Vec3> points, const std::string& field);

/// The limit of their size alone, for points that are not a mesh. first: number of the first of them in messages.
void check_magnitudes(std::span<const Vec3> points, const std::string& field, std::uint64_t first = 0);

}  // namespace deform
