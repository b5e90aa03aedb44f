// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "core/base/error.h"
#include "core/base/text.h"
#include "core/io/assembly/coordinate_records.h"
#include "core/io/assembly/number_fields.h"
#include "core/io/formats/abaqus/abaqus_deck.h"
#include "core/io/formats/abaqus/abaqus_model.h"
#include "core/io/readers.h"

namespace deform::io {

namespace {

using Members = AbaqusModel::Members;

/// The largest number of characters of a number in Abaqus.
constexpr std::uint8_t longest_number = 20;

class AbaqusReader {
 public:
  AbaqusReader(DeckFile main, AbaqusDeck::Open open)
      : deck_(std::move(main), std::move(open)), model_([this](const AbaqusModel::Place& place, const std::string& message) {
          deck_.fail_at(place.file, place.at, message);
        }) {}

  ElementMesh read() {
    while (deck_.next()) {
      if (deck_.kind() == AbaqusDeck::Kind::keyword) {
        finish_element();
        read_keyword();
      } else {
        read_data();
      }
    }
    finish_element();
    if (model_.point_count() == 0) deck_.fail("the file has no nodes");
    return model_.finish();
  }

  std::deque<DeckFile>& files() { return deck_.files(); }
  /// By file.
  std::vector<std::vector<FieldRecord>> take_records() {
    records_.resize(deck_.files().size());
    return std::move(records_);
  }

 private:
  enum class Data { none, nodes, elements, set, surface, system };

  std::string required(const char* parameter) {
    const auto value = deck_.parameter(parameter);
    if (!value || value->empty()) deck_.fail("*" + deck_.keyword() + " without " + parameter);
    return *value;
  }

