# SPDX-License-Identifier: GPL-3.0-or-later
# What cmake --install puts under its prefix, in four components:
#   client     headers (deform/client.h), libraries, CMake and pkg-config files of the client library; the contract (deform/v1/*.proto)
#              and the evaluator of compiled deformations
#   files      the same of the libraries that read, write and measure meshes; needs client
#   tools      deform, its manual pages and what shells need to complete its command line
#   server     the same of deformd, and its unit for systemd
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(DEFORM_PROTO_DIR ${CMAKE_INSTALL_DATADIR}/deform/proto)
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/deform)
set(pkgconfig_dir ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
file(RELATIVE_PATH DEFORM_PC_PREFIX /prefix/${pkgconfig_dir} /prefix)
string(REGEX REPLACE "/$" "" DEFORM_PC_PREFIX ${DEFORM_PC_PREFIX})

# deform_install_library(COMPONENT TARGETS ... HEADERS ...): HEADERS are those that users include; what these include comes along.
function(deform_install_library component)
  cmake_parse_arguments(ARG "" "" "TARGETS;HEADERS" ${ARGN})
  foreach(target ${ARG_TARGETS})
    string(REPLACE deform_ "" name ${target})
    set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
    add_library(deform::${name} ALIAS ${target})
  endforeach()
  install(TARGETS ${ARG_TARGETS} EXPORT deform-${component} COMPONENT ${component}
          ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
  install(EXPORT deform-${component} NAMESPACE deform:: FILE deform-${component}-targets.cmake DESTINATION ${package_dir}
          COMPONENT ${component})
  install(CODE "
    set(source \"${PROJECT_SOURCE_DIR}\")
    set(target \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_INCLUDEDIR}\")
    set(headers \"${ARG_HEADERS}\")
    include(\"${PROJECT_SOURCE_DIR}/deploy/cmake/install_headers.cmake\")" COMPONENT ${component})
  set_property(GLOBAL APPEND PROPERTY DEFORM_INSTALLED_HEADERS ${ARG_HEADERS})  # of which docs/ makes the reference
  configure_file(${PROJECT_SOURCE_DIR}/deploy/cmake/deform-${component}.pc.in deform-${component}.pc @ONLY)
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/deform-${component}.pc DESTINATION ${pkgconfig_dir} COMPONENT ${component})
endfunction()

if(DEFORM_BUILD_NETWORK)
  deform_install_library(client
    TARGETS deform_base deform_codec deform_compiled deform_proto deform_proto_grpc deform_convert_base deform_client
    HEADERS client/client.h client/design.h client/design_measures.h core/base/version.h core/compiled/deformation.h core/compiled/reader.h)
  install(DIRECTORY ${PROJECT_BINARY_DIR}/proto/deform DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT client
          FILES_MATCHING PATTERN *.pb.h)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/proto/deform DESTINATION ${DEFORM_PROTO_DIR} COMPONENT client FILES_MATCHING PATTERN *.proto)
  configure_package_config_file(${PROJECT_SOURCE_DIR}/deploy/cmake/deform-config.cmake.in deform-config.cmake
                                INSTALL_DESTINATION ${package_dir} PATH_VARS CMAKE_INSTALL_INCLUDEDIR DEFORM_PROTO_DIR)
  write_basic_package_version_file(deform-config-version.cmake COMPATIBILITY SameMinorVersion)
  install(FILES ${PROJECT_SOURCE_DIR}/docs/licenses/Apache-2.0.txt DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/deform COMPONENT client)
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/deform-config.cmake ${CMAKE_CURRENT_BINARY_DIR}/deform-config-version.cmake
          DESTINATION ${package_dir} COMPONENT client)
endif()

if(DEFORM_BUILD_NETWORK AND DEFORM_BUILD_FILES)
  add_library(deform_files INTERFACE)
  target_link_libraries(deform_files INTERFACE deform_io deform_quality deform_measures deform_mesh)
  deform_install_library(files
    TARGETS deform_mesh deform_io deform_quality deform_measures deform_files
    HEADERS core/io/mesh_file.h core/io/vtk_output.h core/io/coloured_ply.h core/mesh/adjacency.h core/mesh/ahmed.h
            core/mesh/inspect.h core/mesh/region.h core/quality/displacement.h core/quality/flipped_faces.h
            core/quality/mesh_quality.h core/quality/report.h core/quality/safe_amplitude.h core/measures/clearance.h core/measures/integrals.h
            core/measures/sobolev_filter.h core/measures/thickness.h)
  install(FILES ${PROJECT_SOURCE_DIR}/deploy/cmake/FindCGNS.cmake DESTINATION ${package_dir} COMPONENT files)
endif()

install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/deform COMPONENT tools)
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/deformd COMPONENT server)
set(systemd ${PROJECT_SOURCE_DIR}/deploy/systemd)
install(FILES ${systemd}/deformd.service DESTINATION lib/systemd/system COMPONENT server)
install(FILES ${systemd}/sysusers.conf RENAME deformd.conf DESTINATION lib/sysusers.d COMPONENT server)
install(FILES ${systemd}/deformd.yaml DESTINATION ${CMAKE_INSTALL_DATADIR}/deformd COMPONENT server)

# deform_install_materials(COMPONENT NAME TARGET): the bill of materials of an installed program, made from what is installed.
function(deform_install_materials component name target)
  install(CODE "
    set(name ${name})
    set(build \"${PROJECT_BINARY_DIR}\")
    set(target ${target})
    set(prefix \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}\")
    set(program \"\${prefix}/${CMAKE_INSTALL_BINDIR}/${name}\")
    set(output \"\${prefix}/${CMAKE_INSTALL_DATADIR}/doc/${name}/${name}.spdx.json\")
    file(STRINGS \"${PROJECT_BINARY_DIR}/core/base/commit/commit.cpp\" commit REGEX \"commit[(][)]\")
    string(REGEX REPLACE \".*\\\"(.*)\\\".*\" \"\\\\1\" commit \"\${commit}\")
    set(version \"${PROJECT_VERSION}+\${commit}\")
    if(EXISTS \"\${program}\")
      include(\"${PROJECT_SOURCE_DIR}/deploy/cmake/sbom.cmake\")
    endif()" COMPONENT ${component})
endfunction()
if(TARGET deform)
  deform_install_materials(tools deform client/cli/deform)
endif()
if(TARGET deform-cad)
  deform_install_materials(tools deform-cad client/cli/deform-cad)
endif()
if(TARGET deformd)
  deform_install_materials(server deformd server/deformd)
endif()
include(${PROJECT_SOURCE_DIR}/deploy/cmake/packages.cmake)
