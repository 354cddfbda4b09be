#!/bin/sh
# Makes what the Python host needs under build/python_host: a virtual environment with packages from PyPI, and the messages
# from their schema. Prints the environment's python. Exit code 77: Embree for Python cannot be had here.
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
made=$root/build/python_host
mkdir -p "$made/generated"
# Python code made by protoc 3.21 (Debian 12) goes with version 4 of the Python package.
if ! "$made/venv/bin/python" -c 'import embreex, google.protobuf, numpy, OpenSSL, xxhash' 2>/dev/null; then
  {
    /usr/bin/python3 -m venv "$made/venv" &&
      timeout 240 "$made/venv/bin/python" -m pip install -q --disable-pip-version-check \
        'embreex>=4.4' numpy 'protobuf>=4.21,<5' pyopenssl xxhash
  } >&2 || { echo "embreex cannot be installed from PyPI here" >&2; exit 77; }
fi
command -v protoc >/dev/null || { echo "protoc is missing (Debian: protobuf-compiler)" >&2; exit 77; }
protoc --proto_path="$root/src" --python_out="$made/generated" wire/messages.proto parts/manifest.proto scene/scene.proto
echo "$made/venv/bin/python"
