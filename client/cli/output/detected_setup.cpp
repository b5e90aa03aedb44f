// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/output/detected_setup.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "client/cli/output/format.h"
#include "client/cli/setup/reading.h"
#include "client/cli/setup/region_points.h"
#include "core/base/text.h"
#include "core/io/mesh_file.h"
#include "proto/convert/method_traits.h"

namespace deform::cli {

namespace {

constexpr std::size_t most_inline = 16;  ///< ids that stand in the setup itself, on one line
constexpr std::uint32_t first_handle = ResolvedRegions::first_handle;

/// "plane_1, plane_2 and circle_1"
std::string names_text(const google::protobuf::RepeatedPtrField<std::string>& names) {
  std::string text;
  for (int i = 0; i < names.size(); ++i) {
    text += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + yaml_text(names[i]);
  }
  return text;
}

/// Components that are rounding beside the largest are 0.
std::string vector_text(const google::protobuf::RepeatedField<double>& x) {
  constexpr double rounding = 1e-12;
  double largest = 0;
  for (const double component : x) largest = std::max(largest, std::abs(component));
  std::string text = "[";
  for (int k = 0; k < x.size(); ++k) {
    text += (k == 0 ? "" : ", ") + number_text(std::abs(x[k]) <= rounding * largest ? 0 : x[k]);
  }
  return text + "]";
}

std::string shape_text(const v1::DetectedPrimitive& about) {
  switch (about.kind()) {
    case v1::PRIMITIVE_PLANE:
      return "through " + vector_text(about.point()) + ", normal " + vector_text(about.axis());
    case v1::PRIMITIVE_CYLINDER:
      return "radius " + number_text(about.radius()) + ", axis " + vector_text(about.axis()) + " through " +
             vector_text(about.point());
    case v1::PRIMITIVE_SPHERE:
      return "radius " + number_text(about.radius()) + ", centre " + vector_text(about.point());
    case v1::PRIMITIVE_CONE:
      return "half angle " + number_text(about.half_angle()) + ", axis " + vector_text(about.axis()) + ", apex " +
             vector_text(about.point());
    default:
      return {};
  }
}

std::string shape_text(const v1::DetectedEdge& about) {
  if (about.kind() == v1::EDGE_LINE) return "from " + vector_text(about.point()) + ", direction " + vector_text(about.axis());
  return "radius " + number_text(about.radius()) + ", centre " + vector_text(about.point()) + ", normal " +
         vector_text(about.axis());
}

class Writer {
 public:
  Writer(const client::Detected& detected, const DetectedSetupOptions& options) : detected_(detected), options_(options) {}

  DetectedSetup write() {
    for (const auto& primitive : detected_.primitives) {
      const double share = 100 * primitive.about.area() / detected_.summary.area();
      add(primitive.about, shape_text(primitive.about) + "; " + number_text(share) + " % of the surface", primitive.points);
    }
    for (const auto& edge : detected_.edges) {
      const std::string on = edge.about.lies_on().empty() ? "" : ", on " + names_text(edge.about.lies_on());
      add(edge.about, shape_text(edge.about) + on + "; length " + number_text(edge.about.length()), edge.points);
    }
    result_.text = head();
    result_.text += result_.written == 0 ? "constraints: []  # nothing was found that can be one\n" : "constraints:\n";
    result_.text += kept_.str();
    if (result_.left_out > 0) {
      result_.text +=
          "  # Left out, with the reason. To keep one all the same, remove \"# \" in front of its \"-\".\n" + left_out_.str();
    }
    if (!sets_.empty()) result_.points = sets_text();
    return std::move(result_);
  }

 private:
  std::string head() const {
    const v1::DetectSummary& summary = detected_.summary;
    const std::string detection = "Found by deform detect with tolerance " + number_text(summary.tolerance()) +
                                  ", smallest area " + number_text(100 * summary.minimum_area()) +
                                  " % of the surface, largest angle " + number_text(summary.maximum_angle()) + " rad.";
    const std::string found = "# " + (options_.origin.empty() ? detection : options_.origin) + "\n";
    if (!options_.beginning.empty()) {
      const bool open = options_.beginning.back() != '\n';
      return options_.beginning + (open ? "\n" : "") + "\n" + found + "# Take out what need not be kept.\n";
    }
    return found +
           "# Take out what need not be kept, say what moves and what stays, then: deform prepare FILE --check\n"
           "geometry: " +
           yaml_text(options_.geometry) +
           "\n"
           "method: {mls: {}}\n" +
           options_.symmetry +
           "handles: []  # such as: [{name: top, region: {half_space: {point: [0, 0, 1], normal: [0, 0, 1]}}}]\n"
           "fixed: []    # such as: [{half_space: {point: [0, 0, 0], normal: [0, 0, -1]}}]\n";
  }

