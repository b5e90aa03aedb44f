// SPDX-License-Identifier: GPL-3.0-or-later
#include "client/cli/compare/compared_output.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iomanip>
#include <nlohmann/json.hpp>

#include "client/cli/compare/compared_table.h"
#include "client/cli/output/cell_options.h"
#include "client/cli/output/format.h"
#include "client/cli/output/gates.h"
#include "core/base/text.h"
#include "core/base/vectors.h"
#include "core/base/version.h"
#include "core/report/image.h"

namespace deform::cli {

namespace {

using Mark = ComparisonPage::Mark;

nlohmann::ordered_json compared_json(const ComparedDesign& design, const std::vector<ShownMeasure>& measures) {
  nlohmann::ordered_json json;
  if (!design.error.empty()) {
    json["error"] = design.error;
    return json;
  }
  const auto& result = design.result;
  json["verdict"] = verdict_name(result.verdict());
  json["reasons"] = std::vector<std::string>(result.reasons().begin(), result.reasons().end());
  json["warnings"] = std::vector<std::string>(result.warnings().begin(), result.warnings().end());
  json["estimated_error"] = result.estimated_error();
  json["max_displacement"] = result.max_displacement();
  json["prescribed_displacement"] = result.prescribed_displacement();
  if (design.misfit) {
    json["misfit"] = {{"largest", design.misfit->largest}, {"rms", design.misfit->rms}, {"point", design.misfit->point}};
  }
  if (design.smoothness) {
    json["roughness"] = design.smoothness->high_pass_energy;
    json["border_kink"] = design.smoothness->border_kink;
  }
  for (std::size_t m = 0; m < measures.size(); ++m) json["measures"][measures[m].name] = design.measures[m];
  if (result.has_faces()) json["flipped_faces"] = result.faces().flipped();
  if (result.has_cells()) {
    json["inverted_cells"] = result.cells().inverted();
    json["safe_amplitude"] = result.cells().safe_amplitude();
    json["least_determinant"] = result.cells().least_determinant();
  }
  for (const auto& constraint : result.constraints().residuals()) json["constraints"][constraint.name()] = constraint.largest();
  return json;
}

nlohmann::ordered_json compared_json(const ComparedMethod& method, const MethodComparison& comparison) {
  nlohmann::ordered_json json;
  json["label"] = method.choice.label;
  json["method"] = method.choice.kind;
  json["options"] = method.choice.source;
  json["refused"] = method.refusals;
  if (!method.refusals.empty()) return json;
  json["system"] = method.system.id();
  json["unknowns"] = std::max(method.system.functions(), method.system.centres());
  json["prepare_seconds"] = method.system.seconds();
  json["seconds_per_design"] = method.seconds_per_design;
  json["bytes"] = method.system.bytes();
  json["peak_bytes"] = method.peak_bytes;
  json["designs"] = nlohmann::ordered_json::array();
  for (const ComparedDesign& design : method.designs) json["designs"].push_back(compared_json(design, comparison.measures));
  return json;
}

// ---- text ----

void print_table(const ComparisonPage::Table& table, std::ostream& out) {
  std::vector<std::size_t> widths;
  const auto widen = [&](std::size_t column, const std::string& text) {
    if (widths.size() <= column) widths.resize(column + 1);
    widths[column] = std::max(widths[column], text.size());
  };
  widen(0, "method");
  for (std::size_t c = 0; c < table.columns.size(); ++c) widen(c + 1, table.columns[c]);
  for (const auto& row : table.rows) {
    widen(0, printable(row.method));
    for (std::size_t c = 0; c < row.cells.size(); ++c) widen(c + 1, printable(row.cells[c].text));
  }
  const auto put = [&](std::size_t column, const std::string& text) {
    out << "  " << (column == 0 ? std::left : std::right) << std::setw(static_cast<int>(widths[column])) << text;
  };
  put(0, "method");
  for (std::size_t c = 0; c < table.columns.size(); ++c) put(c + 1, table.columns[c]);
  out << '\n';
  for (const auto& row : table.rows) {
    put(0, printable(row.method));
    for (std::size_t c = 0; c < row.cells.size(); ++c) put(c + 1, printable(row.cells[c].text));
    for (std::size_t k = 0; k < row.refusals.size(); ++k) out << (k == 0 ? "  refused: " : "; ") << printable(row.refusals[k]);
    out << '\n';
  }
}

// ---- pictures ----

/// Draws the designs of a comparison.
class Gallery {
 public:
  Gallery(const MethodComparison& comparison, std::size_t design)
      : comparison_(comparison), mesh_(*comparison.mesh), design_(design) {
    for (const ComparedMethod& method : comparison.methods) {
      if (method.refusals.empty() && !made(method).points.empty()) shown_.push_back(&method);
    }
    choose_view();
  }

