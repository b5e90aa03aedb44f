// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/cad/correspondence.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRep_Tool.hxx>
#include <GeomAbs_SurfaceType.hxx>
#include <TopoDS.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <tuple>
#include <unordered_map>

#include "core/base/error.h"
#include "core/base/number_text.h"
#include "core/base/vectors.h"
#include "core/cad/coordinates.h"
#include "core/cad/face_marks.h"
#include "core/cad/model_graph.h"

namespace deform::cad {

namespace {

constexpr double normal_weight = 0.1;  ///< of the difference of two unit normals, beside that of places in sizes of the model
constexpr double clearly = 1.5;        ///< another way has to fit so much worse, in squares
constexpr double slightly = 1.1;       ///< another way that fits so much better, in squares, contradicts what stays
constexpr double far_better = 20;      ///< a turned model that fits so much better, in squares, is not overlooked
constexpr int forced_kind = 100;
constexpr int most_tries = 20000, most_first = 24, most_second = 6;

/// Colours of the entities of both models; equal colours may be partners.
struct Colours {
  std::vector<int> before, after;
};

/// The old model as it is laid over the new one; lengths are divided by `size`.
struct View {
  std::string words;
  std::vector<Vec3> places, normals;
  double size = 1;
  double stays = 0;  ///< > 0: entities are counted that do not lie within this distance of their partners
};

/// The best correspondence in a view.
struct Answer {
  Colours colours;
  std::vector<int> pairs;
  double cost = std::numeric_limits<double>::infinity();   ///< sum of squares
  double rival = std::numeric_limits<double>::infinity();  ///< of the best other way that was found
  std::vector<int> rival_pairs;
  bool counts = false;           ///< `cost` and `rival` are how many entities do not stay where they are
  int stay = 0, rival_stay = 0;  ///< of the entities that the best other way pairs otherwise
  std::string question, words;
  bool found() const { return !pairs.empty(); }
  bool clear() const {
    if (counts) return found() && stay >= 2 && 2 * rival_stay <= stay;
    return found() && rival >= clearly * cost + 1e-9;
  }
};

/// The two models may not be paired further: too many ways were tried.
struct TooManySymmetries {};

class Matching {
 public:
  Matching(const Model& before, const Model& after, std::span<const ForcedPair> pairs, FaceTypes types)
      : models_{&before, &after},
        before_(graph_of(before, types)),
        after_(graph_of(after, types)),
        uses_before_(uses(before)),
        uses_after_(uses(after)),
        names_(common_names(before, after)) {
    std::tie(paints_before_, paints_after_) = numbered_colours(before, after);
    if (types == FaceTypes::left_out) leave_types();
    for (const ForcedPair& pair : pairs) force(pair);
  }

  bool structures_differ() const {
    Colours start = first_colours();
    return !refine(start);
  }

  Correspondence solve() {
    Colours start = first_colours();
    if (!refine(start)) refuse_structure(start);
    if (!may_run_so(start)) refuse_turn();
    std::string note;
    start = decide(std::move(start), note);
    const std::vector<int> pairs = partners(start);
    prove(pairs);
    check_types(pairs);
    Correspondence found = with_senses(pairs);
    if (!note.empty()) found.notes.push_back(note);
    add_marks_against(pairs, found.notes);
    return found;
  }

 private:
  /// Planes have normals, and what became of them none.
  void leave_types() {
    before_.normals.assign(before_.normals.size(), {});
    after_.normals.assign(after_.normals.size(), {});
    types_before_ = kinds_of_faces(*models_[0]);
    types_after_ = kinds_of_faces(*models_[1]);
  }

  /// Whether faces may be partners where types are left out: they are of one type, or one of them has no shape of its own.
  bool may_become(int f, int partner) const {
    const auto free = [](const std::vector<int>& kind) { return kind[1] > GeomAbs_Torus; };
    return types_before_[f] == types_after_[partner] || free(types_before_[f]) || free(types_after_[partner]);
  }

  void check_types(const std::vector<int>& pairs) const {
    if (types_before_.empty()) return;
    for (int f = 0; f < before_.first_edge; ++f) {
      if (before_.kinds[f].front() == forced_kind || may_become(f, pairs[f])) continue;
      throw Error(ErrorCode::failed_precondition, "the CAD models differ in structure: the partner of " +
                                                      models_[0]->face_name(f) + " would be " + models_[1]->face_name(pairs[f]) +
                                                      " of the new model, which has another type");
    }
  }

