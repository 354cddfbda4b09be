#!/usr/bin/env bash
# arm64.sh [--build-only]: builds the program and its tests for arm64 on this machine, with Debian's cross compiler and
# arm64's own libraries in build/arm64-root (1 GB, nothing of it is installed), and runs in qemu-user the tests of the label
# `unit`, a render, and a worker in a cluster of x86 hosts. Exit code 77, with the reason, where it cannot.
# CLOUDRENDERER_ARM64_TESTS: a pattern of test programs to build and run instead of all of `unit`.
set -euo pipefail
cd "$(dirname "$0")/.."

skip() {
  echo "SKIPPED: $*"
  exit 77
}

root=$PWD/build/arm64-root
[[ $(dpkg --print-architecture 2>/dev/null) == amd64 ]] || skip "the machine is no x86 Debian: build there with the preset ci"
needed=()
for package in g++-aarch64-linux-gnu qemu-user-static mmdebstrap; do
  [[ $(dpkg-query -W -f '${Status}' "$package" 2>/dev/null) == "install ok installed" ]] || needed+=("$package")
done
if [[ ${#needed[@]} -gt 0 ]]; then
  [[ $(id -u) -eq 0 ]] || skip "these packages are missing, and installing them needs root: ${needed[*]}"
  echo "arm64.sh: installing ${needed[*]}"
  { apt-get update -qq && apt-get install -y -qq --no-install-recommends "${needed[@]}"; } >/dev/null 2>&1 ||
    skip "apt-get cannot install ${needed[*]}"
fi

# Unpacked only: no program of arm64 runs for it. What installing would have done is two links.
wanted="libc6-dev libstdc++-12-dev $(tools/setup.sh --libraries)"
if [[ $(cat "$root/.packages" 2>/dev/null) != "$wanted" ]]; then
  echo "arm64.sh: fetching arm64's libraries into $root"
  rm -rf "$root"
  mkdir -p build
  mmdebstrap --quiet --architectures=arm64 --variant=extract --include="$wanted" \
    --aptopt='APT::Install-Recommends "false"' "$(. /etc/os-release && echo "$VERSION_CODENAME")" "$root" >/dev/null ||
    skip "Debian's arm64 packages cannot be had"
  find "$root" -type l -lname '/*' -printf '%p %l\n' | while read -r link target; do ln -sfn --relative "$root$target" "$link"; done
  for library in blas lapack; do
    ln -sf "$library/lib$library.so.3" "$root/usr/lib/aarch64-linux-gnu/lib$library.so.3"
  done
  echo "$wanted" >"$root/.packages"
fi

cmake --preset arm64 >/dev/null
all=$(ctest --test-dir build/arm64 -N --show-only=json-v1 -L unit 2>/dev/null || true)
