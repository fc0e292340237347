"""The one environment that fills templates of reports and pages, and what they show texts and sizes with."""

import re
from pathlib import Path
from urllib.parse import quote

import jinja2
from markupsafe import Markup

TEMPLATES = Path(__file__).parent / "templates"
# What a name may hold and a page must not: bytes that are no UTF-8, controls, and marks that turn the order of letters.
_NO_TEXT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]")
_NO_BYTE = re.compile("[\ud800-\udc7f\udd00-\udfff]")  # the surrogates between stand for bytes of a name


def render_template(template: str, **values: object) -> str:
    """A template of the folder templates, filled in.

    Args:
        template: Its file name.
        values: What it shows. Every text is escaped, and what no page can hold is replaced.

    Raises:
        jinja2.UndefinedError: The template shows a value that is not there.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_finish,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"bytes": in_bytes, "link": link_to}
    page = environment.get_template(template).render(**values)
    return page if page.endswith("\n") else f"{page}\n"


def clean_text(text: str) -> str:
    """A text that a page can hold: what is no character, or would turn others round, is shown as �."""
    return _NO_TEXT.sub("\ufffd", text)


def link_to(path: str) -> str:
    """The address of a file, as seen from the page's folder; whatever its name is, it is no other kind of address."""
    encoded = _NO_BYTE.sub("\ufffd", path).encode("utf-8", "surrogateescape")
    return f"./{quote(encoded, safe='/')}"


def in_bytes(size_bytes: int) -> str:
    """A size in the unit in which it reads well, 1000 at a step."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= factor * 0.9995:
            return f"{size_bytes / factor:.3g} {unit}"
    return f"{size_bytes} bytes"


def _finish(value: object) -> object:
    return clean_text(value) if isinstance(value, str) and not isinstance(value, Markup) else value
