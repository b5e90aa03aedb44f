// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/refined_setup.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "client/cli/setup/reading.h"
#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/io/mesh_file.h"
#include "core/numerics/lattice/moved_lattice.h"
#include "proto/convert/controls/controls.h"

namespace deform::cli {

namespace {

// The limits of setup.proto.
constexpr std::size_t most_along_axis = 1000, most_controls = 100000, most_moved_controls = 10000;
constexpr std::size_t most_setup_bytes = std::size_t{1} << 26;

YAML::Node flow_list(const std::vector<std::string>& items) {
  YAML::Node list(YAML::NodeType::Sequence);
  list.SetStyle(YAML::EmitterStyle::Flow);
  for (const std::string& item : items) list.push_back(item);
  return list;
}

template <typename Numbers>
YAML::Node numbers_node(const Numbers& numbers) {
  std::vector<std::string> items;
  for (const auto number : numbers) {
    if constexpr (std::is_floating_point_v<std::decay_t<decltype(number)>>) {
      items.push_back(number_digits(number));
    } else {
      items.push_back(std::to_string(number));
    }
  }
  return flow_list(items);
}

YAML::Node flow_map() {
  YAML::Node map(YAML::NodeType::Map);
  map.SetStyle(YAML::EmitterStyle::Flow);
  return map;
}

/// A setup as a message and as YAML, which are changed together.
class Rewriting {
 public:
  Rewriting(const Refinement& refinement, const Mesh& mesh)
      : refinement_(refinement),
        name_(refinement.setup.string()),
        input_(io::read_file(refinement.setup, nullptr, most_setup_bytes)),
        setup_(read_setup_file(refinement.setup).setup),
        mesh_(mesh),
        options_(convert::lattice_from_proto(setup_.method().ffd().lattice())),
        coarse_(control_lattice(setup_, mesh)),
        fine_(finer()) {}

  RefinedSetup run() {
    RefinedSetup result{{fine_.fine(), {}}, sizes_of(coarse_.lattice), std::nullopt, 0, {}};
    check_limits();
    std::vector<Vec3> places = coarse_.places;
    if (!refinement_.values.empty()) {
      places = moved_controls(setup_, coarse_, refinement_.values);
      result.mesh = moved_mesh(places, result.outside);
    }
    const bool at_rest = options_.control_points.empty() && refinement_.values.empty();
    result.lattice.places = at_rest ? fine_.fine().control_points() : fine_.refined(places);
    result.text = rewritten(at_rest ? std::vector<Vec3>() : result.lattice.places);
    return result;
  }

 private:
  static std::array<std::size_t, 3> sizes_of(const Lattice& lattice) {
    return {lattice.axis(0).size(), lattice.axis(1).size(), lattice.axis(2).size()};
  }

  LatticeRefinement finer() const {
    try {
      return {coarse_.lattice, options_.basis, refinement_.axes};
    } catch (const Error& error) {
      refuse(std::string("method.ffd.lattice.points: ") + error.what());
    }
  }

  void check_limits() const {
    const auto sizes = sizes_of(fine_.fine());
    const std::string text = std::to_string(sizes[0]) + " x " + std::to_string(sizes[1]) + " x " + std::to_string(sizes[2]);
    if (*std::max_element(sizes.begin(), sizes.end()) > most_along_axis) {
      refuse("method.ffd.lattice.points: they would be " + text + ", at most " + std::to_string(most_along_axis) +
             " along an axis are allowed");
    }
    const bool moved = !options_.control_points.empty() || !refinement_.values.empty();
    const std::size_t most = moved ? most_moved_controls : most_controls;
    if (fine_.fine().size() > most) {
      refuse("method.ffd.lattice.points: they would be " + text + ", at most " + std::to_string(most) + " in all are allowed" +
             (moved ? " of a lattice that is not at rest" : ""));
    }
    if (!refinement_.values.empty() && setup_.then_size() > 0) {
      refuse("then: a setup with several methods cannot start from a design; refine its lattice at rest, without values");
    }
    if (!refinement_.values.empty() && setup_.symmetry_size() > 0) {
      refuse("--set: a setup with symmetry planes cannot start from a design; refine its lattice at rest, without values");
    }
    if (refinement_.values.empty() || selects_controls(setup_)) return;
    refuse(
        "--set: only with control CONTROLS variables move control points; with ENERGY and MESH they follow from the handles when "
        "a design "
        "is solved for, and the refined lattice can only start from the shape at rest");
  }

  /// The mesh of the design; points outside of the lattice stay.
  std::vector<Vec3> moved_mesh(const std::vector<Vec3>& places, std::size_t& outside) const {
    const Lattice& lattice = coarse_.lattice;
    const LatticeCoordinates found = options_.control_points.empty()
                                         ? coordinates_in(lattice, mesh_.points)
                                         : MovedLattice(lattice, coarse_.places).coordinates(mesh_.points);
    std::vector<Vec3> moves(places.size());
    for (std::size_t p = 0; p < places.size(); ++p) moves[p] = places[p] - coarse_.places[p];
    std::vector<Vec3> points = mesh_.points;
    auto out = found.outside.begin();
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (out != found.outside.end() && *out == i) {
        ++out;
        continue;
      }
      points[i] = points[i] + lattice.sum(moves, found.u[i]);
    }
    outside = found.outside.size();
    return points;
  }

