# SPDX-License-Identifier: GPL-3.0-or-later
# Writes the bill of materials of an installed program, SPDX 2.3 as JSON: the Debian packages of the shared libraries that it loads, those
# that they load included, and of the headers whose code is compiled into it. A part of CMake's install script, with
#   name, version, build   of the program, and the build folder with its target
#   target                 the target in that folder, "server/deformd"
#   program                the installed program
#   output                 the file to write
# With SOURCE_DATE_EPOCH in the environment the same program gives the same file. Without dpkg libraries are listed by file name; without
# Ninja those are missing of which only headers are used. The document says so.
cmake_policy(VERSION 3.25)

# sbom_packages(RESULT FILE...): the packages that own the files, sorted, without those that no package owns.
function(sbom_packages result)
  set(found "")
  if(ARGN)
    execute_process(COMMAND dpkg-query --search ${ARGN} OUTPUT_VARIABLE owners ERROR_QUIET)
    string(REGEX MATCHALL "[^\n]+: /[^\n]*" lines "${owners}")
    foreach(line IN LISTS lines)
      if(NOT line MATCHES "^diversion ")
        string(REGEX REPLACE ": /.*$" "" package "${line}")
        list(APPEND found ${package})
      endif()
    endforeach()
    list(REMOVE_DUPLICATES found)
    list(SORT found)
  endif()
  set(${result} ${found} PARENT_SCOPE)
endfunction()

# sbom_relate(RELATION COMMENT ID): the program to the package of that id.
macro(sbom_relate relation comment id)
  string(JSON relationships SET "${relationships}" ${related}
         "{\"spdxElementId\": \"SPDXRef-${name}\", \"relationshipType\": \"${relation}\", \"relatedSpdxElement\": \"${id}\", \"comment\": \"${comment}\"}")
  math(EXPR related "${related} + 1")
endmacro()

# sbom_add(PACKAGE RELATION COMMENT): a package of Debian, unless it is there already, and what the program has to do with it.
macro(sbom_add package relation comment)
  execute_process(COMMAND dpkg-query --show "--showformat=\${Package}\n\${Version}\n\${Architecture}\n\${source:Package}\n\${source:Version}\n\${Homepage}\n"
                          ${package} OUTPUT_VARIABLE known OUTPUT_STRIP_TRAILING_WHITESPACE)
  string(REPLACE "\n" ";" known "${known};")
  list(GET known 0 package_name)
  list(GET known 1 package_version)
  list(GET known 2 architecture)
  list(GET known 3 source_name)
  list(GET known 4 source_version)
  list(GET known 5 homepage)
  string(REGEX REPLACE "[^A-Za-z0-9.-]" "-" id "SPDXRef-deb-${package_name}")
  if(NOT id IN_LIST ids)
    list(APPEND ids ${id})
    string(REPLACE ":" "%3A" purl "${package_name}@${package_version}?arch=${architecture}&distro=debian-${release}")
    string(REPLACE "+" "%2B" purl "pkg:deb/debian/${purl}")
    set(entry "{}")
    string(JSON entry SET "${entry}" SPDXID "\"${id}\"")
    string(JSON entry SET "${entry}" name "\"${package_name}\"")
    string(JSON entry SET "${entry}" versionInfo "\"${package_version}\"")
    string(JSON entry SET "${entry}" supplier "\"Organization: Debian\"")
    string(JSON entry SET "${entry}" downloadLocation "\"NOASSERTION\"")
    string(JSON entry SET "${entry}" filesAnalyzed false)
    string(JSON entry SET "${entry}" licenseConcluded "\"NOASSERTION\"")
    string(JSON entry SET "${entry}" licenseDeclared "\"NOASSERTION\"")
    string(JSON entry SET "${entry}" copyrightText "\"NOASSERTION\"")
    string(JSON entry SET "${entry}" sourceInfo "\"source package ${source_name} ${source_version}; licences in /usr/share/doc/${package_name}/copyright\"")
    if(homepage)
      string(JSON entry SET "${entry}" homepage "\"${homepage}\"")
    endif()
    string(JSON entry SET "${entry}" externalRefs
           "[{\"referenceCategory\": \"PACKAGE-MANAGER\", \"referenceType\": \"purl\", \"referenceLocator\": \"${purl}\"}]")
    string(JSON packages SET "${packages}" ${listed} "${entry}")
    math(EXPR listed "${listed} + 1")
  endif()
  sbom_relate(${relation} "${comment}" ${id})
endmacro()

find_program(dpkg_query dpkg-query)
file(STRINGS /etc/os-release release REGEX "^VERSION_ID=")
string(REGEX REPLACE "^VERSION_ID=\"?([^\"]*)\"?$" "\\1" release "${release}")
file(SHA256 ${program} digest)
string(TIMESTAMP created "%Y-%m-%dT%H:%M:%SZ" UTC)

