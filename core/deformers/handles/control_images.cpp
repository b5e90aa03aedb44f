// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/control_images.h"

#include <algorithm>
#include <cmath>

#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/deformers/option_checks.h"

namespace deform {

namespace {

constexpr double image_agreement = 1e-9;  // of the motions of control points that are images of each other

std::string control_text(std::uint32_t control, const HeldPoints& held) {
  return std::to_string(control) + " (handle \"" + held.setup.handles[held.region_of[control]].name + "\")";
}

/// "mirror images in symmetry[0] and symmetry[1]", or "images of each other by 2 sectors".
std::string images_text(unsigned image, unsigned sectors) {
  if (sectors > 0) return "images of each other by " + std::to_string(image) + (image == 1 ? " sector" : " sectors");
  std::string text;
  for (std::size_t k = 0; k < 3; ++k) {
    if ((image >> k & 1u) != 0) text += (text.empty() ? "" : " and ") + std::string("symmetry[") + std::to_string(k) + "]";
  }
  return "mirror images in " + text;
}

}  // namespace

std::vector<unsigned> ControlMatches::matched_planes() const {
  unsigned planes = 0;
  for (std::size_t k = 0; k < images.size() && sectors == 0; ++k) planes |= images[k].empty() ? 0u : 1u << k;
  std::vector<unsigned> result;
  for (unsigned image = 0; image <= planes; ++image) {
    if ((image & ~planes) == 0) result.push_back(image);
  }
  return result;
}

bool ControlMatches::empty() const {
  return std::all_of(images.begin(), images.end(), [](const auto& image) { return image.empty(); });
}

std::vector<ControlMatches::Image> ControlMatches::images_of(std::uint32_t control) const {
  std::vector<Image> result;
  if (sectors == 0) {
    for (const unsigned image : matched_planes()) {
      std::uint32_t at = control;
      for (std::size_t k = 0; k < images.size() && at != no_control; ++k) {
        if ((image >> k & 1u) != 0) at = images[k][at];
      }
      if (at != no_control) result.push_back({image, at});
    }
    return result;
  }
  result.push_back({0, control});
  if (images.empty()) return result;
  unsigned turns = 1;
  for (std::uint32_t at = images[0][control]; turns < sectors && at != no_control; at = images[0][at]) {
    result.push_back({turns++, at});
  }
  if (images.size() > 1 && turns < sectors && images[1][control] != no_control) {
    result.push_back({sectors - 1, images[1][control]});
  }
  return result;
}

std::size_t ControlMatches::bytes() const {
  std::size_t bytes = 0;
  for (const auto& image : images) bytes += image.size() * sizeof(std::uint32_t);
  return bytes;
}

double ComponentPart::factor(const Symmetry& symmetry, unsigned image) const {
  if (turn == Turn::cosine) return symmetry.sector().cosine(image);
  if (turn == Turn::sine) return symmetry.sector().sine(image);
  return odd >= 0 && (image >> odd & 1u) != 0 ? -1 : 1;
}

Vec3 ComponentPart::taken(const Vec3& u) const {
  Vec3 result{};
  const Vec3 from = turn == Turn::sine ? Vec3{0, -u[2], u[1]} : u;
  for (const std::size_t k : components) result[k] = from[k];
  return result;
}

Vec3 ComponentPart::given(const Vec3& u) const {
  Vec3 result{};
  for (const std::size_t k : components) result[k] = u[k];
  return turn == Turn::sine ? Vec3{0, result[2], -result[1]} : result;
}

/// Those along normals of planes have one each, the others share one. Across the axis of a sector the images add up like complex
/// numbers, and those of two sectors have no sines.
std::vector<ComponentPart> component_parts(const Symmetry& symmetry, unsigned planes) {
  using Turn = ComponentPart::Turn;
  if (symmetry.is_sector()) {
    std::vector<ComponentPart> result{{{0}}, {{1, 2}, -1, Turn::cosine}};
    if (symmetry.sector().count() > 2) result.push_back({{1, 2}, -1, Turn::sine});
    return result;
  }
  ComponentPart even;
  std::vector<ComponentPart> odd;
  for (std::size_t k = 0; k < 3; ++k) {
    if (k < symmetry.planes() && (planes >> k & 1u) != 0) {
      odd.push_back({{k}, static_cast<int>(k)});
    } else {
      even.components.push_back(k);
    }
  }
  std::vector<ComponentPart> result;
  if (!even.components.empty()) result.push_back(std::move(even));
  result.insert(result.end(), odd.begin(), odd.end());
  return result;
}

void check_images(const ControlMatches& matches, const Setup& setup, const SelectedRegions& regions) {
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    for (const PointId p : regions.handles[h]) {
      for (const auto& [image, q] : matches.images_of(p)) {
        if (!std::binary_search(regions.fixed.begin(), regions.fixed.end(), q)) continue;
        refuse_argument("handle \"" + setup.handles[h].name + "\": control point " + std::to_string(p) +
                        " moves, but control point " + std::to_string(q) + " is in a fixed region, and they are " +
                        images_text(image, matches.sectors) + "; take either of them out with `difference`");
      }
    }
  }
}