  std::string rewritten(const std::vector<Vec3>& places) {
    std::string bytes(places.size() * sizeof(Vec3), '\0');
    if (!bytes.empty()) std::memcpy(bytes.data(), places.data(), bytes.size());
    IdFiles id_files(refinement_.setup.parent_path());
    const auto ids = [&](const std::string& file, const std::string& set) { return id_files.ids(file, set); };
    const auto named = [&](std::string_view length) { return mesh_length(length, bounding_box(mesh_.points)); };
    const auto parse = [&](const std::string& text, const ReadBytes& read) {
      v1::Setup message;
      Problems problems(Problems::Mode::throw_first);
      parse_yaml(text, name_, message, {ids, read, named}, problems);
      return message;
    };
    expected_ = parse(input_, [&](const std::string&) { return std::string(); });
    root_ = YAML::Load(input_);
    change_lattice(bytes);
    if (!refinement_.values.empty()) {
      root_["geometry"] = refinement_.geometry;
      expected_.set_geometry(refinement_.geometry);
    }
    if (selects_controls(setup_)) change_regions();
    YAML::Emitter emitter;
    emitter << root_;
    std::string text = std::string(emitter.c_str()) + "\n";
    const v1::Setup got = parse(text, [&](const std::string&) { return bytes; });
    if (got.SerializeAsString() == expected_.SerializeAsString()) return text;
    throw Error(ErrorCode::failed_precondition,
                name_ + ": written again, its YAML says something else; write out aliases and merged keys");
  }

  void change_lattice(const std::string& bytes) {
    v1::Lattice& message = *expected_.mutable_method()->mutable_ffd()->mutable_lattice();
    YAML::Node ffd = root_["method"]["ffd"];
    if (!ffd["lattice"]) ffd["lattice"] = flow_map();
    YAML::Node lattice = ffd["lattice"];
    const auto sizes = sizes_of(fine_.fine());
    lattice["points"] = numbers_node(sizes);
    message.clear_points();
    for (const std::size_t size : sizes) message.add_points(static_cast<std::uint32_t>(size));
    if (bytes.empty()) return;
    YAML::Node file = flow_map();
    file["file"] = refinement_.control_points;
    lattice["control_points"] = file;
    message.set_control_points(bytes);
    if (message.place_case() != v1::Lattice::PLACE_NOT_SET) return;
    // The automatic box would be that of another mesh.
    const LatticeFrame& frame = coarse_.lattice.frame();
    YAML::Node box = flow_map();
    const Vec3 far = frame.origin + frame.axes[0] + frame.axes[1] + frame.axes[2];
    box["min"] = numbers_node(frame.origin);
    box["max"] = numbers_node(far);
    lattice["box"] = box;
    for (const double x : frame.origin) message.mutable_box()->add_min(x);
    for (const double x : far) message.mutable_box()->add_max(x);
  }

  void change_regions() {
    for (int i = 0; i < setup_.handles_size(); ++i) {
      const std::string what = "handle \"" + setup_.handles(i).name() + "\"";
      YAML::Node handle = root_["handles"][static_cast<std::size_t>(i)];
      handle["region"] = changed(setup_.handles(i).region(), *expected_.mutable_handles(i)->mutable_region(), what);
    }
    for (int i = 0; i < setup_.fixed_size(); ++i) {
      const std::string what = "fixed[" + std::to_string(i) + "]";
      root_["fixed"][static_cast<std::size_t>(i)] = changed(setup_.fixed(i), *expected_.mutable_fixed(i), what);
    }
  }

  YAML::Node changed(const v1::Region& region, v1::Region& expected, const std::string& what) const {
    const std::vector<PointId> selected = control_points_of(region, coarse_, what);
    const std::vector<std::size_t> ids = fine_.refined_selection(std::vector<std::size_t>(selected.begin(), selected.end()));
    if (ids.empty()) refuse(what + ": its region contains no control point");
    YAML::Node node = flow_map(), inner = flow_map();
    expected.Clear();
    if (!region.has_lattice()) {
      inner["ids"] = numbers_node(ids);
      for (const std::size_t id : ids) expected.mutable_control()->add_ids(static_cast<std::uint32_t>(id));
      node["control"] = inner;
      return node;
    }
    const auto sizes = sizes_of(fine_.fine());
    // What is selected is a range along each axis again.
    const auto index = [&](std::size_t id, std::size_t k) {
      return k == 0 ? id % sizes[0] : k == 1 ? id / sizes[0] % sizes[1] : id / sizes[0] / sizes[1];
    };
    const v1::LatticeRange& range = region.lattice();
    v1::LatticeRange& wider = *expected.mutable_lattice();
    const std::array<int, 3> given{range.i_size(), range.j_size(), range.k_size()};
    const std::array<google::protobuf::RepeatedField<std::uint32_t>*, 3> fields{wider.mutable_i(), wider.mutable_j(),
                                                                                wider.mutable_k()};
    for (std::size_t k = 0; k < 3; ++k) {
      if (given[k] == 0) continue;
      const std::array<std::size_t, 2> ends{index(ids.front(), k), index(ids.back(), k)};
      inner[std::string(1, "ijk"[k])] = numbers_node(ends);
      for (const std::size_t end : ends) fields[k]->Add(static_cast<std::uint32_t>(end));
    }
    node["lattice"] = inner;
    return node;
  }

  const Refinement& refinement_;
  const std::string name_, input_;
  const v1::Setup setup_;
  const Mesh& mesh_;
  const LatticeOptions options_;
  const ControlLattice coarse_;
  const LatticeRefinement fine_;
  v1::Setup expected_;
  YAML::Node root_;
};

}  // namespace

RefinedSetup refined_setup(const Refinement& refinement, const Mesh& mesh) { return Rewriting(refinement, mesh).run(); }

}  // namespace deform::cli
