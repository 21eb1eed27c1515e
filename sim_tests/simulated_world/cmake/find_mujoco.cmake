# SPDX-License-Identifier: BSD-3-Clause
# MuJoCo as the target mujoco::mujoco, if it is there: for this package and, as part of its configuration, for those that
# link it. Debian has a package with CMake files. A release and the Python wheel hold headers and library alone.
set(MUJOCO_ROOT "$ENV{MUJOCO_ROOT}" CACHE PATH "Folder of a MuJoCo release or of the wheel's package mujoco, in place of the system's")
if(MUJOCO_ROOT AND NOT TARGET mujoco::mujoco)
  file(GLOB MUJOCO_LIBRARY "${MUJOCO_ROOT}/lib/libmujoco.so" "${MUJOCO_ROOT}/libmujoco.so.*")
  if(NOT MUJOCO_LIBRARY OR NOT EXISTS "${MUJOCO_ROOT}/include/mujoco/mujoco.h")
    message(FATAL_ERROR "MUJOCO_ROOT=${MUJOCO_ROOT} needs include/mujoco/mujoco.h and lib/libmujoco.so or libmujoco.so.VERSION")
  endif()
  add_library(mujoco::mujoco SHARED IMPORTED)
  set_target_properties(mujoco::mujoco PROPERTIES
    IMPORTED_LOCATION "${MUJOCO_LIBRARY}" INTERFACE_INCLUDE_DIRECTORIES "${MUJOCO_ROOT}/include")
elseif(NOT TARGET mujoco::mujoco)
  set(OpenGL_GL_PREFERENCE GLVND)  # MuJoCo's package configuration looks for OpenGL
  find_package(mujoco QUIET)
endif()
