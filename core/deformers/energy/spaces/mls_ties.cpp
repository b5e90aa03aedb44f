// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/energy/spaces/mls_ties.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/numerics/sampling/mls_basis.h"

namespace deform {

namespace {

std::vector<std::vector<std::uint32_t>> members_of(const std::vector<std::uint32_t>& part) {
  std::vector<std::vector<std::uint32_t>> members;
  for (std::uint32_t j = 0; j < part.size(); ++j) {
    if (part[j] >= members.size()) members.resize(part[j] + 1);
    members[part[j]].push_back(j);
  }
  return members;
}

/// Appends the rows w_j - (continuation of the joined samples at j) for the samples of one part.
void tie(std::span<const Vec3> samples, const std::vector<std::uint32_t>& members, std::vector<std::uint32_t> joined,
         std::size_t cover, RowBlocks& rows) {
  std::sort(joined.begin(), joined.end());
  std::vector<Vec3> places;
  places.reserve(joined.size());
  for (const std::uint32_t j : joined) places.push_back(samples[j]);
  // No sample is within this radius: each place of evaluation has one of its own.
  MlsBasis::Options options;
  options.cover.cover = cover;
  options.flat = 1e-2;  // a continuation far away must not lean on what the samples hardly tell
  const MlsBasis others(places, std::numeric_limits<double>::min(), options);
  const double weight = 1 / std::sqrt(static_cast<double>(members.size()));
  MlsBasis::Row row;
  std::vector<std::pair<std::uint32_t, double>> entries;
  for (const std::uint32_t j : members) {
    others.evaluate(samples[j], MlsBasis::Order::values, row);
    entries.assign(1, {j, weight});
    for (std::size_t a = 0; a < row.samples.size(); ++a) entries.emplace_back(joined[row.samples[a]], -weight * row.values[a]);
    std::sort(entries.begin(), entries.end());
    for (const auto& [column, value] : entries) {
      rows.columns.push_back(column);
      rows.values.push_back(value);
    }
    rows.starts.push_back(static_cast<std::int64_t>(rows.columns.size()));
  }
}

}  // namespace

Ties component_ties(std::span<const Vec3> samples, const std::vector<std::uint32_t>& part, std::size_t cover) {
  const auto members = members_of(part);
  Ties ties;
  ties.parts = members.size();
  if (ties.parts < 2) return ties;
  std::vector<double> distance(members.size(), std::numeric_limits<double>::infinity());  // to those joined
  std::vector<std::uint32_t> joined;
  const auto join = [&](std::size_t p) {
    distance[p] = -1;
    std::vector<Vec3> places;
    for (const std::uint32_t j : members[p]) places.push_back(samples[j]);
    joined.insert(joined.end(), members[p].begin(), members[p].end());
    const PointTree tree(places);
    for (std::size_t other = 0; other < members.size(); ++other) {
      if (distance[other] < 0) continue;
      for (const std::uint32_t j : members[other]) distance[other] = std::min(distance[other], tree.nearest(samples[j]).square);
    }
  };
  const auto larger = [](const auto& a, const auto& b) { return a.size() < b.size(); };
  join(static_cast<std::size_t>(std::max_element(members.begin(), members.end(), larger) - members.begin()));
  for (std::size_t count = 1; count < members.size(); ++count) {
    std::size_t next = members.size();
    for (std::size_t p = 0; p < members.size(); ++p) {
      if (distance[p] >= 0 && (next == members.size() || distance[p] < distance[next])) next = p;
    }
    tie(samples, members[next], joined, cover, ties.rows);
    join(next);
  }
  return ties;
}

}  // namespace deform