ControlSources::ControlSources(const ControlMatches& matches, std::size_t count, const SelectedRegions& regions)
    : sectors_(matches.sectors) {
  std::vector<char> moves(count, 0);
  for (const auto& handle : regions.handles) {
    for (const PointId p : handle) moves[p] = 1;
  }
  matched_ = !matches.empty();
  for (std::uint32_t p = 0; p < count; ++p) {
    first_.push_back(sources_.size());
    for (const auto& [image, q] : matches.images_of(p)) {
      if (moves[q] != 0) sources_.push_back({q, regions.symmetry.inverse(image)});
    }
  }
  first_.push_back(sources_.size());
}

std::vector<Vec3> ControlSources::displacements(std::vector<Vec3> own, const Symmetry& symmetry) const {
  if (symmetry.empty()) return own;
  for (Vec3& u : own) u = symmetry.to_frame(u);
  std::vector<Vec3> result(own.size());
  for (std::size_t p = 0; p < own.size(); ++p) {
    const std::span<const Source> from = of(p);
    for (const Source& source : from) result[p] = result[p] + symmetry.components_in(own[source.control], source.image);
    if (!from.empty()) result[p] = result[p] / static_cast<double>(from.size());
  }
  return result;
}

std::vector<Vec3> ControlSources::transposed(std::span<const Vec3> at_controls, const Symmetry& symmetry) const {
  std::vector<Vec3> result(size());
  for (std::size_t p = 0; p < size(); ++p) {
    const std::span<const Source> from = of(p);
    for (const Source& source : from) {
      const Vec3 back = symmetry.components_in(at_controls[p], symmetry.inverse(source.image));
      result[source.control] = result[source.control] + back / static_cast<double>(from.size());
    }
  }
  return result;
}

void ControlSources::check_agreement(const HeldPoints& held, const std::function<Vec3(PointId)>& motion_of, double allowed,
                                     const std::string& what) const {
  const Symmetry& symmetry = held.symmetry;
  for (std::size_t p = 0; p < size(); ++p) {
    const std::span<const Source> from = of(p);
    for (std::size_t i = 1; i < from.size(); ++i) {
      const auto motion = [&](const Source& source) {
        return symmetry.components_in(symmetry.to_frame(motion_of(source.control)), source.image);
      };
      const double apart = distance(motion(from[0]), motion(from[i]));
      if (apart <= allowed) continue;
      refuse_argument(what + ": control points " + control_text(from[0].control, held) + " and " +
                      control_text(from[i].control, held) + " are " +
                      images_text(symmetry.composed(from[0].image, symmetry.inverse(from[i].image)), sectors_) +
                      ", but their motions are not, by " + number_digits(apart) +
                      "; move them alike, or take one of them out of the handles with `difference`");
    }
  }
}

void ControlSources::check_design(const HeldPoints& held, const BoundDesign& design, std::size_t index) const {
  if (!matched_) return;
  double allowed = image_agreement * held.diagonal;
  for (std::size_t k = 0; k < held.symmetry.planes(); ++k) allowed = std::max(allowed, 4 * held.symmetry.reach(k));
  const auto motion = [&](PointId p) { return held.prescribed_position(design, p, MotionKind::position) - held.mesh.points[p]; };
  check_agreement(held, motion, allowed, "designs[" + std::to_string(index) + "]");
}

void ControlSources::check_rates(const HeldPoints& held, const std::vector<Affine>& rates, const std::string& what) const {
  if (!matched_) return;
  double size = 0;  // of the terms of a rate
  const Box box = bounding_box(held.mesh.points);
  for (const Affine& m : rates) {
    for (std::size_t i = 0; i < 12; ++i) {
      const std::size_t k = i % 4;
      size = std::max(size, std::abs(m[i]) * (k == 3 ? 1.0 : std::max(std::abs(box.min[k]), std::abs(box.max[k]))));
    }
  }
  double allowed = image_agreement;
  for (std::size_t k = 0; k < held.symmetry.planes(); ++k) {
    allowed = std::max(allowed, 4 * held.symmetry.reach(k) / held.diagonal);
  }
  const auto rate = [&](PointId p) { return transformed(rates[held.region_of[p]], held.mesh.points[p]); };
  check_agreement(held, rate, allowed * size, what);
}

std::string ControlSources::note(const SelectedRegions& regions, const std::string& word) const {
  std::size_t in_handles = 0, moved = 0;
  for (const auto& handle : regions.handles) in_handles += handle.size();
  for (std::size_t p = 0; p < size(); ++p) moved += of(p).empty() ? 0 : 1;
  const std::size_t images = moved - in_handles;  // an image of itself moves with itself
  return std::to_string(in_handles) + " " + word + " are in handles, " +
         (images == 0
              ? ""
              : std::to_string(images) + (sectors_ > 0 ? " are " : " are mirror ") + "images of these and move with them, ") +
         "the other " + std::to_string(size() - moved) + " stay.";
}

std::vector<double> field_sums(const SelectedRegions& regions, std::span<const std::array<double, 4>> fields,
                               std::span<const Vec3> at_controls) {
  std::vector<double> result(12 * regions.handles.size(), 0.0);
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    for (const PointId p : regions.handles[h]) {
      for (std::size_t f = 0; f < 4; ++f) {
        for (std::size_t k = 0; k < 3; ++k) result[3 * (4 * h + f) + k] += fields[p][f] * at_controls[p][k];
      }
    }
  }
  return result;
}

}  // namespace deform
