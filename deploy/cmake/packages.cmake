# SPDX-License-Identifier: GPL-3.0-or-later
# Debian packages by cpack -G DEB: deform, deformd, and libdeform-dev of the components client and files. What they depend on is found
# in their programs (dpkg-shlibdeps).
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_VENDOR deformd)
set(CPACK_PACKAGE_CONTACT "The developers of deformd <deformd@localhost>")
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Deformation of meshes for shape optimization")
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_OUTPUT_FILE_PREFIX packages)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)

set(CPACK_DEBIAN_TOOLS_PACKAGE_NAME deform)
set(CPACK_DEBIAN_TOOLS_DESCRIPTION "Command line of deformd, which deforms meshes for shape optimization")
set(CPACK_DEBIAN_TOOLS_PACKAGE_SUGGESTS deformd)

set(CPACK_DEBIAN_SERVER_PACKAGE_NAME deformd)
set(CPACK_DEBIAN_SERVER_DESCRIPTION "Server that deforms meshes for shape optimization")
set(CPACK_DEBIAN_SERVER_PACKAGE_SUGGESTS deform)
set(debian ${PROJECT_SOURCE_DIR}/deploy/debian)
set(CPACK_DEBIAN_SERVER_PACKAGE_CONTROL_EXTRA ${debian}/postinst ${debian}/prerm)

set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libdeform-dev)
set(CPACK_DEBIAN_DEVELOPMENT_DESCRIPTION "Client library of deformd, readers and writers of meshes")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS
    "libgrpc++-dev, libprotobuf-dev, protobuf-compiler, protobuf-compiler-grpc, libdraco-dev, libzstd-dev, libxxhash-dev, libssl-dev, libtbb-dev, zlib1g-dev, libnetcdf-dev, libcgns-dev")

include(CPack)
cpack_add_component_group(tools)
cpack_add_component_group(server)
cpack_add_component_group(development)
cpack_add_component(tools GROUP tools)
cpack_add_component(server GROUP server)
cpack_add_component(client GROUP development)
cpack_add_component(files GROUP development)
