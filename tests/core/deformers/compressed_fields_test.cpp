// SPDX-License-Identifier: GPL-3.0-or-later
// Fields that are stored to a bound against the same fields in doubles, value by value.
#include "core/deformers/handles/compressed_fields.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "core/base/error.h"

namespace deform::compressed_fields_test {
namespace {

struct Fields {
  std::vector<Vec3> places;
  FieldTiles tiles;
};

/// Points row by row on a curved sheet; fields that are smooth there, of different sizes.
Fields smooth(std::size_t points, std::size_t fields) {
  Fields result{{}, FieldTiles(points, fields)};
  for (std::size_t i = 0; i < points; ++i) {
    const double u = static_cast<double>(i % 40) / 40, v = static_cast<double>(i / 40) / 40;
    result.places.push_back({u, v, 0.2 * std::sin(3 * u)});
    for (std::size_t f = 0; f < fields; ++f) {
      const double a = 0.1 + 0.05 * static_cast<double>(f), x = u - a, y = v - 1 + a;
      result.tiles.at(i, f) = std::pow(10.0, -static_cast<double>(f % 4)) * std::sqrt(x * x + y * y + 0.05);
    }
  }
  return result;
}

Fields noise(std::size_t points, std::size_t fields) {
  Fields result = smooth(points, fields);
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (std::size_t i = 0; i < points; ++i) {
    for (std::size_t f = 0; f < fields; ++f) result.tiles.at(i, f) = uniform(random);
  }
  return result;
}

/// points x columns: the sums of the fields with coefficients (fields x columns), tile by tile.
std::vector<double> sums(const CompressedFields& fields, const std::vector<Vec3>& places, const std::vector<std::uint32_t>& rows,
                         const std::vector<double>& coefficients, std::size_t columns) {
  CompressedSums all(fields, rows, coefficients.data(), columns, columns);
  std::vector<double> result, out(columns * tile_size);
  for (std::size_t t = 0; t < tile_count(fields.points()); ++t) {
    const std::size_t first = t * tile_size, count = std::min(tile_size, fields.points() - first);
    std::fill(out.begin(), out.end(), 0.0);
    all.add_tile(t, std::span(places).subspan(first, count), 0, columns, out.data());
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t c = 0; c < columns; ++c) result.push_back(out[c * tile_size + i]);
    }
  }
  return result;
}

/// The stored values, points x fields: sums with the unit matrix.
std::vector<double> stored(const CompressedFields& fields, const std::vector<Vec3>& places) {
  const std::size_t F = fields.fields();
  std::vector<std::uint32_t> rows(F);
  std::vector<double> unit(F * F, 0.0);
  for (std::size_t f = 0; f < F; ++f) {
    rows[f] = static_cast<std::uint32_t>(f);
    unit[f * F + f] = 1;
  }
  return sums(fields, places, rows, unit, F);
}

/// Checks every value against the bound and what the fields say of themselves; gives the largest error.
double check_values(const Fields& the, const CompressedFields& compressed, double bound) {
  const std::vector<double> values = stored(compressed, the.places);
  const std::size_t F = the.tiles.fields();
  std::vector<double> largest(F, 0.0);
  for (std::size_t i = 0; i < the.tiles.points(); ++i) {
    for (std::size_t f = 0; f < F; ++f) largest[f] = std::max(largest[f], std::abs(values[i * F + f] - the.tiles.at(i, f)));
  }
  for (std::size_t f = 0; f < F; ++f) {
    EXPECT_LE(largest[f], compressed.errors()[f]) << f;
    EXPECT_LE(compressed.errors()[f], bound) << f;
    EXPECT_LE(compressed.errors()[f], largest[f] + 2e-12) << f << ": says more than there is";
  }
  return *std::max_element(largest.begin(), largest.end());
}

TEST(CompressedFields, KeepTheBoundAtEveryPoint) {
  for (const std::size_t fields : {4, 12, 80}) {
    const Fields the = smooth(1600, fields);
    for (const double bound : {1e-4, 1e-7, 1e-9, 1e-11}) {
      const CompressedFields compressed(the.tiles, the.places, bound, {});
      EXPECT_GT(check_values(the, compressed, bound), 0.2 * bound) << "finer than it has to be: " << bound;
      EXPECT_LT(compressed.bytes(), the.tiles.bytes()) << bound;
      EXPECT_LE(compressed.bytes(), CompressedFields::bytes_for(1600, fields, bound)) << bound;
    }
  }
}

TEST(CompressedFields, SmoothFieldsTakeAFractionOfTheMemory) {
  const Fields the = smooth(3200, 40);
  const auto share = [&](double bound) {
    return static_cast<double>(CompressedFields(the.tiles, the.places, bound, {}).bytes()) /
           static_cast<double>(the.tiles.bytes());
  };
  EXPECT_LT(share(1e-6 / 40), 0.3);
  EXPECT_LT(share(1e-8 / 40), 0.5);
}

TEST(CompressedFields, NoiseKeepsTheBoundToo) {
  const Fields the = noise(1100, 8);
  for (const double bound : {1e-2, 1e-5, 1e-8, 1e-12}) {  // the last takes columns in two parts
    const CompressedFields compressed(the.tiles, the.places, bound, {});
    check_values(the, compressed, bound);
    EXPECT_LE(compressed.bytes(), CompressedFields::bytes_for(1100, 8, bound)) << bound;
  }
  // Within the rounding of sums the values themselves are kept.
  const CompressedFields exact(the.tiles, the.places, 1e-16, {});
  EXPECT_EQ(check_values(the, exact, 1e-16), 0);
  EXPECT_LE(exact.bytes(), CompressedFields::bytes_for(1100, 8, 1e-16));
}

