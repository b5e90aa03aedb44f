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

std::vector<unsigned> ControlMatches::matched() const {
  std::vector<unsigned> result{0};
  unsigned planes = 0;
  for (std::size_t k = 0; k < images.size(); ++k) planes |= images[k].empty() ? 0u : 1u << k;
  if (planes != 0 && sectors > 0) {
    for (unsigned image = 1; image < sectors; ++image) result.push_back(image);
    return result;
  }
  for (unsigned image = 1; image <= planes; ++image) {
    if ((image & ~planes) == 0) result.push_back(image);
  }
  return result;
}

std::uint32_t ControlMatches::image_of(std::uint32_t control, unsigned image) const {
  for (unsigned turn = 0; sectors > 0 && turn < image; ++turn) control = images[0][control];
  for (std::size_t k = 0; sectors == 0 && k < images.size() && control != no_control; ++k) {
    if ((image >> k & 1u) != 0) control = images[k][control];
  }
  return control;
}

std::size_t ControlMatches::bytes() const {
  std::size_t bytes = 0;
  for (const auto& image : images) bytes += image.size() * sizeof(std::uint32_t);
  return bytes;
}

void check_images(const ControlMatches& matches, const Setup& setup, const SelectedRegions& regions) {
  const std::vector<unsigned> images = matches.matched();
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    for (const PointId p : regions.handles[h]) {
      for (std::size_t i = 1; i < images.size(); ++i) {
        const std::uint32_t q = matches.image_of(p, images[i]);
        if (q == ControlMatches::no_control || !std::binary_search(regions.fixed.begin(), regions.fixed.end(), q)) continue;
        refuse_argument("handle \"" + setup.handles[h].name + "\": control point " + std::to_string(p) +
                        " moves, but control point " + std::to_string(q) + " is in a fixed region, and they are " +
                        images_text(images[i], matches.sectors) + "; take either of them out with `difference`");
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
  const std::vector<unsigned> images = matches.matched();
  matched_ = images.size() > 1;
  for (std::uint32_t p = 0; p < count; ++p) {
    first_.push_back(sources_.size());
    for (const unsigned image : images) {
      const std::uint32_t q = matches.image_of(p, image);
      if (q != ControlMatches::no_control && moves[q] != 0) sources_.push_back({q, regions.symmetry.inverse(image)});
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
