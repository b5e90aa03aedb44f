// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace deform::io {

/// Whether these are the bytes of a classic netCDF file (CDF-1, CDF-2 or CDF-5) rather than of an HDF5 one.
bool is_classic_netcdf(std::string_view bytes);

/// Throws Error(invalid_argument) when a classic netCDF file does not hold all its variables: libnetcdf reads zeros where a file
/// is cut off, and lets it grow where one is written. Variables along the unlimited dimension may be short, results come last.
/// Anything but such a file passes. Format: NetCDF Users Guide, appendix "File Format Specifications".
void check_classic_netcdf(std::string_view bytes, const std::string& name);

}  // namespace deform::io
