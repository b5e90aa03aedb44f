// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/region_files.h"

#include <algorithm>
#include <span>

#include "core/base/error.h"
#include "core/io/vtk_output.h"

namespace deform::cli {

namespace {

using io::Colour;
using io::VtkArray;

constexpr Colour free_colour{208, 208, 208}, fixed_colour{85, 85, 85}, constraint_colour{51, 34, 136};
constexpr std::size_t most_constraint_arrays = 50;  // detect writes hundreds of constraints

/// Part of the way to black (below 0) or white.
Colour shaded(const Colour& colour, double way) {
  Colour result{};
  for (std::size_t k = 0; k < 3; ++k) {
    const double channel = colour[k];
    result[k] = static_cast<unsigned char>(way < 0 ? channel * (1 + way) : channel + (255 - channel) * way);
  }
  return result;
}

/// Okabe and Ito, Color Universal Design (2008), without black.
Colour handle_colour(std::size_t handle) {
  constexpr Colour palette[] = {{230, 159, 0}, {86, 180, 233},  {0, 158, 115}, {213, 94, 0},
                                {0, 114, 178}, {204, 121, 167}, {240, 228, 66}};
  constexpr std::size_t size = std::size(palette);
  constexpr double ways[] = {0, -0.4, 0.4, -0.6, 0.6, -0.2, 0.2};
  return shaded(palette[handle % size], ways[handle / size % std::size(ways)]);
}

Colour colour_of(std::uint32_t label) {
  if (label == ResolvedRegions::free) return free_colour;
  if (label == ResolvedRegions::fixed) return fixed_colour;
  return handle_colour(label - ResolvedRegions::first_handle);
}

std::vector<char> mask_of(std::span<const PointId> ids, std::size_t points) {
  std::vector<char> mask(points, 0);
  for (const PointId id : ids) mask[id] = 1;
  return mask;
}

std::vector<Colour> point_colours(const RegionPicture& picture, std::size_t points) {
  constexpr double pale = 0.6;
  const auto& labels = picture.regions.labels;
  std::vector<Colour> colours(points);
  const auto centre = picture.centres ? mask_of(*picture.centres, points) : std::vector<char>();
  for (std::size_t i = 0; i < points; ++i) {
    colours[i] = colour_of(labels[i]);
    if (!centre.empty() && !centre[i] && labels[i] != ResolvedRegions::free) colours[i] = shaded(colours[i], pale);
  }
  for (const auto& constraint : picture.regions.constraints) {
    for (const auto& region : constraint.regions) {
      for (const PointId point : region) {
        if (labels[point] == ResolvedRegions::free) colours[point] = constraint_colour;
      }
    }
  }
  return colours;
}

VtkArray mask_array(const std::string& name, std::span<const PointId> ids, std::size_t points) {
  const auto mask = mask_of(ids, points);
  return {name, 1, {mask.begin(), mask.end()}, VtkArray::Type::uint8};
}

void add_constraint_arrays(const RegionPicture& picture, std::size_t points, io::VtkArrays& arrays) {
  const auto& constraints = picture.regions.constraints;
  if (constraints.empty()) return;
  VtkArray first{"constraint", 1, std::vector<double>(points, 0), VtkArray::Type::int32};
  std::vector<VtkArray> each;
  for (std::size_t c = 0; c < constraints.size(); ++c) {
    VtkArray one{"constraint " + constraints[c].name, 1, std::vector<double>(points, 0), VtkArray::Type::int32};
    for (std::size_t r = 0; r < constraints[c].regions.size(); ++r) {
      for (const PointId point : constraints[c].regions[r]) {
        one.values[point] = static_cast<double>(r + 1);
        if (first.values[point] == 0) first.values[point] = static_cast<double>(c + 1);
      }
    }
    if (c < most_constraint_arrays) each.push_back(std::move(one));
  }
  arrays.points.push_back(std::move(first));
  std::move(each.begin(), each.end(), std::back_inserter(arrays.points));
  io::VtkTexts names{"constraint_names", {"none"}};
  for (const auto& constraint : constraints) names.values.push_back(constraint.name);
  arrays.texts.push_back(std::move(names));
}

io::VtkArrays arrays_of(const RegionPicture& picture, std::size_t points) {
  io::VtkArrays arrays;
  const auto& labels = picture.regions.labels;
  arrays.points.push_back({"region", 1, {labels.begin(), labels.end()}, VtkArray::Type::int32});
  VtkArray colour{"colour", 3, {}, VtkArray::Type::uint8};
  for (const Colour& c : point_colours(picture, points)) colour.values.insert(colour.values.end(), c.begin(), c.end());
  arrays.points.push_back(std::move(colour));
  if (picture.centres) arrays.points.push_back(mask_array("centre", *picture.centres, points));
  if (!picture.regions.contested.empty()) {
    arrays.points.push_back(mask_array("contested", picture.regions.contested, points));
  }
  io::VtkTexts names{"region_names", {"free", "fixed"}};
  names.values.insert(names.values.end(), picture.regions.handles.begin(), picture.regions.handles.end());
  arrays.texts.push_back(std::move(names));
  add_constraint_arrays(picture, points, arrays);
  return arrays;
}

}  // namespace

std::vector<LegendEntry> legend(const RegionPicture& picture) {
  const ResolvedRegions& regions = picture.regions;
  std::vector<LegendEntry> entries{{ResolvedRegions::free, "free", "", free_colour},
                                   {ResolvedRegions::fixed, "fixed", "", fixed_colour}};
  for (std::size_t h = 0; h < regions.handles.size(); ++h) {
    const std::uint32_t value = ResolvedRegions::first_handle + static_cast<std::uint32_t>(h);
    entries.push_back({value, "handle", regions.handles[h], colour_of(value)});
  }
  for (const std::uint32_t label : regions.labels) ++entries[label].points;
  if (picture.centres) {
    for (const PointId id : *picture.centres) ++entries[regions.labels[id]].centres;
  }
  for (std::size_t c = 0; c < regions.constraints.size(); ++c) {
    std::vector<PointId> points;
    for (const auto& region : regions.constraints[c].regions) points.insert(points.end(), region.begin(), region.end());
    std::sort(points.begin(), points.end());
    const auto last = std::unique(points.begin(), points.end());
    entries.push_back({static_cast<std::uint32_t>(c + 1), "constraint", regions.constraints[c].name, constraint_colour,
                       static_cast<std::size_t>(last - points.begin())});
  }
  return entries;
}

std::string colour_text(const io::Colour& colour) {
  constexpr const char* digits = "0123456789abcdef";
  std::string text = "#";
  for (const unsigned char channel : colour) {
    text += digits[channel / 16];
    text += digits[channel % 16];
  }
  return text;
}

void write_regions(const Mesh& mesh, const RegionPicture& picture, const std::filesystem::path& path) {
  const std::string extension = path.extension().string();
  if (extension == ".ply") return io::write_point_coloured_ply(mesh, point_colours(picture, mesh.point_count()), path);
  if (extension == ".vtp") return io::write_vtp(mesh, arrays_of(picture, mesh.point_count()), path);
  if (extension != ".vtu") {
    throw Error(ErrorCode::invalid_argument, path.string() + ": regions are written as .vtp, .ply or, of a volume mesh, .vtu");
  }
  if (mesh.elements) return io::write_vtu(mesh.points, *mesh.elements, arrays_of(picture, mesh.point_count()), path);
  if (mesh.cells) return io::write_vtu(mesh.points, *mesh.cells, arrays_of(picture, mesh.point_count()), path);
  throw Error(ErrorCode::invalid_argument, path.string() + ": the mesh has no cells; its regions are written as .vtp or .ply");
}

}  // namespace deform::cli
