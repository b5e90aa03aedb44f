// SPDX-License-Identifier: GPL-3.0-or-later
// The schema of setups: what it says of setups that the reader takes and of those that it refuses. It is judged by the part of
// JSON Schema that it uses, written down here.
#include "client/cli/setup/setup_schema.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "client/cli/setup/reading.h"
#include "core/base/error.h"
#include "deform/v1/setup.pb.h"

namespace deform::cli::setup_schema_test {
namespace {

using Document = nlohmann::ordered_json;

class Validator {
 public:
  bool takes(const Document& value) const { return takes(root_, value); }

 private:
  bool takes(const Document& schema, const Document& value) const {
    for (const auto& [word, rule] : schema.items()) {
      if (!obeys(word, rule, schema, value)) return false;
    }
    return true;
  }

  bool obeys(const std::string& word, const Document& rule, const Document& schema, const Document& value) const {
    const auto holds = [&](const Document& each) { return takes(each, value); };
    if (word == "$ref") return holds(root_.at(Document::json_pointer(rule.get<std::string>().substr(1))));
    if (word == "type") return of_type(rule, value);
    if (word == "enum") return std::find(rule.begin(), rule.end(), value) != rule.end();
    if (word == "anyOf") return std::any_of(rule.begin(), rule.end(), holds);
    if (word == "allOf") return std::all_of(rule.begin(), rule.end(), holds);
    if (word == "oneOf") return std::count_if(rule.begin(), rule.end(), holds) == 1;
    if (word == "not") return !holds(rule);
    if (word == "minimum") return !value.is_number() || value.get<double>() >= rule.get<double>();
    if (word == "maximum") return !value.is_number() || value.get<double>() <= rule.get<double>();
    if (word == "minLength") return !value.is_string() || value.get<std::string>().size() >= rule;
    if (word == "items") {
      return !value.is_array() ||
             std::all_of(value.begin(), value.end(), [&](const Document& item) { return takes(rule, item); });
    }
    if (word == "minProperties") return !value.is_object() || value.size() >= rule;
    if (word == "maxProperties") return !value.is_object() || value.size() <= rule;
    if (word == "required") {
      return !value.is_object() ||
             std::all_of(rule.begin(), rule.end(), [&](const Document& key) { return value.contains(key); });
    }
    if (word == "properties") {
      for (const auto& [key, inner] : rule.items()) {
        if (value.is_object() && value.contains(key) && !takes(inner, value.at(key))) return false;
      }
      return true;
    }
    if (word == "additionalProperties") {
      if (!value.is_object()) return true;
      for (const auto& entry : value.items()) {
        if (!schema.at("properties").contains(entry.key())) return false;
      }
      return true;
    }
    EXPECT_TRUE(word == "$schema" || word == "title" || word == "$defs" || word == "description" || word == "contentEncoding")
        << word;
    return true;
  }

  static bool of_type(const std::string& type, const Document& value) {
    return type == "object"    ? value.is_object()
           : type == "array"   ? value.is_array()
           : type == "string"  ? value.is_string()
           : type == "boolean" ? value.is_boolean()
           : type == "integer" ? value.is_number_integer()
                               : value.is_number();
  }

