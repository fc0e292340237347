#!/usr/bin/env bash
# Pin requirements/*.in with hashes for every supported Python; the files record no download address.
# usage: tools/lock.sh [--upgrade]     needs: pip install uv
set -eu
cd "$(dirname "$0")/.."
common=(--generate-hashes --no-emit-index-url --no-emit-find-links --custom-compile-command "tools/lock.sh" --quiet)
uv pip compile --universal --python-version 3.11 "${common[@]}" "$@" requirements/product.in -o requirements/product.txt
uv pip compile --universal --python-version 3.11 "${common[@]}" "$@" -c requirements/product.txt requirements/develop.in -o requirements/develop.txt
uv pip compile --python-version 3.11 "${common[@]}" "$@" requirements/preview.in -o requirements/preview.txt
uv pip compile --universal --python-version 3.11 "${common[@]}" "$@" -c requirements/develop.txt requirements/wheel.in -o requirements/wheel.txt
