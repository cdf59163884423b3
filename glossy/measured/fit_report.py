"""What a fit left over: errors and albedos by incident angle, the material as a file, the report.

The albedo of a table is the sum of p = f |cos theta_o| over the outgoing directions of one incident
direction, each with its solid angle (thesis eqs. 2.7, 2.8). Beside it stands the same sum over the
fitted model, over the rows that were measured (not zero), and the model's own integral.
"""

import dataclasses
import json
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..brdf import Lobe, Material
from .fit import SIDES, Fit
from .fit_kernels import L1
from .fit_metrics import METRICS, finish, transform
from .fit_rows import row_weights
from .solid_angle import solid_angles
from .table import MeasuredTable

Float64Array = npt.NDArray[np.float64]

SAME_ANGLE = 0.5  # degrees of theta_i within which incident directions share a line


@dataclasses.dataclass(frozen=True)
class AngleLine:
    """One incident polar angle [deg] of one side, over all its azimuths.

    ``error`` is the fit's metric over these rows alone. ``measured``, ``fitted``: albedo of the
    table and of the model over the same rows; ``model``: of the model over the whole hemisphere.
    Albedos are means over the channels.
    """

    side: str
    theta: float
    directions: int
    rows: int
    error: float
    measured: float
    fitted: float
    model: float


def angle_lines(table: MeasuredTable, fit: Fit) -> list[AngleLine]:
    """Errors and albedos of a fit, a line for each incident polar angle of each side."""
    lines: list[AngleLine] = []
    code = METRICS.index(fit.metric)
    for side in SIDES:
        part = table.reflection if side == "reflection" else table.transmission
        if side not in fit.parameters or not len(part):
            continue
        omega = solid_angles(part) if part.weight is None else part.weight
        c = np.abs(part.wi[:, 2:] * part.wo[:, 2:])
        model = fit.eval(part.wi, part.wo)
        w = row_weights(part, fit.weights)[:, None] * (part.f != 0.0)
        d = np.abs(transform(part.f * c, code) - transform(model * c, code))
        cost = w * (d if code == L1 else d * d)
        p, q = part.transfer, model * np.abs(part.wo[:, 2:])
        seen = part.f != 0.0
        lights, members = part.incident_directions()
        theta = np.degrees(np.arccos(np.clip(np.abs(lights[:, 2]), 0.0, 1.0)))
        for group in _groups(theta):
            rows = np.concatenate([members[k] for k in group])
            share = omega[rows, None] / len(group)
            lines.append(
                AngleLine(
                    side=side,
                    theta=float(theta[group].mean()),
                    directions=len(group),
                    rows=len(rows),
                    error=finish(float(cost[rows].sum()), float(w[rows].sum()) or 1.0, code),
                    measured=float((share * p[rows]).sum(axis=0).mean()),
                    fitted=float((share * (q * seen)[rows]).sum(axis=0).mean()),
                    model=_albedo(
                        fit, side, lights[group], float((share * q[rows]).sum() / fit.channels)
                    ),
                )
            )
    return lines


def _groups(theta: Float64Array) -> list[npt.NDArray[np.intp]]:
    """Indices of incident directions of about the same polar angle."""
    order = np.argsort(theta, kind="stable")
    cuts = np.flatnonzero(np.diff(theta[order]) > SAME_ANGLE) + 1
    return np.split(order, cuts)


def _albedo(fit: Fit, side: str, lights: Float64Array, summed: float) -> float:
    """Mean albedo of the model; by its rows for the baselines, which have no integral."""
    if fit.material is None:
        return summed
    up, down = fit.material.albedo(lights * np.sign(lights[:, 2:]))
    return float(np.mean(up if side == "reflection" else down))


def material_text(material: Material, suffix: str = ".toml") -> str:
    """A material as the file that ``--material`` takes, TOML or JSON, nine digits."""
    if suffix == ".json":
        values = {"kd": material.kd, **_below(material)}
        for side in SIDES:
            values[side] = [dataclasses.asdict(lobe) for lobe in getattr(material, side)]
        return json.dumps(_rounded(values), indent=2) + "\n"
    blocks = [f"kd = {_toml(material.kd)}\n"]
    blocks[0] += "".join(f"{k} = {_toml(v)}\n" for k, v in _below(material).items())
    for side in SIDES:
        for lobe in getattr(material, side):
            lines = [
                f"{f.name} = {_toml(getattr(lobe, f.name))}\n" for f in dataclasses.fields(Lobe)
            ]
            blocks.append(f"[[{side}]]\n" + "".join(lines))
    return "\n".join(blocks)


def energy_line(fit: Fit) -> str:
    """One sentence on the light that the fitted material sends out; empty for the baselines."""
    found = fit.energy
    if found is None:
        return ""
    theta = found["worst"][0]
    held = "" if found["limit"] is None else f", held at or below 1 to {found['limit']:g} degrees"
    text = f"largest directional albedo {found['largest']:.4g} at {theta:g} degrees{held}"
    if found["exceeds_from"] is None:
        return text
    return f"{text}: sends out more than it receives from {found['exceeds_from']:g} degrees"