  void force(const ForcedPair& pair) {
    const auto kind = static_cast<int>(pair.kind);
    const char* names[] = {"face", "edge", "vertex"};
    const auto check = [&](int number, const Model& model) {
      const int counts[] = {model.face_count(), model.edge_count(), model.vertex_count()};
      if (number < 1 || number > counts[kind]) {
        throw Error(ErrorCode::invalid_argument, "pairs: " + std::string(names[kind]) + " " + std::to_string(number) +
                                                     " is out of range, " + model.name + " has " + std::to_string(counts[kind]));
      }
    };
    check(pair.before, *models_[0]);
    check(pair.after, *models_[1]);
    const auto index = [&](const ModelGraph& graph, int number) {
      return (kind == 0 ? 0 : kind == 1 ? graph.first_edge : graph.first_vertex) + number - 1;
    };
    const std::vector<int> mark{forced_kind, static_cast<int>(forced_++)};
    before_.kinds[index(before_, pair.before)] = mark;
    after_.kinds[index(after_, pair.after)] = mark;
  }

  Colours first_colours() const {
    std::map<std::vector<int>, int> ids;
    Colours colours;
    for (const auto& kind : before_.kinds)
      colours.before.push_back(ids.try_emplace(kind, static_cast<int>(ids.size())).first->second);
    for (const auto& kind : after_.kinds)
      colours.after.push_back(ids.try_emplace(kind, static_cast<int>(ids.size())).first->second);
    return colours;
  }

  /// Whether each colour is there as often in both models. Colours are below the number of entities of both.
  static bool balanced(const Colours& colours) {
    std::vector<int> surplus(colours.before.size() + colours.after.size() + 1, 0);
    for (const int c : colours.before) ++surplus[c];
    for (const int c : colours.after) --surplus[c];
    return std::all_of(surplus.begin(), surplus.end(), [](int count) { return count == 0; });
  }

  /// Until neighbours tell nothing more apart. False when the two models differ. Colours of neighbours are compared by a sum of
  /// 64 bits; prove() looks at what comes of it.
  bool refine(Colours& colours) const {
    std::size_t classes = 0;
    while (true) {
      if (!balanced(colours)) return false;
      const std::size_t finer = tell_neighbours(colours);
      if (finer == classes) return balanced(colours);
      classes = finer;
    }
  }

  /// Colours by those of the entities and of their neighbours; returns how many there are then.
  std::size_t tell_neighbours(Colours& colours) const {
    std::unordered_map<std::uint64_t, int> ids;
    const auto next = [&](const ModelGraph& graph, const std::vector<int>& old) {
      std::vector<int> result(old.size());
      for (int i = 0; i < graph.size_of_graph(); ++i) {
        std::uint64_t key = scrambled(~static_cast<std::uint64_t>(old[i]));
        for (const int j : graph.neighbours[i]) key += scrambled(static_cast<std::uint64_t>(old[j]));
        result[i] = ids.try_emplace(key, static_cast<int>(ids.size())).first->second;
      }
      return result;
    };
    colours.before = next(before_, colours.before);
    colours.after = next(after_, colours.after);
    return ids.size();
  }

  /// The finalizer of splitmix64.
  static std::uint64_t scrambled(std::uint64_t x) {
    x += 0x9e3779b97f4a7c15U;
    x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
    x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
    return x ^ (x >> 31U);
  }

  /// That neighbours go to neighbours and nothing changes its kind.
  void prove(const std::vector<int>& pairs) const {
    for (int i = 0; i < before_.size_of_graph(); ++i) {
      std::vector<int> images, neighbours = after_.neighbours[pairs[i]];
      for (const int j : before_.neighbours[i]) images.push_back(pairs[j]);
      std::sort(images.begin(), images.end());
      std::sort(neighbours.begin(), neighbours.end());
      if (images != neighbours || before_.kinds[i] != after_.kinds[pairs[i]]) {
        throw Error(ErrorCode::internal, "the correspondence of the CAD models does not keep their structure");
      }
    }
  }

  /// What structure leaves open is decided by places, see by_geometry(), else by what the files call and paint the faces. Clear
  /// answers that contradict each other are refused.
  Colours decide(Colours start, std::string& note) {
    if (branch(start, file_view()).of < 0) return start;
    const Marks marks = by_marks(start);
    std::optional<Error> refusal;
    Answer chosen = attempt(start, refusal);
    if (!chosen.clear() && marks.any()) {
      std::optional<Error> again;
      chosen = attempt(marks.colours, again);
      if (!refusal) refusal = again;
      chosen.words = marks.words();
      note = "Structure and places leave several ways to pair the models; " + marks.agreement() + " with the one that is taken.";
    } else if (chosen.clear() && marks.any() && forced_ == 0) {  // whoever gives pairs decides
      refuse_against(chosen, marks);
    }
    if (!chosen.clear() && refusal) throw Error(*refusal);
    if (!chosen.clear()) {
      throw Error(ErrorCode::failed_precondition, "the correspondence of the CAD models is ambiguous: " + chosen.question +
                                                      ", and both fit about as well; name pairs in a file with --map");
    }
    if (note.empty() && !chosen.words.empty()) {
      note = "Structure leaves several ways to pair the models; the one that fits best " + chosen.words + " is taken" +
             how_clear(chosen) + (marks.any() ? "; " + marks.agreement() : "") + ".";
    }
    return std::move(chosen.colours);
  }

