#!/usr/bin/env bash
# setup.sh [--build-only | --libraries]: installs what building and testing need: Debian 12 or later packages, as root.
# Quiet; does nothing when all is there. --libraries: only tells the packages that are linked, which arm64.sh needs too.
set -euo pipefail

libraries=(
  libembree-dev libopenexr-dev libopenimageio-dev libglm-dev libtbb-dev
  uuid-dev libasio-dev libprotobuf-dev libssl-dev
  libcli11-dev libspdlog-dev libfmt-dev nlohmann-json3-dev
  zlib1g-dev liblz4-dev libzstd-dev libxxhash-dev libboost-dev
  libcpp-httplib-dev prometheus-cpp-dev libsqlite3-dev libnanovdb-dev
)
packages=(
  build-essential cmake ninja-build ccache pkg-config clang-format clang-tidy
  openimageio-tools protobuf-compiler openssl
)
test_libraries=(libgtest-dev libbenchmark-dev)
if [[ ${1:-} == --libraries ]]; then
  echo "${libraries[@]}" "${test_libraries[@]}"
  exit 0
fi
packages+=("${libraries[@]}")
[[ ${1:-} == --build-only ]] || packages+=(
  "${test_libraries[@]}"
  python3 python3-numpy python3-openimageio python3-venv iproute2 chromium
)

missing=()
for package in "${packages[@]}"; do
  [[ $(dpkg-query -W -f '${Status}' "$package" 2>/dev/null) == "install ok installed" ]] || missing+=("$package")
done
[[ ${#missing[@]} -eq 0 ]] && exit 0

if [[ $(id -u) -ne 0 ]]; then
  echo "setup.sh: these packages are missing, and installing them needs root: ${missing[*]}" >&2
  exit 1
fi
echo "setup.sh: installing ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
if ! { apt-get update -qq && apt-get install -y -qq --no-install-recommends "${missing[@]}"; } >"$log" 2>&1; then
  cat "$log" >&2
  echo "setup.sh: apt-get failed; its output is above" >&2
  rm -f "$log"
  exit 1
fi
rm -f "$log"
