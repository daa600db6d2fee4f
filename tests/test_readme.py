"""What the README shows is what runs."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parent.parent / "README.md"


def test_the_python_example_runs_and_reads_the_press(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    exec(compile(example, str(README), "exec"), {})
    state, depth_mm = capsys.readouterr().out.split()
    assert state == "locked"
    # The default press has come down to 0.2 mm by 0.5 s.
    assert float(depth_mm) == pytest.approx(0.2, rel=0.003)


def test_every_file_that_the_readme_links_to_exists() -> None:
    links = re.findall(r"\]\(([^)#:]+)\)", README.read_text())
    assert links
    for link in links:
        assert (README.parent / link).exists(), link