  const Document root_ = setup_schema();
};

bool is_read(const std::string& json) {
  v1::Setup setup;
  ValueFiles files;
  files.ids = [](const std::string&, const std::string&) { return std::vector<std::uint32_t>{1}; };
  files.bytes = [](const std::string&) { return std::string(24, '\0'); };
  files.names = [](std::string_view) { return 2.0; };
  Problems problems(Problems::Mode::throw_first);
  try {
    parse_yaml(json, "setup.json", setup, files, problems);
  } catch (const Error&) {
    return false;
  }
  return true;
}

TEST(SetupSchema, TakesAndRefusesWhatTheReaderDoes) {
  const Validator schema;
  struct Case {
    const char* json;
    bool right;
  };
  const Case cases[] = {
      {R"({"geometry": "a.obj"})", true},
      {R"({"geometry": "a", "method": {"rbf": {"kernel": "QUINTIC", "polynomial_degree": 2, "shape": 0.5}}})", true},
      {R"({"geometry": "a", "method": {"rbf": {"kernel": "quintic"}}})", false},
      {R"({"geometry": "a", "method": {"rbf": {"kernels": "QUINTIC"}}})", false},
      {R"({"geometry": "a", "method": {"rbf": {}, "shell": {}}})", false},
      {R"({"geometry": "a", "method": {"ffd": {"lattice": {"points": [5, 6, 7], "frame": {"origin": [0, 0, 0]}}}}})", true},
      {R"({"geometry": "a", "method": {"ffd": {"lattice": {"box": {}, "frame": {}}}}})", false},
      {R"({"geometry": "a", "method": {"ffd": {"lattice": {"control_points": {"file": "m.vtp"}}}}})", true},
      {R"({"geometry": "a", "method": {"ffd": {"lattice": {"control_points": {"fil": "m.vtp"}}}}})", false},
      {R"({"geometry": "a", "handles": [{"name": "h", "region": {"group": "g"}}]})", true},
      {R"({"geometry": "a", "handles": {"name": "h"}})", false},
      {R"({"geometry": "a", "fixed": [{"patch": {"seed": [0, 1, 2], "angle": 20}}, {"patch": {"point": 3}}]})", true},
      {R"({"geometry": "a", "fixed": [{"ids": {"file": "p.json", "set": "s"}}, {"ids": [1, 2]}]})", true},
      {R"({"geometry": "a", "fixed": [{"ids": [-1]}]})", false},
      {R"({"geometry": "a", "fixed": [{"ids": [4294967296]}]})", false},
      {R"({"geometry": "a", "fixed": [{"ids": [1.5]}]})", false},
      {R"({"geometry": "a", "fixed": [{"difference": [{"all": true}, {"complement": {"union": [{"group": "g"}]}}]}]})", true},
      {R"({"geometry": "a", "fixed": [{"open_boundary": 1}]})", false},
      {R"({"geometry": "a", "variables": [{"name": "v", "handle": "h", "translate": [0, 0, "Lz/2"], "upper": "0.05*L"}]})", true},
      {R"({"geometry": "a", "variables": [{"name": "v", "handle": "h", "rotate": {"axis": [0, 0, 1], "unit": "DEGREES"},
           "also": [{"handle": "k"}]}]})",
       true},
      {R"({"geometry": "a", "variables": [{"name": "v", "rotate": {"unit": "GRAD"}}]})", false},
      {R"({"geometry": "a", "variables": [{"upper": [1]}]})", false},
      {R"({"geometry": "a", "constraints": [{"name": "c", "rigid": {"layers": 2}, "exact": true}]})", true},
      {R"({"geometry": "a", "constraints": [{"name": "c", "rigid": {}, "planar": {}}]})", false},
      {R"({"geometry": "a", "seed": 18446744073709551615})", true},
      {R"({"geometry": "a", "seed": -1})", false},
      {R"({"geometri": "a"})", false},
      {R"([])", false},
  };
  for (const Case& each : cases) {
    EXPECT_EQ(schema.takes(Document::parse(each.json)), each.right) << each.json;
    // Expressions are words without quotes in YAML; JSON has them in quotes only, which the reader takes for texts.
    std::string yaml = each.json;
    for (const char* word : {"Lz/2", "0.05*L"}) {
      const std::string quoted = '"' + std::string(word) + '"';
      if (const auto place = yaml.find(quoted); place != std::string::npos) yaml.replace(place, quoted.size(), word);
    }
    EXPECT_EQ(is_read(yaml), each.right) << yaml;
  }
}

TEST(SetupSchema, RefusesWhatOnlyTheServerRefuses) {
  const Validator schema;
  EXPECT_FALSE(schema.takes(Document::parse(R"({"method": {"rbf": {}}})"))) << "no geometry";
  EXPECT_FALSE(schema.takes(Document::parse(R"({"geometry": "a", "fixed": [{"group": "g", "all": true}]})")));
  EXPECT_FALSE(schema.takes(Document::parse(R"({"geometry": "a", "fixed": [{}]})")));
}

}  // namespace
}  // namespace deform::cli::setup_schema_test
