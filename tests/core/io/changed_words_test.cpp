// SPDX-License-Identifier: GPL-3.0-or-later
// What becomes of a text file in which one word is another one: it is refused in the line of that word, or read, and as the same
// mesh only where the word says nothing of the mesh. A change in these tables is a change of what readers accept.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/io/formats/openfoam/openfoam_folder.h"
#include "core/io/mesh_file.h"

namespace deform::io::changed_words_test {
namespace {

/// A line of a file, and a mark for each of its words when that is left out, and for each when it is "?", 77, -1, 0.5 and 1:
/// '=' the same mesh is read
/// '~' another mesh is read
/// 'q' refused in this line, and the word is quoted
/// 'l' refused in this line
/// '^' refused in a line before, 'v' in one behind, 'f' for the file as a whole
struct Row {
  std::string line, marks;
};

const std::vector<std::string> changes{"", "?", "77", "-1", "0.5", "1"};

std::string text_of(const std::vector<Row>& rows) {
  std::string text;
  for (const Row& row : rows) text += row.line + '\n';
  return text;
}

struct Word {
  std::size_t begin, end;
};

std::vector<Word> words_of(const std::string& line) {
  constexpr const char* between = " ,=<>(){};";
  std::vector<Word> words;
  for (std::size_t at = 0; (at = line.find_first_not_of(between, at)) != std::string::npos;) {
    const std::size_t end = std::min(line.find_first_of(between, at), line.size());
    words.push_back({at, end});
    at = end;
  }
  return words;
}

/// All that a caller sees of a mesh.
std::string described(const MeshFile& file) {
  const Mesh& mesh = *file.mesh();
  std::ostringstream text;
  const auto add = [&text](const auto& numbers) {
    for (const auto& number : numbers) text << +number << ' ';
    text << '\n';
  };
  for (const Vec3& point : mesh.points) add(point);
  add(mesh.face_sizes);
  add(mesh.face_points);
  add(file.face_entities);
  for (const Group& group : mesh.groups) {
    text << group.name << '\n';
    add(group.points);
    add(group.faces);
  }
  for (std::size_t e = 0; mesh.elements && e < mesh.elements->size(); ++e) {
    text << static_cast<int>(mesh.elements->types[e]) << ": ";
    add(mesh.elements->nodes(e));
  }
  if (mesh.cells) {
    add(mesh.cells->owner);
    add(mesh.cells->neighbour);
  }
  return text.str();
}

using Read = std::function<std::unique_ptr<MeshFile>(const std::string& name, const std::string& bytes)>;

std::unique_ptr<MeshFile> read_alone(const std::string& name, const std::string& bytes) { return parse_mesh(bytes, name); }

void expect_marks(const std::string& name, const std::vector<Row>& rows, const Read& read = read_alone) {
  const std::string text = text_of(rows), before = described(*read(name, text));
  const auto mark_of = [&](const std::string& bytes, std::size_t line, const std::string& change) {
    try {
      return described(*read(name, bytes)) == before ? '=' : '~';
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ErrorCode::invalid_argument) << error.what();
      const std::string message = error.what(), start = name + ": line ";
      if (!message.starts_with(start)) return 'f';
      std::size_t digits = 0;
      const std::size_t found = std::stoul(message.substr(start.size()), &digits);
      if (found != line) return found < line ? '^' : 'v';
      return !change.empty() && message.find(change, start.size() + digits) != std::string::npos ? 'q' : 'l';
    }
  };
  std::size_t begin = 0;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const std::string& line = rows[r].line;
    std::string marks;
    for (const std::string& change : changes) {
      if (!marks.empty()) marks += ' ';
      for (const Word& word : words_of(line)) {
        std::string bytes = text;
        bytes.replace(begin + word.begin, word.end - word.begin, change);
        marks += mark_of(bytes, r + 1, change);
      }
    }
    EXPECT_EQ(rows[r].marks, marks) << name << ", line " << r + 1 << ": " << line;
    begin += line.size() + 1;
  }
}

TEST(ChangedWords, Obj) {
  expect_marks("a.obj", {
                            {"# a square and a triangle", "====== ====== ====== ====== ====== ======"},
                            {"mtllib car.mtl", "== == == == == =="},
                            {"o body", "~~ ~~ ~~ ~~ ~~ ~~"},
                            {"v 0 0 0", "~lll ~qqq ~~~~ ~~~~ ~~~~ ~~~~"},
                            {"v 1 0 0 1", "~~~~= ~qqq= ~~~~= ~~~~= ~~~~= ~=~~="},
                            {"v 1 1 0", "~lll ~qqq ~~~~ ~~~~ ~~~~ ~==~"},
                            {"v 0 1 0", "~lll ~qqq ~~~~ ~~~~ ~~~~ ~~=~"},
                            {"vt 0 0", "=== === === === === ==="},
                            {"vn 0 0 1", "==== ==== ==== ==== ==== ===="},
                            {"g left right", "~~~ ~~~ ~~~ ~~~ ~~~ ~~~"},
                            {"usemtl red", "~~ ~~ ~~ ~~ ~~ ~~"},
                            {"s 1", "== == == == == =="},
                            {"f 1 2 3", "~~~~ ~qqq ~qqq ~~~~ ~lll ~=~~"},
                            {"f 1/1/1 3//1 -2/1", "~~~~ ~qqq ~qqq ~~~~ ~lll ~=~~"},
                            {"l 1 2", "~~~ ~qq ~qq ~~~ ~ll ~=~"},
                        });
}

