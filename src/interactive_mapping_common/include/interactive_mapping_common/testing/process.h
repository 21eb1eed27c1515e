// SPDX-License-Identifier: BSD-3-Clause
// A program that a test starts, kills and waits for.
#pragma once

#include <fcntl.h>
#include <spawn.h>
#include <unistd.h>
#include <csignal>
#include <sys/wait.h>

#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

extern char** environ;

namespace node_tests {

/// Killed, if it still runs, at the end of its scope. All output goes to `log_file`.
class Process {
 public:
  Process(std::vector<std::string> arguments, const std::string& log_file) : log_file_(log_file) {
    std::vector<char*> argv;
    argv.reserve(arguments.size() + 1);
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log_file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
    const int failure = posix_spawnp(&pid_, argv[0], &actions, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    if (failure != 0) throw std::runtime_error("cannot start " + arguments.front());
  }
  ~Process() {
    if (hasEnded()) return;
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, &status_, 0);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void signal(int number) {
    if (!hasEnded()) ::kill(pid_, number);
  }
  bool hasEnded() {
    if (!has_ended_) has_ended_ = ::waitpid(pid_, &status_, WNOHANG) == pid_;
    return has_ended_;
  }
  /// After its end: exit code, or minus the signal that ended it.
  int exitCode() const { return WIFEXITED(status_) ? WEXITSTATUS(status_) : -WTERMSIG(status_); }

  std::string output() const {
    std::ifstream in(log_file_);
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
  }

 private:
  std::string log_file_;
  pid_t pid_{-1};
  int status_{0};
  bool has_ended_{false};
};

}  // namespace node_tests