  /// by_geometry(), with the reason where it finds a contradiction.
  Answer attempt(const Colours& start, std::optional<Error>& refusal) {
    try {
      return by_geometry(start);
    } catch (const TooManySymmetries&) {
      refusal = Error(ErrorCode::failed_precondition, "the CAD models have too many symmetries; name pairs in a file with --map");
    } catch (const Error& error) {
      if (error.code() != ErrorCode::failed_precondition) throw;
      refusal = error;
    }
    return {};
  }

  /// What stays where it is, how far entities move as they lie in the files, after a translation and a scaling, and after a turn
  /// as well. A view that finds no clear answer has no say; clear answers that contradict each other are refused.
  Answer by_geometry(const Colours& start) {
    Answer chosen = by_places(start);
    if (chosen.clear() && !std::isfinite(chosen.rival)) {  // the only way
      chosen.words.clear();
      return chosen;
    }
    if (chosen.clear() && chosen.counts) return chosen;
    const Answer turned = by_shape(start);
    if (turned.clear() && !chosen.clear()) return turned;
    if (forced_ == 0 && turned.clear() && differ(chosen, turned) && far_better * turned.cost + 1e-9 < laid_best(chosen.pairs)) {
      refuse_contradiction(chosen, turned);
    }
    return chosen;
  }

  static std::string how_clear(const Answer& answer) {
    if (answer.counts) {
      return " (" + std::to_string(answer.stay) + " faces, edges and vertices that others would move stay, and " +
             std::to_string(answer.rival_stay) + " the other way round)";
    }
    const double ratio = std::sqrt(answer.rival / std::max(answer.cost, 1e-18));
    if (ratio > 1000) return " (others by more than 1000 times the distance)";
    return " (others by " + number_digits(std::round(10 * ratio) / 10) + " times the distance or more)";
  }

  /// What stays, if that is clear, else the distances in the files or after a translation and a scaling.
  Answer by_places(const Colours& start) {
    Answer staying = choose(start, staying_view());
    Answer in_place = choose(start, file_view());
    if (staying.clear()) {
      // A row that moves by its pitch, or its first member to the other end?
      if (differ(staying, in_place) && slightly * in_place.cost < cost_of(staying.pairs, file_view())) {
        refuse_contradiction(staying, in_place);
      }
      return staying;
    }
    Answer moved = choose(start, moved_view());
    if (in_place.clear() && moved.clear() && differ(in_place, moved)) refuse_contradiction(in_place, moved);
    return in_place.clear() || !moved.clear() ? in_place : moved;
  }

  /// After the similarity that fits a correspondence best, for those that differ in the partners of two entities.
  Answer by_shape(const Colours& start) {
    std::vector<Answer> found;
    const View moved = moved_view();
    try {
      tries_ = 0;
      const Branch first = branch(start, moved);
      for (std::size_t i = 0; i < first.candidates.size() && i < most_first; ++i) {
        const auto once = refined(fixed(start, first.of, first.candidates[i]));
        if (!once) continue;
        const Branch second = branch(*once, moved);
        if (second.of < 0) add_laid(complete(*once, moved), found);
        for (std::size_t j = 0; j < second.candidates.size() && j < most_second; ++j) {
          const auto twice = refined(fixed(*once, second.of, second.candidates[j]));
          if (twice) add_laid(complete(*twice, view_of(best_placement(before_, after_, singles(*twice)), "")), found);
        }
      }
      if (found.empty()) return {};
      std::stable_sort(found.begin(), found.end(), [](const Answer& a, const Answer& b) { return a.cost < b.cost; });
      Answer best = choose(start, view_of(best_placement(before_, after_, found.front().pairs), ""));
      if (!best.found() || best.cost > found.front().cost) {
        best.colours = found.front().colours;
        best.pairs = found.front().pairs;
        best.cost = found.front().cost;
      }
      for (const Answer& other : found) {
        if (differ(best, other)) best.rival = std::min(best.rival, other.cost);
      }
      best.words = "after a turn and a scaling";
      return best;
    } catch (const TooManySymmetries&) {
      return {};
    }
  }

  void add_laid(const std::optional<Colours>& colours, std::vector<Answer>& found) const {
    if (!colours) return;
    Answer answer;
    answer.colours = *colours;
    answer.pairs = partners(*colours);
    answer.cost = laid_best(answer.pairs);
    found.push_back(std::move(answer));
  }

