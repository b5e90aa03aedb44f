// SPDX-License-Identifier: Apache-2.0
#include "core/report/comparison_page.h"

#include "core/base/base64.h"
#include "core/base/text.h"
#include "core/report/image.h"
#include "core/report/page_head.h"

namespace deform {

namespace {

using Mark = ComparisonPage::Mark;

std::string class_of(Mark mark) { return mark == Mark::good ? " class=\"good\"" : mark == Mark::bad ? " class=\"bad\"" : ""; }

void append_compared(std::string& out, const ComparisonPage::Row& row, std::size_t columns) {
  out += "<tr><td>" + markup_text(row.method) + "</td>";
  if (!row.refusals.empty()) {
    out += "<td class=\"refused\" colspan=\"" + std::to_string(columns) + "\"><b class=\"bad\">refused</b>";
    for (const auto& reason : row.refusals) out += "<br>" + markup_text(reason);
    out += "</td></tr>\n";
    return;
  }
  for (const auto& cell : row.cells) out += "<td" + class_of(cell.mark) + ">" + markup_text(cell.text) + "</td>";
  out += "</tr>\n";
}

void append_table(std::string& out, const ComparisonPage::Table& table) {
  out += "<div class=\"scroll\"><table>\n<thead><tr><th>method</th>";
  for (const auto& column : table.columns) out += "<th>" + markup_text(column) + "</th>";
  out += "</tr></thead>\n<tbody>\n";
  for (const auto& row : table.rows) append_compared(out, row, table.columns.size());
  out += "</tbody></table></div>\n";
}

void append_gallery(std::string& out, const ComparisonPage::Gallery& gallery) {
  out += "<h3>" + markup_text(gallery.title) + "</h3>\n<p class=\"scale\">" + markup_text(gallery.low) +
         "<i style=\"background:" + scale_gradient() + "\"></i>" + markup_text(gallery.high) + "</p>\n<div class=\"shots\">\n";
  for (const auto& shot : gallery.shots) {
    out += "<figure>\n<img alt=\"" + markup_text(gallery.title + ", " + shot.caption) + "\" src=\"data:image/png;base64," +
           base64_encoded(shot.png) + "\">\n<figcaption>" + markup_text(shot.caption);
    if (!shot.note.empty()) out += " <span" + class_of(shot.mark) + ">" + markup_text(shot.note) + "</span>";
    out += "</figcaption>\n</figure>\n";
  }
  out += "</div>\n";
}

void append_design(std::string& out, const ComparisonPage::Design& design) {
  out += "<section>\n<h2>" + markup_text(design.name) + "</h2>\n<p class=\"soft\">" + markup_text(design.values) + "</p>\n";
  for (const auto& gallery : design.galleries) append_gallery(out, gallery);
  append_table(out, design.table);
  for (const auto& remark : design.remarks) out += "<p class=\"soft\">" + markup_text(remark) + "</p>\n";
  out += "</section>\n";
}

}  // namespace

std::string html_page(const ComparisonPage& page) {
  std::string out = quality::page_head("Methods compared for " + page.setup, "img-src data:");
  out += "<header>\n<p class=\"kind\">Methods compared</p>\n<h1>" + markup_text(page.setup) + "</h1>\n";
  for (const auto& line : page.about) out += "<p>" + markup_text(line) + "</p>\n";
  out += "</header>\n<section>\n<h2>Methods</h2>\n";
  append_table(out, page.methods);
  out += "</section>\n";
  for (const auto& design : page.designs) append_design(out, design);
  out += "<section>\n<h2>How it was measured</h2>\n";
  for (const auto& note : page.notes) out += "<p class=\"soft\">" + markup_text(note) + "</p>\n";
  return out + "</section>\n<footer>Written by " + markup_text(page.program) + ".</footer>\n</body>\n</html>\n";
}

}  // namespace deform