  template <typename About>
  void add(const About& about, const std::string& shape, const std::vector<PointId>& ids) {
    const std::string name = yaml_text(about.name());
    if (about.constraint().empty()) {
      ++result_.left_out;
      left_out_ << "  # " << name << ": " << ids.size() << " points are too few for a constraint\n";
      return;
    }
    std::map<std::uint32_t, std::size_t> held;  // points by label
    if (!options_.held.labels.empty()) {
      for (const PointId p : ids) ++held[options_.held.labels.at(p)];
    }
    const std::size_t loose = held.empty() ? ids.size() : held[ResolvedRegions::free];
    held.erase(ResolvedRegions::free);
    const std::string region = "[{ids: " + ids_text(about.name(), ids) + "}]";
    const char* const exact = options_.kept == DetectedSetupOptions::Kept::exactly ? "exact: true, " : "";
    const auto mirror = options_.in_symmetry.find(about.name());
    if (loose == 0 || !about.implied_by().empty() || mirror != options_.in_symmetry.end()) {
      ++result_.left_out;
      const std::string reason = mirror != options_.in_symmetry.end() ? mirror->second
                                 : loose == 0                         ? "all its points are " + holders_text(held, ids.size())
                                                                      : "follows from " + names_text(about.implied_by());
      left_out_ << "  # - {name: " << name << ", " << yaml_text(about.constraint()) << ": {}, " << exact << "regions: " << region
                << "}  # " << reason << '\n';
      return;
    }
    ++result_.written;
    kept_ << "  # " << shape << ", " << ids.size() << " points, rms " << number_text(about.rms()) << '\n';
    if (!held.empty()) kept_ << "  # " << holders_text(held, 0) << ": these points stay where the design puts them\n";
    kept_ << "  - name: " << name << "\n    " << yaml_text(about.constraint()) << ": {}\n"
          << (options_.kept == DetectedSetupOptions::Kept::exactly ? "    exact: true\n" : "") << "    regions: " << region
          << '\n';
  }

  /// "12 points in handle \"top\", 3 fixed"; of all points without the number.
  std::string holders_text(const std::map<std::uint32_t, std::size_t>& held, std::size_t all) const {
    std::string text;
    for (const auto& [label, count] : held) {
      if (!text.empty()) text += ", ";
      if (count != all) text += std::to_string(count) + (count == 1 ? " point " : " points ");
      text += label < first_handle ? "fixed" : "in handle " + yaml_text(options_.held.handles.at(label - first_handle));
    }
    return text;
  }

  /// A list, or where it stands.
  std::string ids_text(const std::string& name, const std::vector<PointId>& ids) {
    if (ids.size() > most_inline) {
      sets_.emplace_back(name, &ids);
      return "{file: " + yaml_text(options_.points_file) + ", set: " + yaml_text(name) + "}";
    }
    return list_text(ids, ", ");
  }

  static std::string list_text(const std::vector<PointId>& ids, const char* between) {
    std::string text = "[";
    for (std::size_t i = 0; i < ids.size(); ++i) text += (i > 0 ? between : "") + std::to_string(ids[i]);
    return text + "]";
  }

  /// One line for every set.
  std::string sets_text() const {
    std::string text = "{\n";
    for (std::size_t i = 0; i < sets_.size(); ++i) {
      text +=
          nlohmann::json(sets_[i].first).dump() + ": " + list_text(*sets_[i].second, ",") + (i + 1 < sets_.size() ? ",\n" : "\n");
    }
    return text + "}\n";
  }

  const client::Detected& detected_;
  const DetectedSetupOptions& options_;
  DetectedSetup result_;
  std::ostringstream kept_, left_out_;
  std::vector<std::pair<std::string, const std::vector<PointId>*>> sets_;
};

/// The first characters of lines that hold a key or a value of the root.
bool is_block_map(const std::string& text) {
  std::istringstream lines(text);
  bool any = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("---") || line.starts_with("...")) return false;
    if (line.empty() || line[0] == '#' || line[0] == ' ' || line[0] == '\r') continue;
    if (line[0] == '{' || line[0] == '}') return false;
    any = true;
  }
  return any;
}

bool has_key(const std::string& text, const std::string& key) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(key)) return true;
  }
  return false;
}

}  // namespace

std::string yaml_text(const std::string& text) {
  const auto plain = [](unsigned char c) { return std::isalnum(c) != 0 || c == '_' || c == '.' || c == '-' || c == '/'; };
  const bool word = !text.empty() && std::isalpha(static_cast<unsigned char>(text[0])) != 0 &&
                    std::all_of(text.begin(), text.end(), plain) && text != "true" && text != "false" && text != "null";
  return word ? text : nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

DetectedSetup detected_setup(const client::Detected& detected, const DetectedSetupOptions& options) {
  return Writer(detected, options).write();
}

std::string continued_text(const std::filesystem::path& path) {
  const v1::Setup setup = read_setup_file(path).setup;
  const std::string text = io::read_file(path);
  const auto refuse = [&](const std::string& why) { throw Error(ErrorCode::invalid_argument, path.string() + ": " + why); };
  if (setup.constraints_size() > 0 || has_key(text, "constraints:")) {
    refuse("constraints: what is found would be added to them; take them out, or detect the mesh file");
  }
  if (setup.then_size() > 0) refuse("then: a setup with several methods takes no constraints; detect the mesh file");
  if (!is_block_map(text)) refuse("constraints can only be added to a setup in block style; detect the mesh file");
  if (!convert::method_features(setup.method()).constraints) {
    refuse("method: " + convert::method_name(setup.method()) +
           " takes no constraints; choose {mls: {}}, {shell: {}}, {subspace: {}} or {ffd: {}}");
  }
  return text;
}

}  // namespace deform::cli
