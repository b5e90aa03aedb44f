# SPDX-License-Identifier: GPL-3.0-or-later
# Installs headers and all headers of the project that they include, as deform/NAME: core/base/error.h becomes deform/base/error.h,
# client/client.h deform/client.h, and their includes are changed accordingly. A part of CMake's install script, with
#   source, target    root of the repository, folder to install to
#   headers           those that users include
cmake_policy(VERSION 3.25)
include(${source}/deploy/cmake/header_closure.cmake)
deform_header_closure(installed ${source} ${headers})
foreach(header IN LISTS installed)
  file(READ ${source}/${header} text)
  string(REGEX REPLACE "#include \"(core|client)/" "#include \"deform/" text "${text}")
  string(REGEX REPLACE "^(core|client)/" "" name ${header})
  set(file ${target}/deform/${name})
  file(WRITE ${file}.part "${text}")
  file(COPY_FILE ${file}.part ${file} ONLY_IF_DIFFERENT)
  file(REMOVE ${file}.part)
  list(APPEND CMAKE_INSTALL_MANIFEST_FILES ${file})
  message(STATUS "Installed: ${file}")
endforeach()