set(ids "")
set(relationships "[{\"spdxElementId\": \"SPDXRef-DOCUMENT\", \"relationshipType\": \"DESCRIBES\", \"relatedSpdxElement\": \"SPDXRef-${name}\"}]")
set(related 1)
set(listed 1)
set(packages "[{\"SPDXID\": \"SPDXRef-${name}\", \"name\": \"${name}\", \"versionInfo\": \"${version}\", \"primaryPackagePurpose\": \"APPLICATION\",
  \"downloadLocation\": \"NOASSERTION\", \"filesAnalyzed\": false, \"licenseConcluded\": \"GPL-3.0-or-later\", \"licenseDeclared\": \"GPL-3.0-or-later\",
  \"copyrightText\": \"NOASSERTION\", \"checksums\": [{\"algorithm\": \"SHA256\", \"checksumValue\": \"${digest}\"}]}]")
set(remarks "")

# What the program loads.
file(GET_RUNTIME_DEPENDENCIES EXECUTABLES ${program} RESOLVED_DEPENDENCIES_VAR loaded UNRESOLVED_DEPENDENCIES_VAR missing)
foreach(library IN LISTS missing)
  string(APPEND remarks "${library}: not found when this was written. ")
endforeach()
set(paths "")
foreach(library IN LISTS loaded)
  file(REAL_PATH ${library} library)
  list(APPEND paths ${library})
  if(library MATCHES "^/usr(/lib.*)")
    list(APPEND paths ${CMAKE_MATCH_1})  # where /lib is a link to /usr/lib, packages may name either
  endif()
endforeach()
if(dpkg_query)
  sbom_packages(owners ${paths})
  foreach(package IN LISTS owners)
    sbom_add(${package} DYNAMIC_LINK "loads a library of it")
  endforeach()
else()
  string(APPEND remarks "Without dpkg: libraries by their file names. ")
  foreach(library IN LISTS loaded)
    get_filename_component(file ${library} NAME)
    string(REGEX REPLACE "[^A-Za-z0-9.-]" "-" id "SPDXRef-file-${file}")
    string(JSON packages SET "${packages}" ${listed} "{\"SPDXID\": \"${id}\", \"name\": \"${file}\", \"downloadLocation\": \"NOASSERTION\", \"filesAnalyzed\": false,
      \"licenseConcluded\": \"NOASSERTION\", \"licenseDeclared\": \"NOASSERTION\", \"copyrightText\": \"NOASSERTION\"}")
    math(EXPR listed "${listed} + 1")
    sbom_relate(DYNAMIC_LINK "loads it" ${id})
  endforeach()
endif()

# What is compiled into it.
find_program(ninja NAMES ninja ninja-build)
if(dpkg_query AND ninja AND EXISTS ${build}/.ninja_deps)
  execute_process(COMMAND ${ninja} -C ${build} -t inputs ${target} OUTPUT_VARIABLE inputs)
  string(REGEX MATCHALL "[^\n]+\\.(o|gch)\n" objects "${inputs}")
  string(REPLACE "\n" "" objects "${objects}")
  execute_process(COMMAND ${ninja} -C ${build} -t deps ${objects} COMMAND sed -n "s/^ *\\(\\/usr\\/.*\\)/\\1/p" COMMAND sort -u
                  OUTPUT_VARIABLE headers OUTPUT_STRIP_TRAILING_WHITESPACE)
  string(REPLACE "\n" ";" headers "${headers}")
  sbom_packages(owners ${headers})
  foreach(package IN LISTS owners)
    sbom_add(${package} STATIC_LINK "code of its headers is compiled in")
  endforeach()
else()
  string(APPEND remarks "Libraries of which only headers are used are not listed: that takes dpkg and a build by Ninja. ")
endif()

set(document "{\"spdxVersion\": \"SPDX-2.3\", \"dataLicense\": \"CC0-1.0\", \"SPDXID\": \"SPDXRef-DOCUMENT\"}")
string(JSON document SET "${document}" name "\"${name} ${version}\"")
string(JSON document SET "${document}" documentNamespace "\"urn:deformd:sbom:${name}:sha256:${digest}\"")
string(JSON document SET "${document}" creationInfo "{\"created\": \"${created}\", \"creators\": [\"Tool: cmake-${CMAKE_VERSION}\"]}")
if(remarks)
  string(STRIP "${remarks}" remarks)
  string(JSON document SET "${document}" comment "\"${remarks}\"")
endif()
string(JSON document SET "${document}" packages "${packages}")
string(JSON document SET "${document}" relationships "${relationships}")
file(WRITE ${output} "${document}\n")
list(APPEND CMAKE_INSTALL_MANIFEST_FILES ${output})
message(STATUS "Installed: ${output}")
