"""The paper's claims as statements about measured numbers, and whether they hold.

A comparison of two errors a < b is certain when it survives the truth's own error u ::

    holds:  a + u < b - u      does not hold:  a - u >= b + u      else within uncertainty      (1)

since u bounds how far the error against the truth is from the error against the exact integral. A
claim holds when all of its comparisons do, and does not when any one fails. One whose lobes or
budgets were not measured is not tested, and ``numbers`` says what it needs.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from .bench import Cell

LOW = (7, 14, 20, 30)  # the paper's "low budgets"
FIGURE_9 = (14, 30, 270)
MANY = 270  # of Fig. 10: fewer samples say nothing about its claims
SIMILAR = 1.5  # two errors are called similar within this factor
HOLDS, FAILS, UNSURE, UNTESTED = "holds", "does not hold", "within uncertainty", "not tested"
LOBES = {"iso": "an isotropic lobe", "aniso": "an anisotropic lobe"}
NEEDS: dict[str, tuple[tuple[str, ...], Callable[[Sequence[int]], bool], str]] = {
    "a-iso": (("iso",), lambda n: bool({*n} & {*LOW}), "a budget of 7, 14, 20 or 30"),
    "a-aniso": (("aniso",), lambda n: bool({*n} & {*LOW}), "a budget of 7, 14, 20 or 30"),
    "b": (("iso", "aniso"), lambda n: bool({*n} & {*LOW}), "a budget of 7, 14, 20 or 30"),
    "c1": (("iso",), lambda n: max(n) >= MANY, f"a budget of {MANY} or more"),
    "c2": (("aniso",), lambda n: max(n) >= MANY, f"a budget of {MANY} or more"),
    "d": (("iso",), lambda n: {*n} >= {*FIGURE_9}, "budgets of 14, 30 and 270"),
    "e": ((), lambda n: len(n) > 1, "two budgets"),
    "f": ((), lambda n: 20 in n, "a budget of 20"),
    "g": ((), lambda n: 14 in n, "a budget of 14"),
}
"""By the start of a claim's id: its lobes, the test of its budgets, and that test in words."""


@dataclasses.dataclass(frozen=True)
class Claim:
    """A claim with its verdict; ``numbers`` says them in words, ``evidence`` holds them."""

    id: str
    statement: str
    source: str
    verdict: str
    numbers: str
    evidence: list[dict[str, Any]]


def compare(a: float, b: float, u: float) -> int:
    """Eq. (1) for a < b: +1 holds, -1 does not, 0 within uncertainty."""
    if a + u < b - u:
        return 1
    return -1 if a - u >= b + u else 0


def verdict(outcomes: Iterable[int]) -> str:
    """One verdict of all comparisons of a claim."""
    found = set(outcomes)
    if not found:
        return UNTESTED
    if -1 in found:
        return FAILS
    return HOLDS if found == {1} else UNSURE


class Table:
    """The cells by what they measure."""

    def __init__(self, cells: Sequence[Cell]) -> None:
        self.cells = cells
        self._by = {(c.case, c.method, c.budget, c.bias_kind): c for c in cells}
        self.cases = list(dict.fromkeys(c.case for c in cells))
        self.kinds = {c.case: c.kind for c in cells}
        self.budgets = sorted({c.budget for c in cells})

    def of_kind(self, kind: str) -> list[str]:
        """Cases that are "iso" or "aniso"."""
        return [case for case in self.cases if self.kinds[case] == kind]

    def pairs(
        self, a: str, b: str, cases: Sequence[str], budgets: Sequence[int], bias: str
    ) -> list[tuple[Cell, Cell]]:
        """Cells of method ``a`` beside those of ``b``, where both were measured."""
        keys = itertools.product(cases, budgets)
        found = [(self._by.get((c, a, n, bias)), self._by.get((c, b, n, bias))) for c, n in keys]
        return [(x, y) for x, y in found if x is not None and y is not None]

    def row(self, method: str, case: str, bias: str) -> list[Cell | None]:
        """The cell of one method and case at each budget, None where there is none."""
        return [self._by.get((case, method, n, bias)) for n in self.budgets]

    def line(self, method: str, case: str, bias: str) -> list[Cell]:
        """The cells of one method and case over growing budgets."""
        return [c for c in self.row(method, case, bias) if c is not None]


