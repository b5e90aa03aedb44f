// SPDX-License-Identifier: GPL-3.0-or-later
#include "proto/convert/findings.h"

#include <algorithm>
#include <cstdint>

namespace deform::convert {

namespace {

constexpr std::size_t most_listed = 100;  // ids

}  // namespace

v1::CellReport cell_report(const InversionCheck& check, const SafeAmplitude& safety) {
  v1::CellReport report;
  report.set_cells(check.cell_count());
  report.set_safe_amplitude(safety.amplitude);
  if (safety.first_cell) report.set_first_cell(static_cast<std::uint32_t>(*safety.first_cell));
  report.set_inverted(safety.inverted.count);
  for (const Extreme& cell : safety.inverted.worst) report.add_inverted_ids(static_cast<std::uint32_t>(cell.id));
  report.set_least_determinant(safety.inverted.least_determinant.value);
  report.set_least_determinant_cell(static_cast<std::uint32_t>(safety.inverted.least_determinant.id));
  report.set_inverted_at_rest(check.at_rest().count);
  report.set_without_volume(safety.inverted.without_volume);
  report.set_wrong_pyramid(safety.inverted.wrong_pyramid);
  report.set_left_handed(check.left_handed());
  return report;
}

v1::FaceReport face_report(std::size_t faces, const std::vector<Extreme>& flipped) {
  v1::FaceReport report;
  report.set_faces(faces);
  report.set_flipped(flipped.size());
  for (std::size_t k = 0; k < std::min(flipped.size(), most_listed); ++k) {
    report.add_flipped_ids(static_cast<std::uint32_t>(flipped[k].id));
  }
  return report;
}

void set_intersecting(v1::FaceReport& report, const std::vector<IntersectingFace>& faces) {
  report.set_intersecting(faces.size());
  for (std::size_t k = 0; k < std::min(faces.size(), most_listed); ++k) report.add_intersecting_ids(faces[k].face);
}

std::string intersecting_faces_warning(const v1::FaceReport& faces) {
  return std::to_string(faces.intersecting()) + " of " + std::to_string(faces.faces()) +
         " faces ran into others, the first is face " + std::to_string(faces.intersecting_ids(0));
}

std::string flipped_faces_warning(const v1::FaceReport& faces) {
  return std::to_string(faces.flipped()) + " of " + std::to_string(faces.faces()) + " faces are flipped, face " +
         std::to_string(faces.flipped_ids(0)) + " worst: the surface is folded over there";
}

}  // namespace deform::convert
