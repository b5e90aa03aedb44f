// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "core/mesh/mesh.h"
#include "deform/v1/setup.pb.h"

namespace deform::client {

/// The mesh of a setup. Throws Error(invalid_argument) with the reason if it is not known.
using MeshSource = std::function<std::shared_ptr<const Mesh>()>;

/// Fills in the cage of a method, if it is a cage: the points and faces of the mesh file that it names, which is looked for in
/// `folder`, or with `generate` those of a cage around the mesh (cage_around()). Corners at the same place count as one point
/// where a format has no others (STL). With symmetry planes of `setup` a cage that is made surrounds the mesh and its images
/// and is its own mirror image, or with CONTROLS a box that ends in the planes. Without either nothing is done to a method that
/// has vertices. Errors name `field`, as "method.cage". Throws Error(invalid_argument, not_found, failed_precondition): no such
/// file, one that is no mesh, a face that is no triangle, more than one of file, generate and vertices, or none; planes that are
/// not known here or for which no cage can be made; what cage_around() throws.
void fill_cage(const std::filesystem::path& folder, const std::string& field, const MeshSource& mesh, const v1::Setup& setup,
               v1::Method& method);

}  // namespace deform::client