def material_line(material: Material) -> str | None:
    """A material as a line ``key=value,...`` for ``--material``; None if it has several lobes."""
    if material.transmission or len(material.reflection) > 1:
        return None
    values: dict[str, Any] = {"kd": material.kd, **_below(material)}
    for lobe in material.reflection:
        values |= dataclasses.asdict(lobe)
    rounded = _rounded({k: v for k, v in values.items() if v is not None})
    texts = {k: v if isinstance(v, list) else [v] for k, v in rounded.items()}
    return ",".join(f"{k}={'/'.join(f'{x:.9g}' for x in v)}" for k, v in texts.items())


def _below(material: Material) -> dict[str, Any]:
    """The diffuse transmission, if there is any."""
    some = np.any(np.asarray(material.diffuse_transmission) > 0.0)
    return {"diffuse_transmission": material.diffuse_transmission} if some else {}


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _rounded(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(v) for v in value]
    return float(f"{value:.9g}")


def _toml(value: float | Sequence[float]) -> str:
    rounded = _rounded(value)
    return json.dumps(rounded)


def parameter_table(fit: Fit) -> str:
    """The fitted parameters as a Markdown table, a line a lobe."""
    lines = [
        "| side | mx | my | alpha | r0 | ks | diffuse |",
        "|---|---|---|---|---|---|---|",
    ]
    c = fit.channels
    for side, p in fit.parameters.items():
        kd = _numbers(p[:c])
        lobes = p[c:].reshape(-1, 4 + c)
        for lobe in lobes:
            shape = " | ".join(f"{v:.4g}" for v in lobe[:4])
            lines.append(f"| {side} | {shape} | {_numbers(lobe[4:])} | {kd} |")
            kd = ""
        if not len(lobes):
            lines.append(f"| {side} | | | | | | {kd} |")
    return "\n".join(lines)


def _numbers(values: Float64Array) -> str:
    return " ".join(f"{v:.4g}" for v in values)


def report_text(
    table: MeasuredTable, fit: Fit, lines: Sequence[AngleLine], others: Sequence[Fit] = ()
) -> str:
    """The fit report in Markdown; its pictures are ``fit_plots.write_plots``'s."""
    name = table.name or pathlib.Path(table.source).name or "table"
    ends = "; stopped by the time limit" if fit.stopped else ""
    parts = [
        f"# Fit of {name}",
        f"Model {fit.model}, metric {fit.metric}, weights {fit.weights}, {fit.rows} rows, "
        f"{fit.channels} channel{'s' if fit.channels > 1 else ''}. "
        f"Error **{fit.error:.5g}**, {fit.evaluations} evaluations of the metric, "
        f"{fit.seconds:.1f} s{ends}.",
        parameter_table(fit),
    ]
    if fit.at_bounds:
        parts.append(
            "On a bound, so not held by the data (or bounded too tightly): "
            f"{', '.join(fit.at_bounds)}."
        )
    if fit.material is not None:
        parts.append(f"Energy: {energy_line(fit)}.")
        parts += ["## Material", f"```toml\n{material_text(fit.material)}```"]
    stages = [f"| {s.name} | {s.error:.5g} | {s.seconds:.2f} |" for s in fit.stages]
    parts += ["## Steps", "\n".join(["| step | error | seconds |", "|---|---|---|", *stages])]
    if others:
        rows = [
            f"| {f.model} | {f.error:.5g} | {f.error / fit.error if fit.error else np.inf:.3f} | "
            f"{f.seconds:.1f} |"
            for f in (fit, *others)
        ]
        head = f"| model | error | over {fit.model} | seconds |"
        parts += ["## Other models", "\n".join([head, "|---|---|---|---|", *rows])]
    head = (
        "| side | θi | directions | rows | error | albedo measured | fitted, same rows | "
        "fitted, whole |"
    )
    rows = [
        f"| {x.side} | {x.theta:.1f}° | {x.directions} | {x.rows} | {x.error:.4g} | "
        f"{x.measured:.4f} | {x.fitted:.4f} | {x.model:.4f} |"
        for x in lines
    ]
    parts += ["## By incident angle", "\n".join([head, "|---|---|---|---|---|---|---|---|", *rows])]
    parts.append(
        "Albedos are means over channels and azimuths. *Same rows* leaves out what was not "
        "measured."
    )
    parts += [
        "## Pictures",
        "![Transfer probability in the plane of incidence](plane.png)",
        "![All outgoing directions, measured beside fitted](discs.png)",
        "![Error and albedo by incident angle](angles.png)",
    ]
    return "\n\n".join(parts) + "\n"


def report_json(
    table: MeasuredTable, fit: Fit, lines: Sequence[AngleLine], others: Sequence[Fit] = ()
) -> dict[str, Any]:
    """The report as plain values, fit for JSON."""
    return {
        "table": {"name": table.name, "source": table.source, "rows": len(table)},
        "fit": fit.to_dict(),
        "angles": [dataclasses.asdict(x) for x in lines],
        "others": [f.to_dict() for f in others],
    }
