// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Geom_Surface.hxx>
#include <array>
#include <cstddef>
#include <vector>

#include "core/base/run_context.h"
#include "core/base/types.h"
#include "core/cad/face_warp.h"

namespace deform::cad {

/// The triangles of a mesh on one face of a model.
struct FacePatch {
  struct Node {
    Vec3 place{};
    Parameters uv{};
    bool inner = false;  ///< off the edges: it may slide
    bool pole = false;   ///< where the surface has no normal, or rounding gives it one, such as at the apex of a cone
  };
  struct Triangle {
    std::array<int, 3> nodes{};   ///< counter-clockwise seen along du x dv of the surface
    std::array<Vec3, 3> shape{};  ///< what it shall resemble: its corners at rest, any placement
  };
  std::vector<Node> nodes;
  std::vector<Triangle> triangles;
  std::array<double, 4> box{};  ///< u and v, least and largest, that inner nodes may have; periodic directions have no limit
};

/// Triangles that lie the other way round than du x dv of the surface says, as their index.
std::vector<std::size_t> flipped_triangles(const Handle(Geom_Surface) & surface, const FacePatch& patch);

/// How far triangles are from their shapes and from growing all alike: mean over the areas at rest of (s + 1/s) / 2 - 1, with s
/// the ratio of the largest and the least stretch, and the same with the ratio of the growth of the area and its mean. 0: a
/// similarity; infinite where a triangle has no area.
double distortion(const FacePatch& patch);

/// Slides inner nodes on the surface until no triangle is flipped: those within `rings` edges of the triangles and nodes given.
/// The energy of a triangle is that of Garanzha, Kaporin, Kudryavtseva, Protais, Ray, Sokolov, "Foldover-free maps in 50 lines of
/// code" (ACM Transactions on Graphics 40(4), 2021), with the determinant measured along the normal of the surface; it is least
/// for triangles of the shape and size at rest, and grows without limit where a triangle degenerates, which is approached by
/// regularization. L-BFGS in (u, v). Whether it succeeded is for the caller to see; edges stay, so that triangles with all
/// corners on edges stay as they are. Throws Error(cancelled, deadline_exceeded) by the context.
void slide_inner_nodes(const Handle(Geom_Surface) & surface, FacePatch& patch, const std::vector<std::size_t>& triangles,
                       const std::vector<std::size_t>& nodes, std::size_t rings, const RunContext& context);

}  // namespace deform::cad
