// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/deformers/handles/stored_basis.h"

#include <array>
#include <cstring>
#include <string>
#include <type_traits>
#include <utility>

#include "core/base/error.h"
#include "core/base/version.h"
#include "core/deformers/handles/handle_system.h"

namespace deform {

namespace {

/// Another one whenever bytes that were written before would mean something else: then they are not read any more.
constexpr std::array<char, 16> layout_tag{"deform.basis.3"};

[[noreturn]] void refuse_bytes(const std::string& why) { throw Error(ErrorCode::data_loss, "stored basis: " + why); }

template <typename T>
concept Flat = std::is_trivially_copyable_v<T>;

/// Writes what visit() names.
class Out {
 public:
  explicit Out(const StoredBasis::Sink& sink) : sink_(sink) {}

  template <Flat T>
  void value(const T& value) {
    sink_(&value, sizeof value);
  }
  template <typename Array>
  void array(const Array& values) {
    value(static_cast<std::uint64_t>(values.size()));
    if (!values.empty()) sink_(values.data(), values.size() * sizeof(values[0]));
  }
  /// Calls each(item) for all of them.
  template <typename Items, typename Each>
  void items(const Items& items, const Each& each) {
    value(static_cast<std::uint64_t>(items.size()));
    for (const auto& item : items) each(item);
  }
  void tiles(const FieldTiles& tiles) {
    value(static_cast<std::uint64_t>(tiles.points()));
    value(static_cast<std::uint64_t>(tiles.fields()));
    if (tiles.bytes() > 0) sink_(tiles.tile(0), tiles.bytes());
  }
  void compressed(const std::optional<CompressedFields>& fields);

 private:
  const StoredBasis::Sink& sink_;
};

/// Reads the same.
class In {
 public:
  explicit In(compiled::ByteSource& from) : from_(from), left_(from.size()) {}

  template <Flat T>
  void value(T& value) {
    take(&value, sizeof value);
  }
  void value(bool& value) {
    unsigned char byte = 0;
    take(&byte, sizeof byte);
    value = byte != 0;
  }
  template <typename Array>
  void array(Array& values) {
    values.resize(count(sizeof(values[0])));
    take(values.data(), values.size() * sizeof(values[0]));
  }
  template <typename Items, typename Each>
  void items(Items& items, const Each& each) {
    const std::size_t size = count(sizeof(std::uint64_t));  // each takes at least as much
    for (std::size_t i = 0; i < size; ++i) each(items.emplace_back());
  }
  void tiles(FieldTiles& tiles) {
    std::uint64_t points = 0, fields = 0;
    value(points);
    value(fields);
    if (points > left_ || fields > left_ || (points > 0 && fields > left_ / sizeof(double) / points)) refuse_bytes("too short");
    if (FieldTiles::bytes_for(points, fields) > left_) refuse_bytes("too short");
    tiles = FieldTiles(points, fields);
    if (tiles.bytes() > 0) take(tiles.tile(0), tiles.bytes());
  }
  void compressed(std::optional<CompressedFields>& fields);
  void finish() const {
    if (left_ != 0) refuse_bytes("bytes are left over");
  }

 private:
  void take(void* data, std::size_t size) {
    if (size > left_) refuse_bytes("too short");
    if (size > 0) from_.read({static_cast<std::byte*>(data), size});
    left_ -= size;
  }
  std::size_t count(std::size_t bytes_of_one) {
    std::uint64_t count = 0;
    value(count);
    if (count > left_ / bytes_of_one) refuse_bytes("too short");
    return count;
  }

