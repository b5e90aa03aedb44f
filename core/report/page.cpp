// SPDX-License-Identifier: Apache-2.0
#include "core/report/page.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <type_traits>

#include "core/base/base64.h"
#include "core/base/text.h"
#include "core/report/page_head.h"

namespace deform {

namespace {

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.6g", value);
  return text;
}

/// All digits, for the script; JSON-like numbers only.
std::string exact(double value) {
  if (!std::isfinite(value)) return "0";
  char text[40];
  std::snprintf(text, sizeof(text), "%.17g", value);
  return text;
}

std::string vector_text(const Vec3& v, const char* separator, std::string (*text)(double)) {
  return text(v[0]) + separator + text(v[1]) + separator + text(v[2]);
}

/// The bytes of numbers, lowest first.
template <typename T>
std::string little_endian(const std::vector<T>& values) {
  using Bits = std::conditional_t<sizeof(T) == 2, std::uint16_t, std::uint32_t>;
  std::string bytes;
  bytes.reserve(sizeof(T) * values.size());
  for (const T value : values) {
    const auto bits = std::bit_cast<Bits>(value);
    for (std::size_t k = 0; k < sizeof(T); ++k) bytes += static_cast<char>(bits >> (8 * k));
  }
  return bytes;
}

void append_header(std::string& out, const QualityPage& page) {
  out += "<header>\n<p class=\"kind\">Mesh quality</p>\n<h1>" + markup_text(page.file) + "</h1>\n";
  if (page.before) out += "<p class=\"soft\">Compared with " + markup_text(page.before_file) + "</p>\n";
  std::string counts;
  for (const auto& [name, count] : page.after.counts) {
    if (count == 0) continue;
    std::string noun = name;
    std::replace(noun.begin(), noun.end(), '_', ' ');
    counts += (counts.empty() ? "" : ", ") + std::to_string(count) + " " + markup_text(noun);
  }
  out += "<p>" + counts + "</p>\n";
  if (!page.gates.empty()) {
    out += "<ul class=\"gates\">\n";
    for (const auto& gate : page.gates) {
      out += std::string("<li class=\"") + (gate.failed ? "bad\">failed: " : "good\">passed: ") + markup_text(gate.condition) +
             (gate.failed ? " holds, it is " : " does not hold, it is ") + number(gate.value) + "</li>\n";
    }
    out += "</ul>\n";
  }
  for (const auto& note : page.notes) out += "<p class=\"soft\">" + markup_text(note) + "</p>\n";
  out += "</header>\n";
}

/// The change of a value, highlighted if significant.
std::string change_cell(const QualityRow& row, double before) {
  const double change = row.value - before;
  if (change == 0) return "<td class=\"soft\">0</td>";
  const char* mark = "";
  constexpr double worth_a_colour = 1e-3;
  if (std::abs(change) <= worth_a_colour * std::abs(before)) {
    mark = " class=\"soft\"";
  } else if (row.better != Better::neither) {
    mark = (change > 0) == (row.better == Better::higher) ? " class=\"good\"" : " class=\"bad\"";
  }
  std::string text = change > 0 ? "+" : "";
  text += number(change);
  if (before != 0 && std::isfinite(change)) {
    char percent[32];
    std::snprintf(percent, sizeof(percent), " (%+.2g %%)", 100 * change / std::abs(before));
    if (std::abs(change) < 10 * std::abs(before)) text += percent;
  }
  return std::string("<td") + mark + ">" + text + "</td>";
}

void append_measures(std::string& out, const QualityPage& page) {
  out += "<section>\n<h2>Measures</h2>\n<div class=\"scroll\"><table>\n<thead><tr><th>measure</th>";
  out += page.before ? "<th>before</th><th>after</th><th>change</th>" : "<th>value</th>";
  out += "<th>where (id)</th></tr></thead>\n<tbody>\n";
  for (const QualityRow& row : page.after.rows) {
    if (!row.in_table) continue;
    out += "<tr><td>" + markup_text(row.label) + "</td>";
    if (page.before) {
      const QualityRow* before = page.before->find(row.name);
      out += "<td>" + (before ? number(before->value) : "") + "</td><td>" + number(row.value) + "</td>";
      out += before ? change_cell(row, before->value) : "<td></td>";
    } else {
      out += "<td>" + number(row.value) + "</td>";
    }
    out += "<td>" + (row.id ? std::to_string(*row.id) : "") + "</td></tr>\n";
  }
  out += "</tbody></table></div>\n<p class=\"soft\">" + markup_text(page.after.method) + "</p>\n</section>\n";
}

/// The checks that failed; those that `before` did not fail with the same count are marked.
void append_failed_checks(std::string& out, const QualityPage& page) {
  if (page.after.failed.empty()) return;
  out += "<section>\n<h2>Failed checks</h2>\n<ul>\n";
  for (const std::string& check : page.after.failed) {
    const bool same = page.before && std::count(page.before->failed.begin(), page.before->failed.end(), check) > 0;
    out += (same ? "<li class=\"soft\">" : "<li class=\"bad\">") + markup_text(check) + (same ? " (as before)" : "") + "</li>\n";
  }
  out += "</ul>\n</section>\n";
}

void append_constraints(std::string& out, const QualityPage& page) {
  if (page.constraints.empty()) return;
  out +=
      "<section>\n<h2>Constraints</h2>\n<div class=\"scroll\"><table>\n<thead><tr><th>constraint</th><th>largest</th><th>rms</th>"
      "<th>largest without</th><th>rms without</th><th></th></tr></thead>\n<tbody>\n";
  for (const auto& constraint : page.constraints) {
    out += "<tr><td>" + markup_text(constraint.name) + "</td>";
    for (const double value : {constraint.largest, constraint.rms, constraint.free_largest, constraint.free_rms}) {
      out += "<td>" + number(value) + "</td>";
    }
    out += constraint.missed ? "<td class=\"bad\">not exact</td></tr>\n" : "<td></td></tr>\n";
  }
  out +=
      "</tbody></table></div>\n<p class=\"soft\">Residuals: how far the points are from the shape that fits them best, of a "
      "distance "
      "the error of the distance; without any constraint on the right.</p>\n</section>\n";
}

/// Bars of `after`, and the outline of `before` over them; heights are shares of all, so that other numbers of cells compare.
class Plot {
 public:
  Plot(const QualityHistogram& after, const QualityHistogram* before) : after_(after), before_(before) {
    if (before_ && before_->counts.size() != after_.counts.size()) before_ = nullptr;
    highest_ = std::max(highest(after_), before_ ? highest(*before_) : 0);
  }