  void read_keyword() {
    const std::string& keyword = deck_.keyword();
    data_ = Data::none;
    if (keyword == "NODE") {
      begin_nodes();
    } else if (keyword == "ELEMENT") {
      begin_elements();
    } else if (keyword == "NSET") {
      begin_set(Members::nodes, required("NSET"));
    } else if (keyword == "ELSET") {
      begin_set(Members::elements, required("ELSET"));
    } else if (keyword == "SURFACE") {
      begin_surface();
    } else if (keyword == "PART") {
      scope_ = model_.part(required("NAME"));
    } else if (keyword == "INSTANCE") {
      begin_instance();
    } else if (keyword == "ENDPART" || keyword == "ENDINSTANCE") {
      scope_ = 0;
    } else if (keyword == "SYSTEM") {
      data_ = Data::system;
    } else {
      for (const char* generator : {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY"}) {
        if (keyword != generator) continue;
        deck_.fail("*" + keyword + " makes or moves what does not stand in the file, which is not supported");
      }
    }
  }

  void begin_nodes() {
    const std::string system = upper_case(deck_.parameter("SYSTEM").value_or("R"));
    if (system != "R")
      deck_.fail("nodes in the coordinate system " + in_quotes(system) + ", only R, the rectangular one, is supported");
    data_ = Data::nodes;
    set_ = deck_.parameter("NSET").value_or("");
    include_input();
  }

  void begin_elements() {
    const std::string name = upper_case(required("TYPE"));
    type_ = abaqus_type(name);
    if (type_.use == AbaqusType::Use::unsupported) deck_.fail("elements of type " + in_quotes(name) + " are not supported");
    type_number_ = model_.add_type(type_);
    data_ = Data::elements;
    set_ = deck_.parameter("ELSET").value_or("");
    include_input();
  }

  /// The data lines may be in a separate file.
  void include_input() {
    if (const auto input = deck_.parameter("INPUT")) deck_.include(*input);
  }

  void begin_set(Members members, const std::string& name) {
    data_ = Data::set;
    set_ = name;
    set_members_ = members;
    generate_ = deck_.parameter("GENERATE").has_value();
    set_scope_ = scope_;
    if (const auto instance = deck_.parameter("INSTANCE")) set_scope_ = instance_scope(*instance);
    AbaqusModel::Set& set = model_.set(scope_, members, name);
    if (deck_.parameter("INTERNAL")) set.internal = true;
    if (const auto elements = deck_.parameter("ELSET"); elements && members == Members::nodes) {
      set.entries.push_back({0, 0, 1, *elements, set_scope_, place(), Members::elements});
    }
  }

  std::size_t instance_scope(const std::string& name) {
    const auto scope = model_.find_instance(name);
    if (!scope) deck_.fail("there is no instance " + in_quotes(name));
    return *scope;
  }

  void begin_surface() {
    const std::string type = upper_case(deck_.parameter("TYPE").value_or("ELEMENT"));
    if (type != "ELEMENT" && type != "NODE") return;
    data_ = Data::surface;
    set_ = required("NAME");
    model_.surface(scope_, set_).members = type == "NODE" ? Members::nodes : Members::elements;
  }

  /// Its points are those of its part, wherever it puts them; unless it has nodes of its own.
  void begin_instance() {
    const std::string name = required("NAME");
    const auto part = deck_.parameter("PART");
    scope_ = part ? model_.part(*part) : model_.add_part(name);
    if (part && !model_.has_nodes(scope_)) scope_ = model_.add_part(name);
    model_.name_instance(name, scope_);
  }

  AbaqusModel::Place place() const { return {deck_.file(), deck_.position()}; }

  void read_data() {
    switch (data_) {
      case Data::nodes:
        return read_node();
      case Data::elements:
        return read_element();
      case Data::set:
        return generate_ ? read_range() : read_members();
      case Data::surface:
        return read_surface();
      case Data::system:
        deck_.fail("*SYSTEM: nodes in a coordinate system of their own are not supported");
      case Data::none:
        break;
    }
  }

  std::int64_t integer(std::size_t i, const char* what) {
    const auto& fields = deck_.fields();
    const std::string_view text = i < fields.size() ? fields[i].text : std::string_view();
    const auto value = parse_integer(text);
    if (!value) deck_.fail(std::string("expected an integer as ") + what + ", found " + in_quotes(text));
    return *value;
  }

  void read_node() {
    const auto& fields = deck_.fields();
    const std::int64_t label = integer(0, "the number of a node");
    Vec3 point{};
    FieldRecord record;
    record.point = static_cast<PointId>(model_.point_count());
    for (std::size_t k = 0; k < 3; ++k) {
      NumberField& field = record.axes[k];
      field.width = longest_number;
      const std::size_t i = k + 1;
      if (i >= fields.size()) {
        field.at = deck_.line_end();
        field.missing = static_cast<std::uint16_t>(i + 1 - fields.size() - (deck_.ends_in_comma() ? 1 : 0));
        continue;
      }
      field.at = fields[i].at;
      field.length = static_cast<std::uint16_t>(fields[i].text.size());
      if (fields[i].text.empty()) continue;
      const auto value = parse_decimal(fields[i].text, DecimalStyle::abaqus);
      if (!value) deck_.fail("expected a finite number as a coordinate, found " + in_quotes(fields[i].text));
      point[k] = *value;
    }
    const std::uint32_t number = model_.add_node(scope_, label, point, place());
    if (!set_.empty()) model_.set(scope_, Members::nodes, set_).members.push_back(number);
    records_.resize(std::max<std::size_t>(records_.size(), deck_.file() + 1));
    records_[deck_.file()].push_back(record);
  }

  /// One element may take several lines: until it has all its nodes, or the last line does not end in a comma.
  void read_element() {
    std::size_t i = 0;
    if (!element_open_) {
      element_ = {integer(0, "the number of an element"), type_number_, place()};
      nodes_.clear();
      element_open_ = true;
      i = 1;
    }
    for (; i < deck_.fields().size(); ++i) {
      if (deck_.fields()[i].text.empty()) continue;
      if (type_.nodes != 0 && nodes_.size() == type_.nodes) {
        deck_.fail("element " + std::to_string(element_.label) + " has more than " + std::to_string(type_.nodes) + " nodes");
      }
      if (type_.use == AbaqusType::Use::other && !parse_integer(deck_.fields()[i].text)) continue;
      nodes_.push_back(integer(i, "a node of an element"));
    }
    if (type_.nodes != 0 ? nodes_.size() == type_.nodes : !deck_.ends_in_comma()) finish_element();
  }

  void finish_element() {
    if (!element_open_) return;
    element_open_ = false;
    if (nodes_.size() < type_.nodes) {
      deck_.fail_at(element_.place.file, element_.place.at,
                    "element " + std::to_string(element_.label) + " has " + std::to_string(nodes_.size()) + " nodes, expected " +
                        std::to_string(type_.nodes));
    }
    const std::uint32_t number = model_.add_element(scope_, element_, nodes_);
    if (!set_.empty()) model_.set(scope_, Members::elements, set_).members.push_back(number);
  }

  void read_members() {
    AbaqusModel::Set& set = model_.set(scope_, set_members_, set_);
    for (const AbaqusDeck::Field& field : deck_.fields()) {
      if (field.text.empty()) continue;
      AbaqusModel::Set::Entry entry;
      entry.scope = set_scope_;
      entry.place = place();
      entry.of = set_members_;
      if (const auto label = parse_integer(field.text)) {
        entry.first = entry.last = *label;
      } else {
        entry.name = unquoted(field.text);
      }
      set.entries.push_back(std::move(entry));
    }
  }

  void read_range() {
    AbaqusModel::Set::Entry entry;
    entry.scope = set_scope_;
    entry.place = place();
    entry.first = integer(0, "the first label of a range");
    entry.last =
        deck_.fields().size() > 1 && !deck_.fields()[1].text.empty() ? integer(1, "the last label of a range") : entry.first;
    if (deck_.fields().size() > 2 && !deck_.fields()[2].text.empty()) entry.step = integer(2, "the step of a range");
    if (entry.step < 1 || entry.last < entry.first) {
      deck_.fail("a range from " + std::to_string(entry.first) + " to " + std::to_string(entry.last) + " in steps of " +
                 std::to_string(entry.step));
    }
    model_.set(scope_, set_members_, set_).entries.push_back(std::move(entry));
  }

  void read_surface() {
    const auto& fields = deck_.fields();
    AbaqusModel::Surface::Entry entry;
    entry.what = unquoted(fields[0].text);
    entry.scope = scope_;
    entry.place = place();
    if (fields.size() > 1) entry.face = std::string(fields[1].text);
    // A line without a set means all free faces of the model, or refines them.
    if (!entry.what.empty()) model_.surface(scope_, set_).entries.push_back(std::move(entry));
  }

  static std::string unquoted(std::string_view text) {
    if (text.size() > 1 && text.front() == '"' && text.back() == '"') text = text.substr(1, text.size() - 2);
    return std::string(text);
  }

  AbaqusDeck deck_;
  AbaqusModel model_;
  std::vector<std::vector<FieldRecord>> records_;
  AbaqusModel::Scope scope_ = 0, set_scope_ = 0;
  Data data_ = Data::none;
  std::string set_;  // the set or surface that data lines add to; empty: none
  Members set_members_ = Members::nodes;
  bool generate_ = false;
  AbaqusType type_;
  std::uint32_t type_number_ = 0;
  AbaqusModel::NewElement element_;
  bool element_open_ = false;
  std::vector<std::int64_t> nodes_;
};

/// A deck and the files that it includes.
class AbaqusMeshFile : public MeshFile {
 public:
  AbaqusMeshFile(std::deque<DeckFile>&& files, std::vector<std::vector<FieldRecord>>&& records, std::shared_ptr<const Mesh> mesh)
      : MeshFile(Format::abaqus, std::move(mesh)), files_(std::move(files)), records_(std::move(records)) {}