  double laid_best(const std::vector<int>& pairs) const {
    return cost_of(pairs, view_of(best_placement(before_, after_, pairs), ""));
  }

  /// What names and colours of faces in the files tell apart.
  struct Marks {
    Colours colours;  ///< of structure, names and colours
    int names = 0;    ///< pairs of faces that have a name of their own in both files
    int painted = 0;  ///< faces with a colour that is as often among their like in both files
    bool any() const { return names + painted > 0; }
    std::string words() const {
      return std::string("by the ") +
             (names == 0     ? "colours"
              : painted == 0 ? "names"
                             : "names and colours") +
             " of faces in the files";
    }
    std::string agreement() const {
      const auto counted = [](int n, const char* what) { return std::to_string(n) + " " + what + (n == 1 ? "" : "s"); };
      if (painted == 0) return counted(names, "name") + " of faces " + (names == 1 ? "agrees" : "agree");
      if (names == 0) return "the colours of " + counted(painted, "face") + " agree";
      return counted(names, "name") + " of faces and the colours of " + std::to_string(painted) + " agree";
    }
  };

  /// Names first, and colours where they do not contradict them. What structure forbids is left out; marks_against() says so.
  Marks by_marks(const Colours& start) {
    Marks marks{start, 0, 0};
    Colours named = start;
    int names = 0;
    bool kept = true;
    for (const auto& [f, other] : names_) {
      kept = kept && start.before[f] == start.after[other];
      named = fixed(std::move(named), f, other);
      ++names;
    }
    if (names > 0 && kept) take(std::move(named), marks, names, marks.names);
    Colours painted = marks.colours;
    const int faces = paint(painted);
    if (faces > 0) take(std::move(painted), marks, faces, marks.painted);
    return marks;
  }

  /// What neighbours make of it, where structure allows it.
  void take(Colours given, Marks& marks, int count, int& counted) {
    try {
      tries_ = 0;
      std::optional<Colours> finer = refined(std::move(given));
      if (!finer || !complete(*finer, file_view())) return;
      marks.colours = *std::move(finer);
      counted = count;
    } catch (const TooManySymmetries&) {  // no way was found
    }
  }

  /// Tells faces that may be partners apart by their colours in the files, where as many of them have it in both files; returns
  /// how many those are.
  int paint(Colours& colours) const {
    if (paints_before_.empty() || paints_after_.empty()) return 0;
    std::map<std::array<int, 2>, std::array<int, 2>> counts;  // by class and paint
    std::map<int, int> sizes;
    for (int f = 0; f < before_.first_edge; ++f) ++sizes[colours.before[f]];
    for (int f = 0; f < before_.first_edge; ++f) ++counts[{colours.before[f], paints_before_[f]}][0];
    for (int f = 0; f < after_.first_edge; ++f) ++counts[{colours.after[f], paints_after_[f]}][1];
    int fresh = 1 + std::max(*std::max_element(colours.before.begin(), colours.before.end()),
                             *std::max_element(colours.after.begin(), colours.after.end()));
    int faces = 0;
    for (const auto& [key, count] : counts) {
      const auto [colour, paint] = key;
      if (paint == unpainted || count[0] != count[1] || count[0] == sizes[colour]) continue;
      for (int f = 0; f < before_.first_edge; ++f) {
        if (colours.before[f] == colour && paints_before_[f] == paint) colours.before[f] = fresh;
      }
      for (int f = 0; f < after_.first_edge; ++f) {
        if (colours.after[f] == colour && paints_after_[f] == paint) colours.after[f] = fresh;
      }
      ++fresh;
      faces += count[0];
    }
    return faces;
  }

  /// What the files call and paint otherwise than the pairs are, which was not used then.
  void add_marks_against(const std::vector<int>& pairs, std::vector<std::string>& notes) const {
    const std::string against = forced_ > 0 ? "the given pairs" : "the structure of the models";
    const auto example = [&](int f) {
      return ", such as of " + models_[0]->face_name(f) + ", whose partner is " + models_[1]->face_name(pairs[f]) + ".";
    };
    int named = 0, first = 0;
    for (const auto& [f, other] : names_) {
      if (pairs[f] != other && ++named == 1) first = f;
    }
    if (named > 0)
      notes.push_back("The names of faces in the files contradict " + against + " and are not used" + example(first));
    if (paints_before_.empty()) return;
    const auto has = [](const std::vector<int>& paints, int paint) {
      return paint != unpainted && std::find(paints.begin(), paints.end(), paint) != paints.end();
    };
    int painted = 0;
    for (int f = 0; f < before_.first_edge; ++f) {
      const int old = paints_before_[f], now = paints_after_[pairs[f]];
      if (old == now || !(has(paints_after_, old) || has(paints_before_, now))) continue;
      if (++painted == 1) first = f;
    }
    if (painted == 0) return;
    if (painted == 1) {
      notes.push_back("The colour of " + models_[0]->face_name(first) + " differs from that of its partner, " +
                      models_[1]->face_name(pairs[first]) + ", and is not used.");
    } else {
      notes.push_back("The colours of " + std::to_string(painted) +
                      " faces differ from those of their partners and are not used" + example(first));
    }
  }

