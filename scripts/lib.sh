# shellcheck shell=bash
# SPDX-License-Identifier: BSD-3-Clause
# What the scripts share: environment, packages, build, messages. Sourced, never run.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
cd "$root"

# ROS modules belong to the system's Python, whatever else comes first on PATH.
export PATH="/usr/bin:$PATH"
# rostest must not depend on what the machine's own name resolves to.
export ROS_HOSTNAME=localhost
# Logs and test results of ROS stay out of the home folder.
export ROS_HOME="$root/build/ros_home"
# Message code for Lisp and JavaScript is used by nothing here.
export ROS_LANG_DISABLE=genlisp:geneus:gennodejs
jobs=${JOBS:-$(nproc)}
log_dir=$root/build/log

say() { printf '%s\n' "$*"; }
die() { printf 'error: %s\n' "$*" >&2; exit 1; }

# usage_from SCRIPT: prints the comment block below the shebang and SPDX line as help.
usage_from() { awk 'NR <= 2 { next } /^#/ { sub(/^# ?/, ""); print; next } { exit }' "$1"; }

# Every ten seconds: the last line of a log, so that a long step can be told from a hung one.
report_progress() {
  local log=$1 line last=
  set +e  # showing progress must never end anything
  while sleep 10 >/dev/null 2>&1; do
    kill -0 "$$" 2>/dev/null || exit 0
    line=$(tail -c 2000 "$log" 2>/dev/null | tail -n 1 | tr '\r' '\n' | tail -n 1 | cut -c 1-110)
    if [ -n "$line" ] && [ "$line" != "$last" ]; then printf '    %s\n' "$line"; last=$line; fi
  done
}

# note_machine: what a measurement was made on.
note_machine() {
  say "date      $(date -u +%Y-%m-%dT%H:%MZ)"
  say "commit    $(git describe --always --dirty 2>/dev/null || echo unknown)"
  say "processor $(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -n 1), $(nproc) cores"
  say "compiler  $(c++ --version | head -n 1)"
  say "load      $(cut -d ' ' -f 1-3 /proc/loadavg) at the start"
}

# What has been done and how long it took, "SECONDS LABEL" each: note_duration adds a line, say_durations prints all.
durations=()
note_duration() { durations+=("$((SECONDS - $1)) $2"); }
say_durations() {
  local entry
  for entry in "${durations[@]}" "$SECONDS in all"; do printf '%6d s  %s\n' "${entry%% *}" "${entry#* }"; done
}

# run_logged LABEL LOG COMMAND...: output goes to LOG; on failure its end is shown and the path named.
run_logged() {
  local label=$1 log=$2 start=$SECONDS rc=0 watcher
  shift 2
  mkdir -p "$(dirname "$log")"
  : >"$log"
  say "$label ..."
  report_progress "$log" &
  watcher=$!
  "$@" >"$log" 2>&1 </dev/null || rc=$?
  { kill "$watcher" && wait "$watcher"; } 2>/dev/null || true
  if [ "$rc" -ne 0 ]; then
    {
      # Compilers say what is wrong first and ninja stops later: start at its FAILED line if there is one.
      if grep -q '^FAILED: ' "$log"; then
        grep -n '^FAILED: ' "$log" | head -n 1 | cut -d : -f 1 | { read -r n; tail -n "+$n" "$log" | head -n 60; }
      else
        tail -n 40 "$log"
      fi
      printf '\nFAILED: %s (exit code %d). Full log: %s\n' "$label" "$rc" "${log#"$root"/}"
    } >&2
    return "$rc"
  fi
  say "    done in $((SECONDS - start)) s"
  note_duration "$start" "$label"
}

