// SPDX-License-Identifier: Apache-2.0
#include "core/io/assembly/number_fields.h"

#include <algorithm>
#include <bit>

#include "core/base/error.h"
#include "core/io/assembly/coordinate_records.h"

namespace deform::io {

namespace {

/// A number as it stands in columns: at the right end where the old one did, else where that began. The last field of a line may
/// have fewer columns.
std::string aligned(const std::string& number, std::string_view old, std::size_t columns) {
  const std::size_t first = old.find_first_not_of(' ');
  const std::size_t room = columns - number.size();
  if (first == std::string_view::npos || (old.size() == columns && old.back() != ' ')) return std::string(room, ' ') + number;
  std::string text = std::string(std::min(first, room), ' ') + number;
  if (old.size() == columns) text.resize(columns, ' ');
  return text;
}

class FieldWriter {
 public:
  FieldWriter(std::string_view bytes, DecimalStyle style) : bytes_(bytes), style_(style) {
    out_.reserve(bytes.size() + bytes.size() / 4);
    const bool lf = bytes.find('\n') != std::string_view::npos, cr = bytes.find('\r') != std::string_view::npos;
    line_end_ = !cr ? "\n" : lf ? "\r\n" : "\r";
  }

  void replace(const NumberField& field, double value, const std::string& which) {
    const auto number = fitted_decimal(value, field.width, style_);
    if (!number) {
      throw Error(ErrorCode::invalid_argument,
                  which + " does not fit into the " + std::to_string(field.width) + " characters of its field");
    }
    out_.append(bytes_.substr(copied_, field.at - copied_));
    // What an earlier coordinate has changed at this end of a line counts.
    if (field.at != end_ || field.new_line) longer_ = 0;
    const bool fixed = field.kind == NumberField::Kind::fixed;
    const std::string text = fixed ? aligned(*number, bytes_.substr(field.at, field.length), field.width) : *number;
    if (field.new_line) out_ += line_end_ + "*";
    if (field.missing > longer_) {
      out_.append(static_cast<std::size_t>(field.missing - longer_), fixed ? ' ' : ',');
      longer_ = field.missing;
    }
    if (fixed) longer_ += static_cast<std::ptrdiff_t>(text.size()) - field.length;
    out_ += text;
    copied_ = end_ = field.at + field.length;
  }

  std::string take() {
    out_.append(bytes_.substr(copied_));
    return std::move(out_);
  }

 private:
  const std::string_view bytes_;
  const DecimalStyle style_;
  std::string out_, line_end_;
  std::size_t copied_ = 0;
  std::size_t end_ = ~std::size_t{0};  // of the field before
  std::ptrdiff_t longer_ = 0;          // how many columns or commas the line has there more than it had
};

class FieldMeshFile : public MeshFile {
 public:
  FieldMeshFile(Format format, std::string bytes, std::shared_ptr<const Mesh> mesh, std::vector<FieldRecord> records,
                DecimalStyle style)
      : MeshFile(format, std::move(mesh)), bytes_(std::move(bytes)), records_(std::move(records)), style_(style) {}

  std::string with_points(std::span<const Vec3> points) const override {
    check_points(points, original_points().size());
    return with_number_fields(bytes_, records_, original_points(), points, style_);
  }

 private:
  const std::string bytes_;
  const std::vector<FieldRecord> records_;
  const DecimalStyle style_;
};

}  // namespace

std::string with_number_fields(std::string_view bytes, std::span<const FieldRecord> records, std::span<const Vec3> before,
                               std::span<const Vec3> after, DecimalStyle style) {
  FieldWriter writer(bytes, style);
  for (const FieldRecord& record : records) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double value = after[record.point][k];
      if (same_bits(value, before[record.point][k])) continue;
      writer.replace(record.axes[k], value, "points[" + std::to_string(record.point) + "]: coordinate " + "xyz"[k]);
    }
  }
  return writer.take();
}

std::unique_ptr<MeshFile> make_field_mesh_file(Format format, std::string bytes, std::shared_ptr<const Mesh> mesh,
                                               std::vector<FieldRecord> records, DecimalStyle style) {
  return std::make_unique<FieldMeshFile>(format, std::move(bytes), std::move(mesh), std::move(records), style);
}

}  // namespace deform::io
