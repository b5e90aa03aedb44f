// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/quality/extreme.h"
#include "core/quality/face_intersections.h"
#include "core/quality/safe_amplitude.h"
#include "deform/v1/deformation.pb.h"

namespace deform::convert {

v1::CellReport cell_report(const InversionCheck& check, const SafeAmplitude& safety);
/// The report on flipped faces, worst first, of a mesh with this number of faces.
v1::FaceReport face_report(std::size_t faces, const std::vector<Extreme>& flipped);
/// Adds the faces that ran into others.
void set_intersecting(v1::FaceReport& report, const std::vector<IntersectingFace>& faces);
/// The warning about flipped faces in one sentence; there must be one.
std::string flipped_faces_warning(const v1::FaceReport& faces);
/// The same of faces that ran into others.
std::string intersecting_faces_warning(const v1::FaceReport& faces);

}  // namespace deform::convert
