"""``vtsdt schema``: the JSON Schema of study files."""

from __future__ import annotations

import json
from collections.abc import Sequence

from vtsdt.cli.arguments import Parser

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt schema``."""
    parser = Parser(
        prog="vtsdt schema",
        description="Print the JSON Schema of study files, with which editors complete and check them.",
    )
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    parser.parse_args(list(arguments))
    from discrepancy.problem.schema import study_schema

    print(json.dumps(study_schema(), indent=2, ensure_ascii=False))
    return 0