  std::string with_points(std::span<const Vec3> points) const override {
    std::vector<FilePart> parts = parts_with_points(points);
    for (std::size_t i = 1; i < parts.size(); ++i) {
      if (parts[i].bytes == files_[i].bytes) continue;
      throw Error(ErrorCode::failed_precondition, files_[0].name + ": nodes stand in " + files_[i].name +
                                                      ", which it includes, so they cannot be written in one file");
    }
    return std::move(parts[0].bytes);
  }

  std::vector<FilePart> parts_with_points(std::span<const Vec3> points) const override {
    check_points(points, original_points().size());
    std::vector<FilePart> parts;
    for (std::size_t i = 0; i < files_.size(); ++i) {
      parts.push_back({files_[i].input, files_[i].original,
                       with_number_fields(files_[i].bytes, records_[i], original_points(), points, DecimalStyle::abaqus)});
    }
    return parts;
  }

 private:
  const std::deque<DeckFile> files_;
  const std::vector<std::vector<FieldRecord>> records_;
};

std::unique_ptr<MeshFile> read(DeckFile main, const AbaqusDeck::Open& open) {
  const std::string name = main.name;
  AbaqusReader reader(std::move(main), open);
  std::shared_ptr<const Mesh> mesh = mesh_of(reader.read(), name);
  return std::make_unique<AbaqusMeshFile>(std::move(reader.files()), reader.take_records(), std::move(mesh));
}

std::unique_ptr<MeshFile> parse_abaqus(std::string bytes, const std::string& name) {
  return read({name, std::move(bytes), {}, {}}, {});
}

std::unique_ptr<MeshFile> parse_with_includes(std::string bytes, const std::filesystem::path& path) {
  const std::filesystem::path folder = path.parent_path();
  return read({path.string(), std::move(bytes), {}, path}, [folder](const std::string& input) {
    const std::filesystem::path original = folder / input;
    return DeckFile{original.string(), read_file(original), input, original};
  });
}

}  // namespace

Reader abaqus_reader() {
  return {.format = Format::abaqus,
          .name = "Abaqus",
          .extensions = {".inp"},
          .parse = parse_abaqus,
          .parse_with_includes = parse_with_includes};
}

}  // namespace deform::io
