"""A page taken apart: its text, its elements, and all that it refers to; and recordings with more in them."""

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser

import h5py
import numpy as np

HOSTILE = "<script>alert('x')</script> & \"co\""

VOID = {"meta", "br", "img", "link", "input", "hr"}


@dataclass
class Page(HTMLParser):
    """tags: every element in turn. refers: values of attributes that could load something. ids: as given."""

    source: str
    tags: list[str] = field(default_factory=list)
    refers: list[str] = field(default_factory=list)
    ids: list[str] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)
    open_tags: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.feed(self.source)
        self.close()
        assert self.open_tags == []
        self.refers += re.findall(r"url\(([^)]*)\)", self.source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open_tags.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name in {"src", "href", "xlink:href", "data", "action", "poster", "srcset"}:
                self.refers.append(value or "")
            if name == "id":
                self.ids.append(value or "")
            assert not name.startswith("on"), f"{tag} {name}"

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open_tags.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())


def add_row(file: h5py.File, table: str, **values: object) -> None:
    """Add a row to a table; what is not given is 0 or empty."""
    dataset = file[f"{table}/table"]
    row = np.zeros(1, dataset.dtype)
    for name, value in values.items():
        row[name] = value
    dataset.resize(len(dataset) + 1, axis=0)
    dataset[-1:] = row
