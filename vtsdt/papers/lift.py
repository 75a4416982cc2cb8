"""The tables and figures of González et al. 2020 made again: the chapters of the lift, in the paper's order."""

from __future__ import annotations

from collections.abc import Iterator

from discrepancy.validation.published import PaperChapter
from multibody.base.progress import Progress
from vtsdt.papers.alignment import alignment_chapters
from vtsdt.papers.equations import equations_chapter
from vtsdt.papers.filter_tuning import table_2_chapter
from vtsdt.papers.measured_trips import table_3_chapter
from vtsdt.papers.reduced_models import drawings_chapter, figure_5_chapter, figure_6_chapter, table_1_chapter
from vtsdt.papers.table_4 import other_benches, table_4_chapter
from vtsdt.papers.threshold import figure_10_chapter

__all__ = ["chapters"]


def chapters(progress: Progress) -> Iterator[PaperChapter]:
    """Yield the chapters of the lift paper, in its order."""
    yield drawings_chapter()
    progress("Table 1: states and times of the models")
    yield table_1_chapter()
    progress("other benches that meet the fitted figures of Table 4")
    others = other_benches()
    progress("Fig. 5: the 1D model against the reference")
    yield figure_5_chapter(others)
    progress("Fig. 6: natural frequencies along the trip")
    yield figure_6_chapter(others)
    progress("Eqs. 1 to 31")
    yield equations_chapter()
    yield table_2_chapter(progress)
    figure_8, figure_9, figure_13 = alignment_chapters(progress)
    yield figure_8
    yield figure_9
    yield figure_10_chapter(progress)
    yield table_3_chapter(progress)
    yield table_4_chapter(progress)
    yield figure_13
