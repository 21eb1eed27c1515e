// SPDX-License-Identifier: BSD-3-Clause
#include "egl_context.h"

#include <sstream>
#include <stdexcept>
#include <string>

#include <EGL/egl.h>
#include <EGL/eglext.h>

namespace simulated_world {
namespace {

[[noreturn]] void fail(const std::string& step) {
  std::ostringstream message;
  message << "off-screen rendering: " << step << " failed (EGL error 0x" << std::hex << eglGetError()
          << "); it needs Mesa's EGL with surfaceless contexts (packages libegl-mesa0, libgl1-mesa-dri)";
  throw std::runtime_error(message.str());
}

EGLDisplay openDisplay() {
  const auto getPlatformDisplay =
      reinterpret_cast<PFNEGLGETPLATFORMDISPLAYEXTPROC>(eglGetProcAddress("eglGetPlatformDisplayEXT"));
  if (getPlatformDisplay == nullptr) {
    fail("eglGetPlatformDisplayEXT");
  }
  const EGLDisplay display = getPlatformDisplay(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
  if (display == EGL_NO_DISPLAY) {
    fail("eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA)");
  }
  if (eglInitialize(display, nullptr, nullptr) != EGL_TRUE) {
    fail("eglInitialize");
  }
  return display;
}

/// Open until the process ends: the graphics driver forgets to free some memory each time it is unloaded, and to load it
/// again takes longer than to make a context.
EGLDisplay sharedDisplay() {
  static const EGLDisplay display = openDisplay();
  return display;
}

}  // namespace

EglContext::EglContext() : display_(sharedDisplay()), context_(EGL_NO_CONTEXT), owner_(std::this_thread::get_id()) {
  const EGLint attributes[] = {EGL_RED_SIZE,
                               8,
                               EGL_GREEN_SIZE,
                               8,
                               EGL_BLUE_SIZE,
                               8,
                               EGL_ALPHA_SIZE,
                               8,
                               EGL_DEPTH_SIZE,
                               24,
                               EGL_STENCIL_SIZE,
                               8,
                               EGL_SURFACE_TYPE,
                               EGL_PBUFFER_BIT,
                               EGL_RENDERABLE_TYPE,
                               EGL_OPENGL_BIT,
                               EGL_NONE};
  EGLConfig config = nullptr;
  EGLint num_configs = 0;
  if (eglChooseConfig(display_, attributes, &config, 1, &num_configs) != EGL_TRUE || num_configs < 1) {
    fail("eglChooseConfig");
  }
  if (eglBindAPI(EGL_OPENGL_API) != EGL_TRUE) {
    fail("eglBindAPI(EGL_OPENGL_API)");
  }
  context_ = eglCreateContext(display_, config, EGL_NO_CONTEXT, nullptr);
  if (context_ == EGL_NO_CONTEXT) {
    fail("eglCreateContext");
  }
  try {
    makeCurrent();
  } catch (...) {
    eglDestroyContext(display_, context_);
    throw;
  }
}

EglContext::~EglContext() {
  if (eglGetCurrentContext() == context_) {
    eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  }
  eglDestroyContext(display_, context_);
}

void EglContext::makeCurrent() {
  if (std::this_thread::get_id() != owner_) {
    throw std::logic_error("off-screen rendering: used in another thread than it was made in");
  }
  if (eglGetCurrentContext() != context_ &&
      eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_) != EGL_TRUE) {
    fail("eglMakeCurrent");
  }
}

}  // namespace simulated_world
