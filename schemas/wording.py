"""Wording of messages: numbers of things, with noun and verb in the singular or plural."""

from __future__ import annotations

_PLURAL_VERBS = {"is": "are", "was": "were", "has": "have", "does": "do", "carries": "carry"}
_SIBILANTS = ("s", "x", "ch", "sh")


def counted(number: int, noun: str, verb: str = "") -> str:
    """Number with its noun and verb, as "1 strike", "3 axes", "1 frame is" or "2 frames are".

    Args:
        number: number of things.
        noun: their name in the singular; an adjective may precede it, as in "damaged record".
        verb: verb in the singular, as "is" or "gives"; "" for none.
    """
    if number == 1:
        return f"1 {noun} {verb}".rstrip()
    plural_verb = _PLURAL_VERBS.get(verb, verb.removesuffix("s"))
    return f"{number} {_plural(noun)} {plural_verb}".rstrip()


def _plural(noun: str) -> str:
    if noun.endswith("is"):
        return f"{noun[:-2]}es"  # axis
    if noun.endswith("y") and noun[-2] not in "aeiou":
        return f"{noun[:-1]}ies"  # body
    return f"{noun}es" if noun.endswith(_SIBILANTS) else f"{noun}s"
