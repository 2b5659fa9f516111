"""The glossary: which terms a text uses, and that no term is explained twice."""

from __future__ import annotations

import pytest

from vve_sumo.metrics.table import METRICS
from vve_sumo.report.glossary import TERMS, used_in


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("the headways of two cars", ["headway, time gap"]),
        ("The Time To Collision and the RSS gap", ["gap", "RSS (Responsibility-Sensitive Safety)", "TTC"]),
        ("a gaping hole in the jerky onsets", ["onset"]),
        ("cross-traffic at the lot", []),
    ],
)
def test_terms_are_found_as_whole_words_in_any_case_and_in_the_plural(text: str, words: list[str]) -> None:
    assert [term.word.removesuffix(" (time to collision)") for term in used_in([text])] == words


def test_no_spelling_belongs_to_two_terms() -> None:
    spellings = [spelling.lower() for term in TERMS for spelling in term.spellings]
    assert len(spellings) == len(set(spellings))
    assert len({term.word for term in TERMS}) == len(TERMS)


def test_a_term_that_is_a_metric_means_what_the_metrics_table_says() -> None:
    (drac,) = used_in(["DRAC"])
    assert drac.meaning == METRICS["drac_mps2"].meaning
