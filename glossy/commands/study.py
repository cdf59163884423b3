"""``glossy study``: speed against error of the methods, and the paper's claims tested."""

import argparse

from . import options

EXAMPLE = """\
examples:
  glossy study -o out
  glossy study --env room.hdr --size 512 --material mx=.2,my=.075 -o out
  glossy study --methods regular/paper,importance,thesis --samples 14,30,270 -o out
  glossy study --resume -o out          continue after an interruption
  glossy study --workers 8 -o out       eight processes (needs the extra "dask")
  glossy study --methods regular/jacobian,split-sum,bent/hdrp,axis-taps -o out
  glossy study --methods importance,pem,pem/distance/pem5:box -o out
  glossy study --methods prefiltered,prefiltered/flat,prefiltered/multi -o out
  glossy study --methods lattice,auto --max-error .02,.05,.1 -o out

A method is NAME or NAME/FOOTPRINT or NAME/FOOTPRINT/VARIANT; the variant is the normalisation of
regular or the estimator of thesis, as in thesis/thesis/4.24; auto/.05 is auto with
that error. DIR receives report.md, study.json, study.csv, speed.png, the pictures, and cells/ with
one file per finished measurement.
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "study",
        help="speed against error, and the paper's claims tested",
        description="Measure error and time of the real-time methods against the ground truth "
        "over sample budgets, without and with the best level bias, and say which of the paper's "
        "claims hold in these runs.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    options.add_scene_arguments(parser, gbuffer=False)
    group = parser.add_argument_group("study")
    group.add_argument(
        "--methods", metavar="A,B", help="default: the three regular ones, importance"
    )
    group.add_argument(
        "--max-error", metavar="X,X", help="of auto: accepted relative RMS errors (default 0.05)"
    )
    group.add_argument("--samples", metavar="N,N", help="budgets (default 7,14,20,30,50,100,270)")
    group.add_argument(
        "--filter",
        metavar="NAME",
        help="pyramid: box, gauss4, gauss6, round, pem5:cos, ... (gauss6)",
    )
    group.add_argument(
        "--reference-tolerance", type=float, metavar="X", help="of the truth (default 1e-3)"
    )
    group.add_argument("--repeats", type=int, metavar="N", help="timed runs a cell (default 3)")
    spread = group.add_mutually_exclusive_group()
    spread.add_argument(
        "--workers", type=int, metavar="N", help="processes, by Dask (default: none)"
    )
    spread.add_argument("--scheduler", metavar="tcp://...", help="of a running Dask cluster")
    group.add_argument("--resume", action="store_true", help="keep the finished cells in DIR")
    parser.add_argument(
        "-o", "--output", required=True, metavar="DIR", help="folder for the results"
    )
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the study, write its folder and print the tables."""
    from ..study.commandline import run as run_study

    return run_study(args)
