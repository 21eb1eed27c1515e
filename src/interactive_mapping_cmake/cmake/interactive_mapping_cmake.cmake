# SPDX-License-Identifier: BSD-3-Clause
# A dependent links the targets of a package by name, wherever that package was built: in the same CMake run
# (catkin_make), in a workspace of its own, or in an install space.

set(interactive_mapping_cmake_FOLDER ${CMAKE_CURRENT_LIST_DIR})

# interactive_mapping_package([FIND_PACKAGE...])
# Compiler settings and options of a package; call it before catkin_package(). FIND_PACKAGE: what dependents must find before they
# can link the exported targets, e.g. Eigen3 for Eigen3::Eigen. Sets the CFG_EXTRAS of catkin_package():
# interactive_mapping_EXTRAS.
macro(interactive_mapping_package)
  set(CMAKE_CXX_STANDARD 17)
  set(CMAKE_CXX_STANDARD_REQUIRED ON)
  set(CMAKE_CXX_EXTENSIONS OFF)
  add_compile_options(-Wall -Wextra -Wpedantic -Wshadow)
  if(NOT CMAKE_BUILD_TYPE)  # without optimisation an image takes 40 times longer; other packages keep their own choice
    set(CMAKE_BUILD_TYPE Release)
  endif()
  option(GPIS_BUILD_BENCHMARKS "Build the programs bench_*, collected in the target benchmarks" OFF)
  option(GPIS_BUILD_SOAK "Build the programs of scripts/soak, collected in the target soak_programs" OFF)
  set(interactive_mapping_FIND ${ARGN})
  set(interactive_mapping_EXTRAS ${interactive_mapping_cmake_FOLDER}/interactive_mapping_targets.cmake)
endmacro()

# interactive_mapping_tests()
# Compiler settings of the tests, which are the targets that follow in this folder: what GCC does beyond -O1 takes a quarter
# of a test's build and saves nothing that a test's run would show.
macro(interactive_mapping_tests)
  add_compile_options($<$<CONFIG:Release>:-O1>)
endmacro()

# interactive_mapping_ros_test_main()
# The library of that name: main() of a test that is a node, for tests without one of their own.
function(interactive_mapping_ros_test_main)
  if(NOT TARGET interactive_mapping_ros_test_main)
    add_library(interactive_mapping_ros_test_main STATIC EXCLUDE_FROM_ALL ${interactive_mapping_cmake_FOLDER}/ros_test_main.cpp)
    target_include_directories(interactive_mapping_ros_test_main SYSTEM PRIVATE ${roscpp_INCLUDE_DIRS} ${GMOCK_INCLUDE_DIRS})
    target_link_libraries(interactive_mapping_ros_test_main ${roscpp_LIBRARIES})
  endif()
endfunction()

# interactive_mapping_add_tests(FOLDER UNIT... [ROSTEST] [INCLUDES FOLDER...] [SYSTEM_INCLUDES FOLDER...]
#   [LIBRARIES LIBRARY...] [DEFINITIONS NAME=VALUE...] [PROGRAMS TARGET...])
# For each unit a test test_UNIT from FOLDER/test_UNIT.cpp. ROSTEST: it is a node and runs in FOLDER/UNIT.test.
# PROGRAMS: built before it.
function(interactive_mapping_add_tests folder)
  cmake_parse_arguments(tests "ROSTEST" "" "INCLUDES;SYSTEM_INCLUDES;LIBRARIES;DEFINITIONS;PROGRAMS" ${ARGN})
  foreach(unit ${tests_UNPARSED_ARGUMENTS})
    if(tests_ROSTEST)
      add_rostest_gmock(test_${unit} ${folder}/${unit}.test ${folder}/test_${unit}.cpp)
      interactive_mapping_ros_test_main()
      set(gmock interactive_mapping_ros_test_main ${GMOCK_LIBRARIES} ${GTEST_LIBRARIES})
    else()
      catkin_add_gmock(test_${unit} ${folder}/test_${unit}.cpp)
      set(gmock ${GMOCK_MAIN_LIBRARIES})
    endif()
    if(TARGET test_${unit})
      target_include_directories(test_${unit} PRIVATE ${tests_INCLUDES})
      target_include_directories(test_${unit} SYSTEM PRIVATE ${tests_SYSTEM_INCLUDES})
      target_link_libraries(test_${unit} ${tests_LIBRARIES} ${gmock})
      target_compile_definitions(test_${unit} PRIVATE ${tests_DEFINITIONS})
      if(tests_PROGRAMS)
        add_dependencies(test_${unit} ${tests_PROGRAMS})
      endif()
    endif()
  endforeach()
endfunction()

# interactive_mapping_collect(TARGET PROGRAM...)
# Adds the programs to what `mission` (all that simulation.launch can start, and map_sequence for its bag), `benchmarks` or `soak_programs` builds.
function(interactive_mapping_collect target)
  if(NOT TARGET ${target})
    add_custom_target(${target})
  endif()
  add_dependencies(${target} ${ARGN})
endfunction()

# interactive_mapping_install(TARGET...)
# Installs libraries and programs, and exports them to the packages that find this one. Call it once in a package.
function(interactive_mapping_install)
  foreach(target ${ARGN})
    foreach(property INTERFACE_INCLUDE_DIRECTORIES INTERFACE_SYSTEM_INCLUDE_DIRECTORIES)
      get_target_property(folders ${target} ${property})
      if(folders)
        # An install space holds none of the workspace's folders; its headers are all in one.
        set(exported)
        foreach(folder ${folders})
          if("${folder}/" MATCHES "^(${CMAKE_SOURCE_DIR}|${CMAKE_BINARY_DIR}|${CATKIN_DEVEL_PREFIX})/")
            set(folder $<BUILD_INTERFACE:${folder}>)
          endif()
          list(APPEND exported ${folder})
        endforeach()
        list(APPEND exported $<INSTALL_INTERFACE:${CATKIN_GLOBAL_INCLUDE_DESTINATION}>)
        set_target_properties(${target} PROPERTIES ${property} "${exported}")
      endif()
    endforeach()
  endforeach()
  set(file ${PROJECT_NAME}Targets.cmake)
  export(TARGETS ${ARGN} FILE ${CATKIN_DEVEL_PREFIX}/${CATKIN_PACKAGE_SHARE_DESTINATION}/cmake/${file})
  install(TARGETS ${ARGN} EXPORT ${PROJECT_NAME}
    ARCHIVE DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
  install(EXPORT ${PROJECT_NAME} FILE ${file} DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION}/cmake)
  set_property(GLOBAL PROPERTY ${PROJECT_NAME}_IN_THIS_RUN TRUE)
endfunction()

# interactive_mapping_find_apriltag()
# libapriltag as the target apriltag::apriltag.
macro(interactive_mapping_find_apriltag)
  if(NOT TARGET apriltag::apriltag)  # Debian's file cannot be read twice in one workspace
    find_package(apriltag REQUIRED)
  endif()
  find_library(APRILTAG_UTILS_LIBRARY apriltag-utils)  # Debian's second half of the library
  if(APRILTAG_UTILS_LIBRARY)
    set_property(TARGET apriltag::apriltag APPEND PROPERTY INTERFACE_LINK_LIBRARIES ${APRILTAG_UTILS_LIBRARY})
  endif()
endmacro()