  /// A clear answer by places that does not keep what names and colours tell apart.
  void refuse_against(const Answer& answer, const Marks& marks) const {
    for (int f = 0; f < before_.first_edge; ++f) {
      if (marks.colours.before[f] == marks.colours.after[answer.pairs[f]]) continue;
      int other = 0;
      while (marks.colours.after[other] != marks.colours.before[f]) ++other;
      refuse_contradiction(f, answer.pairs[f], answer.words, other, marks.words());
    }
  }

  bool differ(const Answer& a, const Answer& b) const {
    return !std::equal(a.pairs.begin(), a.pairs.begin() + before_.first_wire, b.pairs.begin());
  }

  [[noreturn]] void refuse_contradiction(const Answer& a, const Answer& b) const {
    int i = 0;
    while (a.pairs[i] == b.pairs[i]) ++i;
    refuse_contradiction(i, a.pairs[i], a.words, b.pairs[i], b.words);
  }

  [[noreturn]] void refuse_contradiction(int i, int one, const std::string& by, int other, const std::string& but_by) const {
    throw Error(ErrorCode::failed_precondition,
                "the correspondence of the CAD models is ambiguous: the partner of " + before_.name(*models_[0], i) +
                    " of the old model is " + after_.name(*models_[1], one) + " " + by + ", but " +
                    after_.name(*models_[1], other) + " " + but_by + "; name pairs in a file with --map");
  }

  View view_of(const Placement& placement, const std::string& words) const {
    View view;
    view.words = words;
    view.size = after_.size;
    const auto turned = [&](const Vec3& v) {
      const Eigen::Vector3d x = placement.turn * Eigen::Vector3d(v[0], v[1], v[2]);
      return Vec3{x[0], x[1], x[2]};
    };
    for (const Vec3& place : before_.places)
      view.places.push_back(placement.scale * turned(place - placement.from) + placement.to);
    for (const Vec3& normal : before_.normals) view.normals.push_back(turned(normal));
    return view;
  }

  View file_view() const {
    return {"where they lie in the files", before_.places, before_.normals, std::max(before_.size, after_.size)};
  }

  View staying_view() const {
    View view = file_view();
    view.words = "by what stays where it is";
    view.stays = 1e-9 * models_[0]->diagonal;
    return view;
  }

  View moved_view() const {
    Placement placement;
    placement.scale = after_.size / before_.size;
    placement.from = before_.centre;
    placement.to = after_.centre;
    return view_of(placement, "after a translation and a scaling");
  }

  struct Branch {
    int of = -1;                  ///< of the old model
    std::vector<int> candidates;  ///< of the new one, nearest first
  };

  /// The smallest class of faces with more than one member, else of edges, vertices, others.
  Branch branch(const Colours& colours, const View& view) const {
    std::map<int, int> sizes;
    for (const int colour : colours.before) ++sizes[colour];
    const int ends[] = {before_.first_edge, before_.first_vertex, before_.first_wire, before_.size_of_graph()};
    int begin = 0;
    for (const int end : ends) {
      Branch found;
      for (int i = begin; i < end; ++i) {
        const int size = sizes[colours.before[i]];
        if (size > 1 && (found.of < 0 || size < sizes[colours.before[found.of]])) found.of = i;
      }
      begin = end;
      if (found.of < 0) continue;
      for (int j = 0; j < after_.size_of_graph(); ++j) {
        if (colours.after[j] != colours.before[found.of]) continue;
        if (found.of >= before_.first_edge || types_before_.empty() || may_become(found.of, j)) found.candidates.push_back(j);
      }
      std::stable_sort(found.candidates.begin(), found.candidates.end(),
                       [&](int a, int b) { return pair_cost(view, found.of, a) < pair_cost(view, found.of, b); });
      return found;
    }
    return {};
  }

  double pair_cost(const View& view, int a, int b) const {
    if (a >= before_.first_wire) return 0;
    const double square = squared_distance(view.places[a], after_.places[b]);
    const double turn = a < before_.first_edge ? squared_distance(view.normals[a], after_.normals[b]) : 0;
    const double cost = square / (view.size * view.size) + normal_weight * turn;
    if (view.stays == 0) return cost;
    return std::sqrt(square) <= view.stays && turn < 1e-12 ? 0 : 1 + 1e-9 * std::min(1.0, cost);
  }

  double cost_of(const std::vector<int>& pairs, const View& view) const {
    double cost = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) cost += pair_cost(view, static_cast<int>(i), pairs[i]);
    return cost;
  }

