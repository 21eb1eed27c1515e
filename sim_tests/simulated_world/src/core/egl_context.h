// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <thread>

namespace simulated_world {

/// Desktop OpenGL context without surface, window or display. Belongs to the thread that made it.
class EglContext {
 public:
  /// Makes the context and makes it current. Throws std::runtime_error with the step that failed and EGL's error code.
  EglContext();
  ~EglContext();
  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

  /// Makes it the thread's current one, if it is not. Throws std::logic_error in another thread.
  void makeCurrent();

 private:
  void* display_;  // EGLDisplay
  void* context_;  // EGLContext
  std::thread::id owner_;
};

}  // namespace simulated_world