TEST(ChangedWords, Off) {
  expect_marks("a.off", {
                            {"COFF # colours", "vl= qq= ql= qq= qq= ql="},
                            {"4 2 0", "vv= qqq qq= qq= qqq v~="},
                            {"0 0 0 255 0 0", "~~~=== qqq=== ~~~=== ~~~=== ~~~=== ~~~==="},
                            {"1 0 0 255 0 0", "~~~=== qqq=== ~~~=== ~~~=== ~~~=== =~~==="},
                            {"1 1 0 255 0 0", "~~~=== qqq=== ~~~=== ~~~=== ~~~=== ==~==="},
                            {"0 1 0 255 0 0", "~~~=== qqq=== ~~~=== ~~~=== ~~~=== ~=~==="},
                            {"3 0 1 2", "lvvv qqqq qqqq qqqq qqqq ~~=~"},
                            {"3 0 2 3 1 0 0", "l~~~=== qqqq=== qqqq=== qqqq=== qqqq=== ~~~~==="},
                        });
}

TEST(ChangedWords, Ply) {
  expect_marks("a.ply", {
                            {"ply", "v q q q q q"},
                            {"format ascii 1.0", "lll qqq qqq qqq qqq qqq"},
                            {"comment of no interest", "l=== q=== q=== q=== q=== q==="},
                            {"element vertex 3", "lll q^q q^v q^q q^q q^v"},
                            {"property float x", "lll qq^ qq^ qq^ qq^ qq^"},
                            {"property float y", "lll qq^ qq^ qq^ qq^ qq^"},
                            {"property float z", "lll qq^ qq^ qq^ qq^ qq^"},
                            {"property uchar red", "lll qq= qq= qq= qq= qq="},
                            {"element face 1", "lll q~q q~v q~q q~q q~="},
                            {"property list uchar int vertex_indices", "lllll qqqq~ qqqq~ qqqq~ qqqq~ qqqq~"},
                            {"end_header", "v q q q q q"},
                            {"0 0 0 9", "vvvv qqq= ~~~= ~~~= ~~~= ~~~="},
                            {"1 0 0 9", "vvvv qqq= ~~~= ~~~= ~~~= =~~="},
                            {"0 1 0 9", "vvvv qqq= ~~~= ~~~= ~~~= ~=~="},
                            {"3 0 1 2", "lvvv qqqq qqqq qqqq qqqq q~=~"},
                        });
}

TEST(ChangedWords, Stl) {
  expect_marks("a.stl", {
                            {"solid first part", "f~~ f~~ f~~ f~~ f~~ f~~"},
                            {"facet normal 0 0 1", "l==== q==== q==== q==== q==== q===="},
                            {"outer loop", "vv vq vq vq vq vq"},
                            {"vertex 0 0 0", "lvvv qqqq q~~~ q~~~ q~~~ q~~~"},
                            {"vertex 1 0 0", "lvvv qqqq q~~~ q~~~ q~~~ q=~~"},
                            {"vertex 0 1 0", "lvvv qqqq q~~~ q~~~ q~~~ q~=~"},
                            {"endloop", "v q q q q q"},
                            {"endfacet", "v q q q q q"},
                            {"endsolid first part", "l== q== q== q== q== q=="},
                        });
}

TEST(ChangedWords, Medit) {
  expect_marks("a.mesh", {
                             {"MeshVersionFormatted 2", "l= l= l= l= l= l="},
                             {"Dimension", "= = = = = ="},
                             {"3", "v q q q q q"},
                             {"Vertices 4", "vv vq vq vq vq vv"},
                             {"0 0 0 7", "vvvv qqqq ~~~= ~~~= ~~~q ~~~="},
                             {"1 0 0 7", "vvvv qqqq ~~~= ~~~= ~~~q =~~="},
                             {"0 1 0 7", "vvvv qqqq ~~~= ~~~= ~~~q ~=~="},
                             {"0 0 1 7", "vvvv qqqq ~~~= ~~~= ~~~q ~~=="},
                             {"Corners 1", "== == == == == =="},
                             {"2", "= = = = = ="},
                             {"Triangles 1", "~v ~q ~q ~q ~q ~="},
                             {"1 2 3 5", "lllv qqqq qqq~ qqq~ qqqq =~~~"},
                             {"Tetrahedra 1", "~v ~q ~q ~q ~q ~="},
                             {"1 2 3 4 6", "llllv qqqqq qqqq= qqqq= qqqqq =~~~="},
                             {"End", "= = = = = ="},
                         });
}

