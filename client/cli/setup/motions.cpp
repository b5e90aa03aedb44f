// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/setup/motions.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <memory>

#include "client/cli/output/format.h"
#include "client/cli/setup/point_match.h"
#include "client/cli/setup/reading.h"
#include "client/design.h"
#include "core/base/error.h"

namespace deform::cli {

namespace {

const std::vector<std::string> matrix_columns{"handle", "m00", "m01", "m02", "m03", "m10", "m11",
                                              "m12",    "m13", "m20", "m21", "m22", "m23"};

std::vector<v1::Motion> matrices(const Csv& csv, const HandlePoints& handle_points) {
  std::vector<v1::Motion> motions;
  for (const auto& row : csv.rows) {
    const std::string& handle = row.fields[0];
    for (const auto& earlier : motions) {
      if (earlier.handle() == handle) refuse(csv.where(row, 0) + "\"" + handle + "\" stands there twice");
    }
    try {
      handle_points(handle);
    } catch (const Error& error) {
      refuse(csv.where(row, 0) + error.what());
    }
    Affine map{};
    for (std::size_t k = 0; k < map.size(); ++k) map[k] = csv.number(row, k + 1);
    motions.push_back(client::affine_motion(handle, map));
  }
  return motions;
}

/// Lines about single points: how they name them and what they say.
enum class PointLines { displacements_by_id, positions_by_id, displacements_by_place };

/// The displacements of one handle while its lines are read.
struct HandleDisplacements {
  std::vector<PointId> points;
  std::vector<Vec3> values;
  std::vector<char> given;
  std::unique_ptr<const PointMatch> match;  ///< for points named by their place
};

class DisplacementReader {
 public:
  DisplacementReader(const Csv& csv, PointLines lines, const HandlePoints& handle_points, const RestPlaces& rest)
      : csv_(csv), lines_(lines), handle_points_(handle_points), rest_(rest) {}

  std::vector<v1::Motion> read() {
    for (const auto& row : csv_.rows) add(row);
    std::vector<v1::Motion> motions;
    for (const auto& [name, handle] : handles_) {
      check_complete(name, handle);
      motions.push_back(client::displacement_motion(name, handle.values));
    }
    return motions;
  }

 private:
  bool by_place() const { return lines_ == PointLines::displacements_by_place; }

  HandleDisplacements& handle_of(const Csv::Row& row) {
    const std::string& name = row.fields[0];
    if (const auto found = handles_.find(name); found != handles_.end()) return found->second;
    std::vector<PointId> points;
    try {
      points = handle_points_(name);
    } catch (const Error& error) {
      refuse(csv_.where(row, 0) + error.what());
    }
    HandleDisplacements& handle = handles_[name];
    handle.points = std::move(points);
    handle.values.resize(handle.points.size());
    handle.given.resize(handle.points.size());
    if (by_place()) handle.match = std::make_unique<const PointMatch>(rest_.points, handle.points, rest_.tolerance);
    return handle;
  }

  Vec3 vector(const Csv::Row& row, std::size_t first) const {
    return {csv_.number(row, first), csv_.number(row, first + 1), csv_.number(row, first + 2)};
  }

  std::size_t find_id(const Csv::Row& row, const HandleDisplacements& handle) const {
    const std::string& text = row.fields[1];
    PointId id{};
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), id);
    if (failure != std::errc() || end != text.data() + text.size()) {
      refuse(csv_.where(row, 1) + "expected a point id from 0, got \"" + text.substr(0, 40) + "\"");
    }
    const auto place = std::lower_bound(handle.points.begin(), handle.points.end(), id);
    if (place == handle.points.end() || *place != id) {
      refuse(csv_.where(row, 1) + "point " + std::to_string(id) + " is not in handle \"" + row.fields[0] + "\"");
    }
    return static_cast<std::size_t>(place - handle.points.begin());
  }

  std::size_t find_place(const Csv::Row& row, const HandleDisplacements& handle) const {
    const auto index = handle.match->nearest(vector(row, 1), handle.given);
    if (!index) {
      refuse(csv_.where(row, 1) + "no point of handle \"" + row.fields[0] + "\" that no line has named yet is within " +
             number_text(rest_.tolerance) + " of this place; check units and mesh, or raise --match-tolerance");
    }
    return *index;
  }