def _evidence(a: Cell, b: Cell, field: str = "rms") -> dict[str, Any]:
    return {
        "case": a.case,
        "samples": [a.samples, b.samples],
        "bias": [a.bias, b.bias],
        a.method: getattr(a, field),
        b.method: getattr(b, field),
        "truth_error": a.truth_error,
    }


def _percent(cell: Cell) -> str:
    return f"{100.0 * cell.relative_rms:.3g} %"


def _truth(cells: Iterable[Cell]) -> str:
    worst = max((c.truth_error / c.truth_level for c in cells if c.truth_level > 0.0), default=0.0)
    return f"truth +-{100.0 * worst:.2g} %"


def _lower(id: str, statement: str, source: str, pairs: list[tuple[Cell, Cell]]) -> Claim:
    """The claim that the first of each pair has the lower RMS error."""
    outcomes = [compare(a.rms, b.rms, a.truth_error) for a, b in pairs]
    parts = [f"n={a.samples} {_percent(a)} : {_percent(b)}" for a, b in pairs]
    by_case = {case: [] for case, _ in ((a.case, b) for a, b in pairs)}  # type: dict[str, list[str]]
    for (a, _), part in zip(pairs, parts, strict=True):
        by_case[a.case].append(part)
    text = "; ".join(f"{case}: {', '.join(items)}" for case, items in by_case.items())
    wins = sum(o == 1 for o in outcomes)
    numbers = f"lower in {wins} of {len(pairs)} ({text}; {_truth(a for a, _ in pairs)})"
    return Claim(
        id,
        statement,
        source,
        verdict(outcomes),
        numbers if pairs else "",
        [_evidence(a, b) for a, b in pairs],
    )


def _ratio(pairs: Sequence[tuple[Cell, Cell]]) -> float:
    """Geometric mean of the second error over the first; neither is zero."""
    return math.exp(sum(math.log(b.rms / a.rms) for a, b in pairs) / len(pairs))


def _gain(table: Table, regular: str, rival: str, bias: str) -> Claim:
    groups = [table.pairs(regular, rival, table.of_kind(k), LOW, bias) for k in ("iso", "aniso")]
    statement = f"The advantage at low budgets is larger for anisotropic lobes ({bias} bias)"
    if not all(groups) or min(c.rms for g in groups for pair in g for c in pair) == 0.0:
        return Claim(f"b-{bias}", statement, "Fig. 8, Sec. 10", UNTESTED, "", [])
    iso, aniso = (_ratio(group) for group in groups)
    # both ratios move by at most the truth's error relative to the smaller error of each pair
    doubt = [max(2.0 * a.truth_error / min(a.rms, b.rms) for a, b in group) for group in groups]
    outcome = compare(iso, aniso, 0.5 * (iso * doubt[0] + aniso * doubt[1]))
    numbers = (
        f"{rival} error / {regular} error, geometric mean over the low budgets: "
        f"isotropic {iso:.3f}, anisotropic {aniso:.3f}"
    )
    return Claim(
        f"b-{bias}",
        statement,
        "Fig. 8, Sec. 10",
        verdict([outcome]),
        numbers,
        [{"iso": iso, "aniso": aniso}],
    )


def _top(table: Table) -> tuple[list[int], int]:
    """The largest budget if it is one of many samples; and the count to speak of."""
    top = [n for n in table.budgets[-1:] if n >= MANY]
    return top, top[0] if top else MANY


