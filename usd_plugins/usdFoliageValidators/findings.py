"""How the validators word a finding: its name, severity, place and what to do."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdValidation

Findings = list[UsdValidation.ValidationError]
MAX_LISTED = 10


def error(prim: Usd.Prim, name: str, text: str, property_name: str = "") -> UsdValidation.ValidationError:
    """An error at a prim, or at its property; text names what is wrong and what to do."""
    return _finding(prim, name, text, property_name, UsdValidation.ValidationErrorType.Error)


def warning(prim: Usd.Prim, name: str, text: str, property_name: str = "") -> UsdValidation.ValidationError:
    """A warning at a prim, or at its property; text names what is wrong and what to do."""
    return _finding(prim, name, text, property_name, UsdValidation.ValidationErrorType.Warn)


def count(wrong: NDArray[np.bool_], what: str) -> str:
    """ "3 of 200 leaves (the first is 17)" for the elements that are True."""
    return f"{np.count_nonzero(wrong)} of {len(wrong)} {what} (the first is {int(np.argmax(wrong))})"


def which(wrong: NDArray[np.bool_], what: str, names: Sequence[str] | None = None) -> str:
    """ "3 of 200 leaves (17, 20 and 31)" for the elements that are True, by their numbers or their names."""
    listed = [names[number] if names else str(number) for number in np.flatnonzero(wrong)]
    if len(listed) > MAX_LISTED:
        listed = [*listed[:MAX_LISTED], f"{len(listed) - MAX_LISTED} more"]
    text = " and ".join([", ".join(listed[:-1]), listed[-1]] if len(listed) > 1 else listed)
    return f"{np.count_nonzero(wrong)} of {len(wrong)} {what} ({text})"


def wrong_prim_type(prim: Usd.Prim, schema: str, allowed: Sequence[str]) -> Findings:
    """The finding where a schema was put on a prim that it is not for; USD itself does not look when it composes."""
    if prim.GetTypeName() in allowed:
        return []
    kinds = " or ".join(allowed)
    text = f"has {schema}, which is for {kinds}, and is of type {prim.GetTypeName() or 'none'}; apply it to a {kinds}"
    return [error(prim, "WrongPrimType", text)]


def _finding(
    prim: Usd.Prim, name: str, text: str, property_name: str, severity: UsdValidation.ValidationErrorType
) -> UsdValidation.ValidationError:
    path: Sdf.Path = prim.GetPath().AppendProperty(property_name) if property_name else prim.GetPath()
    site = UsdValidation.ValidationErrorSite(prim.GetStage(), path)
    return UsdValidation.ValidationError(name, severity, [site], f"<{path}> {text}")