  static Colours fixed(Colours colours, int a, int b) {
    const int fresh = 1 + std::max(*std::max_element(colours.before.begin(), colours.before.end()),
                                   *std::max_element(colours.after.begin(), colours.after.end()));
    colours.before[a] = fresh;
    colours.after[b] = fresh;
    return colours;
  }

  /// What the neighbours make of it; nothing when the models differ, or the loops run in opposite directions.
  std::optional<Colours> refined(Colours colours) {
    if (++tries_ > most_tries) throw TooManySymmetries();
    if (!refine(colours) || !may_run_so(colours)) return std::nullopt;
    return colours;
  }

  /// Nearest candidates first, until all are distinguished. Nothing when there is no way.
  std::optional<Colours> complete(Colours colours, const View& view) {
    auto finer = refined(std::move(colours));
    if (!finer) return std::nullopt;
    const Branch at = branch(*finer, view);
    if (at.of < 0) return finer;
    for (const int b : at.candidates) {
      if (auto done = complete(fixed(*finer, at.of, b), view)) return done;
    }
    return std::nullopt;
  }

  /// The way of least cost, one entity after another, each with all its candidates. No pairs when there is no way.
  Answer choose(Colours colours, const View& view) {
    Answer answer;
    answer.words = view.words;
    answer.counts = view.stays > 0;
    tries_ = 0;
    while (true) {
      const Branch at = branch(colours, view);
      if (at.of < 0) break;
      struct Way {
        int candidate;
        double cost;
        std::vector<int> pairs;
      };
      std::vector<Way> ways;
      for (const int b : at.candidates) {
        if (const auto done = complete(fixed(colours, at.of, b), view)) {
          std::vector<int> pairs = partners(*done);
          const double cost = cost_of(pairs, view);
          ways.push_back({b, cost, std::move(pairs)});
        }
      }
      if (ways.empty()) refuse_turn();
      std::stable_sort(ways.begin(), ways.end(), [](const Way& a, const Way& b) { return a.cost < b.cost; });
      if (ways.size() > 1 && ways[1].cost < answer.rival) {
        answer.rival = ways[1].cost;
        answer.rival_pairs = ways[1].pairs;
        answer.question = before_.name(*models_[0], at.of) + " of the old model may be " +
                          after_.name(*models_[1], ways[0].candidate) + " or " + after_.name(*models_[1], ways[1].candidate) +
                          " of the new one";
      }
      colours = fixed(std::move(colours), at.of, ways[0].candidate);
      refine(colours);
    }
    answer.pairs = partners(colours);
    answer.cost = cost_of(answer.pairs, view);
    if (answer.counts) count_stays(answer, view);
    answer.colours = std::move(colours);
    return answer;
  }

  void count_stays(Answer& answer, const View& view) const {
    for (int i = 0; i < before_.first_wire; ++i) {
      if (answer.rival_pairs.empty() || answer.pairs[i] == answer.rival_pairs[i]) continue;
      answer.stay += pair_cost(view, i, answer.pairs[i]) < 0.5 ? 1 : 0;
      answer.rival_stay += pair_cost(view, i, answer.rival_pairs[i]) < 0.5 ? 1 : 0;
    }
  }

  /// The partners of entities that are distinguished; -1: none yet.
  std::vector<int> singles(const Colours& colours) const {
    std::map<int, std::array<int, 3>> of;  // members before, member before, member after
    for (int i = 0; i < before_.size_of_graph(); ++i) {
      auto& entry = of[colours.before[i]];
      ++entry[0];
      entry[1] = i;
    }
    for (int j = 0; j < after_.size_of_graph(); ++j) of[colours.after[j]][2] = j;
    std::vector<int> pairs(before_.size_of_graph(), -1);
    for (const auto& [colour, entry] : of) {
      if (entry[0] == 1) pairs[entry[1]] = entry[2];
    }
    return pairs;
  }

  /// Whether the loops of the faces that are distinguished run as those of their partners.
  bool may_run_so(const Colours& colours) {
    const std::vector<int> pairs = singles(colours);
    const bool solid = models_[0]->solids.Extent() > 0 && models_[1]->solids.Extent() > 0;
    for (int f = 0; f < before_.first_edge; ++f) {
      if (pairs[f] < 0) continue;
      int sense = solid ? models_[0]->face_sense(f) * models_[1]->face_sense(pairs[f]) : 0;
      for (const auto& [e, use] : uses_before_[f]) {
        const int partner = pairs[before_.first_edge + e];
        const auto [first, last] = before_.ends[e];
        if (partner < 0 || use == 0 || first < 0 || last < 0 || first == last || pairs[first] < 0 || pairs[last] < 0) continue;
        const auto other = uses_after_[pairs[f]].find(partner - after_.first_edge);
        if (other == uses_after_[pairs[f]].end()) return false;
        const int vote = use * other->second * (after_.ends[partner - after_.first_edge][0] == pairs[first] ? 1 : -1);
        if (vote == 0) continue;
        if (sense != 0 && sense != vote) {
          if (!turned_) turned_ = {f, pairs[f]};
          return false;
        }
        sense = vote;
      }
    }
    return true;
  }