TEST(ChangedWords, Su2) {
  expect_marks("a.su2", {
                            {"NDIME= 2", "vl vq vq vq vq vq"},
                            {"NELEM= 2", "~l ~q ~q ~q ~q ~v"},
                            {"5 0 1 2 0", "l~~~= qqqq= qqqq= qqqq= qqqq= ~~=~="},
                            {"9 1 4 3 2 1", "~~~~~= qqqqq= qqqqq= qqqqq= qqqqq= ~=~~~="},
                            {"NPOIN= 5", "vl vq vq vq vq v^"},
                            {"0 0 0", "=== qq= ~~= ~~= ~~= ~~="},
                            {"1 0 1", "~~= qq= ~~= ~~= ~~= =~="},
                            {"0 1 2", "~~= qq= ~~= ~~= ~~= ~=="},
                            {"1 1 3", "~~= qq= ~~= ~~= ~~= ==="},
                            {"2 0 4", "~~= qq= ~~= ~~= ~~= ~~="},
                            {"NMARK= 1", "== == q= q= q= q="},
                            {"MARKER_TAG= wall", "vl v~ v~ v~ v~ v~"},
                            {"MARKER_ELEMS= 2", "~l ~q ~q ~q ~q ~v"},
                            {"3 0 1", "lll qqq qqq qqq qqq =~="},
                            {"3 1 4", "=ll qqq qqq qqq qqq ~=~"},
                        });
}

