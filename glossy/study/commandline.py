"""``glossy study`` from its arguments to its folder."""

import argparse
import dataclasses
import pathlib
import shlex
import time
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any

from .. import _check
from .._output import write_text
from ..commands import options
from . import claims, plots, report, settings, spread, store
from .run import Study

SIDE = 128  # pixels of the default picture: the default study takes about a minute
DEFAULT_TOLERANCE = 1e-3


SAID = (
    "env", "size", "material", "shape", "width", "height", "input_layout", "orientation",
    "negative", "nonfinite", "encoding", "crop", "methods", "max_error", "samples", "filter",
    "reference_tolerance", "repeats", "max_pixels",
)  # fmt: skip
"""Options that say what is measured; the others say where and how."""


def command_line(args: argparse.Namespace, resume: bool = False) -> str:
    """The command that starts the same study anew, or adds it to its folder."""
    words = ["glossy", "study"]
    if args.scene:
        words.append(str(args.scene))
    for name in sorted(SAID):
        value = getattr(args, name)
        if value is not None:
            words += ["--" + name.replace("_", "-"), str(value)]
    words += ["--resume"] if resume else []
    return shlex.join([*words, "-o", str(args.output)])


def continued(
    args: argparse.Namespace, old: dict[str, Any], sessions: Sequence[dict[str, Any]]
) -> argparse.Namespace:
    """The arguments of a command that resumes a study.

    What they leave out is as the study was started; methods and budgets are added to its own.
    """
    said = vars(args)
    first = sessions[0].get("arguments", {})
    whole = {name: first.get(name) for name in ("scene", *SAID) if said[name] is None}
    methods = with_errors(args.methods.split(","), args) if args.methods else []
    labels = [settings.parse_method(name).label for name in methods]
    whole["methods"] = ",".join(dict.fromkeys([*old["methods"], *labels]))
    budgets = {*old["budgets"], *(_budgets(args.samples) if args.samples else ())}
    whole["samples"] = ",".join(map(str, sorted(budgets)))
    if args.max_error and not args.methods:
        raise _check.fail("--max-error", "is for auto among --methods", args.methods)
    return argparse.Namespace(**{**said, **whole, "max_error": None})


def with_old_cases(plan: settings.Plan, old: dict[str, Any]) -> settings.Plan:
    """The plan with the cases of the folder before its own."""
    names = [case["name"] for case in old["cases"]]
    own = {case.name: case for case in plan.cases}
    cases = [own.get(case["name"]) or settings.restored_case(case) for case in old["cases"]]
    cases += [case for case in plan.cases if case.name not in names]
    return dataclasses.replace(plan, cases=cases)


def _budgets(text: str | None) -> tuple[int, ...]:
    if text is None:
        return settings.BUDGETS
    try:
        return tuple(sorted(int(part) for part in text.split(",")))
    except ValueError:
        raise _check.fail("samples", "must be whole numbers with commas", text) from None


def with_errors(named: Sequence[str], args: argparse.Namespace) -> list[str]:
    """The methods, ``auto`` once for each error of --max-error."""
    if args.max_error is None:
        return list(named)
    if not any(name.strip() == "auto" for name in named):
        raise _check.fail("--max-error", "is for auto among --methods", args.methods)
    errors = args.max_error.split(",")
    each = [[f"auto/{e.strip()}" for e in errors] if n.strip() == "auto" else [n] for n in named]
    return [name for some in each for name in some]


def plan_from(args: argparse.Namespace, scene: Any) -> settings.Plan:
    """The plan the arguments describe; without SCENE and --material, the paper's three lobes."""
    named = with_errors(args.methods.split(",") if args.methods else settings.METHODS, args)
    if args.scene or args.material:
        text = args.material
        cases = [
            settings.case_of(scene.load_material(), text if text and "=" not in text else None)
        ]
    else:
        cases = settings.default_cases()
    tolerance = args.reference_tolerance
    return settings.Plan(
        cases=cases,
        methods=[settings.parse_method(name) for name in named],
        budgets=_budgets(args.samples),
        filter=args.filter or scene.options.get("filter", "gauss6"),
        storage=scene.options.get("storage", "rgba32f"),
        tolerance=DEFAULT_TOLERANCE if tolerance is None else tolerance,
        repeats=3 if args.repeats is None else args.repeats,
    )


def evaluate(study: Study) -> dict[str, list[claims.Claim]]:
    """The claims with each regular method against importance, the paper's first."""
    labels = [m.label for m in study.plan.methods]
    regulars = [name for name in labels if name.startswith("regular")]
    if "importance" not in labels:
        return {}
    regulars.sort(key=lambda name: name != "regular/paper")
    return {name: claims.evaluate(study.cells, name, "importance") for name in regulars}


def finish(study: Study, variants: dict[str, list[claims.Claim]]) -> list[str]:
    """Write plots, pictures, report.md, study.csv and study.json; the pictures' names."""
    folder = study.store.folder
    s = study.settings
    subtitle = f"{pathlib.Path(s['environment']).name}, cube map {s['cube_size']}, {s['filter']}"
    plots.speed_against_error(study.cells, folder / "speed.png", subtitle)
    names = []
    for case in study.plan.cases:
        for kind in ("zero", "best"):
            name = f"pictures-{case.slug}-{kind}.png"
            if plots.pictures(study, case.name, kind, folder / name):
                names.append(name)
    write_text(folder / "study.csv", report.to_csv(study.cells))
    write_text(folder / "report.md", report.markdown(study, variants, names))
    write_text(folder / "study.json", report.dumps(report.to_dict(study, variants, names)))
    return names


def run(args: argparse.Namespace) -> int:
    """The command."""
    start = time.perf_counter()
    old = store.recorded(args.output) if args.resume else None
    if old is not None:
        args = continued(args, *old)
    if args.scene is None:
        args.width = SIDE if args.width is None else args.width
        args.height = args.width if args.height is None else args.height
    wanted = argparse.Namespace(
        **{**vars(args), "samples": None, "filter": None, "max_error": None}
    )
    scene = options.scene_from(wanted)
    plan, command = plan_from(args, scene), command_line(args)
    if old is not None:
        own, plan = len(plan.cases), with_old_cases(plan, old[0])
        if len(plan.cases) > own:  # which one command does not describe
            command = f"{old[1][-1].get('command', '')}\n{command_line(args, resume=True)}"
    study = Study(
        plan,
        scene.environment.load(),
        scene.points(),
        scene.environment.source,
        args.output,
        resume=args.resume,
        command=command,
        arguments={name: getattr(args, name) for name in ("scene", *SAID)},
    )
    with study.store.lock:
        return measured(study, args, start)


def measured(study: Study, args: argparse.Namespace, start: float) -> int:
    """Run a study and print what it found."""
    spreads = args.workers is not None or args.scheduler is not None
    with spread.connect(args.workers, args.scheduler) if spreads else nullcontext() as client:
        study.run(lambda steps: options.progress(steps, len(steps), "study"), client)
    variants = evaluate(study)
    names = finish(study, variants)
    if args.json:
        print(report.dumps(report.to_dict(study, variants, names)), end="")
        return 0
    print(report.error_table(study.cells))
    print(report.time_table(study.cells))
    print(report.preparation_table(study))
    print()
    for name, found in list(variants.items())[:1]:
        print(f"The paper's claims in these runs, {name} against importance:")
        print(report.claim_lines(found))
        print()
    print(f"{time.perf_counter() - start:.0f} s; written to {study.store.folder}/report.md,")
    print(f"study.json, study.csv, speed.png and {len(names)} pictures")
    return 0