  bool empty() const { return shown_.empty() || view_points_.empty(); }

  ComparisonPage::Gallery displacements() {
    const auto values = [&](const ComparedMethod& method) {
      std::vector<double> moved;
      const Points& points = made(method).points;
      for (std::size_t i = 0; i < points.size(); ++i) moved.push_back(distance(points[i], mesh_.points[i]));
      return moved;
    };
    return gallery("Displacement", 1, values);
  }

  ComparisonPage::Gallery curvature_changes() {
    constexpr double most = 0.99;  // of the points: few extreme ones would hide the others
    const auto values = [&](const ComparedMethod& method) {
      std::vector<double> change = made(method).curvature_change;
      for (double& value : change) value = std::abs(value);
      return change;
    };
    return gallery("Change of mean curvature", most, values);
  }

 private:
  using Values = std::function<std::vector<double>(const ComparedMethod&)>;

  const ComparedDesign& made(const ComparedMethod& method) const { return method.designs[design_]; }

  /// The same for all: around the mesh at rest and the designs that are not bad.
  void choose_view() {
    used_.resize(mesh_.point_count());
    const auto offsets = mesh_.face_offsets();
    for (FaceId f = 0; f < mesh_.face_count(); ++f) {
      if (!comparison_.hidden.empty() && comparison_.hidden[f]) continue;
      for (std::uint64_t c = offsets[f]; c < offsets[f + 1]; ++c) used_[mesh_.face_points[c]] = 1;
    }
    const auto add = [&](const Points& points) {
      for (std::size_t i = 0; i < points.size(); ++i) {
        if (used_[i] && is_finite(points[i])) view_points_.push_back(points[i]);
      }
    };
    add(mesh_.points);
    for (const ComparedMethod* method : shown_) {
      if (made(*method).result.verdict() != v1::VERDICT_BAD) add(made(*method).points);
    }
    if (!view_points_.empty()) view_ = view_of(view_points_, static_cast<double>(width) / height);
  }

  /// The largest value that the scale shows: the share `most` of those of all methods that are not bad, or of all.
  double top(const std::vector<std::vector<double>>& values, double most) const {
    for (const bool all : {false, true}) {
      std::vector<double> sorted;  // of the points that are drawn
      for (std::size_t m = 0; m < shown_.size(); ++m) {
        if (!all && made(*shown_[m]).result.verdict() == v1::VERDICT_BAD) continue;
        for (std::size_t i = 0; i < values[m].size(); ++i) {
          if (used_[i] && std::isfinite(values[m][i])) sorted.push_back(values[m][i]);
        }
      }
      if (sorted.empty()) continue;
      const auto rank = sorted.begin() + static_cast<std::ptrdiff_t>(most * static_cast<double>(sorted.size() - 1));
      std::nth_element(sorted.begin(), rank, sorted.end());
      if (*rank > 0) return *rank;
    }
    return 0;
  }

  /// Whether a point that is drawn has more than the scale shows: bad designs do not count for its end.
  bool goes_beyond(const std::vector<std::vector<double>>& values, double high) const {
    for (const auto& of_method : values) {
      for (std::size_t i = 0; i < of_method.size(); ++i) {
        if (used_[i] && of_method[i] > high) return true;
      }
    }
    return false;
  }

  ComparisonPage::Gallery gallery(const std::string& title, double most, const Values& of) {
    std::vector<std::vector<double>> values;
    for (const ComparedMethod* method : shown_) values.push_back(of(*method));
    const double high = top(values, most);
    ComparisonPage::Gallery gallery{title, "0", number_text(high), {}};
    if (goes_beyond(values, high)) gallery.high += " and more";
    for (std::size_t m = 0; m < shown_.size(); ++m) {
      const ComparedDesign& design = made(*shown_[m]);
      for (double& value : values[m]) value = high > 0 ? value / high : 0;
      const ImageSource source{design.points, mesh_.face_sizes, mesh_.face_points, values[m], comparison_.hidden, design.flipped};
      const auto verdict = design.result.verdict();
      gallery.shots.push_back({shown_[m]->choice.label, verdict_name(verdict),
                               verdict == v1::VERDICT_GOOD  ? Mark::good
                               : verdict == v1::VERDICT_BAD ? Mark::bad
                                                            : Mark::none,
                               png_bytes(draw(source, view_, width, height))});
    }
    return gallery;
  }