  void add(const Csv::Row& row) {
    HandleDisplacements& handle = handle_of(row);
    const std::size_t index = by_place() ? find_place(row, handle) : find_id(row, handle);
    if (handle.given[index]) {
      refuse(csv_.where(row, 1) + "point " + std::to_string(handle.points[index]) + " stands there twice");
    }
    handle.given[index] = 1;
    Vec3& value = handle.values[index];
    value = vector(row, by_place() ? 4 : 2);
    if (lines_ != PointLines::positions_by_id) return;
    for (std::size_t k = 0; k < 3; ++k) value[k] -= rest_.points[handle.points[index]][k];
  }

  void check_complete(const std::string& name, const HandleDisplacements& handle) const {
    const auto missing = std::find(handle.given.begin(), handle.given.end(), 0);
    if (missing == handle.given.end()) return;
    const auto count = std::count(handle.given.begin(), handle.given.end(), 0);
    refuse(csv_.name + ": handle \"" + name + "\": " + std::to_string(count) + " of its " + std::to_string(handle.given.size()) +
           " points are missing, the first is point " +
           std::to_string(handle.points[static_cast<std::size_t>(missing - handle.given.begin())]) +
           "; list every point, with 0,0,0 where it stays");
  }

  const Csv& csv_;
  const PointLines lines_;
  const HandlePoints& handle_points_;
  const RestPlaces& rest_;
  std::map<std::string, HandleDisplacements> handles_;
};

}  // namespace

std::vector<v1::Motion> read_motions(const Csv& csv, const HandlePoints& handle_points, const RestPlaces& rest) {
  const auto points = [&](PointLines lines) { return DisplacementReader(csv, lines, handle_points, rest).read(); };
  std::vector<v1::Motion> motions;
  if (csv.header == matrix_columns) {
    motions = matrices(csv, handle_points);
  } else if (csv.header == std::vector<std::string>{"handle", "point", "dx", "dy", "dz"}) {
    motions = points(PointLines::displacements_by_id);
  } else if (csv.header == std::vector<std::string>{"handle", "point", "x", "y", "z"}) {
    motions = points(PointLines::positions_by_id);
  } else if (csv.header == std::vector<std::string>{"handle", "x", "y", "z", "dx", "dy", "dz"}) {
    motions = points(PointLines::displacements_by_place);
  } else {
    refuse(csv.name +
           ": the columns are none of handle,m00,...,m23; handle,point,dx,dy,dz; handle,point,x,y,z; handle,x,y,z,dx,dy,dz");
  }
  if (motions.empty()) refuse(csv.name + ": there is no motion below the header");
  return motions;
}

std::size_t variable_index(const v1::Setup& setup, const std::string& name, const std::string& where) {
  std::vector<std::string> names;
  for (int k = 0; k < setup.variables_size(); ++k) {
    if (setup.variables(k).name() == name) return static_cast<std::size_t>(k);
    names.push_back(setup.variables(k).name());
  }
  const std::string near = nearest_names(name, names);
  std::string all;
  for (const auto& candidate : names) all += (all.empty() ? "" : ", ") + candidate;
  refuse(where + ": the setup has no design variable \"" + name + "\"; " +
         (!near.empty() ? "did you mean " + near + "?"
          : all.empty() ? "it has none"
                        : "it has " + all));
}

std::vector<double> parse_settings(const std::vector<std::string>& settings, const v1::Setup& setup) {
  if (settings.empty()) return {};
  std::vector<double> values(static_cast<std::size_t>(setup.variables_size()), 0.0);
  std::vector<char> given(values.size(), 0);
  for (const auto& setting : settings) {
    const auto equals = setting.rfind('=');  // names may have one, numbers have none
    if (equals == std::string::npos) refuse("--set " + setting + ": expected NAME=VALUE");
    const std::string name = setting.substr(0, equals);
    const std::size_t index = variable_index(setup, name, "--set " + setting);
    const auto value = parse_number(setting.substr(equals + 1));
    if (!value) refuse("--set " + setting + ": expected a finite number after the =");
    if (given[index]) refuse("--set " + setting + ": \"" + name + "\" is set twice");
    given[index] = 1;
    values[index] = *value;
  }
  return values;
}

}  // namespace deform::cli