  compiled::ByteSource& from_;
  std::uint64_t left_;
};

template <typename Archive, typename Info>
void visit_info(Archive& archive, Info& info) {
  const auto all = [&](auto&... values) { (archive.value(values), ...); };
  all(info.points, info.fixed_points, info.handle_points, info.deformable_points, info.constraint_points, info.centres,
      info.held_points, info.samples, info.functions, info.cubature_points, info.merged_duplicates, info.polynomial_terms,
      info.affine_hull_dimension, info.basis_fields, info.bytes, info.factor_bytes, info.basis_bytes, info.design_bytes,
      info.diagonal, info.condition, info.tolerance, info.solver, info.reduced, info.reduction_tolerance, info.reduction_misfit,
      info.reduction_error);
  archive.items(info.notes, [&](auto& note) { archive.array(note); });
  archive.items(info.stage_seconds, [&](auto& stage) {
    archive.array(stage.first);
    archive.value(stage.second);
  });
}

template <typename Archive, typename Block>
void visit_block(Archive& archive, Block& block) {
  archive.value(block.centre);
  archive.value(block.inverse_radius);
  archive.array(block.affine);
  archive.array(block.steps);
  archive.array(block.offsets);
  archive.array(block.bits);
  archive.value(block.stride);
  archive.array(block.directions);
  archive.value(block.tile_bytes);
  archive.array(block.codes);
  archive.array(block.exact);
}

template <typename Archive, typename Basis>
void visit_basis(Archive& archive, Basis& basis) {
  archive.array(basis.components);
  archive.value(basis.converged);
  archive.value(basis.turned);
  archive.array(basis.residuals);
  archive.value(basis.checked);
  archive.array(basis.errors);
  archive.array(basis.more);
  archive.tiles(basis.tiles);
  archive.compressed(basis.compressed);
}

void Out::compressed(const std::optional<CompressedFields>& fields) {
  value(fields.has_value());
  if (!fields) return;
  value(static_cast<std::uint64_t>(fields->points()));
  value(static_cast<std::uint64_t>(fields->fields()));
  items(fields->blocks(), [&](const FieldBlock& block) { visit_block(*this, block); });
  array(fields->errors());
}

void In::compressed(std::optional<CompressedFields>& fields) {
  bool any = false;
  value(any);
  if (!any) return;
  std::uint64_t points = 0, count = 0;
  std::vector<FieldBlock> blocks;
  std::vector<double> errors;
  value(points);
  value(count);
  items(blocks, [&](FieldBlock& block) { visit_block(*this, block); });
  array(errors);
  fields.emplace(points, count, std::move(blocks), std::move(errors));
}

bool same_bits(const void* a, const void* b, std::size_t size) { return std::memcmp(a, b, size) == 0; }

}  // namespace

const HandleSystem* StoredBasis::source(const System& system) {
  const auto* of_handles = dynamic_cast<const HandleSystem*>(&system);
  if (of_handles == nullptr || !of_handles->has_basis() || !of_handles->setup_.constraints.empty()) return nullptr;
  return of_handles;
}

void StoredBasis::write(const HandleSystem& system, const Sink& sink) {
  Out out(sink);
  out.value(layout_tag);
  out.array(std::string(version()));
  visit_info(out, system.info_);
  out.value(system.box_);
  out.array(system.frames_);
  out.value(static_cast<std::uint64_t>(system.following().size()));
  out.items(system.basis_, [&](const HandleBasis& basis) { visit_basis(out, basis); });
}

std::uint64_t StoredBasis::bytes(const HandleSystem& system) {
  std::uint64_t bytes = 0;
  write(system, [&](const void*, std::size_t size) { bytes += size; });
  return bytes;
}

StoredBasis StoredBasis::read(compiled::ByteSource& from) {
  In in(from);
  std::array<char, 16> tag{};
  in.value(tag);
  if (tag != layout_tag) refuse_bytes("of another layout");
  // The same setup may have other bits in another version.
  std::string writer;
  in.array(writer);
  if (writer != version())
    refuse_bytes("of version " + writer.substr(0, 32) + " of this program, which has version " + version());
  StoredBasis result;
  visit_info(in, result.info);
  in.value(result.box);
  in.array(result.frames);
  in.value(result.following);
  std::uint64_t bases = 0;
  in.value(bases);
  for (std::uint64_t b = 0; b < bases; ++b) {
    HandleBasis basis{{}, FieldTiles(0, 0), {}};
    visit_basis(in, basis);
    result.bases.push_back(std::move(basis));
  }
  in.finish();
  return result;
}

void StoredBasis::check_fits(const HandleSystem& system) const {
  const auto require = [](bool fits, const char* what) {
    if (!fits) refuse_bytes(std::string("its ") + what + " are not those of the setup on the mesh");
  };
  require(same_bits(&box, &system.box_, sizeof box), "unit coordinates");
  require(frames.size() == system.frames_.size() &&
              same_bits(frames.data(), system.frames_.data(), frames.size() * sizeof(HandleFrame)),
          "handles");
  const SystemInfo& own = system.info_;
  require(following == system.following().size() && info.points == own.points && info.handle_points == own.handle_points &&
              info.fixed_points == own.fixed_points,
          "points");
  require(!bases.empty(), "bases");
  const std::size_t fields = system.fields();
  for (const HandleBasis& basis : bases) {
    const bool whole = basis.compressed ? basis.compressed->fits(following, fields)
                                        : basis.tiles.points() == following && basis.tiles.fields() == fields;
    require(whole && basis.residuals.size() == fields && basis.errors.size() == bases.front().errors.size() &&
                basis.checked == bases.front().checked && basis.checked <= HandleBasis::Checked::held &&
                basis.errors.size() % fields == 0 && (basis.more.empty() || basis.more.size() == fields) &&
                basis.compressed.has_value() == bases.front().compressed.has_value(),
            "fields");
    for (const std::size_t k : basis.components) require(k < 3, "components");
  }
}

}  // namespace deform