# list_packages GROUP...: names of those groups in apt-packages.txt; no argument: all groups but lint, display, package, campaign and docs.
list_packages() {
  awk -v wanted=" $* " '
    /^# group: / { group = $3; next }
    { sub(/#.*/, "") }
    NF == 0 { next }
    wanted ~ /^ *$/ ? group !~ /^(lint|display|package|campaign|docs)$/ : index(wanted, " " group " ") { print $1 }
  ' "$root/scripts/apt-packages.txt"
}

# install_packages [GROUP...]: installs what is missing; asks dpkg first, so that it costs nothing the second time.
install_packages() {
  local wanted missing sudo=()
  if [ "${SKIP_INSTALL:-0}" = 1 ]; then say "Packages: not looked at (SKIP_INSTALL=1)"; return 0; fi
  if ! command -v apt-get >/dev/null || ! command -v dpkg-query >/dev/null; then
    die "this is not a Debian system. Install the counterparts of scripts/apt-packages.txt, then run again with SKIP_INSTALL=1."
  fi
  wanted=$(list_packages "$@")
  # shellcheck disable=SC2086  # one word per package
  missing=$(comm -23 <(sort -u <<<"$wanted") \
    <(dpkg-query -W -f '${db:Status-Status} ${Package}\n' $wanted 2>/dev/null | sed -n 's/^installed //p' | sort -u))
  if [ -z "$missing" ]; then say "Packages: all $(wc -l <<<"$wanted") installed"; return 0; fi

  # shellcheck disable=SC1091
  local system; system=$(. /etc/os-release && printf '%s %s' "${ID:-unknown}" "${VERSION_ID:-}")
  case $system in
    "debian 12") ;;
    debian*) say "Note: the package list is for Debian 12; this is $system." ;;
    *) die "the package list is for Debian 12 and this is $system. With ROS Noetic installed: rosdep install --from-paths src sim_tests --ignore-src -y, then run again with SKIP_INSTALL=1." ;;
  esac
  if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null || { ! sudo -n true 2>/dev/null && [ ! -t 2 ]; }; then
      # shellcheck disable=SC2086
      die "packages are missing and this user may not install them. As root: apt-get install --no-install-recommends" $missing
    fi
    sudo -v || die "packages are missing and sudo was refused."
    sudo=(sudo)
  fi
  local apt=("${sudo[@]}" env DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8 apt-get -o DPkg::Lock::Timeout=300 -o Acquire::Retries=3)
  run_logged "Packages: reading the index" "$log_dir/apt-update.log" "${apt[@]}" update
  # shellcheck disable=SC2086
  run_logged "Packages: installing $(wc -w <<<"$missing") missing of $(wc -l <<<"$wanted")" "$log_dir/apt-install.log" \
    "${apt[@]}" install -y --no-install-recommends $missing
}

# build_workspace [TARGET...]: configures and builds; no argument: `all`.
# Read from the caller: build_dir (default build), build_type (default Release), map_only (OFF or ON), cmake_options (array).
build_workspace() {
  local dir=${build_dir:-build} devel=$root/devel generator options ignored name
  [ "$dir" = build ] || devel=$root/$dir/devel
  # shellcheck disable=SC1091
  if [ -f /opt/ros/noetic/setup.bash ]; then set +u; . /opt/ros/noetic/setup.bash; set -u; fi
  /usr/bin/python3 scripts/vendor_msgs || return
  for ignored in src/vendor_msgs/*/CATKIN_IGNORE; do
    name=$(basename "$(dirname "$ignored")")
    [ ! -e "$devel/share/$name/cmake" ] || die "$devel/ holds $name from an earlier build, which would hide the original: remove $dir/ and $devel/."
  done
  if [ -f "$dir/CMakeCache.txt" ]; then
    generator=$(sed -n 's/^CMAKE_GENERATOR:INTERNAL=//p' "$dir/CMakeCache.txt")
    [ -z "$generator" ] || [ "$generator" = Ninja ] || die "$dir/ was made by \"$generator\" and cannot be continued with Ninja: remove $dir/ and devel/."
  fi
  options=(-G Ninja "-DCMAKE_BUILD_TYPE=${build_type:-Release}" "-DCATKIN_DEVEL_PREFIX=$devel"
    "-DMAP_ONLY=${map_only:-OFF}")
  if command -v ccache >/dev/null; then
    options+=(-DCMAKE_C_COMPILER_LAUNCHER=ccache -DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
  fi
  [ -z "${cmake_options+x}" ] || options+=("${cmake_options[@]}")
  [ $# -gt 0 ] || set -- all
  run_logged "Configuring $dir/" "$log_dir/$dir-configure.log" cmake -S . -B "$dir" "${options[@]}" || return
  run_logged "Building $dir/ ($*), $jobs jobs" "$log_dir/$dir-build.log" ninja -C "$dir" -j "$jobs" "$@" || return
  case " $* " in *" all "* | *" mission "*)  # for scripts/campaign --no-build
    PYTHONPATH=tools /usr/bin/python3 -c 'from interactive_mapping_tools import workspace; print(workspace.software())' > "$devel/.software" ;;
  esac
}

# use_workspace: makes rosrun and rospack know the packages built here, or in a catkin workspace that is sourced.
use_workspace() {
  if [ ! -f "$root/devel/setup.bash" ]; then
    case "$(rospack find pick_mission 2>/dev/null)" in "$root"/*) return ;; esac
    die "devel/setup.bash is missing: build first, or source the catkin workspace this is in."
  fi
  # Sourced already, perhaps by a workspace on top of it: that one's packages stay known.
  case ":${CMAKE_PREFIX_PATH-}:" in *":$root/devel:"*) return ;; esac
  set +u
  # shellcheck disable=SC1091
  . "$root/devel/setup.bash"
  set -u
}