  static constexpr std::size_t width = 480, height = 320;

  const MethodComparison& comparison_;
  const Mesh& mesh_;
  const std::size_t design_;
  std::vector<const ComparedMethod*> shown_;
  std::vector<char> used_;  // n: whether the point is drawn
  std::vector<Vec3> view_points_;
  View view_;
};

std::vector<ComparisonPage::Gallery> galleries_of(const MethodComparison& comparison, std::size_t design) {
  Gallery gallery(comparison, design);
  if (gallery.empty()) return {};
  std::vector<ComparisonPage::Gallery> galleries{gallery.displacements()};
  constexpr double rounding = 1e-9;  // roughness of surfaces that moved as a whole is less
  const bool bends = std::any_of(comparison.methods.begin(), comparison.methods.end(), [&](const ComparedMethod& method) {
    return method.refusals.empty() && method.designs[design].smoothness &&
           method.designs[design].smoothness->high_pass_energy > rounding;
  });
  if (bends) galleries.push_back(gallery.curvature_changes());
  return galleries;
}

std::vector<std::string> notes_of(const MethodComparison& comparison) {
  std::vector<std::string> notes{
      "Every method got the same mesh, handles, fixed regions, variables and constraints. The best values of a column are "
      "marked, those of bad designs left out.",
      "Misfit: the largest distance of a point of a handle or fixed region from where the design sends it, model units. Times "
      "are "
      "those of the server, a design alone, without checks of its quality; memory is that of the prepared system.",
      "Verdicts are those of the server: how far the result may be from the exact solution of the method's own equations, and "
      "whether faces are flipped or cells inverted. They do not say which method suits the shape."};
  const bool smooth = std::any_of(comparison.methods.begin(), comparison.methods.end(), [](const ComparedMethod& method) {
    return !method.designs.empty() && method.designs[0].smoothness.has_value();
  });
  if (smooth) {
    notes.push_back(
        "Roughness: the sum over the points of area times the square of the change of mean curvature less its mean over the "
        "neighbours, apart from sharp edges (30 degrees at rest, grey in the pictures); ripples have much, smooth bends little. "
        "Kink at borders: by how many degrees the largest jump of normals grew "
        "between handles, fixed regions and the rest.");
  }
  notes.push_back("Pictures: flipped faces are red. Of volume meshes the patches that handles hold are shown.");
  return notes;
}

}  // namespace

nlohmann::ordered_json comparison_json(const MethodComparison& comparison) {
  nlohmann::ordered_json json;
  json["setup"] = comparison.setup;
  json["points"] = comparison.mesh->point_count();
  json["at_rest"] = nlohmann::ordered_json::object();
  for (const ShownMeasure& shown : comparison.measures) json["at_rest"][shown.name] = shown.at_rest;
  json["designs"] = nlohmann::ordered_json::array();
  for (std::size_t d = 0; d < comparison.designs.size(); ++d) {
    json["designs"].push_back({{"name", comparison.designs[d]}, {"values", comparison.values[d]}});
  }
  json["methods"] = nlohmann::ordered_json::array();
  for (const ComparedMethod& method : comparison.methods) json["methods"].push_back(compared_json(method, comparison));
  return json;
}

void print_comparison(const MethodComparison& comparison, std::ostream& out) {
  print_table(methods_table(comparison), out);
  for (std::size_t d = 0; d < comparison.designs.size(); ++d) {
    out << '\n' << printable(comparison.designs[d]) << ": " << printable(comparison.values[d]) << '\n';
    print_table(design_table(comparison, d), out);
    for (const auto& remark : design_remarks(comparison, d)) out << "  " << printable(remark) << '\n';
  }
  out << std::flush;
}

void write_comparison_page(const MethodComparison& comparison, const std::filesystem::path& path) {
  ComparisonPage page;
  page.setup = comparison.setup;
  const Mesh& mesh = *comparison.mesh;
  page.about.push_back(std::to_string(mesh.point_count()) + " points, " + std::to_string(mesh.face_count()) + " faces" +
                       (mesh.cell_count() > 0 ? ", " + std::to_string(mesh.cell_count()) + " cells" : ""));
  page.methods = methods_table(comparison);
  for (std::size_t d = 0; d < comparison.designs.size(); ++d) {
    page.designs.push_back({comparison.designs[d], comparison.values[d], galleries_of(comparison, d), design_table(comparison, d),
                            design_remarks(comparison, d)});
  }
  page.notes = notes_of(comparison);
  page.program = std::string("deform ") + version();
  io::write_file(path, html_page(page));
}

}  // namespace deform::cli
