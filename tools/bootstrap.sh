#!/usr/bin/env bash
# Set up everything usdfoliage needs on a machine: system packages, .venv, .venv-preview, the native extension.
# usage: tools/bootstrap.sh packages|product|preview|all|test
# Each step is skipped when what it made is newer than what it depends on.
set -eu
cd "$(dirname "$0")/.."

# Build tools and OpenSubdiv; exrenvmap (tests); Mesa's software GL and what Blender's wheel links (preview).
PACKAGES=(
  g++ cmake ninja-build libosd-dev openexr
  libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri
  libx11-6 libxext6 libxi6 libxfixes3 libxrender1 libxkbcommon0 libsm6 libice6
  # The viewer's windows (Qt on X11).
  libglx-mesa0 libdbus-1-3 libfontconfig1 libxkbcommon-x11-0 libxcb-cursor0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1
  libxcb-randr0 libxcb-render-util0 libxcb-shape0 libxcb-xinerama0 libxcb-xkb1
)
# What tests look with: reports in a browser, the viewer on a virtual display.
TEST_PACKAGES=(chromium chromium-driver xvfb)

report() { printf '%s\n' "setup: $*" >&2; }
fail() { printf '%s\n' "error: $*" >&2; exit 1; }

# The python that a stamp was made for is part of the stamp, so that a new interpreter rebuilds.
fingerprint() { cat "$@" 2>/dev/null | sha256sum | cut -c1-16; }

find_python() { # find_python VERSION...: the first such interpreter that starts
  local version
  for version in "$@"; do
    if command -v "python$version" >/dev/null 2>&1 && "python$version" -c '' >/dev/null 2>&1; then
      command -v "python$version"
      return
    fi
  done
}

product_python() {
  local python=${PYTHON:-$(find_python 3.11 3.12 3.13)}
  [ -n "$python" ] || fail "no Python 3.11, 3.12 or 3.13 found; install one, or set PYTHON"
  printf '%s' "$python"
}

preview_python() {
  local python=${PREVIEW_PYTHON:-$(find_python 3.11)}
  [ -n "$python" ] || fail "no Python 3.11 found, which the preview needs; install it, or set PREVIEW_PYTHON"
  printf '%s' "$python"
}

install_packages() { # install_packages PACKAGE...: these, and what the pythons need
  local wanted=("$@") missing=() package python pythons
  pythons=$(product_python)
  if [ -z "${USDFOLIAGE_HYDRA_PYTHON:-}" ]; then pythons="$pythons $(preview_python)"; fi
  for python in $pythons; do
    case "$(readlink -f "$python")" in
      /usr/bin/python3.*) # Debian splits headers and venv off the interpreter
        package=$(basename "$(readlink -f "$python")")
        wanted+=("$package-dev" "$package-venv") ;;
    esac
  done
  if ! command -v dpkg-query >/dev/null 2>&1 || ! command -v apt-get >/dev/null 2>&1; then
    if [ -n "${USDFOLIAGE_PACKAGES_CHECKED:-}" ]; then return; fi
    report "this machine has no apt; install what these Debian packages hold, then set USDFOLIAGE_PACKAGES_CHECKED=1"
    fail "packages needed: ${wanted[*]}"
  fi
  for package in "${wanted[@]}"; do
    dpkg-query -W -f '${db:Status-Abbrev}' "$package" 2>/dev/null | grep -q '^ii' || missing+=("$package")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  local root=()
  if [ "$(id -u)" != 0 ]; then
    command -v sudo >/dev/null 2>&1 || fail "these packages are missing and neither root nor sudo is there: ${missing[*]}"
    root=(sudo)
  fi
  report "installing ${missing[*]}"
  "${root[@]}" apt-get update -qq || fail "apt-get update failed; is a package source configured?"
  "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null \
    || fail "apt-get could not install: ${missing[*]}"
}

make_venv() { # make_venv FOLDER PYTHON REQUIREMENTS
  local folder=$1 python=$2 requirements=$3 stamp
  stamp="$(fingerprint "$requirements")-$("$python" -c 'import sys; print(sys.version.split()[0])')"
  [ "$(cat "$folder/stamp" 2>/dev/null)" != "$stamp" ] || return 0
  report "$folder: Python packages of $requirements"
  "$python" -m venv --clear "$folder" || fail "$python cannot make a virtual environment; on Debian: apt-get install python3-venv"
  "$folder/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes -r "$requirements" \
    || fail "pip could not install $requirements into $folder"
  printf '%s' "$stamp" > "$folder/stamp"
}

build_product() {
  make_venv .venv "$(product_python)" requirements/develop.txt
  # Tools and tests import one another as tools.* and tests.support.*, whichever folder they are started in.
  pwd > "$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/usdfoliage_develop.pth"
  # An editable install compiles no modules, and a process that may write none compiles them at every start.
  .venv/bin/python -m compileall -qq pipeline/usdfoliage usd_plugins hydra_preview tools \
    || true # what cannot be compiled is reported where it is imported
  local stamp
  stamp=$(find pipeline/native pyproject.toml -type f | LC_ALL=C sort | xargs cat | sha256sum | cut -c1-16)
  if [ "$(cat .venv/built 2>/dev/null)" = "$stamp" ] && .venv/bin/python -c 'import usdfoliage._native' 2>/dev/null; then return; fi
  report "building the extension"
  PATH="$PWD/.venv/bin:$PATH" .venv/bin/python -m pip install --quiet --disable-pip-version-check \
    --no-build-isolation --no-deps --editable . || fail "the extension did not build; the compiler's message is above"
  printf '%s' "$stamp" > .venv/built
}

build_preview() {
  if [ -n "${USDFOLIAGE_HYDRA_PYTHON:-}" ]; then
    report "preview: using $USDFOLIAGE_HYDRA_PYTHON"
    return
  fi
  make_venv .venv-preview "$(preview_python)" requirements/preview.txt
}

case "${1:-all}" in
  packages) install_packages "${PACKAGES[@]}" ;;
  product) build_product ;;
  preview) build_preview ;;
  all) install_packages "${PACKAGES[@]}"; build_product; build_preview ;;
  test) install_packages "${PACKAGES[@]}" "${TEST_PACKAGES[@]}"; build_product; build_preview ;;
  *) fail "usage: tools/bootstrap.sh packages|product|preview|all|test" ;;
esac
