// SPDX-License-Identifier: GPL-3.0-or-later
#include <google/protobuf/util/json_util.h>

#include <stdexcept>

#include "deform/v1/setup.pb.h"
#include "proto/convert/setup.h"
#include "tests/wire/vectors.h"

namespace deform::wire {

namespace {

enum class Geometry { flat, solid };  ///< whether all points have the same z

struct SetupCase {
  const char* name;
  const char* json;
  Geometry geometry = Geometry::solid;
};

constexpr SetupCase cases[] = {
    {"no method", R"({"handles": [{"name": "roof", "region": {"group": "roof"}}]})"},
    {"no method, flat geometry", R"({"handles": [{"name": "roof", "region": {"group": "roof"}}]})", Geometry::flat},
    {"an empty method",
     R"({"method": {"rbf": {}}, "handles": [{"name": "a", "region": {"all": true}}], "seed": "18446744073709551615"})"},
    {"defaults said",
     R"({"method": {"rbf": {"kernel": "TRIHARMONIC", "polynomialDegree": 1, "reductionRings": 3, "tolerance": 1e-6}},
         "handles": [{"name": "roof", "region": {"group": "roof"}}]})"},
    {"rings as they are said", R"({"method": {"rbf": {"reduction": "REDUCTION_RINGS", "reductionTolerance": 0.01}},
         "handles": [{"name": "roof", "region": {"group": "roof"}}]})"},
    {"a reduction tolerance", R"({"method": {"rbf": {"reduction": "REDUCTION_TOLERANCE", "reductionTolerance": 0.001,
         "reductionRings": 4}}, "handles": [{"name": "roof", "region": {"group": "roof"}}]})"},
    {"incremental QR with rings", R"({"method": {"rbf": {"solver": "INCREMENTAL_QR", "reductionRings": 2}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"shape of a kernel without shape",
     R"({"method": {"rbf": {"kernel": "BIHARMONIC", "shape": 0.25, "solver": "CHOLESKY", "tolerance": 1e-8, "centreOrder": "GREEDY",
         "samples": [{"variables": [1]}]}}, "handles": [{"name": "a", "region": {"boundary": true}}]})"},
    {"negative zeros", R"({"method": {"rbf": {"kernel": "GAUSSIAN", "shape": -0.0, "tolerance": -0.0, "polynomialDegree": 0}},
         "handles": [{"name": "a", "region": {"sphere": {"centre": [-0.0, 0, 1], "radius": 0}}}]})"},
    {"shapes and rings",
     R"({"method": {"rbf": {"kernel": "WENDLAND_C2", "shape": 0.75, "solver": "SOLVER_AUTOMATIC", "reduction": "REDUCTION_OFF",
         "reductionRings": 7, "basis": "BASIS_NEVER"}}, "handles": [{"name": "a", "region": {"openBoundary": true}}]})"},
    {"quintic, LU", R"({"method": {"rbf": {"kernel": "QUINTIC", "solver": "LU", "reductionRings": 5}},
         "handles": [{"name": "a", "region": {"openBoundary": true}}]})"},
    {"iterative", R"({"method": {"rbf": {"kernel": "MULTIQUADRIC", "solver": "ITERATIVE", "tolerance": 1e-7}},
         "handles": [{"name": "a", "region": {"all": true}}]})"},
    {"incremental QR, greedy",
     R"({"method": {"rbf": {"solver": "INCREMENTAL_QR", "centreOrder": "GREEDY", "samples": [{"variables": [0.5, -0.25]},
         {"variables": [0, 1]}]}}, "handles": [{"name": "a", "region": {"group": "g"}}], "variables": [{"name": "u", "handle": "a",
         "translate": [0, 0, 1]}, {"name": "v", "handle": "a", "translate": [1, 0, 0], "lower": 0, "upper": 2.5}]})"},
    {"incremental QR, farthest point", R"({"method": {"rbf": {"solver": "INCREMENTAL_QR", "centreOrder": "FARTHEST_POINT"}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"shell", R"({"method": {"shell": {}}, "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"soft shell",
     R"({"method": {"shell": {"energy": {"stretching": 0.5, "bending": 0, "handles": "HANDLES_SOFT", "basis": "BASIS_ALWAYS"}}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"hard shell with a weight that is ignored", R"({"method": {"shell": {"energy": {"fixing": 5}}}, "handles": [{"name": "a",
         "region": {"group": "g"}}], "constraintOptions": {"iterations": 10}})"},
    {"subspace", R"({"method": {"subspace": {}}, "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"subspace, global kernel", R"({"method": {"subspace": {"kernel": "SUBSPACE_BIHARMONIC", "centres": 200, "cover": 30}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"subspace, compact kernel", R"({"method": {"subspace": {"kernel": "SUBSPACE_WENDLAND_C2", "energy": {"stretching": 1}}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"mls", R"({"method": {"mls": {"surfaceSamples": 300, "weights": [{"region": {"ids": [9, 2, 9, 0]}, "bending": 2}]}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"mls with straight supports", R"({"method": {"mls": {"domain": "DOMAIN_ENCLOSED"}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"mls with as many samples as given", R"({"method": {"mls": {"surfaceSamples": 300, "volumeSamples": 200}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"mls on the surface alone", R"({"method": {"mls": {"domain": "DOMAIN_SURFACE", "surfaceSamples": 300}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"mls as it was stored before it had a domain", R"({"method": {"mls": {"energy": {"bending": 1, "handles": "HANDLES_HARD"},
         "surfaceSamples": 300, "cubature": 4, "cover": 12}}, "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"subspace, compact kernel alone", R"({"method": {"subspace": {"kernel": "SUBSPACE_GAUSSIAN", "linear": "LINEAR_LEFT_OUT"}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"subspace as it was stored before it had linear functions", R"({"method": {"subspace": {"kernel": "SUBSPACE_GAUSSIAN",
         "energy": {"bending": 1, "handles": "HANDLES_HARD"}, "centres": 1000, "cover": 50}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"rbf by the median spacing", R"({"method": {"rbf": {"kernel": "MULTIQUADRIC", "automaticShape": "SHAPE_OF_MEDIAN"}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"rbf as it was stored before it had an automatic shape", R"({"method": {"rbf": {"kernel": "GAUSSIAN", "polynomialDegree": 0,
         "tolerance": 1e-6, "reduction": "REDUCTION_TOLERANCE", "reductionTolerance": 1e-4}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"ffd that meets handles at centres", R"({"method": {"ffd": {"energy": {"misfit": "MISFIT_AT_CENTRES"}}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"ffd as it was stored before misfits had a rule", R"({"method": {"ffd": {"energy": {"bending": 1, "handles": "HANDLES_HARD"},
         "lattice": {"basis": "UNIFORM_CUBIC"}, "control": "ENERGY"}}, "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"subspace as it was stored before misfits had a rule", R"({"method": {"subspace": {"energy": {"bending": 1,
         "handles": "HANDLES_HARD"}, "kernel": "SUBSPACE_MLS", "centres": 1000, "cover": 8}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"mls as it was stored before misfits had a rule", R"({"method": {"mls": {"energy": {"bending": 1, "handles": "HANDLES_HARD"},
         "cubature": 4, "cover": 20, "domain": "DOMAIN_CONNECTED"}}, "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"soft mls, for which misfits have no rule", R"({"method": {"mls": {"energy": {"handles": "HANDLES_SOFT",
         "misfit": "MISFIT_AT_JOINS"}}}, "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"several methods", R"({"method": {"ffd": {}}, "handles": [{"name": "a", "region": {"group": "g"}}],
         "constraintOptions": {"iterations": 10}, "then": [{"handles": [{"name": "b", "region": {"ids": [4, 1, 4]}}],
         "fixed": [{"ids": [9, 9, 2]}]}, {"method": {"shell": {}}, "handles": [{"name": "c", "region": {"boundary": true}}]}],
         "variables": [{"name": "u", "handle": "a", "translate": [0, 0, 1], "also": [{"handle": "b",
         "rotate": {"axis": [0, 0, 1], "unit": "RADIANS"}}]}]})"},
    {"several methods, flat geometry", R"({"handles": [{"name": "a", "region": {"group": "g"}}],
         "then": [{"method": {"rbf": {}}, "handles": [{"name": "b", "region": {"all": true}}]}]})",
     Geometry::flat},
    {"ffd", R"({"method": {"ffd": {}}, "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"ffd in a turned frame", R"({"method": {"ffd": {"energy": {"stretching": 0.5, "handles": "HANDLES_SOFT"}, "clamp": 0.1,
         "lattice": {"frame": {"origin": [0, -1, 0.5], "axes": [1, 1, 0, -1, 1, 0, 0, 0, 2]}, "points": [5, 6, 7],
         "basis": "CLAMPED_CUBIC"}}}, "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"ffd by direct manipulation", R"({"method": {"ffd": {"control": "MESH", "clamp": 1e-4, "energy": {"stretching": 3,
         "basis": "BASIS_NEVER"}, "lattice": {"box": {"min": [0, 0, 0], "max": [1, 2, 3]}, "basis": "BERNSTEIN"}}},
         "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"ffd by control points", R"({"method": {"ffd": {"control": "CONTROLS", "clamp": 0.1, "energy": {"stretching": 3},
         "lattice": {"points": [2, 2, 2], "basis": "BERNSTEIN", "controlPoints": "AAAAAAAA4D8AAAAAAADwvwAAAAAAAABA"}}},
         "handles": [{"name": "a", "region": {"lattice": {"i": [0, 1], "k": [1, 1]}}}], "fixed": [{"control": {"ids": [3, 1, 3]}}]})"},
    {"cage",
     R"({"method": {"cage": {"vertices": [0, 0, 0, 4, 0, 0, 0, 4, 0, 0, 0, 4.5], "triangles": [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2,
         3]}}, "handles": [{"name": "a", "region": {"control": {"ids": [2, 0, 2]}}}]})"},
    {"cage with everything said",
     R"({"method": {"cage": {"vertices": [0, 0, 0, 4, 0, 0, 0, 4, 0, 0, 0, 4.5], "triangles": [0, 2, 1, 0, 1,
         3, 0, 3, 2, 1, 2, 3], "coordinates": "MEAN_VALUE", "control": "CONTROLS", "basis": "BASIS_NEVER", "basisTolerance": 1e-6}},
         "handles": [{"name": "a", "region": {"control": {"ids": [2]}}}]})"},
    {"cage by direct manipulation",
     R"({"method": {"cage": {"vertices": [0, 0, 0, 4, 0, 0, 0, 4, 0, 0, 0, 4.5], "triangles": [0, 2, 1, 0,
         1, 3, 0, 3, 2, 1, 2, 3], "control": "MESH", "clamp": 1e-4}}, "handles": [{"name": "a", "region": {"group": "g"}}]})"},
    {"cage with Green coordinates",
     R"({"method": {"cage": {"vertices": [0, 0, 0, 4, 0, 0, 0, 4, 0, 0, 0, 4.5], "triangles": [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2,
         3], "coordinates": "GREEN"}}, "handles": [{"name": "a", "region": {"control": {"ids": [2, 0, 2]}}}]})"},
    {"regions", R"({"method": {"rbf": {}}, "handles": [
         {"name": "box", "region": {"box": {"min": [0, 0, 0], "max": [1, 2, 3]}}},
         {"name": "cylinder", "region": {"cylinder": {"start": [0, 0, 0], "end": [0, 0, 1], "radius": 0.5}}},
         {"name": "set", "region": {"difference": [{"union": [{"ids": [3, 1, 2]}, {"group": "g"}]}, {"intersection": [{"all": true},
           {"ids": [5, 5]}]}]}}],
         "fixed": [{"halfSpace": {"point": [0, 0, 0.1], "normal": [0, 0, -2]}}, {"complement": {"grow": {"region": {"ids": [4294967295, 7]},
           "rings": 2}}}]})"},
    {"variables", R"({"handles": [{"name": "a", "region": {"group": "g"}}], "variables": [
         {"name": "t", "handle": "a", "translate": [0, 0, 1], "lower": -1, "upper": 0},
         {"name": "r", "handle": "a", "rotate": {"axis": [0, 1, 0]}},
         {"name": "q", "handle": "a", "rotate": {"axis": [0, 1, 0], "centre": [1, 2, 3]}},
         {"name": "s", "handle": "a", "scale": {}},
         {"name": "d\u00e9formation", "handle": "a", "scale": {"centre": [1, 0, 0], "axis": [1, 0, 0]}}]})"},
    {"patches",
     R"({"handles": [{"name": "a", "region": {"patch": {"seed": [0, 0.5, 1]}}}], "fixed": [{"patch": {"point": 0, "angle": 180}},
         {"grow": {"region": {"patch": {"point": 7}}, "rings": 1}}]})"},
    {"variables of several handles, in degrees",
     R"({"handles": [{"name": "a", "region": {"group": "g"}}, {"name": "b", "region": {"group": "h"}}, {"name": "c", "region": {"ids": [1]}}],
         "variables": [
         {"name": "r", "handle": "a", "rotate": {"axis": [0, 1, 0], "unit": "DEGREES"}, "also": [{"handle": "b"},
           {"handle": "c", "rotate": {"axis": [0, -1, 0], "unit": "RADIANS"}}]},
         {"name": "s", "handle": "a", "scale": {}, "also": [{"handle": "b", "scale": {"axis": [1, 0, 0]}},
           {"handle": "c", "translate": [0, 0, -1]}]}]})"},
    {"symmetry", R"({"handles": [{"name": "a", "region": {"group": "g"}}], "symmetry": [{"point": [0, 0, 0], "normal": [0, 1, 0]},
         {"region": {"ids": [2, 1]}}]})"},
    {"sector", R"({"handles": [{"name": "a", "region": {"group": "g"}}], "symmetry": [{"sector": {"axis": [0, 0, 2], "count": 36,
         "periodic": [{"ids": [2, 1, 1]}, {"group": "high"}]}}]})"},
    {"constraints with their defaults",
     R"({"method": {"mls": {}}, "handles": [{"name": "a", "region": {"group": "g"}}], "constraints": [
         {"name": "1", "regions": [{"ids": [2, 1, 1]}], "planar": {}}, {"name": "2", "regions": [{"group": "p"}], "circular": {}},
         {"name": "3", "regions": [{"group": "p"}], "cylindrical": {}}, {"name": "4", "regions": [{"group": "p"}], "spherical": {}},
         {"name": "5", "regions": [{"group": "p"}], "conical": {}}, {"name": "6", "regions": [{"group": "p"}], "straight": {}},
         {"name": "7", "regions": [{"group": "p"}], "featureLine": {}}, {"name": "8", "regions": [{"group": "p"}], "rigid": {}},
         {"name": "9", "regions": [{"group": "p"}], "fixedPlane": {"point": [0, 0, 0], "normal": [0, 0, 1]}},
         {"name": "10", "regions": [{"group": "p"}], "symmetric": {}},
         {"name": "11", "regions": [{"group": "p"}, {"group": "q"}], "coplanar": {}},
         {"name": "12", "regions": [{"group": "p"}, {"group": "q"}], "parallel": {}},
         {"name": "13", "regions": [{"group": "p"}, {"group": "q"}], "orthogonal": {}},
         {"name": "14", "regions": [{"group": "p"}, {"group": "q"}], "distance": {}},
         {"name": "15", "regions": [{"group": "p"}], "extent": {"axis": [1, 0, 0], "value": 2}}]})"},
    {"constraints with everything said",
     R"({"method": {"shell": {}}, "handles": [{"name": "a", "region": {"group": "g"}}], "constraints": [
         {"name": "1", "regions": [{"group": "p"}], "weight": 1e6, "exact": true, "circular": {"radius": "KEPT"}},
         {"name": "2", "regions": [{"group": "p"}], "conical": {"angle": "FREE"}},
         {"name": "3", "regions": [{"group": "p"}], "rigid": {"layers": 3}},
         {"name": "4", "regions": [{"group": "p"}], "symmetric": {"point": [0, 0, 0], "normal": [0, 1, 0], "tolerance": 0.01}},
         {"name": "5", "regions": [{"group": "p"}, {"group": "q"}], "distance": {"bound": "MAXIMUM", "value": 0.5}},
         {"name": "6", "regions": [{"group": "p"}], "extent": {"axis": [1, 0, 0], "bound": "MAXIMUM", "value": 2, "ends": 0}}],
         "constraintOptions": {"tolerance": 1e-9}})"},
    {"exact constraints whose steps are carried at centres",
     R"({"method": {"mls": {}}, "handles": [{"name": "a", "region": {"group": "g"}}], "constraints": [
         {"name": "1", "regions": [{"group": "p"}], "planar": {}, "exact": true}],
         "constraintOptions": {"exactSteps": "EXACT_STEPS_AT_CENTRES"}})"},
    {"exact constraints as they were stored before their steps had a rule",
     R"({"method": {"shell": {"energy": {"bending": 1, "handles": "HANDLES_HARD"}}}, "handles": [{"name": "a",
         "region": {"group": "g"}}], "constraints": [{"name": "1", "regions": [{"group": "p"}], "planar": {}, "exact": true}],
         "constraintOptions": {"tolerance": 1e-7, "iterations": 3000}})"},
    {"no exact constraints, whose steps have no rule",
     R"({"method": {"ffd": {}}, "handles": [{"name": "a", "region": {"group": "g"}}], "constraints": [
         {"name": "1", "regions": [{"group": "p"}], "planar": {}}], "constraintOptions": {"exactSteps": "EXACT_STEPS_AT_JOINS"}})"},
};

