// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "client/client.h"
#include "client/id_map.h"

namespace deform::client {

/// The arrays of a registered geometry without its points, which the client keeps anyway.
class HeldGeometry {
 public:
  /// Copies.
  explicit HeldGeometry(const GeometryArrays& arrays);

  /// Views what is kept, and the points.
  GeometryArrays arrays(const Points& points) const;

 private:
  struct Group {
    std::string name;
    std::vector<PointId> points;
    std::vector<FaceId> faces;
  };

  const std::vector<std::uint32_t> face_sizes_, face_points_;
  std::vector<Group> groups_;
  const std::string name_;
  const std::vector<std::uint8_t> element_types_;
  const std::vector<PointId> element_points_;
  const std::uint64_t cell_count_;
  const std::vector<std::uint64_t> cell_face_offsets_;
  const std::vector<PointId> cell_face_points_;
  const std::vector<std::uint32_t> owner_, neighbour_;
  const std::vector<char> empty_faces_;
};

/// What a client with several servers has registered and prepared, so that it can bring it to another one: everything that a
/// server has is a function of geometry and setup. Thread-safe.
class HeldCopies {
 public:
  /// Enters a geometry.
  void keep_geometry(const std::string& id, std::shared_ptr<const HeldGeometry> geometry);
  /// Enters the setup of a system; it names its geometry by the whole id.
  void keep_setup(const std::string& system, v1::Setup setup);
  /// All that others hold, in the same memory.
  void keep_all(const HeldCopies& from);
  /// Nothing where it was not entered.
  std::shared_ptr<const HeldGeometry> geometry(const std::string& id) const;
  /// Nothing where it was not entered.
  std::shared_ptr<const v1::Setup> setup(const std::string& system) const;
  /// Lets go of a geometry that was deleted, by its id or a part of it, and of the setups that refer to it.
  void forget_geometry(const std::string& id);
  /// Lets go of a setup that was deleted, by its id or a part of it.
  void forget_setup(const std::string& system);

 private:
  IdMap<std::shared_ptr<const HeldGeometry>> geometries_;
  IdMap<std::shared_ptr<const v1::Setup>> setups_;
};

}  // namespace deform::client
