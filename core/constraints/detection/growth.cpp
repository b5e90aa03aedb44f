// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/constraints/detection/growth.h"

#include <algorithm>
#include <cmath>

#include "core/constraints/detection/judgement.h"

namespace deform::detection {

namespace {

constexpr std::size_t quick_faces = 400;  ///< largest number of faces in a fit while the region grows
constexpr std::size_t full_faces = 2000;  ///< and in the end
constexpr int rounds = 30;

}  // namespace

double area_of(const Surface& surface, std::span<const FaceId> faces) {
  double sum = 0;
  for (const FaceId f : faces) sum += surface.area[f];
  return sum;
}

namespace {

template <PrimitiveKind kind>
bool fits_kind(const Surface& surface, const Shape& shape, FaceId face, double threshold) {
  const double least = surface.least_cosine[face];
  const bool with_area = surface.area[face] > 0;
  const Vector3d& normal = surface.normal[face];
  if constexpr (kind == PrimitiveKind::plane) {
    if (with_area && !(std::abs(shape.axis.dot(normal)) >= least)) return false;
  }
  for (const PointId p : surface.corners(face)) {
    const Shape::Foot foot = shape.foot<kind>(surface.points[p]);
    if (!(std::abs(foot.distance) <= threshold)) return false;
    // A flat on a round shaft has its ends on the cylinder and the right direction in the middle, but not at its ends.
    if (kind == PrimitiveKind::cylinder && with_area && std::abs(foot.normal.dot(normal)) < least) return false;
  }
  if constexpr (kind == PrimitiveKind::plane) return true;
  return !with_area || std::abs(shape.foot<kind>(surface.centre[face]).normal.dot(normal)) >= least;
}

}  // namespace

bool fits(const Surface& surface, const Shape& shape, FaceId face, double threshold) {
  switch (shape.kind) {
    case PrimitiveKind::plane:
      return fits_kind<PrimitiveKind::plane>(surface, shape, face, threshold);
    case PrimitiveKind::cylinder:
      return fits_kind<PrimitiveKind::cylinder>(surface, shape, face, threshold);
    case PrimitiveKind::sphere:
      return fits_kind<PrimitiveKind::sphere>(surface, shape, face, threshold);
    case PrimitiveKind::cone:
      return fits_kind<PrimitiveKind::cone>(surface, shape, face, threshold);
  }
  return false;
}

void Growth::next_mark() {
  if (++mark_ != 0) return;
  std::fill(marks_.begin(), marks_.end(), 0);
  mark_ = 1;
}

std::vector<FaceId> Growth::neighbourhood(FaceId seed, double area, std::size_t count, std::span<const std::uint32_t> labels) {
  next_mark();
  std::vector<FaceId> faces{seed};
  marks_[seed] = mark_;
  double sum = surface_.area[seed];
  for (std::size_t i = 0; i < faces.size() && (sum < area || faces.size() < count); ++i) {
    for (const FaceId f : surface_.passages(faces[i])) {
      if (marks_[f] == mark_ || labels[f] != unlabelled) continue;
      marks_[f] = mark_;
      faces.push_back(f);
      sum += surface_.area[f];
    }
  }
  return faces;
}

void Growth::flood(const Shape& shape, double threshold, std::size_t most, std::span<const std::uint32_t> labels,
                   std::vector<FaceId>& piece) {
  for (std::size_t i = 0; i < piece.size() && piece.size() < most; ++i) {
    for (const FaceId f : surface_.passages(piece[i])) {
      if (marks_[f] == mark_ || labels[f] != unlabelled) continue;
      marks_[f] = mark_;
      if (fits(surface_, shape, f, threshold)) piece.push_back(f);
    }
  }
}

std::vector<FaceId> Growth::grown(const Shape& shape, double threshold, std::span<const FaceId> start, std::size_t most,
                                  std::span<const std::uint32_t> labels) {
  next_mark();
  std::vector<FaceId> best, piece;
  double best_area = -1, left = area_of(surface_, start);
  for (const FaceId f : start) {
    if (left <= best_area) break;  // not even all that remains could be more
    left -= surface_.area[f];
    if (marks_[f] == mark_ || labels[f] != unlabelled || surface_.area[f] == 0) continue;
    if (!fits(surface_, shape, f, threshold)) continue;
    marks_[f] = mark_;
    piece.assign(1, f);
    flood(shape, threshold, most, labels, piece);
    const double area = area_of(surface_, piece);
    if (area > best_area) {
      best_area = area;
      best.swap(piece);
    }
  }
  return best;
}

std::optional<Region> Growth::converged(const Shape& shape, std::span<const FaceId> start,
                                        std::span<const std::uint32_t> labels) {
  FitData data = surface_.data(start, quick_faces);
  if (data.corners.empty()) return std::nullopt;
  Region region{shape, {start.begin(), start.end()}, area_of(surface_, start), rms_distance(shape, data)};
  if (!(region.rms <= limits_.tolerance)) return std::nullopt;
  Effort effort = Effort::quick;
  int standing = 0;
  for (int round = 0; round < rounds; ++round) {
    const std::size_t most = 4 * region.faces.size() + 32;
    std::vector<FaceId> faces = grown(region.shape, limits_.threshold(region.rms), region.faces, most, labels);
    if (faces.empty()) return std::nullopt;
    const double area = area_of(surface_, faces);
    data = surface_.data(faces, effort == Effort::quick ? quick_faces : full_faces);
    const auto next = refine(region.shape, data, effort);
    if (!next) return std::nullopt;
    const bool grew = faces.size() >= most || area > 1.02 * region.area;
    const bool settled = !grew && area >= 0.999 * region.area;
    region = {*next, std::move(faces), area, rms_distance(*next, data)};
    standing = grew ? 0 : standing + 1;
    // Regions that drift along another surface are detected during growth.
    if (round % 3 == 2 && region.rms > limits_.tolerance / 40 && region.faces.size() > 8 * start.size() &&
        !noisy(surface_, limits_, region.shape, region.faces)) {
      return std::nullopt;
    }
    if (standing >= 2 && area < 0.9 * limits_.minimum_area) return std::nullopt;
    if ((settled && effort == Effort::full) || standing >= 6) break;
    if (settled) effort = Effort::full;
  }
  return region;
}

}  // namespace deform::detection
