"""Whether measurements agree, in words."""

from __future__ import annotations

from fitting.result.result import Result


def agreement_sentences(result: Result) -> tuple[str, ...]:
    """Whether campaigns agree with each other, and with values from elsewhere.

    Args:
        result: of a reconstruction.
    """
    tests = result.joint.tensions if result.joint is not None else ()
    return (*(test.sentence for test in tests), *(test.sentence for test in result.external))
