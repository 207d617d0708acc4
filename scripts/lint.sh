#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# clang-format and clang-tidy over every tracked C++ file, catkin_lint, shellcheck. Nothing is changed.
#   lint.sh [FILE...]      only these C++ files
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
build_dir=${DEVO_BUILD_DIR:-$PWD/build}
export DEVO_BUILD_DIR=$build_dir
./scripts/install_dependencies.sh --lint
status=0

if [ $# -gt 0 ]; then
  files=("$@")
else
  mapfile -t files < <(git ls-files '*.h' '*.cpp')
fi
echo "clang-format: ${#files[@]} files"
clang-format --dry-run -Werror "${files[@]}" || status=1

./scripts/build.sh -DCMAKE_EXPORT_COMPILE_COMMANDS=ON > /dev/null
mapfile -t sources < <(printf '%s\n' "${files[@]}" | grep '\.cpp$' || true)
if [ "${#sources[@]}" -gt 0 ]; then
  echo "clang-tidy: ${#sources[@]} files"
  printf '%s\0' "${sources[@]}" | xargs -0 -n 4 -P "$(nproc)" clang-tidy --quiet -p "$build_dir" || status=1
fi

echo "catkin_lint"
# On a copy: build folders would be taken for the package's, and the folder's name must be the package's.
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
mkdir "$copy/devo"
git ls-files -z --cached --others --exclude-standard | xargs -0 cp --parents -t "$copy/devo"
ROS_DISTRO=noetic catkin_lint --offline -W2 --strict "$copy/devo" || status=1
echo "shellcheck"
shellcheck scripts/*.sh .ci/run || status=1
[ "$status" -eq 0 ] && echo "lint: clean" || echo "lint: see above"
exit "$status"
