// SPDX-License-Identifier: Apache-2.0
#include "core/io/formats/abaqus/abaqus_model.h"

#include <algorithm>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/io/formats/abaqus/abaqus_deck.h"

namespace deform::io {

namespace {

using Use = AbaqusType::Use;

constexpr PointId missing = ~PointId{0};
constexpr int deepest = 100;  // sets that name sets
constexpr const char* nouns[2] = {"node", "element"};

std::size_t number(AbaqusModel::Members members) { return members == AbaqusModel::Members::nodes ? 0 : 1; }

template <typename Number>
void make_unique(std::vector<Number>& numbers) {
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
}

}  // namespace

AbaqusModel::Scope AbaqusModel::part(const std::string& name) {
  const auto found = part_numbers_.find(upper_case(name));
  if (found != part_numbers_.end()) return found->second;
  const Scope scope = add_part(name);
  part_numbers_.emplace(upper_case(name), scope);
  return scope;
}

AbaqusModel::Scope AbaqusModel::add_part(const std::string& name) {
  parts_.emplace_back().name = name;
  return parts_.size() - 1;
}

void AbaqusModel::name_instance(const std::string& name, Scope scope) { instances_[upper_case(name)] = scope; }

std::optional<AbaqusModel::Scope> AbaqusModel::find_instance(const std::string& name) const {
  const auto found = instances_.find(upper_case(name));
  return found == instances_.end() ? std::nullopt : std::optional(found->second);
}

std::uint32_t AbaqusModel::add_node(Scope scope, std::int64_t label, const Vec3& position, const Place& place) {
  Part& part = parts_[scope];
  const auto count = static_cast<std::uint32_t>(part.nodes.size());
  if (!part.nodes.add(label)) fail_(place, "node " + std::to_string(label) + " is there already");
  part.labels[0].push_back(label);
  part.global[0].push_back(static_cast<PointId>(mesh_.points.size()));
  mesh_.points.push_back(position);
  return count;
}

std::uint32_t AbaqusModel::add_type(const AbaqusType& type) {
  types_.push_back(type);
  return static_cast<std::uint32_t>(types_.size() - 1);
}

std::uint32_t AbaqusModel::add_element(Scope scope, const NewElement& element, std::span<const std::int64_t> nodes) {
  Part& part = parts_[scope];
  const auto count = static_cast<std::uint32_t>(part.elements.size());
  if (!part.elements.add(element.label)) {
    fail_(element.place, "element " + std::to_string(element.label) + " is there already");
  }
  part.labels[1].push_back(element.label);
  part.global[1].push_back(static_cast<std::uint32_t>(elements_.size()));
  elements_.push_back(
      {element, static_cast<std::uint32_t>(scope), static_cast<std::uint32_t>(nodes.size()), node_labels_.size()});
  node_labels_.insert(node_labels_.end(), nodes.begin(), nodes.end());
  return count;
}

AbaqusModel::Set& AbaqusModel::set(Scope scope, Members members, const std::string& name) {
  Part& part = parts_[scope];
  auto& sets = part.sets[number(members)];
  const auto [found, added] = part.set_numbers[number(members)].try_emplace(upper_case(name), sets.size());
  if (added) sets.emplace_back().name = name;
  return sets[found->second];
}

AbaqusModel::Surface& AbaqusModel::surface(Scope scope, const std::string& name) {
  Part& part = parts_[scope];
  const auto [found, added] = part.surface_numbers.try_emplace(upper_case(name), part.surfaces.size());
  if (added) part.surfaces.emplace_back().name = name;
  return part.surfaces[found->second];
}

ElementMesh AbaqusModel::finish() {
  resolve_elements();
  add_groups();
  return std::move(mesh_);
}

void AbaqusModel::resolve_elements() {
  nodes_.resize(node_labels_.size(), missing);
  for (Element& element : elements_) {
    const Part& part = parts_[element.scope];
    for (std::size_t i = element.first; i < element.first + element.count; ++i) {
      const auto found = part.nodes.find(node_labels_[i]);
      if (found) {
        nodes_[i] = part.global[0][*found];
      } else if (type_of(element).use != Use::other) {
        fail_(element.place, "element " + std::to_string(element.label) + " has the node " + std::to_string(node_labels_[i]) +
                                 ", which is not there");
      }
    }
    const PointId* nodes = nodes_.data() + element.first;
    if (type_of(element).use == Use::volume) {
      PointId ordered[20];
      for (std::size_t i = 0; i < element.count; ++i) {
        ordered[i] = nodes[type_of(element).order == nullptr ? i : type_of(element).order[i]];
      }
      element.number = static_cast<std::uint32_t>(mesh_.elements.size());
      mesh_.elements.add(type_of(element).volume, {ordered, element.count});
    } else if (type_of(element).use != Use::other) {
      element.number = static_cast<std::uint32_t>(mesh_.faces.size());
      mesh_.add_face({nodes, element.count}, "");
    }
  }
}

std::string AbaqusModel::group_name(Scope scope, const std::string& name,
                                    const std::map<std::string, std::size_t>& of_assembly) const {
  if (scope == 0 || (parts_.size() == 2 && of_assembly.count(upper_case(name)) == 0)) return name;
  return parts_[scope].name + "." + name;
}

void AbaqusModel::add_groups() {
  for (Part& part : parts_) {
    for (const std::size_t of : {0, 1}) part.resolved[of].resize(part.sets[of].size());
  }
  for (Scope scope = 0; scope < parts_.size(); ++scope) {
    const Part& part = parts_[scope];
    for (std::size_t s = 0; s < part.sets[0].size(); ++s) {
      if (part.sets[0][s].internal) continue;
      const std::string name = group_name(scope, part.sets[0][s].name, parts_[0].set_numbers[0]);
      mesh_.point_sets.push_back({name, members_of(scope, Members::nodes, s, 0)});
    }
    for (std::size_t s = 0; s < part.sets[1].size(); ++s) {
      if (part.sets[1][s].internal) continue;
      const std::string name = group_name(scope, part.sets[1][s].name, parts_[0].set_numbers[1]);
      GroupMembers group;
      add_elements(members_of(scope, Members::elements, s, 0), group);
      add_group(name, FaceGroups::Kind::cell_zone, std::move(group));
    }
    for (const Surface& surface : part.surfaces) {
      const std::string name = group_name(scope, surface.name, parts_[0].surface_numbers);
      GroupMembers group;
      add_surface(surface, group);
      add_group(name, FaceGroups::Kind::group, std::move(group));
    }
  }
}

void AbaqusModel::add_group(const std::string& name, FaceGroups::Kind kind, GroupMembers&& members) {
  if (!members.faces.empty()) mesh_.face_sets.push_back({name, std::move(members.faces), kind});
  mesh_.point_sets.push_back({name, std::move(members.points), kind});
}

void AbaqusModel::add_elements(const std::vector<std::uint32_t>& elements, GroupMembers& group) const {
  for (const std::uint32_t e : elements) {
    const Element& element = elements_[e];
    if (type_of(element).use == Use::shell || type_of(element).use == Use::plane) {
      group.faces.push_back(element.number);
    } else {
      const std::vector<PointId> points = points_of(element);
      group.points.insert(group.points.end(), points.begin(), points.end());
    }
  }
}

void AbaqusModel::add_surface(const Surface& surface, GroupMembers& group) {
  for (const Surface::Entry& entry : surface.entries) {
    Set::Entry set;
    set.name = entry.what;
    set.scope = entry.scope;
    set.place = entry.place;
    if (surface.members == Members::nodes) {
      add_entry(set, Members::nodes, 0, group.points);
      continue;
    }
    std::vector<std::uint32_t> found;
    add_entry(set, Members::elements, 0, found);
    for (const std::uint32_t element : found) add_side(elements_[element], entry, group);
  }
  make_unique(group.faces);
}

std::pair<AbaqusModel::Scope, std::string> AbaqusModel::qualified(Scope scope, const std::string& name) const {
  const std::size_t dot = name.rfind('.');
  if (dot != std::string::npos) {
    if (const auto instance = find_instance(name.substr(0, dot))) return {*instance, name.substr(dot + 1)};
  }
  return {scope, name};
}

const std::vector<std::uint32_t>& AbaqusModel::members_of(Scope scope, Members members, std::size_t set, int depth) {
  Part& part = parts_[scope];
  Resolved& resolved = part.resolved[number(members)][set];
  if (resolved.state == Resolved::State::known) return resolved.members;
  const Set& source = part.sets[number(members)][set];
  if (resolved.state == Resolved::State::under_way || depth > deepest) {
    fail_(source.entries.front().place, "set " + in_quotes(source.name) + " names itself, or sets name one another more than " +
                                            std::to_string(deepest) + " deep");
  }
  resolved.state = Resolved::State::under_way;
  for (const std::uint32_t member : source.members) resolved.members.push_back(part.global[number(members)][member]);
  for (const Set::Entry& entry : source.entries) add_entry(entry, members, depth, resolved.members);
  make_unique(resolved.members);
  resolved.state = Resolved::State::known;
  return resolved.members;
}

void AbaqusModel::add_entry(const Set::Entry& entry, Members members, int depth, std::vector<std::uint32_t>& found) {
  if (entry.name.empty()) return add_range(entry, members, found);
  const auto [scope, name] = qualified(entry.scope, entry.name);
  if (const auto label = parse_integer(name)) {
    Set::Entry single = entry;
    single.first = single.last = *label;
    single.scope = scope;
    return add_range(single, members, found);
  }
  const Members of = members == Members::nodes ? entry.of : Members::elements;
  const auto& numbers = parts_[scope].set_numbers[number(of)];
  const auto other = numbers.find(upper_case(name));
  if (other == numbers.end()) {
    fail_(entry.place, std::string("there is no ") + nouns[number(of)] + " set " + in_quotes(name));
    return;
  }
  const std::vector<std::uint32_t>& more = members_of(scope, of, other->second, depth + 1);
  if (of == members) {
    found.insert(found.end(), more.begin(), more.end());
    return;
  }
  for (const std::uint32_t element : more) {
    const auto points = points_of(elements_[element]);
    found.insert(found.end(), points.begin(), points.end());
  }
}

/// Adds the existing labels of a range.
void AbaqusModel::add_range(const Set::Entry& entry, Members members, std::vector<std::uint32_t>& found) const {
  const Part& part = parts_[entry.scope];
  const auto& global = part.global[number(members)];
  const auto& labels = part.labels[number(members)];
  const LabelIndex& all = members == Members::nodes ? part.nodes : part.elements;
  if (entry.first == entry.last) {
    const auto member = all.find(entry.first);
    if (!member) fail_(entry.place, std::string("there is no ") + nouns[number(members)] + " " + std::to_string(entry.first));
    found.push_back(global[*member]);
    return;
  }
  const std::uint64_t steps =
      (static_cast<std::uint64_t>(entry.last) - static_cast<std::uint64_t>(entry.first)) / static_cast<std::uint64_t>(entry.step);
  if (steps <= labels.size()) {
    for (std::int64_t label = entry.first; label <= entry.last; label += entry.step) {
      if (const auto member = all.find(label)) found.push_back(global[*member]);
      if (entry.last - label < entry.step) break;
    }
    return;
  }
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels[i] >= entry.first && labels[i] <= entry.last && (labels[i] - entry.first) % entry.step == 0) {
      found.push_back(global[i]);
    }
  }
}