TEST(ChangedWords, UnstructuredVtk) {
  expect_marks("old.vtk", {
                              {"# vtk DataFile Version 3.0", "lllll llllq llllq llllq lllll llll="},
                              {"title", "= = = = = ="},
                              {"ASCII", "l q q q q q"},
                              {"DATASET UNSTRUCTURED_GRID", "^^ ^^ ^^ ^^ ^^ ^^"},
                              {"POINTS 5 float", "lll qql qql qql qql qvl"},
                              {"0 0 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                              {"2 0 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                              {"0 2 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                              {"0 0 2", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                              {"2 2 2", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                              {"CELLS 3 13", "llv qqq qqv qqq qqq qvq"},
                              {"4 0 1 2 3", "vvvvv qqqqq qffff qqqqq qqqqq vf=~~"},
                              {"4 1 2 3 4", "vvvvv qqqqq ^ffff ^qqqq qqqqq l=~~f"},
                              {"2 0 1", "lvv qqq ^ff ^qq qqq q~="},
                              {"CELL_TYPES 3", "lv qq qv qq qq qv"},
                              {"10", "v q f q q ~"},
                              {"10", "v q f ^ q ~"},
                              {"3", "v q f ^ q ="},
                              {"POINT_DATA 5", "lv qq qv qq qq q~"},
                              {"SCALARS heat float 1", "~~~= ~=~q ~=~v ~=~q ~=~q ~=~="},
                              {"LOOKUP_TABLE default", "~~ ~= ~= ~= ~= ~="},
                              {"0 1 2 3 4", "~~~~~ ===== ===== ===== ===== ====="},
                              {"VECTORS flow float", "~~~ ~=~ ~=~ ~=~ ~=~ ~=~"},
                              {"0 0 0 1 1 1 2 2 2 3 3 3 4 4 4",
                               "~~~~~~~~~~~~~~~ =============== =============== =============== =============== ==============="},
                              {"CELL_DATA 3", "~v ~q ~v ~q ~q ~~"},
                              {"SCALARS part int", "~vv ~~~ ~~~ ~~~ ~~~ ~~~"},
                              {"LOOKUP_TABLE default", "lv q= l= l= q= l="},
                              {"4 6 6", "vvv qqq ~~~ ~~~ qqq ~~~"},
                              {"FIELD more 1", "=vv ==q ==v ==q ==q ==="},
                              {"zone 1 3 int", "lll= =qq= =qq= =qq= =qq= ===="},
                              {"2 2 3", "^vv qqq === === qqq ==="},
                          });
}

TEST(ChangedWords, Vtk5) {
  expect_marks("new.vtk", {
                              {"# vtk DataFile Version 5.1", "lllll llllq llllq llllq lllll llllv"},
                              {"title", "= = = = = ="},
                              {"ASCII", "l q q q q q"},
                              {"DATASET POLYDATA", "^^ ^^ ^^ ^^ ^^ ^^"},
                              {"POINTS 4 double", "lll qql qql qql qql qvl"},
                              {"0 0 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                              {"2 0 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                              {"2 2 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                              {"0 2 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                              {"METADATA", "v q q q q q"},
                              {"INFORMATION 0", "== == == == == =="},
                              {"", ""},
                              {"POLYGONS 3 6", "lvv qqq qvv qqq qqq qvv"},
                              {"OFFSETS vtktypeint64", "ll ll ll ll ll ll"},
                              {"0 3 6", "lvv qqq qqq qqq qqq qfq"},
                              {"CONNECTIVITY vtktypeint64", "ll ll ll ll ll ll"},
                              {"0 1 2 0 2 3", "vvvvvv qqqqqq ffffff qqqqqq qqqqqq ~=~~~~"},
                              {"CELL_DATA 2", "lv qq qv qq qq q~"},
                              {"COLOR_SCALARS paint 3", "~~~ ~=q ~=q ~=q ~=q ~=~"},
                              {"0 0 1 1 0 0", "~~~~~~ ====== ====== ====== ====== ======"},
                              {"NORMALS n float", "~~~ ~=~ ~=~ ~=~ ~=~ ~=~"},
                              {"0 0 1 0 0 1", "~~~~~~ ====== ====== ====== ====== ======"},
                              {"SCALARS part int", "~vv ~~~ ~~~ ~~~ ~~~ ~~~"},
                              {"LOOKUP_TABLE own", "lv q= l= l= q= l="},
                              {"4 6", "vv qq ~~ ~~ qq ~~"},
                              {"LOOKUP_TABLE own 2", "=== ==q ==q ==q ==q ==="},
                              {"1 0 0 1 0 1 0 1", "^vvvvvvv ======== ======== ======== ======== ========"},
                          });
}

TEST(ChangedWords, StructuredVtk) {
  expect_marks("grid.vtk",
               {
                   {"# vtk DataFile Version 2.0", "lllll llllq llllq llllq lllll llll="},
                   {"title", "= = = = = ="},
                   {"ASCII", "l q q q q q"},
                   {"DATASET STRUCTURED_GRID", "^^ ^^ ^^ ^^ ^^ ^^"},
                   {"DIMENSIONS 3 2 2", "lvvv qqqq qvvv qqqq qqqq qvvv"},
                   {"POINTS 12 float", "lll qql qql qql qql qvl"},
                   {"0 0 0 1 0 0 2 0 0", "vvvvvvvvv qqqqqqqqq ~~~~~~~~~ ~~~~~~~~~ ~~~~~~~~~ ~~~=~~~~~"},
                   {"0 1 0 1 1 0 2 1 0", "vvvvvvvvv qqqqqqqqq ~~~~~~~~~ ~~~~~~~~~ ~~~~~~~~~ ~=~==~~=~"},
                   {"0 0 1 1 0 1 2 0 1", "vvvvvvvvv qqqqqqqqq ~~~~~~~~~ ~~~~~~~~~ ~~~~~~~~~ ~~==~=~~="},
                   {"0 1 1 1 1 1 2 1 1", "vvvvvvvvv qqqqqqqqq ~~~~~~~~~ ~~~~~~~~~ ~~~~~~~~~ ~=====~=="},
                   {"POINT_DATA 12", "lv qq qv qq qq q~"},
                   {"TEXTURE_COORDINATES t 1 float", "~ll~ ~=q~ ~=q~ ~=q~ ~=q~ ~==~"},
                   {"0 0 0 0 0 0 0 0 0 0 0 0", "~~~~~~~~~~~~ ============ ============ ============ ============ ============"},
                   {"CELL_DATA 2", "~v ~q ~v ~q ~q ~~"},
                   {"TENSORS s float", "~~~ ~=~ ~=~ ~=~ ~=~ ~=~"},
                   {"1 0 0 0 1 0 0 0 1", "~~~~~~~~~ ========= ========= ========= ========= ========="},
                   {"1 0 0 0 1 0 0 0 1", "~~~~~~~~~ ========= ========= ========= ========= ========="},
                   {"GLOBAL_IDS id vtkIdType", "~~~ ~~~ ~~~ ~~~ ~~~ ~~~"},
                   {"0 1", "^v qq ~~ ~~ qq ~="},
               });
}

TEST(ChangedWords, Gmsh2) {
  expect_marks("two.msh", {
                              {"$MeshFormat", "l l l l l l"},
                              {"2.2 0 8", "llv qqq qqq qqq qqq qfq"},
                              {"$EndMeshFormat", "v l l l l l"},
                              {"$PhysicalNames", "v v v v v v"},
                              {"2", "= q q q q v"},
                              {R"(2 4 "skin")", "=~v qqq ~~q ~~q llq ~~q"},
                              {R"(3 6 "body")", "=~v qqq ~~q ~~q llq ~~q"},
                              {"$EndPhysicalNames", "v l l l l l"},
                              {"$Nodes", "v v v v v v"},
                              {"5", "v q q q q v"},
                              {"1 0 0 0", "vvvv qqqq v~~~ v~~~ q~~~ =~~~"},
                              {"2 2 0 0", "vvvv qqqq v~~~ v~~~ q~~~ q~~~"},
                              {"3 0 2 0", "vvvv qqqq v~~~ v~~~ q~~~ q~~~"},
                              {"4 0 0 2", "vvvv qqqq v~~~ v~~~ q~~~ q~~~"},
                              {"9 2 2 2", "lvvv qqqq v~~~ v~~~ q~~~ q~~~"},
                              {"$EndNodes", "v l l l l l"},
                              {"$Elements", "v v v v v v"},
                              {"4", "v q q q q v"},
                              {"1 2 2 4 3 1 2 3", "vvvvvvvv qqqqqqqq =qq~~qqq =qq~~qqq qqqqqqqq =~~~~=~~"},
                              {"2 4 2 6 7 1 2 3 4", "vvvvvvvvv qqqqqqqqq =qq~=qqqq =qq~=qqqq qqqqqqqqq =vl~==~~~"},
                              {"3 4 3 6 7 0 2 3 4 9", "vvvvvvvvvv qqqqqqqqqq =qq~==qqqq =qq~==qqqq qqqqqqqqqq =vl~==~~~~"},
                              {"4 15 2 5 8 1", "vvvvvv qqqqqq =qq~=q =qq~=q qqqqqq =vl~=="},
                              {"$EndElements", "v l l l l l"},
                          });
}

TEST(ChangedWords, Gmsh4) {
  expect_marks("four.msh", {
                               {"$MeshFormat", "l l l l l l"},
                               {"4.1 0 8", "llv qqq qqq qqq qqq qfq"},
                               {"$EndMeshFormat", "v l l l l l"},
                               {"$PhysicalNames", "v v v v v v"},
                               {"1", "v q q q q ="},
                               {R"(2 4 "skin")", "=~v qqq ~~q ~~q llq ~~q"},
                               {"$EndPhysicalNames", "v l l l l l"},
                               {"$Entities", "v v v v v v"},
                               {"1 0 2 1", "vvvv qqqq qqqq qqqq qqqq =vv="},
                               {"5 0 0 0 1 6", "vvvvvv qqqqqq ~===v~ ~===q~ q===qq ~====~"},
                               {"7 0 0 0 2 2 0 1 4 0", "vvvvvvvvvv qqqqqqqqqq ~======v~v ~======q~q q======qqq ~=======~v"},
                               {"8 0 0 0 2 2 0 0 0", "vvvvvvvvv qqqqqqqqq =======vv =======qq q======qq =======vv"},
                               {"3 0 0 0 2 2 2 0 1 7", "vvvvvvvvvv qqqqqqqqqq =======vv= =======qq= q======qqq =======v=="},
                               {"$EndEntities", "v l l l l l"},
                               {"$Nodes", "v v v v v v"},
                               {"2 5 1 9", "vvvv qqqq qq== qqqq qqqq vv=="},
                               {"2 7 0 3", "lvvv qqqq q=vq q=vq qqqq ==vv"},
                               {"1", "v q v v q ="},
                               {"2", "v q v v q q"},
                               {"3", "v q v v q q"},
                               {"0 0 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                               {"2 0 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                               {"0 2 0", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                               {"3 3 0 2", "vvvv qqqq q=vq q=vq qqqq ==vv"},
                               {"4", "v q v v q q"},
                               {"9", "v q v v q q"},
                               {"0 0 2", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                               {"2 2 2", "vvv qqq ~~~ ~~~ ~~~ ~~~"},
                               {"$EndNodes", "v l l l l l"},
                               {"$Elements", "v v v v v v"},
                               {"3 4 1 4", "vvvv qqqq qq== qqqq qqqq vv=="},
                               {"2 7 2 1", "l~~v qqqq q~qq q~qq qqqq ~~v="},
                               {"1 1 2 3", "vvvv qqqq =qqq =qqq qqqq ==~~"},
                               {"3 3 4 2", "vvvv qqqq q=qq q=qq qqqq ==vv"},
                               {"2 1 2 3 4", "vvvvv qqqqq =qqqq =qqqq qqqqq ==~~~"},
                               {"3 2 3 4 9", "vvvvv qqqqq =qqqq =qqqq qqqqq =~~~~"},
                               {"0 5 15 1", "lvvv qqqq q~qq q~qq qqqq ~~v="},
                               {"4 1", "vv qq =q =q qq =="},
                               {"$EndElements", "v l l l l l"},
                           });
}

TEST(ChangedWords, Abaqus) {
  expect_marks("a.inp", {
                            {"*HEADING", "= = = = = ="},
                            {"a title", "== == == == == =="},
                            {"*NODE, NSET=all", "v~~ v~~ v~~ v~~ v~~ v~~"},
                            {"1, 0, 0, 0", "l=== qqqq v~~~ v~~~ q~~~ =~~~"},
                            {"2, 1, 0, 0", "l~== qqqq v~~~ v~~~ q~~~ q=~~"},
                            {"3, 0, 1, 0", "l=~= qqqq v~~~ v~~~ q~~~ q~=~"},
                            {"14, 0, 0, 1", "l==~ qqqq v~~~ v~~~ q~~~ q~~="},
                            {"15, 1, 1, 1", "l~~~ qqqq v~~~ v~~~ q~~~ q==="},
                            {"*ELEMENT, TYPE=C3D4, ELSET=body", "lll~~ ql~~~ ll~~~ ll~~~ ql~~~ ll~~~"},
                            {"1, 1, 2, 3, 14", "lvvvv qqqqq vqqqq vqqqq qqqqq ==~~~"},
                            {"2, 2, 3, 14, 15", "lllll qqqqq vqqqq vqqqq qqqqq q~~~~"},
                            {"*ELEMENT, TYPE=S3, ELSET=skin", "lllvv ql~vv ll~vv ll~vv ql~vv ll~vv"},
                            {"5, 1, 2, 3", "llll qqqq =qqq =qqq qqqq q=~~"},
                            {"*NSET, NSET=few", "lll ql~ ll~ ll~ ql~ ll~"},
                            {"1, 14", "~~ qq qq qq qq =~"},
                            {"*NSET, NSET=row, GENERATE", "lll~ ql~~ ql~~ ql~~ ql~~ ll~~"},
                            {"1, 3, 2", "l~~ qqq q~~ =qq qqq =~~"},
                            {"*ELSET, ELSET=both", "lll ql~ ll~ ll~ ql~ ll~"},
                            {"1, 2", "~~ qq qq qq qq =~"},
                            {"*SURFACE, NAME=wet", "lll ql~ ql~ ql~ ql~ ll~"},
                            {"1, S1", "=~ qq qq qq qq =q"},
                            {"skin, SPOS", "== q= q= q= q= q="},
                            {"*STEP", "= q q q q ~"},
                            {"*STATIC", "= = = = = ="},
                            {"*END STEP", "== == == == == =="},
                        });
}

TEST(ChangedWords, AbaqusParts) {
  expect_marks("parts.inp", {
                                {"*PART, NAME=left", "vll vlv vlv vlv vlv vlv"},
                                {"*NODE", "v v v v v v"},
                                {"1, 0, 0, 0", "l=== qqqq v~~~ v~~~ q~~~ =~~~"},
                                {"2, 1, 0, 0", "l~== qqqq v~~~ v~~~ q~~~ q=~~"},
                                {"3, 0, 1, 0", "l=~= qqqq v~~~ v~~~ q~~~ q~=~"},
                                {"*ELEMENT, TYPE=S3, ELSET=skin", "lllvv ql~vv ll~vv ll~vv ql~vv ll~vv"},
                                {"1, 1, 2, 3", "llll qqqq =qqq =qqq qqqq ==~~"},
                                {"*END PART", "l= q= q= q= q= q="},
                                {"*PART, NAME=right", "vll vlv vlv vlv vlv vlv"},
                                {"*NODE", "v v v v v v"},
                                {"1, 2, 0, 0", "l~== qqqq v~~~ v~~~ q~~~ =~~~"},
                                {"2, 3, 0, 0", "l~== qqqq v~~~ v~~~ q~~~ q~~~"},
                                {"3, 2, 1, 0", "l~~= qqqq v~~~ v~~~ q~~~ q~=~"},
                                {"*ELEMENT, TYPE=S3, ELSET=skin", "lll~~ ql~~~ ll~~~ ll~~~ ql~~~ ll~~~"},
                                {"1, 1, 2, 3", "llll qqqq =qqq =qqq qqqq ==~~"},
                                {"*NSET, NSET=tip", "lll ql~ ll~ ll~ ql~ ll~"},
                                {"2", "~ q q q q ~"},
                                {"*END PART", "l= q= q= q= q= q="},
                                {"*ASSEMBLY, NAME=all", "=== === === === === ==="},
                                {"*INSTANCE, NAME=l1, PART=left", "vllvv vlvvv vlvvv vlvvv vlvvv vlvvv"},
                                {"*END INSTANCE", "== == == == == =="},
                                {"*INSTANCE, NAME=r1, PART=right", "vllvv vlvvv vlvvv vlvvv vlvvv vlvvv"},
                                {"*END INSTANCE", "~~ ~~ ~~ ~~ ~~ ~~"},
                                {"*NSET, NSET=tip, INSTANCE=r1", "~llvl ~l~vq ~l~vq ~l~vq ~l~vq ~l~vq"},
                                {"1, 3", "~~ qq qq qq qq =~"},
                                {"*SURFACE, NAME=front", "lll ql~ ql~ ql~ ql~ ll~"},
                                {"l1.skin, SNEG", "~= q= q= q= q= q="},
                                {"*END ASSEMBLY", "l= q= q= q= q= q="},
                            });
}

TEST(ChangedWords, Nastran) {
  expect_marks("a.bdf", {
                            {"SOL 101", "== == == == == =="},
                            {"CEND", "= = = = = ="},
                            {"BEGIN BULK", "=l =l =l =l =l =l"},
                            {"GRID,1,,0.,0.,0.", "vl=== vqqqq vv~~~ vv~~~ vq~~~ v=~~~"},
                            {"GRID,2,0,1.,0.,0.", "vl=~== vqqqqq vvq~~~ vvq~~~ vqq~~~ vqq=~~"},
                            {"GRID,3,,0.,1.,0.", "vl=~= vqqqq vv~~~ vv~~~ vq~~~ vq~=~"},
                            {"GRID,14,,0.,0.,1.,0", "vl==~= vqqqq= vv~~~= vv~~~= vq~~~= vq~~=="},
                            {"GRID,15,,1.,1.,1.", "vl~~~ vqqqq vv~~~ vv~~~ vq~~~ vq==="},
                            {"CTETRA,1,7,1,2,3,14", "~l~llll ~qqqqqq ~=~qqqq ~=~qqqq ~qqqqqq ~=~=~~~"},
                            {"CTETRA,2,8,2,3,14,15", "^l~llll ~qqqqqq ~=~qqqq ~=~qqqq ~qqqqqq ~=~~~~~"},
                            {"CTRIA3,5,9,1,2,3", "^l~lll ~qqqqq ~=~qqq ~=~qqq ~qqqqq ~=~=~~"},
                            {"CBAR,6,9,1,2,0.,0.,1.", "======== ======== ======== ======== ======== ========"},
                            {"PSHELL,9,1,.01", "==== ==== ==== ==== ==== ===="},
                            {"MAT1,1,2.1+11,,.3", "==== ==== ==== ==== ==== ===="},
                            {"ENDDATA", "= = = = = ="},
                        });
}

TEST(ChangedWords, Vtu) {
  expect_marks(
      "a.vtu",
      {
          {R"(<?xml version="1.0"?>)", "l=l === l=l l=l l=l l=l"},
          {R"(<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">)",
           "lllllllll qll=l=l=l vll=l=l=l vll=l=l=l vll=l=l=l vll=l=l=l"},
          {"<UnstructuredGrid>", "l v v v v v"},
          {R"(<Piece NumberOfPoints="5" NumberOfCells="2">)", "lllll qvl~l vvl~l vvl~l vvl~l vvl~l"},
          {"<PointData> </PointData>", "ll lv qv qv qv qv"},
          {R"(<CellData Scalars="part" >)", "lll q=l v=l v=l v=l v=l"},
          {R"(<DataArray type="Int32" Name="part" format="ascii" > 4 6 </DataArray>)",
           "llllllllll q~l~lllqqv q~l~lll~~v q~l~lll~~v q~l~lllqqv q~l~lll~~v"},
          {"</CellData>", "l v v v v v"},
          {"<Points>", "l v v v v v"},
          {R"(<DataArray type="Float32" Name="Points" NumberOfComponents="3" format="ascii" >)",
           "lllllllll qll=lllll vll=lllll vll=lllll vll=lllll vll=lllll"},
          {"0 0 0", "^^^ qqq ~~~ ~~~ ~~~ ~~~"},
          {"2 0 0", "^^^ qqq ~~~ ~~~ ~~~ ~~~"},
          {"0 2 0", "^^^ qqq ~~~ ~~~ ~~~ ~~~"},
          {"0 0 2", "^^^ qqq ~~~ ~~~ ~~~ ~~~"},
          {"2 2 2", "^^^ qqq ~~~ ~~~ ~~~ ~~~"},
          {"</DataArray>", "l v v v v v"},
          {"</Points>", "l v v v v v"},
          {"<Cells>", "l v v v v v"},
          {R"(<DataArray type="Int32" Name="connectivity" format="ascii" >)", "lllllll qll^lll vll^lll vll^lll vll^lll vll^lll"},
          {"0 1 2 3 1 2 3 4", "^^^^^^^^ qqqqqqqq ^^^^^^^^ ^^^^^^^^ qqqqqqqq f=~~=~~f"},
          {"</DataArray>", "l v v v v v"},
          {R"(<DataArray type="Int32" Name="offsets" format="ascii" >)", "lllllll qll^lll vll^lll vll^lll vll^lll vll^lll"},
          {"4 8", "^^ qq ^^ ^^ qq f^"},
          {"</DataArray>", "l v v v v v"},
          {R"(<DataArray type="UInt8" Name="types" format="ascii" >)", "lllllll qll^lll vll^lll vll^lll vll^lll vll^lll"},
          {"10 10", "^^ qq ff ^^ qq ~~"},
          {"</DataArray>", "l v v v v v"},
          {"</Cells>", "l v v v v v"},
          {"</Piece>", "l v v v v v"},
          {"</UnstructuredGrid>", "l v v v v v"},
          {"</VTKFile>", "l ^ q q q q"},
      });
}

const std::vector<Row> foam_points = {
    {"FoamFile { version 2.0; format ascii; class vectorField; object points; }",
     "l===l==== q===l==== q===l==== q===l==== q===l==== l===l===="},
    {"12", "v q q q q v"},
    {"(", ""},
    {"(0 0 0) (1 0 0) (2 0 0)", "lllllllll qqqqqqqqq ~~~~~~~~~ ~~~~~~~~~ ~~~~~~~~~ ~~~=~~~~~"},
    {"(0 1 0) (1 1 0) (2 1 0)", "lllllllll qqqqqqqqq ~~~~~~~~~ ~~~~~~~~~ ~~~~~~~~~ ~=~==~~=~"},
    {"(0 0 3) (1 0 3) (2 0 3)", "lllllllll qqqqqqqqq ~~~~~~~~~ ~~~~~~~~~ ~~~~~~~~~ ~~~=~~~~~"},
    {"(0 1 3) (1 1 3) (2 1 3)", "lllllllll qqqqqqqqq ~~~~~~~~~ ~~~~~~~~~ ~~~~~~~~~ ~=~==~~=~"},
    {")", ""},
};

const std::vector<Row> foam_faces = {
    {"FoamFile { version 2.0; format ascii; class faceList; object faces; }",
     "l===l==== q===l==== q===l==== q===l==== q===l==== l===l===="},
    {"11", "v q q q q v"},
    {"(", ""},
    {"4(1 4 10 7)", "lllll qqqqq qqqqq qqqqq qqqqq l===="},
    {"4(0 6 9 3)", "lllll qqqqq qqqqq qqqqq qqqqq l~~~~"},
    {"4(2 5 11 8)", "lllll qqqqq qqqqq qqqqq qqqqq l~~~~"},
    {"4(0 1 7 6)", "lllll qqqqq qqqqq qqqqq qqqqq q~=~~"},
    {"4(1 2 8 7)", "lllll qqqqq qqqqq qqqqq qqqqq l=~~~"},
    {"4(3 9 10 4)", "lllll qqqqq qqqqq qqqqq qqqqq l~~~~"},
    {"4(4 10 11 5)", "lllll qqqqq qqqqq qqqqq qqqqq q~~~~"},
    {"4(0 3 4 1)", "lllll qqqqq qqqqq qqqqq qqqqq l~~~="},
    {"4(1 4 5 2)", "lllll qqqqq qqqqq qqqqq qqqqq l=~~~"},
    {"4(6 7 10 9)", "lllll qqqqq qqqqq qqqqq qqqqq l~~~~"},
    {"4(7 8 11 10)", "lllll qqqqq qqqqq qqqqq qqqqq l~~~~"},
    {")", ""},
};

const std::vector<Row> foam_owner = {
    {"FoamFile { version 2.0; format ascii; class labelList; object owner; }",
     "l===l==== q===l==== q===l==== q===l==== q===l==== l===l===="},
    {"11(0 0 1 0 1 0 1 0 1 0 1)", "llllllllllll qqqqqqqqqqqq qqqqqqqqqqqq qqqqqqqqqqqq qqqqqqqqqqqq l~~=~=~=~=~="},
};

const std::vector<Row> foam_neighbour = {
    {"FoamFile { version 2.0; format ascii; class labelList; object neighbour; }",
     "l===l==== q===l==== q===l==== q===l==== q===l==== l===l===="},
    {"1{1}", "ll qq qq qq qq =="},
};

const std::vector<Row> foam_boundary = {
    {"FoamFile { version 2.0; format ascii; class polyBoundaryMesh; object boundary; }",
     "l===l==== q===l==== q===l==== q===l==== q===l==== l===l===="},
    {"3", "v q q q q v"},
    {"(", ""},
    {"inlet { type patch; nFaces 1; startFace 1; }", "l=l~lfl ~==~qfq ~==~lfq ~==~qfq ~==~qfq ~==~=f="},
    {"outlet { type patch; nFaces 1; startFace 2; }", "l=l~lfl ~==~qfq ~==~lfq ~==~qfq ~==~qfq ~==~=f~"},
    {"sides { type wall; inGroups 2(wall all); nFaces 8; startFace 3; }",
     "l=l~=~~~lfl ~==~q~~~qfq ~==~=~~~lfq ~==~=~~~qfq ~==~q~~~qfq ~==~=~~~~f~"},
    {")", ""},
};

const std::vector<Row> foam_cellzones = {
    {"FoamFile { version 2.0; format ascii; class regIOobject; object cellZones; }",
     "l===l==== q===l==== q===l==== q===l==== q===l==== ~===l===="},
    {"1", "v q q q q ="},
    {"(", ""},
    {"left { type cellZone; cellLabels List<label> 1(0); }", "l==~l=ll ~==~q=qq ~==~q=qq ~==~q=qq ~==~q=qq ~==~q==~"},
    {")", ""},
};

TEST(ChangedWords, OpenFoam) {
  const auto read = [](const std::string& changed, const std::string& bytes) {
    FoamFiles files;
    files.points = {text_of(foam_points), "points"};
    files.faces = {text_of(foam_faces), "faces"};
    files.owner = {text_of(foam_owner), "owner"};
    files.neighbour = {text_of(foam_neighbour), "neighbour"};
    files.boundary = {text_of(foam_boundary), "boundary"};
    files.cell_zones = {text_of(foam_cellzones), "cellZones"};
    for (FoamFiles::Part* part :
         {&files.points, &files.faces, &files.owner, &files.neighbour, &files.boundary, &files.cell_zones}) {
      if (part->name == changed) part->bytes = bytes;
    }
    return parse_openfoam(std::move(files));
  };
  expect_marks("points", foam_points, read);
  expect_marks("faces", foam_faces, read);
  expect_marks("owner", foam_owner, read);
  expect_marks("neighbour", foam_neighbour, read);
  expect_marks("boundary", foam_boundary, read);
  expect_marks("cellZones", foam_cellzones, read);
}

}  // namespace
}  // namespace deform::io::changed_words_test
