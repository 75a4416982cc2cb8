"""The site: what is written from the code, equations as MathML, and the check of the built pages."""

from __future__ import annotations

import html
import importlib.util
from pathlib import Path

import markdown
import pytest

from docs._site.navigation import navigation
from docs._site.reference_pages import reference_pages
from docs._site.summaries import SUMMARIES, with_summary
from docs.generate import GENERATED

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def check_site():
    spec = importlib.util.spec_from_file_location("check_site", ROOT / ".ci" / "check_site.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def rendered(text: str) -> str:
    return markdown.markdown(text, extensions=["docs._site.mathml", "tables"])


def test_equations_become_mathml_and_prices_and_code_stay():
    page = rendered("A force $F < \\mu N$, `$a$`, 5 $ or 6 $.\n\n$$\nx^2\n$$\n\n| a |\n| --- |\n| $y_1$ |\n")
    assert page.count("<math") == 3
    assert page.count('display="block"') == 1
    assert "<code>$a$</code>" in page
    assert "5 $ or 6 $." in page
    assert "<mo><</mo><mi>μ</mi>" in html.unescape(page)
    assert "\\(" not in page


def test_an_equation_that_cannot_be_set_is_named():
    with pytest.raises(ValueError, match=r"cannot set the equation '\\left\( x'"):
        rendered("$\\left( x$")


def test_the_navigation_follows_the_index_and_leaves_no_page_out(tmp_path):
    folder = tmp_path / "howto"
    (folder / "more-pages").mkdir(parents=True)
    for name, text in {
        "index": "[b](b.md) and [a](a.md#part)",
        "a": "",
        "b": "",
        "c": "",
        "more-pages/d": "",
    }.items():
        (folder / f"{name}.md").write_text(text)
    assert navigation(tmp_path) == [
        "index.md",
        {
            "How to": [
                *(f"howto/{name}.md" for name in ("index", "b", "a", "c")),
                {"More pages": ["howto/more-pages/d.md"]},
            ]
        },
    ]


def test_what_is_written_from_the_code_is_ignored_by_git():
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
    assert {f"docs/{name}" for name in GENERATED} <= {line.rstrip("/") for line in ignored}


def test_a_name_is_shown_on_one_reference_page():
    pages = reference_pages(ROOT)
    entries = [line for page in pages.values() for line in page.splitlines() if line.startswith(("::: ", "## "))]
    assert len(entries) > 100
    assert len(set(entries)) == len(entries)
    assert "## StribeckFriction" in pages["multibody.library.md"]


def test_the_check_finds_dead_links_and_what_comes_from_elsewhere(check_site, tmp_path):
    (tmp_path / "a.html").write_text(
        '<h1 id="one">One</h1><a href="b.html#two">b</a><a href="#one">a</a><a href=https://example.org>e</a>'
        '<a href="gone.html">g</a><a href="b.html#three">b</a><pre><a href="text.html"></pre>'
        '<img src="gone.png"><script src="https://example.org/x.js"></script>'
    )
    (tmp_path / "b.html").write_text('<h2 id="two">Two</h2>')
    found = "\n".join(check_site.faults(tmp_path))
    assert len(found.splitlines()) == 4
    for named in ("gone.html", "b.html#three", "gone.png", "https://example.org/x.js"):
        assert named in found


def test_the_walk_finds_what_does_not_fit(check_site, tmp_path):
    pytest.importorskip("playwright")
    if check_site.chromium() is None:
        pytest.skip("needs Chromium")
    (tmp_path / "wide.html").write_text('<div style="width: 900px">wide</div>')
    (tmp_path / "gone.html").write_text('<img src="gone.png"><script>nothing.there</script>')
    (tmp_path / "good.html").write_text("<p>good</p>")
    found = check_site.walk_faults(tmp_path, tmp_path)
    assert len([line for line in found if "wider than the screen" in line and "wide.html at 400 px" in line]) == 1
    assert len([line for line in found if "no image" in line]) == len(check_site.WIDTHS)
    assert len([line for line in found if "fault in a script" in line]) == len(check_site.WIDTHS)
    assert len(found) == 1 + 2 * len(check_site.WIDTHS)
    assert (tmp_path / "good-400.png").stat().st_size > 0


@pytest.mark.parametrize("name", SUMMARIES)
def test_the_short_tables_are_those_of_the_measurements(name):
    assert (ROOT / "docs" / name).read_text(encoding="utf-8") == with_summary(name), "python -m docs._site.summaries"
