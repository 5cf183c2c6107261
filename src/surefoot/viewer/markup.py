"""Markup: the HTML of the live page's panels, from the files in `templates/`."""

from __future__ import annotations

import jinja2

_ENVIRONMENT = jinja2.Environment(
    loader=jinja2.PackageLoader("surefoot.viewer"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_ENVIRONMENT.filters["rgb"] = lambda color: "rgb({}, {}, {})".format(*color)


def render(name: str, **values: object) -> str:
    """The HTML of a template, without its suffix; every value is escaped."""
    return _ENVIRONMENT.get_template(f"{name}.html").render(**values)