TEST(CompressedFields, AffineFieldsAreAffineFunctions) {
  Fields the = smooth(700, 4);
  for (std::size_t i = 0; i < 700; ++i) {
    const Vec3& x = the.places[i];
    for (std::size_t f = 0; f < 4; ++f) the.tiles.at(i, f) = f == 0 ? 1 : x[f - 1];
  }
  const CompressedFields compressed(the.tiles, the.places, 1e-12, {});
  check_values(the, compressed, 1e-12);
  EXPECT_LT(compressed.bytes(), the.tiles.bytes() / 10);
}

TEST(CompressedFields, AnyNumberOfPoints) {  // around tiles and blocks
  for (const std::size_t points : {0, 1, 2, 15, 16, 17, 511, 512, 513, 1025}) {
    const Fields the = smooth(points, 4);
    const CompressedFields compressed(the.tiles, the.places, 1e-7, {});
    check_values(the, compressed, 1e-7);
    if (points == 0) {
      EXPECT_EQ(compressed.bytes(), 4 * sizeof(double)) << "the errors of the fields, nothing else";
    }
  }
}

TEST(CompressedFields, FlatAndCoincidentPlaces) {
  Fields the = smooth(600, 8);
  for (Vec3& x : the.places) x = {x[0], 0.5, 0.5};
  check_values(the, CompressedFields(the.tiles, the.places, 1e-8, {}), 1e-8);
  for (Vec3& x : the.places) x = {0.5, 0.5, 0.5};
  check_values(the, CompressedFields(the.tiles, the.places, 1e-8, {}), 1e-8);
}

TEST(CompressedFields, WhatIsNotFiniteStays) {
  Fields the = smooth(1100, 4);
  the.tiles.at(700, 2) = std::numeric_limits<double>::infinity();
  const CompressedFields compressed(the.tiles, the.places, 1e-6, {});
  const std::vector<std::uint32_t> rows{2};
  const std::vector<double> values = sums(compressed, the.places, rows, {0, 0, 1, 0}, 1);
  EXPECT_EQ(values[700], std::numeric_limits<double>::infinity());
  EXPECT_EQ(values[701], the.tiles.at(701, 2));
  EXPECT_NEAR(values[0], the.tiles.at(0, 2), 1e-6);
}

TEST(CompressedFields, SumsDoNotDependOnOtherColumnsNorOnTheOrderOfTiles) {
  const Fields the = smooth(1300, 12);
  const CompressedFields compressed(the.tiles, the.places, 1e-8, {});
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  constexpr std::size_t columns = 7;
  std::vector<double> B(12 * columns);
  for (double& b : B) b = normal(random);
  const std::vector<std::uint32_t> rows{0, 1, 5, 11};
  const std::vector<double> together = sums(compressed, the.places, rows, B, columns);
  for (std::size_t c = 0; c < columns; ++c) {
    CompressedSums alone(compressed, rows, B.data() + c, columns, 1);
    CompressedSums part(compressed, rows, B.data(), columns, columns);
    for (const std::size_t tile : {80, 3, 40, 41, 0, 81}) {
      const std::span<const Vec3> places =
          std::span(the.places).subspan(tile * tile_size, std::min(tile_size, 1300 - tile * tile_size));
      double one[tile_size] = {}, other[tile_size] = {};
      alone.add_tile(tile, places, 0, 1, one);
      part.add_tile(tile, places, c, 1, other);
      for (std::size_t i = 0; i < places.size(); ++i) {
        EXPECT_EQ(one[i], together[(tile * tile_size + i) * columns + c]);
        EXPECT_EQ(other[i], one[i]);
      }
    }
  }
}

TEST(CompressedFields, TransposedProductIsThatOfTheStoredValues) {
  for (const Fields& the : {smooth(1300, 12), noise(1300, 12)}) {
    const CompressedFields compressed(the.tiles, the.places, 1e-10, {});
    const std::vector<double> values = stored(compressed, the.places);
    std::mt19937_64 random(4);
    std::normal_distribution<double> normal;
    std::vector<Vec3> X(1300);
    for (Vec3& x : X) x = {normal(random), normal(random), normal(random)};
    const std::vector<double> product = compressed.transposed_product(X, the.places, {});
    RunContext one_thread;
    one_thread.threads = 1;
    EXPECT_TRUE(compressed.transposed_product(X, the.places, one_thread) == product);
    for (std::size_t f = 0; f < 12; ++f) {
      for (std::size_t k = 0; k < 3; ++k) {
        long double sum = 0, size = 0;
        for (std::size_t i = 0; i < X.size(); ++i) {
          sum += static_cast<long double>(values[i * 12 + f]) * X[i][k];
          size += std::abs(values[i * 12 + f] * X[i][k]);
        }
        EXPECT_NEAR(product[3 * f + k], static_cast<double>(sum), 1e-13 * static_cast<double>(size)) << f;
      }
    }
  }
}

TEST(CompressedFields, StopWhenCancelled) {
  const Fields the = smooth(1300, 4);
  RunContext context;
  std::stop_source stop;
  context.stop = stop.get_token();
  stop.request_stop();
  EXPECT_THROW(CompressedFields(the.tiles, the.places, 1e-8, context), Error);
}

}  // namespace
}  // namespace deform::compressed_fields_test
