#!/usr/bin/env bash
# arm64.sh [TEST_PROGRAM...]: builds for arm64 on an x86 machine, with Debian's cross compiler and arm64's own libraries in
# build/arm64-root (1 GB; nothing of it is installed), and runs in qemu-user the named test programs (base_tests ...; without
# names all of the label `unit` but fuzzing), a render, and a worker in a cluster with x86 hosts. With names an hour becomes
# minutes. Exit code 77, with the reason, where it cannot.
set -euo pipefail
cd "$(dirname "$0")/.."

skip() {
  echo "SKIPPED: $*"
  exit 77
}

[[ $(dpkg --print-architecture 2>/dev/null) == amd64 ]] || skip "this is no Debian on x86: build with the preset ci where the processor is arm64"
missing=()
for package in g++-aarch64-linux-gnu qemu-user-static mmdebstrap; do
  [[ $(dpkg-query -W -f '${Status}' "$package" 2>/dev/null) == "install ok installed" ]] || missing+=("$package")
done
if [[ ${#missing[@]} -gt 0 ]]; then
  [[ $(id -u) -eq 0 ]] || skip "these packages are missing, and installing them needs root: ${missing[*]}"
  echo "arm64.sh: installing ${missing[*]}"
  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"; } \
    >/dev/null 2>&1 || skip "apt-get cannot install ${missing[*]}"
fi

# The packages are unpacked only, so that no program of arm64 runs for it. What their installation would do is two links.
root=$PWD/build/arm64-root
read -ra libraries <<<"libc6-dev openimageio-tools $(tools/setup.sh --libraries)"  # the tools because CMake wants to see them
if [[ $(cat "$root/.packages" 2>/dev/null) != "${libraries[*]}" ]]; then
  echo "arm64.sh: fetching arm64's libraries into $root"
  rm -rf "$root"
  mkdir -p build
  mmdebstrap --quiet --architectures=arm64 --variant=extract --include="${libraries[*]}" \
    --aptopt='APT::Install-Recommends "false"' "$(. /etc/os-release && echo "$VERSION_CODENAME")" "$root" ||
    skip "Debian's packages for arm64 cannot be had"
  # A link to /lib/... means this folder's.
  find "$root" -type l -lname '/*' -printf '%p %l\n' |
    while read -r link target; do ln -sfnr "$root$target" "$link"; done
  for library in blas lapack; do
    ln -sf "$library/lib$library.so.3" "$root/usr/lib/aarch64-linux-gnu/lib$library.so.3"
  done
  echo "${libraries[*]}" >"$root/.packages"
fi

programs=("$@")
if [[ $# -eq 0 ]]; then
  for file in tests/*.cmake tests/*/CMakeLists.txt; do
    while read -r name; do programs+=("$name"); done < <(sed -n 's/^cloudrenderer_test(\([a-z_]*\) LABEL unit.*/\1/p' "$file")
  done
fi
cmake --preset arm64 >/dev/null
cmake --build build/arm64 --target cloudrenderer "${programs[@]}"
[[ -x build/release/cloudrenderer ]] || { cmake --preset ci >/dev/null && cmake --build build/release --target cloudrenderer; }

# Whole programs, not a process a case: loading the libraries takes the emulator seconds.
status=0
for program in "${programs[@]}"; do
  log=build/arm64/$program.log
  if timeout 3600 qemu-aarch64-static -L "$root" "build/arm64/tests/$program" >"$log" 2>&1; then
    echo "$program: $(grep -E '^\[  PASSED  \]' "$log")$(grep -c '^\[  SKIPPED \].*ms)' "$log" | sed 's/^0$//; s/.\+/, & skipped/')"
  else
    status=1
    echo "$program: failed (exit code or time), see $log"
    grep -E '^\[  (PASSED|FAILED) +\]' "$log" | sort -u || tail -n 5 "$log"
  fi
done
echo "not run on arm64: the labels sim, image and cluster, and fuzzing"
/usr/bin/python3 -W ignore tests/cluster/arm64_test.py build/release/cloudrenderer build/arm64/cloudrenderer "$root" || status=1
exit $status
