"""HTML pages of a single file, pictures included, from templates that extend `web_page.html.j2`."""

import base64
from pathlib import Path
from typing import Any

_BASE = Path(__file__).parent


def rendered_page(template: Path, **content: Any) -> str:
    """Return the page of a template and its content; the template may include files beside it."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, _BASE]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"fixed": _fixed, "percent": _percent}
    return environment.get_template(template.name).render(**content)


def picture_uri(data: bytes) -> str:
    """Return a PNG or JPEG as a data URI."""
    kind = "png" if data.startswith(b"\x89PNG") else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _fixed(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100.0 * value:.0f} %"
