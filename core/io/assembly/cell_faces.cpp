// SPDX-License-Identifier: Apache-2.0
#include "core/io/assembly/cell_faces.h"

#include <algorithm>
#include <numeric>
#include <string>

#include "core/base/error.h"

namespace deform::io {

namespace {

constexpr std::uint32_t none = ~std::uint32_t{0};

[[noreturn]] void refuse(std::uint32_t cell, const std::string& problem) {
  throw Error(ErrorCode::invalid_argument, "cells[" + std::to_string(cell) + "]: a face " + problem);
}

/// For every face the other one with the same points, or none.
std::vector<std::uint32_t> twins(const CellFaces& cells, const std::vector<std::uint32_t>& cell_of) {
  std::vector<PointId> keys = cells.points;
  const auto key = [&](std::uint32_t face) {
    return std::span(keys).subspan(cells.face_offsets[face],
                                   static_cast<std::size_t>(cells.face_offsets[face + 1] - cells.face_offsets[face]));
  };
  const auto faces = static_cast<std::uint32_t>(cells.face_count());
  for (std::uint32_t f = 0; f < faces; ++f) std::sort(key(f).begin(), key(f).end());
  std::vector<std::uint32_t> order(faces);
  std::iota(order.begin(), order.end(), 0u);
  const auto same = [&](std::uint32_t a, std::uint32_t b) {
    return std::equal(key(a).begin(), key(a).end(), key(b).begin(), key(b).end());
  };
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const auto x = key(a), y = key(b);
    const auto [at, bt] = std::mismatch(x.begin(), x.end(), y.begin(), y.end());
    if (at == x.end() && bt == y.end()) return a < b;
    return bt != y.end() && (at == x.end() || *at < *bt);
  });
  std::vector<std::uint32_t> twin(faces, none);
  for (std::size_t i = 0; i + 1 < order.size(); ++i) {
    const std::uint32_t a = order[i], b = order[i + 1];
    if (!same(a, b)) continue;
    if (cell_of[a] == cell_of[b]) refuse(cell_of[b], "stands there twice");
    if (twin[a] != none) refuse(cell_of[b], "belongs to two other cells already");
    twin[a] = b;
    twin[b] = a;
  }
  return twin;
}

}  // namespace

void CellFaces::add_face(std::span<const PointId> corners) {
  points.insert(points.end(), corners.begin(), corners.end());
  face_offsets.push_back(points.size());
}

PolyhedralCells joined(const CellFaces& cells) {
  if (cells.face_count() >= none) throw Error(ErrorCode::invalid_argument, "the cells have more than 4294967294 faces");
  std::vector<std::uint32_t> cell_of(cells.face_count());
  for (std::size_t c = 0; c < cells.cell_count(); ++c) {
    for (std::uint64_t f = cells.cell_offsets[c]; f < cells.cell_offsets[c + 1]; ++f) cell_of[f] = static_cast<std::uint32_t>(c);
  }
  const std::vector<std::uint32_t> twin = twins(cells, cell_of);
  PolyhedralCells out;
  out.cell_count = cells.cell_count();
  const auto add = [&](std::size_t f) {
    const auto corners = cells.face(f);
    out.face_points.insert(out.face_points.end(), corners.begin(), corners.end());
    out.face_offsets.push_back(out.face_points.size());
    out.owner.push_back(cell_of[f]);
  };
  for (std::size_t f = 0; f < twin.size(); ++f) {
    if (twin[f] == none || twin[f] < f) continue;
    add(f);
    out.neighbour.push_back(cell_of[twin[f]]);
  }
  for (std::size_t f = 0; f < twin.size(); ++f) {
    if (twin[f] == none) add(f);
  }
  return out;
}

}  // namespace deform::io
