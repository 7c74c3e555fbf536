"""Page of a report from the cache, where the same page was made before; plots are not drawn again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from analyze.cache.code_version import hash_of_pages
from analyze.pipeline.cached import inputs_of_estimate
from schemas.output_file import write_text
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from analyze.cache.results import ResultCache
    from analyze.result.answer import Answer


@dataclass(frozen=True)
class KeptPage:
    """Text of a report's page, as the cache keeps it."""

    html: str
    """text of the page"""
    made_with: str
    """`hash_of_pages` after it was made"""


def write_report_with_cache(
    answer: Answer, output: Path, score: Mapping[str, Any] | None, cache: ResultCache | None
) -> None:
    """Write the report of an estimate as `write_report` does, from the cache where the page is kept.

    Only pages of finished and sealed recordings are kept.

    Args:
        answer: estimate and its result; its recordings are read again for a page that is not kept.
        output: the HTML file; its folder must exist.
        score: errors against ground truth (`score_answer`); None if the recordings are not virtual.
        cache: cache of results; None to make the page anew.

    Raises:
        RecordingError: a recording cannot be read.
        OutputError: the file cannot be written.
    """
    made: list[KeptPage] = []

    def render() -> KeptPage:
        # Loads the library of plots, which takes longer than all else.
        from analyze.report.report import camera_stills, render_report

        html = render_report(answer, camera_stills(answer.estimate), score)
        made.append(KeptPage(html, hash_of_pages()))
        return made[-1]

    made_with = hash_of_pages()
    inputs = None if cache is None else _inputs(answer, score)
    if cache is not None and inputs is not None:
        evidence = answer.estimate.evidence
        label = f"report of {evidence.spec.name} from {counted(len(evidence.motions), 'strike')}"
        kept = cache.get(KeptPage, (*inputs, made_with), label, render)
        # Otherwise the program was updated while that page was made.
        if kept.made_with == made_with and not made:
            made.append(kept)
    write_text(output, (made[0] if made else render()).html)


def _inputs(answer: Answer, score: Mapping[str, Any] | None) -> tuple[object, ...] | None:
    """All that a page depends on besides the program; None if a recording has no seal or a file is gone.

    Size and time of change of the files show whether one was changed since it was sealed; the page shows
    images from them.
    """
    estimate = answer.estimate
    heads = estimate.evidence.recordings
    if not all(head.content_id for head in heads):
        return None
    try:
        states = [(name, head.path.with_name(name).stat()) for head in heads for name in head.files]
    except OSError:
        return None
    return (
        inputs_of_estimate(estimate.evidence, estimate.options),
        answer.json(),
        score,
        [(name, state.st_size, state.st_mtime_ns) for name, state in states],
    )