v1::Setup parsed(const SetupCase& setup) {
  v1::Setup message;
  const auto status = google::protobuf::util::JsonStringToMessage(setup.json, &message);
  if (!status.ok()) throw std::runtime_error(std::string(setup.name) + ": " + status.ToString());
  convert::setup_from_proto(message, 1000);  // it must be one that a server takes
  return message;
}

}  // namespace

void add_setup_vectors(Vectors& vectors) {
  const std::string geometry(64, 'a');
  Json& file = vectors["setups.json"] = Json::array();
  for (const SetupCase& setup : cases) {
    v1::Setup message = parsed(setup);
    const bool rbf = message.method().has_rbf() || message.method().kind_case() == v1::Method::KIND_NOT_SET;
    if (rbf && setup.geometry == Geometry::flat) message.mutable_method()->mutable_rbf()->set_kernel(v1::THIN_PLATE);
    for (auto& stage : *message.mutable_then()) {
      if (stage.method().has_rbf() && setup.geometry == Geometry::flat)
        stage.mutable_method()->mutable_rbf()->set_kernel(v1::THIN_PLATE);
    }
    const v1::Setup canonical = convert::canonical_setup(message, geometry);
    Json json;
    json["name"] = setup.name;
    json["flat"] = setup.geometry == Geometry::flat;
    json["geometry"] = geometry;
    json["setup"] = Json::parse(setup.json);
    json["canonical"] = base64(canonical.SerializeAsString());
    json["id"] = convert::system_id(canonical);
    file.push_back(json);
  }
}

}  // namespace deform::wire
