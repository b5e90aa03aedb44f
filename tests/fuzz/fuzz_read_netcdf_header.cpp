// SPDX-License-Identifier: GPL-3.0-or-later
// The part of a netCDF file that this project parses itself; the rest is libnetcdf's.
#include "core/io/formats/exodus/netcdf_classic.h"
#include "tests/fuzz/read_and_write_back.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    deform::io::check_classic_netcdf({reinterpret_cast<const char*>(data), size}, "fuzz.e");
  } catch (const deform::Error& error) {
    deform::fuzz::require(error.code() == deform::ErrorCode::invalid_argument, "a refused file is an invalid argument");
  }
  return 0;
}