  /// Sum of the senses of the uses of each edge by a face; 0 of seams.
  static std::vector<std::map<int, int>> uses(const Model& model) {
    std::vector<std::map<int, int>> uses(model.face_count());
    for (int f = 0; f < model.face_count(); ++f) {
      for (const Coedge& use : model.coedges[f]) uses[f][use.edge] += use.sense;
    }
    return uses;
  }

  /// Whether each colour of a face is there as often in both models.
  bool same_faces(const Colours& colours) const {
    std::vector<int> old(colours.before.begin(), colours.before.begin() + before_.first_edge);
    std::vector<int> now(colours.after.begin(), colours.after.begin() + after_.first_edge);
    std::sort(old.begin(), old.end());
    std::sort(now.begin(), now.end());
    return old == now;
  }

  /// Names what has no partner: the face that differs from the nearest one of the new model without a partner.
  [[noreturn]] void refuse_structure(Colours colours) const {
    // What differs first may be edges or loops only.
    for (std::size_t classes = 0; same_faces(colours);) {
      const std::size_t finer = tell_neighbours(colours);
      if (finer == classes) break;
      classes = finer;
    }
    const Model &old = *models_[0], &now = *models_[1];
    const View view = moved_view();
    std::map<int, int> surplus;
    for (const int c : colours.before) ++surplus[c];
    for (const int c : colours.after) --surplus[c];
    std::string text = "the CAD models differ in structure: " + counts(old) + " became " + counts(now);
    const auto solids = [](const Model& model) { return std::to_string(model.solids.Extent()); };
    if (old.solids.Extent() != now.solids.Extent()) text += ", solids: " + solids(old) + " and " + solids(now);
    const int first = first_with(colours.before, before_.first_edge, surplus, 1);
    const int lone = first_with(colours.after, after_.first_edge, surplus, -1);
    if (first >= 0) {
      int near = -1;
      const auto better = [&](int f) {
        const bool alike = before_.kinds[first] == after_.kinds[f], known = before_.kinds[first] == after_.kinds[near];
        return alike != known ? alike : pair_cost(view, first, f) < pair_cost(view, first, near);
      };
      for (int f = 0; f < after_.first_edge; ++f) {
        if (surplus[colours.after[f]] < 0 && (near < 0 || better(f))) near = f;
      }
      const bool same_loops = near >= 0 && before_.loops(first) == after_.loops(near);
      text += "; " + old.face_name(first) + " has " + before_.loops(first) + (same_loops ? before_.bulge(first) : "");
      text += near < 0 ? " and no partner in the new model"
                       : ", the nearest one without a partner in the new model, " + now.face_name(near) + ", has " +
                             after_.loops(near) + (same_loops ? after_.bulge(near) : "") +
                             (same_loops && before_.bulge(first) == after_.bulge(near) ? ", but other neighbours" : "");
    } else if (lone >= 0) {
      text += "; " + now.face_name(lone) + " of the new model has " + after_.loops(lone) + " and no partner in the old one";
    }
    throw Error(ErrorCode::failed_precondition, text);
  }

  static int first_with(const std::vector<int>& colours, int faces, std::map<int, int>& surplus, int sign) {
    for (int f = 0; f < faces; ++f) {
      if (sign * surplus[colours[f]] > 0) return f;
    }
    return -1;
  }

  static std::string counts(const Model& model) {
    return std::to_string(model.face_count()) + " faces, " + std::to_string(model.edge_count()) + " edges and " +
           std::to_string(model.vertex_count()) + " vertices";
  }

  /// New entity of each old one.
  std::vector<int> partners(const Colours& colours) const {
    std::map<int, int> of;
    for (int j = 0; j < after_.size_of_graph(); ++j) of[colours.after[j]] = j;
    std::vector<int> pairs;
    for (const int colour : colours.before) pairs.push_back(of.at(colour));
    return pairs;
  }