def _similar(table: Table, regular: str, rival: str, bias: str) -> Claim:
    top, count = _top(table)
    pairs = table.pairs(regular, rival, table.of_kind("iso"), top, bias)
    statement = (
        f"With the largest budget ({count}) the two methods have similar errors "
        f"on isotropic lobes (within a factor {SIMILAR:g}; {bias} bias)"
    )
    outcomes = []
    for a, b in pairs:
        outcomes.append(compare(b.rms, SIMILAR * a.rms, a.truth_error))
        outcomes.append(compare(a.rms, SIMILAR * b.rms, a.truth_error))
    parts = [f"{a.case}: {_percent(a)} : {_percent(b)}" for a, b in pairs]
    return Claim(
        f"c1-{bias}",
        statement,
        "Fig. 10",
        verdict(outcomes),
        f"{', '.join(parts)}; {_truth(a for a, _ in pairs)}" if pairs else "",
        [_evidence(a, b) for a, b in pairs],
    )


def _falls(table: Table, method: str, bias: str) -> Claim:
    statement = f"The error of {method} falls with every larger budget ({bias} bias)"
    outcomes, parts, evidence = [], [], []
    for case in table.cases:
        line = table.line(method, case, bias)
        outcomes += [compare(y.rms, x.rms, x.truth_error) for x, y in itertools.pairwise(line)]
        if len(line) > 1:
            parts.append(f"{case}: " + " ".join(f"{100.0 * c.relative_rms:.3g}" for c in line))
            evidence.append(
                {
                    "case": case,
                    "samples": [c.samples for c in line],
                    "relative_rms": [c.relative_rms for c in line],
                }
            )
    rises = sum(o == -1 for o in outcomes)
    numbers = f"rises in {rises} of {len(outcomes)} steps (error in %: {'; '.join(parts)})"
    return Claim(
        f"e-{method}-{bias}",
        statement,
        "Sec. 8, Fig. 9",
        verdict(outcomes),
        numbers if outcomes else "",
        evidence,
    )


def samples_needed(line: Sequence[Cell], error: float) -> float | None:
    """Samples at which a method first reaches ``error``, log-log between budgets; None: never."""
    if line and line[0].rms <= error:
        return float(line[0].samples)
    for x, y in itertools.pairwise(line):
        if y.rms <= error < x.rms:
            if y.rms == 0.0:
                return float(y.samples)
            share = math.log(x.rms / error) / math.log(x.rms / y.rms)
            return math.exp(math.log(x.samples) + share * math.log(y.samples / x.samples))
    return None


def _economy(table: Table, regular: str, rival: str, bias: str) -> Claim:
    statement = f"{rival} needs more samples for {regular}'s error at a budget of 20 ({bias} bias)"
    outcomes, parts, evidence = [], [], []
    for a, _ in table.pairs(regular, rival, table.cases, [20], bias):
        line = table.line(rival, a.case, bias)
        low, mid, high = (
            samples_needed(line, max(a.rms + shift * a.truth_error, 0.0)) for shift in (2, 0, -2)
        )
        least, most = (math.inf if n is None else n for n in (low, high))
        outcomes.append(1 if least > a.samples else (-1 if most <= a.samples else 0))
        text = f"{mid:.0f}" if mid is not None else f"more than {line[-1].samples}"
        parts.append(f"{a.case}: {text} for {a.samples}")
        evidence.append({"case": a.case, regular: a.samples, rival: mid})
    return Claim(
        f"f-{bias}", statement, "Sec. 8, Sec. 10", verdict(outcomes), "; ".join(parts), evidence
    )


def _shape(
    id: str,
    statement: str,
    source: str,
    field: str,
    pairs: list[tuple[Cell, Cell]],
    sign: float,
) -> Claim:
    """The claim that ``field`` is larger (sign +1) for the second of each pair than for the first.

    The truth's error, relative to the error it is seen through, is the doubt.
    """
    outcomes, parts = [], []
    for a, b in pairs:
        x, y = sign * getattr(a, field), sign * getattr(b, field)
        doubt = a.truth_error / max(min(a.rms, b.rms), 1e-300) * max(abs(x), abs(y))
        outcomes.append(compare(x, y, doubt))
        values = f"{getattr(a, field):.3g} : {getattr(b, field):.3g}"
        parts.append(f"{a.case} n={a.samples} {values}")
    return Claim(
        id,
        statement,
        source,
        verdict(outcomes),
        "; ".join(parts),
        [_evidence(a, b, field) for a, b in pairs],
    )