  std::string svg() const {
    std::string out = "<svg viewBox=\"0 0 440 190\" role=\"img\" aria-label=\"" + markup_text(after_.title) + "\">\n";
    const std::size_t n = after_.counts.size();
    const double step = width / static_cast<double>(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double size = height_of(after_, i), left = x0 + step * static_cast<double>(i);
      if (after_.counts[i] == 0) continue;
      out += "<rect class=\"after\" x=\"" + number(left + 0.5) + "\" y=\"" + number(y0 - size) + "\" width=\"" +
             number(step - 1) + "\" height=\"" + number(size) + "\"><title>" + bin_text(i) + "</title></rect>\n";
    }
    if (before_) {
      out += "<path class=\"before\" d=\"M" + number(x0) + " " + number(y0);
      for (std::size_t i = 0; i < n; ++i) {
        out.append("V").append(number(y0 - height_of(*before_, i))).append("h").append(number(step));
      }
      out.append("V").append(number(y0)).append("\"/>\n");
    }
    out += "<path class=\"axis\" d=\"M" + number(x0) + " " + number(y0) + "h" + number(width) + "\"/>\n";
    for (int tick = 0; tick <= 4; ++tick) {
      const double value = after_.low + (after_.high - after_.low) * tick / 4;
      const char* anchor = tick == 0 ? "start" : tick == 4 ? "end" : "middle";
      out += "<text x=\"" + number(x0 + width * tick / 4) + "\" y=\"" + number(y0 + 16) + "\" text-anchor=\"" + anchor + "\">" +
             number(value) + "</text>\n";
    }
    char share[32];
    std::snprintf(share, sizeof(share), "%.3g %%", 100 * highest_);
    return out + "<text x=\"" + number(x0) + "\" y=\"12\">" + share + "</text>\n</svg>\n";
  }

 private:
  static constexpr double x0 = 4, y0 = 166, width = 432, tallest = 146;

