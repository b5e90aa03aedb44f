// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/base/types.h"
#include "core/compiled/motion.h"

namespace deform::compiled {

inline constexpr std::uint32_t layout_version = 1;             ///< of the file
inline constexpr std::size_t tile_points = 16;                 ///< of the basis: points side by side
inline constexpr std::size_t most_planes = 3;                  ///< symmetry planes
inline constexpr std::size_t most_bases = 8;                   ///< one per parity
inline constexpr std::uint32_t turned_components = 8 | 4 | 2;  ///< see Basis::components

/// Region of a point: the index of its handle, or one of these.
inline constexpr std::uint32_t fixed_region = 0xfffffffeu;
inline constexpr std::uint32_t following_region = 0xffffffffu;

/// Another handle that a design variable moves.
struct Driven {
  std::uint32_t handle = 0;  ///< its index
  VariableMotion motion;     ///< how the variable moves it
};

/// A design variable.
struct Variable {
  std::string name;            ///< as in the setup
  std::uint32_t handle = 0;    ///< that it moves; of several variables of a handle the first acts first
  VariableMotion motion;       ///< how it moves it
  double lower = 0;            ///< at most 0; may be infinite
  double upper = 0;            ///< at least 0; may be infinite
  std::vector<Driven> also{};  ///< other handles that it moves at the same time, each once
};

/// A region that variables move.
struct Handle {
  std::string name;                                             ///< as in the setup
  std::uint64_t points = 0;                                     ///< that its region selects
  Vec3 reference{};                                             ///< of its fields, unit coordinates
  std::array<Vec3, 3> axes{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  ///< of its fields, orthonormal
};

/// A control point that a handle moves, where handles select control points and no points of the mesh.
struct Control {
  std::uint32_t handle = 0;  ///< its index
  Vec3 place{};              ///< at rest, model units
};

/// Two points that coincide: a design that sends them to different places is refused.
struct Pair {
  std::uint32_t first = 0;   ///< id
  std::uint32_t second = 0;  ///< id
};

/// Values of the fields of all handles at the points that follow (thesis 4.2, eq. 4.1), for some components of the displacement.
struct Basis {
  /// Bit k: component k, in the frame of the symmetry planes or of the sector's axis. With `turned_components` the values apply
  /// to coefficients turned by a right angle about the axis, (0, -c2, c1), and add to those of the basis of components 1 and 2.
  std::uint32_t components = 7;
  std::vector<double> residuals;    ///< per field: largest error at the handle and fixed points
  std::vector<double> more;         ///< per field: what is added to the errors below
  std::vector<double> compression;  ///< per field: by how much a stored value may be off
  std::vector<double> errors;       ///< see Content::misfits; at some points: points x fields, row by row
  std::vector<double>
      values;  ///< tile by tile, in a tile field by field, of a field the 16 points; behind the last of no meaning
  /// To write the values in less memory: see coded_fields.h. Readers put the values in their place.
  std::vector<std::byte> codes;
};

/// All that a compiled deformation holds.
struct Content {
  std::string geometry_id;         ///< 64 lower-case hexadecimal digits
  std::string system_id;           ///< as many
  std::string creator;             ///< what made it: "deformd 0.3.0"
  std::string method;              ///< as in a setup: "rbf"
  std::string mesh;                ///< name of the geometry, mostly a file name; may be empty
  std::vector<std::string> notes;  ///< of the system, one sentence each
  std::string setup;               ///< the Setup message in its canonical form, serialized; may be empty

  std::vector<Handle> handles;      ///< in the order of the setup
  std::vector<Variable> variables;  ///< in the order of the setup

  double diagonal = 0;            ///< D, model units
  double largest_coordinate = 0;  ///< by magnitude, of the mesh
  Vec3 origin{};                  ///< of unit coordinates
  double scale = 1;               ///< of unit coordinates
  double error_margin = 1;        ///< between the errors of the bases and the error that is reported
  double allowed_error = 0;       ///< of a design that has converged, as a fraction of D or of a larger motion; 0: none is set
  double reduction_error = 0;     ///< of the largest prescribed displacement: what fewer centres than all may have changed
  double condition = 0;           ///< of the matrix that was factored, estimated; 0: not known
  bool converged = true;          ///< the basis is what its solver was to reach
  /// The errors of the bases are prescribed - actual values at points of handles and fixed regions, and not estimates of
  /// exact - stored values at points that follow.
  bool misfits = false;
  bool held = true;  ///< points of handles and fixed regions go where these send them, and do not follow

  std::uint32_t planes = 0;  ///< symmetry planes
  bool sector = false;       ///< of a wheel; then there are no planes
  std::array<Vec3, 3> plane_axes{
      {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};   ///< orthonormal; first the normals of the planes, or the axis
  std::array<double, most_planes> reach{};  ///< how far a point of a plane may leave it, model units

  Points rest;                          ///< n x 3, registered order, model units
  std::vector<std::uint32_t> regions;   ///< n
  std::vector<std::uint8_t> on_planes;  ///< n with symmetry planes, else empty; bit k: the point lies on plane k
  std::vector<Control> controls;        ///< empty where handles select points of the mesh
  std::vector<Pair> coincident;         ///< of handle and fixed points
  std::vector<Basis> bases;             ///< of different components

  bool framed() const { return planes > 0 || sector; }       ///< whether displacements are in the frame of plane_axes
  std::size_t points() const { return rest.size(); }         ///< n
  std::size_t fields() const { return 4 * handles.size(); }  ///< 1, x, y, z of every handle
};

/// How many points follow.
std::size_t following_points(const Content& content);
/// Where they are at rest, unit coordinates.
std::vector<Vec3> following_places(const Content& content);
/// Values of a basis of so many points and fields.
constexpr std::size_t basis_values(std::size_t following, std::size_t fields) {
  return (following + tile_points - 1) / tile_points * tile_points * fields;
}

}  // namespace deform::compiled
