"""Findings that have no other reason than that this USD cannot read a shader."""

from collections.abc import Mapping
from dataclasses import replace

from pxr import Plug

from usdfoliage.asset.validation.findings import Finding


def without_parser(finding: Finding) -> Finding:
    """The same finding, but a warning where its only reason is that this USD cannot read such shaders.

    Whether a MaterialX node exists is known to a USD with usdMtlx, whether a glslfx file is one with sdrGlslfx; the
    usd-core wheel has neither and takes every such shader for an error.
    """
    missing: Mapping[str, str] = {"shaderId 'ND_": "usdMtlx", "sourceType 'glslfx'": "sdrGlslfx"}
    if finding.severity != "error" or "SdrCompliance" not in finding.validator:
        return finding
    for words, plugin in missing.items():
        if finding.message.startswith(words) and not Plug.Registry().GetPluginWithName(plugin):
            message = f"{finding.message} (not checked here: this USD has no plug-in {plugin})"
            return replace(finding, severity="warning", message=message)
    return finding