  static double total(const QualityHistogram& histogram) {
    double sum = 0;
    for (const std::size_t count : histogram.counts) sum += static_cast<double>(count);
    return sum > 0 ? sum : 1;
  }
  static double highest(const QualityHistogram& histogram) {
    std::size_t most = 0;
    for (const std::size_t count : histogram.counts) most = std::max(most, count);
    return static_cast<double>(most) / total(histogram);
  }
  /// What is there stays visible.
  double height_of(const QualityHistogram& histogram, std::size_t bin) const {
    if (histogram.counts[bin] == 0 || highest_ == 0) return 0;
    return std::max(1.0, tallest * static_cast<double>(histogram.counts[bin]) / total(histogram) / highest_);
  }
  std::string bin_text(std::size_t bin) const {
    const double step = (after_.high - after_.low) / static_cast<double>(after_.counts.size());
    const double low = after_.low + step * static_cast<double>(bin);
    std::string text = number(low) + " to " + number(low + step) + ": " + std::to_string(after_.counts[bin]);
    if (before_) text += ", before " + std::to_string(before_->counts[bin]);
    return text;
  }

  const QualityHistogram& after_;
  const QualityHistogram* before_;
  double highest_ = 0;
};

void append_histograms(std::string& out, const QualityPage& page) {
  if (page.after.histograms.empty()) return;
  out += "<section>\n<h2>Distributions</h2>\n<div class=\"plots\">\n";
  for (const QualityHistogram& histogram : page.after.histograms) {
    const QualityHistogram* before = nullptr;
    if (page.before) {
      for (const auto& candidate : page.before->histograms) {
        if (candidate.name == histogram.name) before = &candidate;
      }
    }
    out += "<figure>\n<figcaption>" + markup_text(histogram.title) + "</figcaption>\n" + Plot(histogram, before).svg();
    if (before) out += "<p class=\"key\"><i class=\"after\"></i>after<i class=\"before\"></i>before</p>\n";
    out += "</figure>\n";
  }
  out += "</div>\n</section>\n";
}

void append_worst(std::string& out, const QualityPage& page) {
  constexpr std::size_t most_shown = 20;
  out += "<section>\n<h2>Worst</h2>\n";
  for (const WorstList& list : page.after.worst) {
    if (list.entries.empty()) continue;
    const bool values = list.entries.front().value.has_value();
    out += "<h3>" + markup_text(list.title) + "</h3>\n<div class=\"scroll\"><table>\n<thead><tr><th>" + markup_text(list.noun) +
           "</th>" + (values ? "<th>value</th>" : "") + "<th>x</th><th>y</th><th>z</th><th></th></tr></thead>\n<tbody>\n";
    for (std::size_t i = 0; i < std::min(most_shown, list.entries.size()); ++i) {
      const auto& entry = list.entries[i];
      out += "<tr><td>" + std::to_string(entry.id) + "</td>";
      if (values) out += "<td>" + number(entry.value.value_or(0)) + "</td>";
      out += "<td>" + vector_text(entry.position, "</td><td>", number) + "</td><td>";
      if (page.picture) {
        out += "<button type=\"button\" hidden data-at=\"" + vector_text(entry.position, ",", exact) + "\">show</button>";
      }
      out += "</td></tr>\n";
    }
    out += "</tbody></table></div>\n";
    if (list.entries.size() > most_shown) {
      out += "<p class=\"soft\">The first " + std::to_string(most_shown) + "; <code>--json</code> lists more.</p>\n";
    }
  }
  out += "</section>\n";
}

void append_data(std::string& out, const std::string& id, const std::string& attributes, std::string_view bytes) {
  out += "<script type=\"text/plain\" id=\"" + id + "\"" + attributes + ">" + base64_encoded(bytes) + "</script>\n";
}

void append_picture_data(std::string& out, const Picture& picture) {
  append_data(out, "data-points", "", little_endian(picture.points));
  if (!picture.before.empty()) append_data(out, "data-before", "", little_endian(picture.before));
  append_data(out, "data-corners", "", little_endian(picture.corners));
  append_data(out, "data-edges", "", {reinterpret_cast<const char*>(picture.edges.data()), picture.edges.size()});
  append_data(out, "data-part", "", little_endian(picture.part));
  constexpr const char* ends[] = {"neither", "lower", "higher"};
  for (std::size_t i = 0; i < picture.fields.size(); ++i) {
    const auto& field = picture.fields[i];
    const std::string attributes = " data-field=\"" + markup_text(field.label) + "\" data-of=\"" +
                                   (field.of == PictureField::Of::faces ? "faces" : "points") + "\" data-better=\"" +
                                   ends[static_cast<int>(field.better)] + "\" data-low=\"" + exact(field.low) +
                                   "\" data-high=\"" + exact(field.high) + "\" data-clipped=\"" +
                                   (field.clipped ? "true" : "false") + "\"";
    append_data(out, "data-field-" + std::to_string(i), attributes, little_endian(field.values));
  }
}

void append_parts(std::string& out, const Picture& picture) {
  if (picture.parts.size() < 2) return;
  out += "<details><summary>Parts</summary>\n<div class=\"parts\">\n";
  for (const auto& part : picture.parts) {
    out += std::string("<label><input type=\"checkbox\" data-part") + (part.shown ? " checked" : "") + "> " +
           (part.name.empty() ? "<em>in no group</em>" : markup_text(part.name)) + "</label>\n";
  }
  out +=
      "</div>\n<button type=\"button\" id=\"all-parts\">all</button> <button type=\"button\" id=\"no-parts\">none</button>\n"
      "</details>\n";
}

void append_picture(std::string& out, const QualityPage& page) {
  if (!page.picture || page.picture->triangles() == 0) return;
  const Picture& picture = *page.picture;
  out +=
      "<section>\n<h2>Surface</h2>\n<div class=\"tools\">\n<label>Colour <select id=\"field\"></select></label>\n"
      "<span class=\"legend\"><span id=\"low\"></span><span id=\"ramp\"></span><span id=\"high\"></span></span>\n";
  if (!picture.before.empty()) {
    out += "<label>before <input type=\"range\" id=\"morph\" min=\"0\" max=\"100\" value=\"100\"> after</label>\n";
  }
  const bool few = picture.triangles() <= 60'000;  // more edges than that hide the colours
  out += std::string("<label><input type=\"checkbox\" id=\"wires\"") + (few ? " checked" : "") + "> edges</label>\n";
  out += "<label title=\"leave out what looks at you\"><input type=\"checkbox\" id=\"inside\"> inside</label>\n<span>";
  for (const char* side : {"x", "y", "z"}) {
    out += std::string("<button type=\"button\" data-side=\"") + side + "\" title=\"look along " + side + "\">" + side +
           "</button> ";
  }
  out += "<button type=\"button\" id=\"reset\">reset</button></span>\n</div>\n";
  append_parts(out, picture);
  out += "<div id=\"view\" data-centre=\"" + vector_text(picture.centre, ",", exact) + "\" data-scale=\"" + exact(picture.scale) +
         "\"><canvas id=\"canvas\" tabindex=\"0\" aria-label=\"The surface in space\"></canvas><div id=\"mark\" "
         "hidden></div></div>\n"
         "<p class=\"soft\">Drag to turn, wheel or pinch to zoom, right button or two fingers to move, double click to reset. ";
  out += std::to_string(picture.triangles()) + " triangles";
  if (picture.grid > 0) {
    out += " of " + std::to_string(picture.all_triangles) + ": thinned by merging points within a grid of " +
           std::to_string(picture.grid) + " cells along the box; the numbers on this page are those of the whole mesh";
  }
  out += ".<span id=\"without\"></span></p>\n<noscript><p>The picture needs JavaScript.</p></noscript>\n</section>\n";
  append_picture_data(out, picture);
}

}  // namespace

std::string html_page(const QualityPage& page) {
  std::string out = quality::page_head("Mesh quality of " + page.file, "script-src 'unsafe-inline'");
  append_header(out, page);
  append_failed_checks(out, page);
  append_measures(out, page);
  append_constraints(out, page);
  append_picture(out, page);
  append_histograms(out, page);
  append_worst(out, page);
  out += "<footer>Written by " + markup_text(page.program) + ".</footer>\n<script>\n";
  out += quality::page_script();
  out += "</script>\n</body>\n</html>\n";
  return out;
}

}  // namespace deform