std::vector<PointId> AbaqusModel::points_of(const Element& element) const {
  std::vector<PointId> points;
  for (std::size_t i = element.first; i < element.first + element.count; ++i) {
    if (nodes_[i] != missing) points.push_back(nodes_[i]);
  }
  return points;
}

void AbaqusModel::add_side(const Element& element, const Surface::Entry& entry, GroupMembers& group) {
  const std::string face = upper_case(entry.face);
  const char letter = face.empty() ? '\0' : face[0];
  // 0: none, as in SPOS.
  const std::int64_t number = letter == 'S' || letter == 'E' ? parse_integer(std::string_view(face).substr(1)).value_or(0) : 0;
  if (type_of(element).use == Use::volume) {
    if (face.empty()) return add_free_sides(element, group);
    const auto found = letter == 'S' ? abaqus_side(type_of(element).volume, number) : std::nullopt;
    if (!found) {
      fail_(entry.place, "element " + std::to_string(element.label) + ", a " + shape(type_of(element).volume).name +
                             ", has no face " + in_quotes(entry.face));
      return;
    }
    group.faces.push_back(mesh_.faces.size());
    mesh_.faces.push_back(side(element, *found));
    return;
  }
  const std::vector<PointId> points = points_of(element);
  const bool shell = type_of(element).use == Use::shell;
  // For shells, S1 and S2 are the two sides in CalculiX, and S3 is the first edge.
  const std::int64_t edge = letter == 'S' && shell ? number - 2 : number;
  const bool whole = number == 0 || edge < 1;
  if (type_of(element).use != Use::other && whole) {
    group.faces.push_back(element.number);
    return;
  }
  const std::size_t corners = points.size() == 3 || points.size() == 6 ? 3 : 4;
  if (type_of(element).use == Use::other || static_cast<std::uint64_t>(edge) > corners) {
    group.points.insert(group.points.end(), points.begin(), points.end());
    return;
  }
  const auto first = static_cast<std::size_t>(edge - 1);
  group.points.push_back(points[first]);
  group.points.push_back(points[(first + 1) % corners]);
  if (points.size() > corners) group.points.push_back(points[corners + first]);
}

void AbaqusModel::add_free_sides(const Element& element, GroupMembers& group) {
  if (free_.empty()) {
    const BoundaryFaces boundary = boundary_faces(mesh_.elements);
    std::size_t corner = 0;
    for (const std::uint32_t size : boundary.sizes) {
      free_.insert(face_key(std::span(boundary.points).subspan(corner, size)));
      corner += size;
    }
  }
  for (std::size_t f = 0; f < shape(type_of(element).volume).faces.size(); ++f) {
    ElementMesh::Face face = side(element, f);
    if (free_.count(face_key(face.corners)) == 0) continue;
    group.faces.push_back(mesh_.faces.size());
    mesh_.faces.push_back(std::move(face));
  }
}

ElementMesh::Face AbaqusModel::side(const Element& element, std::size_t face) const {
  ElementMesh::Face result;
  const auto nodes = mesh_.elements.nodes(element.number);
  for (const std::uint8_t node : shape(type_of(element).volume).faces[face]) result.corners.push_back(nodes[node]);
  return result;
}

}  // namespace deform::io
