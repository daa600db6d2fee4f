"""Studies of runs that take next to no time."""

from collections.abc import Callable
from pathlib import Path

import pytest

from zeromethod.study import Study, parse_study

HERE = Path(__file__).parent


@pytest.fixture
def own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Procedures of this folder, here and in worker processes."""
    monkeypatch.syspath_prepend(str(HERE))
    monkeypatch.setenv("PYTHONPATH", str(HERE))


@pytest.fixture
def squares(own: None, tmp_path: Path) -> Callable[..., Study]:
    """Make a study of so many squares; further lines go into its table [set]."""

    def make(count: int = 6, *settings: str, seed: int = 3, limit_s: float = 600.0) -> Study:
        text = "\n".join(
            [
                "schema_version = 1",
                'title = "squares"',
                'procedure = "own_procedures:SQUARE"',
                f"seed = {seed}",
                f"limit_s = {limit_s}",
                "[set]",
                *settings,
                "[grid]",
                f"x = [{', '.join(map(str, range(count)))}]",
                "[figure]",
                'x = "x"',
                'y = "square"',
            ]
        )
        path = tmp_path / "squares.toml"
        path.write_text(text)
        return parse_study(text, path)

    return make
