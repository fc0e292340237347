#!/usr/bin/env python3
"""How long an asset takes to validate where what its selections of variants share is asked once, and where it is not.

usage: tools/bench/validation.py ASSET

Anew: every validator of USD and NVIDIA's whole engine, in each selection by itself. Shared: as validate_asset does it.
Asked of the results: every finding of the one is in the other, in the same selections. Times are of the processor.
"""

import argparse
import importlib
import time
from pathlib import Path

import usdfoliage  # noqa: F401  registers the schemas, before any stage
from pxr import Usd
from usdfoliage.asset.locate import find_interface
from usdfoliage.asset.looks.look import open_root_layer
from usdfoliage.asset.validation import nvidia_rules
from usdfoliage.asset.validation import validate as validation
from usdfoliage.asset.validation.findings import Finding
from usdfoliage.asset.validation.known_findings import KnownFindings
from usdfoliage.asset.validation.usd_validators import run_usd_validators

FindingKeys = frozenset[tuple[str, str, str]]  # severity, path, message: USD's and NVIDIA's names for a rule differ


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", type=Path)
    root = open_root_layer(find_interface(parser.parse_args().asset).absolute())
    package = importlib.import_module(nvidia_rules.PACKAGE)
    known = KnownFindings()
    anew_s = shared_s = 0.0
    selections = validation._selections(root)
    for number, selection in enumerate(selections):
        stage = validation._compose(root, selection, Usd.Stage.LoadAll)
        start = time.process_time()
        issues = package.ValidationEngine(variants=False).validate(stage).issues()
        engine = [nvidia_rules._with_our_rules(finding, stage) for finding in nvidia_rules._findings(issues)]
        anew = _keys_of([*run_usd_validators(stage, KnownFindings()), *engine])
        middle = time.process_time()
        shared = _keys_of([*run_usd_validators(stage, known), *nvidia_rules.run_nvidia_rules(stage, known)])
        end = time.process_time()
        anew_s, shared_s = anew_s + middle - start, shared_s + end - middle
        label = f"{number + 1}/{len(selections)} {validation._label(selection)}"
        print(f"{label}: {middle - start:.2f} s anew, {end - middle:.2f} s shared, {len(shared)} findings", flush=True)
        if anew != shared:
            raise SystemExit(f"they differ: {sorted(anew ^ shared)[:4]}")
    print(f"{anew_s:.1f} s anew, {shared_s:.1f} s shared: {anew_s / shared_s:.1f} times as fast")


def _keys_of(findings: list[Finding]) -> FindingKeys:
    return frozenset((finding.severity, finding.path, finding.message) for finding in findings)


if __name__ == "__main__":
    main()
