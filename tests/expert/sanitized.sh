#!/bin/bash
# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Runs tests of the expert with its C++ under AddressSanitizer and UBSan: sanitized.sh [options of pytest].
# The workspace has to be sourced. The package with the checked build is in ros2_ws/build/magat_expert_sanitized.
set -e
cd "$(dirname "$0")/../.."
python=.venv/bin/python
source=ros2_ws/src/magat_expert
build=ros2_ws/build/magat_expert_sanitized
package=$build/magat_expert
core=$package/_core$($python -c 'import sysconfig; print(sysconfig.get_config_var("EXT_SUFFIX"))')
mkdir -p "$package"
touch "$build/COLCON_IGNORE"
cp $source/magat_expert/*.py "$package"
if [ ! -e "$core" ] || [ -n "$(find $source -newer "$core" \( -name '*.?pp' -o -name CMakeLists.txt \))" ]; then
  # shellcheck disable=SC2046  # options and files, one a word
  (cd $source && g++ -std=c++17 -O1 -g -fPIC -shared -fvisibility=hidden -D_GLIBCXX_ASSERTIONS \
    -fsanitize=address,undefined -fno-sanitize-recover=all \
    $("$OLDPWD/$python" -m pybind11 --includes) $(grep -o 'src/[a-z_]*\.cpp' CMakeLists.txt) -o "$OLDPWD/$core")
fi
# libstdc++ too, so that AddressSanitizer finds the functions that throw exceptions. Python itself leaks.
libraries=
for library in libasan.so libubsan.so libstdc++.so; do
  libraries+=$(g++ -print-file-name=$library):
done
LD_PRELOAD=$libraries ASAN_OPTIONS=detect_leaks=0 PYTHONPATH=$PWD/$build:$PYTHONPATH MAGAT_SANITIZED=1 \
  $python -m pytest -p no:cacheprovider tests/expert/test_{fuzz,solver,baselines,batch,properties,lacam}.py "$@"