def evaluate(
    cells: Sequence[Cell], regular: str = "regular/paper", rival: str = "importance"
) -> list[Claim]:
    """The paper's claims about regular against importance sampling, tested on these cells.

    Parameters
    ----------
    cells : sequence of Cell
    regular, rival : str
        Labels of the two methods.

    Returns
    -------
    One Claim each; a claim whose cells were not measured is "not tested".
    """
    table = Table(cells)
    top, count = _top(table)
    wide = [
        c
        for c in table.of_kind("iso")
        if any(x.case == c and abs(x.widths[0] - 0.15) < 0.01 for x in cells)
    ] or table.of_kind("iso")
    words = {"iso": "isotropic", "aniso": "anisotropic"}
    found: list[Claim] = []
    for bias in ("zero", "best"):
        for kind, name in words.items():
            found.append(
                _lower(
                    f"a-{kind}-{bias}",
                    f"Regular sampling has the lower error at low budgets, {name} ({bias} bias)",
                    "Sec. 8, Fig. 8",
                    table.pairs(regular, rival, table.of_kind(kind), LOW, bias),
                )
            )
    makers: list[Callable[[Table, str, str, str], Claim]] = [_gain, _similar]
    found += [make(table, regular, rival, bias) for make in makers for bias in ("zero", "best")]
    for bias in ("zero", "best"):
        found.append(
            _lower(
                f"c2-{bias}",
                f"At {count} samples regular sampling has the lower error on "
                f"anisotropic lobes ({bias} bias)",
                "Fig. 10",
                table.pairs(regular, rival, table.of_kind("aniso"), top, bias),
            )
        )
    figure9 = table.pairs(regular, rival, wide, FIGURE_9, "best")
    if len(figure9) < len(FIGURE_9) * len(wide):
        figure9 = []
    found.append(
        _lower(
            "d1",
            "With the best bias regular sampling has the lower error, isotropic lobe of Fig. 9",
            "Fig. 9",
            figure9,
        )
    )
    found.append(
        _shape(
            "d2",
            "With the best bias importance sampling spreads its error over a larger share of "
            "the pixels",
            "Fig. 9",
            "spread",
            figure9,
            1.0,
        )
    )
    found.append(
        _shape(
            "d3",
            "With the best bias the error of importance sampling is the smoother one",
            "Fig. 9",
            "roughness",
            figure9,
            -1.0,
        )
    )
    found += [_falls(table, m, bias) for m in (regular, rival) for bias in ("zero", "best")]
    found += [_economy(table, regular, rival, bias) for bias in ("zero", "best")]
    found.append(
        _shape(
            "g",
            "At low budgets importance sampling brightens dark areas more (zero bias; relative "
            "excess over the darker half of the pixels)",
            "Fig. 8",
            "dark_bias",
            table.pairs(regular, rival, table.cases, [14], "zero"),
            1.0,
        )
    )
    return [_explained(claim, table) for claim in found]


def _explained(claim: Claim, table: Table) -> Claim:
    """A claim that is not tested says what it needs."""
    if claim.verdict != UNTESTED:
        return claim
    start = next(name for name in NEEDS if claim.id.startswith(name))
    kinds, enough, words = NEEDS[start]
    missing = [LOBES[kind] for kind in kinds if not table.of_kind(kind)]
    if not table.budgets or not enough(table.budgets):
        missing.append(words)
    return dataclasses.replace(claim, numbers=f"needs {' and '.join(missing)}" if missing else "")
