# SPDX-License-Identifier: Apache-2.0
# CGNS::CGNS, the CGNS library, which comes with neither a CMake nor a pkg-config file.
find_path(CGNS_INCLUDE_DIR cgns_io.h)
find_library(CGNS_LIBRARY cgns)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(CGNS REQUIRED_VARS CGNS_LIBRARY CGNS_INCLUDE_DIR)
if(CGNS_FOUND AND NOT TARGET CGNS::CGNS)
  add_library(CGNS::CGNS UNKNOWN IMPORTED)
  set_target_properties(CGNS::CGNS PROPERTIES IMPORTED_LOCATION ${CGNS_LIBRARY} INTERFACE_INCLUDE_DIRECTORIES ${CGNS_INCLUDE_DIR})
endif()
