#!/usr/bin/env bash
# Set-up, build with warnings as errors, all tests but the slow ones (those of clusters one by one). Arguments go to ctest (`tools/test.sh -L unit`).
set -euo pipefail
cd "$(dirname "$0")/.."

start=$SECONDS
tools/setup.sh
setup=$((SECONDS - start))

start=$SECONDS
cmake --workflow --preset ci
build=$((SECONDS - start))

[ -d ../shared/scenes ] || echo "test.sh: no folder ../shared/scenes: tests that want its scenes are skipped"
start=$SECONDS
status=0
ctest --test-dir build/release -LE slow -j "$(nproc)" --output-on-failure --no-tests=error "$@" || status=$?
echo "times: set-up ${setup} s, build ${build} s, tests $((SECONDS - start)) s"
exit $status
