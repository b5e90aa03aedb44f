// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "core/io/assembly/element_mesh.h"
#include "core/io/assembly/label_index.h"
#include "core/io/formats/abaqus/abaqus_types.h"

namespace deform::io {

/// Collects the nodes, elements, sets and surfaces of an Abaqus deck by label, for each part; finish() builds the mesh. Names may
/// be used before they are defined.
class AbaqusModel {
 public:
  /// A position in the files of the deck, for errors.
  struct Place {
    std::uint32_t file = 0;
    std::size_t at = 0;
  };
  /// Throws an Error that names the place.
  using Fail = std::function<void(const Place& place, const std::string& message)>;
  using Scope = std::size_t;  ///< number of a part; 0 for the deck itself and the assembly
  enum class Members { nodes, elements };

  /// A set as the deck describes it.
  struct Set {
    struct Entry {
      std::int64_t first = 0, last = 0, step = 1;  ///< labels
      std::string name;                            ///< name of another set, instead of labels
      Scope scope = 0;                             ///< scope of the labels or the set
      Place place;
      Members of = Members::nodes;  ///< elements: their nodes
    };
    std::string name;
    std::vector<std::uint32_t> members;  ///< indices in the part
    std::vector<Entry> entries;
    bool internal = false;  ///< marked as internal by the program that wrote it
  };
  struct Surface {
    struct Entry {
      std::string what;  ///< a label or a set
      std::string face;  ///< S1, SPOS, E2, ...; empty: all free faces
      Scope scope = 0;
      Place place;
    };
    std::string name;
    Members members = Members::elements;
    std::vector<Entry> entries;
  };

  explicit AbaqusModel(Fail fail) : fail_(std::move(fail)), parts_(1) {}

  /// The part with this name, created if necessary.
  Scope part(const std::string& name);
  /// Adds a part, whose name appears in names of groups.
  Scope add_part(const std::string& name);
  bool has_nodes(Scope scope) const { return parts_[scope].nodes.size() > 0; }
  /// Makes the sets and labels of a scope those of an instance.
  void name_instance(const std::string& name, Scope scope);
  std::optional<Scope> find_instance(const std::string& name) const;

  /// These return the index in the part.
  std::uint32_t add_node(Scope scope, std::int64_t label, const Vec3& position, const Place& place);
  struct NewElement {
    std::int64_t label = 0;
    std::uint32_t type = 0;  ///< from add_type()
    Place place;
  };
  std::uint32_t add_type(const AbaqusType& type);
  std::uint32_t add_element(Scope scope, const NewElement& element, std::span<const std::int64_t> nodes);
  /// The set with this name, created if necessary. The reference is valid until another set is added.
  Set& set(Scope scope, Members members, const std::string& name);
  Surface& surface(Scope scope, const std::string& name);

  std::size_t point_count() const { return mesh_.points.size(); }
  ElementMesh finish();

 private:
  struct Element : NewElement {
    std::uint32_t scope = 0, count = 0;  // scope, number of nodes
    std::size_t first = 0;               // first node
    std::uint32_t number = 0;            // among the volumes or faces of the mesh
  };
  /// The members of a set, once resolved.
  struct Resolved {
    enum class State { unknown, under_way, known } state = State::unknown;
    std::vector<std::uint32_t> members;
  };
  struct GroupMembers {
    std::vector<PointId> points;
    std::vector<std::size_t> faces;  // surface elements
  };
  struct Part {
    std::string name;
    LabelIndex nodes, elements;
    std::vector<std::int64_t> labels[2];   // by number
    std::vector<std::uint32_t> global[2];  // points and elements by number
    std::vector<Set> sets[2];
    std::vector<Resolved> resolved[2];  // by the sets' numbers
    std::map<std::string, std::size_t> set_numbers[2];
    std::vector<Surface> surfaces;
    std::map<std::string, std::size_t> surface_numbers;
  };
  const AbaqusType& type_of(const Element& element) const { return types_[element.type]; }

  void resolve_elements();
  void add_groups();
  std::string group_name(Scope scope, const std::string& name, const std::map<std::string, std::size_t>& of_assembly) const;
  std::pair<Scope, std::string> qualified(Scope scope, const std::string& name) const;
  const std::vector<std::uint32_t>& members_of(Scope scope, Members members, std::size_t set, int depth);
  void add_entry(const Set::Entry& entry, Members members, int depth, std::vector<std::uint32_t>& found);
  void add_range(const Set::Entry& entry, Members members, std::vector<std::uint32_t>& found) const;
  std::vector<PointId> points_of(const Element& element) const;
  void add_group(const std::string& name, FaceGroups::Kind kind, GroupMembers&& members);
  void add_elements(const std::vector<std::uint32_t>& elements, GroupMembers& group) const;
  void add_surface(const Surface& surface, GroupMembers& group);
  void add_side(const Element& element, const Surface::Entry& entry, GroupMembers& group);
  void add_free_sides(const Element& element, GroupMembers& group);
  ElementMesh::Face side(const Element& element, std::size_t face) const;

  Fail fail_;
  std::vector<Part> parts_;
  std::map<std::string, Scope> part_numbers_, instances_;
  std::vector<AbaqusType> types_;
  std::vector<Element> elements_;
  std::vector<std::int64_t> node_labels_;  // labels of the nodes of all elements
  std::vector<PointId> nodes_;             // the same as point ids
  std::set<std::vector<PointId>> free_;    // keys of the boundary, once they are needed
  ElementMesh mesh_;
};

}  // namespace deform::io
