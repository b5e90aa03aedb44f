#include "client/cli/motions.h"

#include <algorithm>
#include <charconv>
#include <map>

#include "client/cli/numbers.h"
#include "client/design.h"
#include "core/base/error.h"

namespace deform::cli {

namespace {

const std::vector<std::string> matrix_columns{"handle", "m00", "m01", "m02", "m03", "m10", "m11",
                                              "m12",    "m13", "m20", "m21", "m22", "m23"};
const std::vector<std::string> displacement_columns{"handle", "point", "dx", "dy", "dz"};

[[noreturn]] void refuse(const std::string& message) { throw Error(ErrorCode::invalid_argument, message); }

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

/// The displacements of one handle while its lines are read.
struct HandleDisplacements {
  std::vector<PointId> points;
  std::vector<Vec3> values;
  std::vector<char> given;
};

PointId point_id(const Csv& csv, const Csv::Row& row) {
  const std::string& text = row.fields[1];
  PointId id{};
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), id);
  if (failure != std::errc() || end != text.data() + text.size()) {
    refuse(csv.where(row, 1) + "expected a point id from 0, got \"" + text.substr(0, 40) + "\"");
  }
  return id;
}

std::vector<v1::Motion> displacements(const Csv& csv, const HandlePoints& handle_points) {
  std::map<std::string, HandleDisplacements> handles;
  for (const auto& row : csv.rows) {
    const std::string& name = row.fields[0];
    auto found = handles.find(name);
    if (found == handles.end()) {
      HandleDisplacements fresh;
      try {
        fresh.points = handle_points(name);
      } catch (const Error& error) {
        refuse(csv.where(row, 0) + error.what());
      }
      fresh.values.resize(fresh.points.size());
      fresh.given.resize(fresh.points.size());
      found = handles.emplace(name, std::move(fresh)).first;
    }
    HandleDisplacements& handle = found->second;
    const PointId id = point_id(csv, row);
    const auto place = std::lower_bound(handle.points.begin(), handle.points.end(), id);
    if (place == handle.points.end() || *place != id) {
      refuse(csv.where(row, 1) + "point " + std::to_string(id) + " is not in handle \"" + name + "\"");
    }
    const auto index = static_cast<std::size_t>(place - handle.points.begin());
    if (handle.given[index]) refuse(csv.where(row, 1) + "point " + std::to_string(id) + " stands there twice");
    handle.given[index] = 1;
    for (std::size_t k = 0; k < 3; ++k) handle.values[index][k] = csv.number(row, k + 2);
  }
  std::vector<v1::Motion> motions;
  for (const auto& [name, handle] : handles) {
    const auto missing = std::find(handle.given.begin(), handle.given.end(), 0);
    if (missing != handle.given.end()) {
      const auto count = std::count(handle.given.begin(), handle.given.end(), 0);
      refuse(csv.name + ": handle \"" + name + "\": " + std::to_string(count) + " of its " + std::to_string(handle.given.size()) +
             " points are missing, the first is point " +
             std::to_string(handle.points[static_cast<std::size_t>(missing - handle.given.begin())]) +
             "; list every point, with 0,0,0 where it stays");
    }
    motions.push_back(client::displacement_motion(name, handle.values));
  }
  return motions;
}

}  // namespace

std::vector<v1::Motion> read_motions(const Csv& csv, const HandlePoints& handle_points) {
  std::vector<v1::Motion> motions;
  if (csv.header == matrix_columns) {
    motions = matrices(csv, handle_points);
  } else if (csv.header == displacement_columns) {
    motions = displacements(csv, handle_points);
  } else {
    refuse(csv.name + ": the columns are neither handle,m00,...,m23 nor handle,point,dx,dy,dz");
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
    const auto equals = setting.find('=');
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
