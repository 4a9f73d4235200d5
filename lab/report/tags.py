"""Pieces of HTML: sections, tables, legends.  Text is escaped here unless it is of type ``Html``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from lostmotion.lab.quantity import SMALLEST_P, number

__all__ = [
    "Html", "Section", "bar", "cell", "figure", "key", "more", "note", "p_value", "paragraphs", "probability", "table"
]  # fmt: skip

CHOSEN = '<tr class="chosen">'


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the page.  id: its anchor."""

    id: str
    heading: str
    body: Html

    def html(self) -> str:
        """The section with its heading."""
        return f'<section id="{self.id}"><h2>{escape(self.heading)}</h2>\n{self.body}\n</section>'


def cell(*parts: str, css: str = "") -> Html:
    """A cell of a table; all parts but the first are set small below it."""
    first, *rest = (part if isinstance(part, Html) else Html(escape(part)) for part in parts)
    small = "".join(f" <small>{part}</small>" for part in rest if part)
    opening = f'<td class="{css}">' if css else "<td>"
    return Html(f"{opening}{first}{small}</td>")


def table(head: Sequence[str], rows: Iterable[Sequence[Html]], chosen: Iterable[bool] = ()) -> Html:
    """A table that scrolls sideways where it is too wide; a head that ends in ">" is right-aligned, for numbers."""
    cells = "".join(f'<th class="number">{escape(h[:-1])}</th>' if h.endswith(">") else f"<th>{escape(h)}</th>"
                    for h in head)  # fmt: skip
    marks = iter(chosen)
    lines = "".join(f"{CHOSEN if next(marks, False) else '<tr>'}{''.join(row)}</tr>\n" for row in rows)
    return Html(f'<div class="scroll"><table><thead><tr>{cells}</tr></thead><tbody>\n{lines}</tbody></table></div>')


def bar(share: float, mark: float) -> Html:
    """A cell with a bar of this share of its width, and a mark at another share; NaN for no mark."""
    full, at = (100 * min(max(v, 0.0), 1.0) for v in (share, mark))
    mark_html = f'<b style="left:{at:.2f}%"></b>' if mark == mark else ""
    return Html(f'<td class="bar"><div class="track"><i style="width:{full:.2f}%"></i>{mark_html}</div></td>')


def key(*names: tuple[str, str]) -> Html:
    """The legend of a plot: for each line its CSS class and its text."""
    items = "".join(f'<li class="{css}">{escape(text)}</li>' for css, text in names)
    return Html(f'<ul class="key">{items}</ul>')


def figure(picture: str, title: str, caption: str = "") -> Html:
    """A picture (SVG) with its title and caption."""
    return Html(
        f"<figure>{picture}<figcaption><strong>{escape(title)}</strong> {escape(caption)}</figcaption></figure>"
    )


def paragraphs(texts: Iterable[str], css: str = "") -> Html:
    """Each text as a paragraph."""
    opening = f'<p class="{css}">' if css else "<p>"
    return Html("".join(f"{opening}{escape(text)}</p>" for text in texts if text))


def note(text: str) -> Html:
    """A paragraph of explanation, in a softer colour."""
    return paragraphs([text], "note")


def more(summary: str, body: str) -> Html:
    """A folded part of the page with a summary."""
    return Html(f"<details><summary>{escape(summary)}</summary>{body}</details>")


def p_value(value: float) -> str:
    """A probability for a sentence: "p = 0.012" or "p < 0.003"."""
    text = probability(value)
    return f"p\u00a0{text}" if text[0] in "u<" else f"p\u00a0=\u00a0{text}"


def probability(value: float) -> str:
    """A probability with two digits for a table; a very small one as a bound."""
    if not math.isfinite(value):
        return "unknown"
    if value < SMALLEST_P:
        return f"<\u00a0{SMALLEST_P:g}"
    return number(value, max(2, 1 - math.floor(math.log10(value))))
