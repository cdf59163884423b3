"""Several studies side by side, as Markdown: errors at three budgets, and the claims' verdicts.

for e in spots room.hdr; do glossy study --env $e -o study-$(basename $e .hdr); done
python benchmarks/summarise_studies.py study-*
"""

import argparse
import json
import pathlib
from typing import Any

import common

BUDGETS = (14, 30, 270)
MARK = {"holds": "holds", "does not hold": "no", "within uncertainty": "unclear", "not tested": "–"}


def load(folder: pathlib.Path) -> dict[str, Any]:
    """The study.json of a folder."""
    found: dict[str, Any] = json.loads((folder / "study.json").read_text(encoding="utf-8"))
    return found


def errors(studies: dict[str, dict[str, Any]]) -> str:
    """Relative RMS errors in percent at best bias, one line for each map and lobe."""
    methods = list(dict.fromkeys(c["method"] for s in studies.values() for c in s["cells"]))
    rows: list[list[object]] = []
    for name, study in studies.items():
        for case in dict.fromkeys(c["case"] for c in study["cells"]):
            row: list[object] = [name, case]
            for method in methods:
                cells = {
                    c["budget"]: f"{100 * c['relative_rms']:.1f}"
                    for c in study["cells"]
                    if (c["case"], c["method"], c["bias_kind"]) == (case, method, "best")
                }
                row.append(" / ".join(cells.get(b, "–") for b in BUDGETS))
            rows.append(row)
    budgets = "/".join(str(b) for b in BUDGETS)
    return f"RMS error [%] at budgets {budgets}, best bias:\n\n" + common.table(
        ["map", "lobe", *methods], rows
    )


def verdicts(studies: dict[str, dict[str, Any]], regular: str = "regular/paper") -> str:
    """The verdict of each claim on each map."""
    claims = {
        name: {c["id"]: c for c in study["claims"][regular]} for name, study in studies.items()
    }
    ids = list(dict.fromkeys(i for found in claims.values() for i in found))
    rows = []
    for claim in ids:
        text = next(found[claim]["statement"] for found in claims.values() if claim in found)
        marks = [
            MARK[found[claim]["verdict"]] if claim in found else "–" for found in claims.values()
        ]
        rows.append([text, *marks])
    return common.table(["claim", *studies], rows)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=pathlib.Path, help="folders of glossy study")
    studies = {}
    for folder in parser.parse_args().folders:
        study = load(folder)
        studies[pathlib.Path(study["settings"]["environment"]).stem] = study
    print(errors(studies), "\n\n", verdicts(studies), sep="")


if __name__ == "__main__":
    main()