  Correspondence with_senses(const std::vector<int>& pairs) const {
    Correspondence found;
    for (int i = 0; i < before_.first_edge; ++i) found.faces.push_back(pairs[i]);
    for (int i = before_.first_edge; i < before_.first_vertex; ++i) found.edges.push_back(pairs[i] - after_.first_edge);
    for (int i = before_.first_vertex; i < before_.first_wire; ++i) found.vertices.push_back(pairs[i] - after_.first_vertex);
    for (int e = 0; e < static_cast<int>(found.edges.size()); ++e) found.edge_senses.push_back(open_edge_sense(found, e));
    for (int f = 0; f < static_cast<int>(found.faces.size()); ++f) found.face_senses.push_back(face_sense(found, f));
    for (int e = 0; e < static_cast<int>(found.edges.size()); ++e) {
      if (found.edge_senses[e] == 0) found.edge_senses[e] = closed_edge_sense(found, e);
    }
    return found;
  }

  int open_edge_sense(const Correspondence& found, int e) const {
    const auto [a0, a1] = before_.ends[e];
    if (a0 < 0 || a1 < 0 || a0 == a1) return 0;
    return found.vertices[a0 - before_.first_vertex] + after_.first_vertex == after_.ends[found.edges[e]][0] ? 1 : -1;
  }

  /// Sense of a use of an edge by a face; 0 when it has none, or both (a seam).
  static int use_of(const std::vector<std::map<int, int>>& uses, int face, int edge) {
    const auto found = uses[face].find(edge);
    return found == uses[face].end() ? 0 : found->second;
  }

  int face_sense(const Correspondence& found, int f) const {
    const int partner = found.faces[f];
    for (const auto& [e, use] : uses_before_[f]) {
      const int vote = use * use_of(uses_after_, partner, found.edges[e]) * found.edge_senses[e];
      if (vote != 0) return vote;
    }
    return models_[0]->face_sense(f) * models_[1]->face_sense(partner);
  }

  [[noreturn]] void refuse_turn() const {
    const auto [f, partner] = turned_.value_or(std::array<int, 2>{0, 0});
    throw Error(ErrorCode::failed_precondition,
                models_[0]->face_name(f) + " of the old model and " + models_[1]->face_name(partner) +
                    " of the new one are partners by structure, but their loops run in opposite "
                    "directions: one model is a mirror image, or inside out; name pairs with --map");
  }

  int closed_edge_sense(const Correspondence& found, int e) const {
    const Model &old = *models_[0], &now = *models_[1];
    for (int f = 0; f < old.face_count(); ++f) {
      const int a = use_of(uses_before_, f, e), b = use_of(uses_after_, found.faces[f], found.edges[e]);
      if (a * b != 0) return (a * b > 0 ? 1 : -1) * found.face_senses[f];
    }
    const TopoDS_Edge edge = old.edge(e), partner = now.edge(found.edges[e]);
    if (BRep_Tool::Degenerated(edge) || BRep_Tool::Degenerated(partner)) return 1;
    const BRepAdaptor_Curve a(edge), b(partner);  // a closed seam: the way that moves its points less
    double along = 0, against = 0;
    for (int i = 1; i < 8; ++i) {
      const auto at = [&](const BRepAdaptor_Curve& curve, double s) {
        return coordinates(curve.Value(curve.FirstParameter() + s * (curve.LastParameter() - curve.FirstParameter())));
      };
      along += squared_distance(at(a, i / 8.0) - at(a, 0), at(b, i / 8.0) - at(b, 0));
      against += squared_distance(at(a, i / 8.0) - at(a, 0), at(b, 1 - i / 8.0) - at(b, 0));
    }
    return against < along ? -1 : 1;
  }

  const Model* models_[2];
  ModelGraph before_, after_;
  const std::vector<std::map<int, int>> uses_before_, uses_after_;  ///< by face and edge
  std::optional<std::array<int, 2>> turned_;                        ///< faces whose loops ran in opposite directions
  std::vector<std::vector<int>> types_before_, types_after_;        ///< of the faces, where the graph leaves them out
  const std::vector<std::array<int, 2>> names_;                     ///< see common_names()
  std::vector<int> paints_before_, paints_after_;                   ///< see numbered_colours()
  std::size_t forced_ = 0;
  int tries_ = 0;
};

}  // namespace

bool structures_differ(const Model& before, const Model& after, FaceTypes types) {
  return Matching(before, after, {}, types).structures_differ();
}

double turned_planes(const Model& before, const Model& after, const Correspondence& partners) {
  const ModelGraph old = graph_of(before), now = graph_of(after);
  int planes = 0, turned = 0;
  for (int f = 0; f < before.face_count(); ++f) {
    const Vec3 &a = old.normals[f], &b = now.normals[partners.faces[f]];
    if (dot(a, a) == 0 || dot(b, b) == 0) continue;
    ++planes;
    if (dot(a, b) < std::sqrt(0.5)) ++turned;
  }
  return planes > 0 ? static_cast<double>(turned) / planes : 0;
}

Correspondence match_models(const Model& before, const Model& after, std::span<const ForcedPair> pairs, FaceTypes types) {
  return Matching(before, after, pairs, types).solve();
}

}  // namespace deform::cad
