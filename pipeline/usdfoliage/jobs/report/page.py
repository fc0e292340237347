"""Pages that hold all they show: one file each, which opens from a disk and asks no network for anything."""

import base64

from markupsafe import Markup

from usdfoliage.files.hashing import hash_bytes
from usdfoliage.jobs.report.environment import TEMPLATES, render_template


def render_page(template: str, style: str, script: str, **values: object) -> str:
    """The text of a page.

    A policy in its head forbids it whatever is not its own: the network, frames, and every script but its own one and
    those beside it.

    Args:
        template: Extends page.html.
        style: Style sheet of this kind of page, which follows page.css.
        script: Its script.
        values: What the template shows. Every text is escaped.
    """
    css = "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in ("page.css", style))
    code = (TEMPLATES / script).read_text(encoding="utf-8")
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(css)}; script-src {_hash(code)} 'self' file:; "
        "base-uri 'none'; form-action 'none'"
    )
    return render_template(template, style=Markup(css), script=Markup(code), policy=policy, **values)  # files of ours


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hash_bytes(text.encode('utf-8'))).decode('ascii')}'"
