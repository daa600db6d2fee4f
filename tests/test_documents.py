"""Files that the glossary and the decision records name exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCUMENTS = [
    *(ROOT / "docs" / name for name in ("glossary.md", "architecture.md")),
    *sorted((ROOT / "docs/decisions").glob("*.md")),
]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_files_named_in_a_document_exist(document):
    text = document.read_text()
    files = re.findall(r"`((?:zeromethod|tests|benchmarks|docs)/[^`]+)`", text)
    modules = re.findall(r"python -m (benchmarks\.\w+)", text)
    links = re.findall(r"\]\(([^)#:]+)\)", text)
    assert files
    for name in files:
        assert (ROOT / name).exists(), name
    for name in modules:
        module = ROOT / name.replace(".", "/")
        assert module.with_suffix(".py").exists() or module.is_dir(), name
    for link in links:
        assert (document.parent / link).exists(), link


def test_the_architecture_names_files_that_exist_and_what_is_in_them():
    """A name stands behind its file: `loop/circle.py` (`Circle.take`)."""
    text = (ROOT / "docs/architecture.md").read_text()
    files = {
        name: next((top / name for top in (ROOT / "zeromethod", ROOT) if (top / name).exists()), None)
        for name in re.findall(r"`([\w/]+\.(?:py|frag|vert|txt))`", text)
    }
    assert len(files) > 60
    assert [name for name, path in files.items() if path is None] == []
    for name, inside in re.findall(r"`([\w/]+\.py)` \(?`(\w+(?:\.\w+)?)`", text):
        code = files[name].read_text()
        for part in inside.split("."):
            assert re.search(rf"\b(?:def|class) {part}\b|^ *(?:self\.)?{part}\b", code, re.MULTILINE), (
                name,
                inside,
            )
