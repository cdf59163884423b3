"""``glossy study``: speed against error of the methods, and the paper's claims tested."""

import argparse

from . import options

EXAMPLE = """\
examples:
  glossy study -o out
  glossy study --env room.hdr --size 512 --material mx=.2,my=.075 -o out
  glossy study --methods regular/paper,importance,thesis --samples 14,30,270 -o out
  glossy study --resume -o out                   continue as it was started
  glossy study --resume --samples 500 -o out     and with a further budget
  glossy study --workers 8 -o out                eight processes (needs the extra "dask")
  glossy study --methods regular/jacobian,split-sum,bent/hdrp,axis-taps -o out
  glossy study --methods importance,pem,pem/distance/pem5:box -o out
  glossy study --methods prefiltered,prefiltered/flat,prefiltered/multi -o out
  glossy study --methods lattice,auto --max-error .02,.05,.1 -o out

A method is NAME, NAME/FOOTPRINT, NAME/VARIANT or NAME/FOOTPRINT/VARIANT:
  regular/paper|thesis|jacobian/paper|projected    footprint, normalisation
  thesis/paper|thesis|jacobian/4.23|4.24|4.25      footprint, estimator
  importance    lattice    axis-taps    split-sum/mean    bent/hdrp    auto/.05 (accepted error)
  pem/constant|distance|view/pem5:cos              footprint, filter
  prefiltered/single|flat|multi                    lobes of a pixel

--resume keeps what DIR holds and measures what is missing. What the command does not say is as the
study was started; --methods, --samples and --material are added to what is there. Anything that
would change a measured figure is refused by its name, and so is a damaged file.

DIR receives report.md, study.json, study.csv, speed.png, the pictures, and cells/ with one file per
finished measurement. One process works in it at a time (study.running.json names it).
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "study",
        help="speed against error, and the paper's claims tested",
        description="Measure error and time of the real-time methods against the ground truth\n"
        "over sample budgets, without and with the best level bias, and say which of\n"
        "the paper's claims hold in these runs.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        conflict_handler="resolve",  # three options have other defaults here
    )
    options.add_scene_arguments(parser, gbuffer=False)
    group = parser.add_argument_group("study")
    group.add_argument(
        "--material",
        metavar="M",
        help="one material in place of the paper's three lobes mx=.1, mx=.15 and mx=.2,my=.075: a "
        "published name, a file, or parameters such as mx=.2,my=.075,r0=1,alpha=0",
    )
    group.add_argument("--width", type=int, metavar="N", help="pixels (default 128)")
    group.add_argument("--height", type=int, metavar="N", help="pixels (default: the width)")
    group.add_argument(
        "--methods",
        metavar="A,B",
        help="methods with commas, see below (default "
        "regular/paper,regular/thesis,regular/jacobian,importance)",
    )
    group.add_argument(
        "--max-error",
        metavar="X,X",
        help="auto: measured once for each of these accepted relative RMS errors, from 0 to 1 "
        "(default 0.05)",
    )
    group.add_argument(
        "--samples",
        metavar="N,N",
        help="budgets: samples per lobe with commas (default 7,14,20,30,50,100,270; some of the "
        "paper's claims need 14, 20, 30 and 270)",
    )
    group.add_argument(
        "--filter",
        metavar="NAME",
        help="of the pyramid: box, gauss4, gauss6, round, pem5:cos, ... (default gauss6)",
    )
    group.add_argument(
        "--reference-tolerance",
        type=float,
        metavar="X",
        help="relative error bound asked of the truth at every pixel (default 1e-3)",
    )
    group.add_argument(
        "--repeats", type=int, metavar="N", help="timed blocks of each cell (default 3)"
    )
    spread = group.add_mutually_exclusive_group()
    spread.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help='worker processes on this machine, by Dask, the extra "dask" (default: none, all in '
        "this process)",
    )
    spread.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="of a Dask cluster that is running (default: none)",
    )
    group.add_argument(
        "--resume",
        action="store_true",
        help="continue the study in DIR, or add to it (default: such a folder is refused)",
    )
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="DIR",
        help="folder for the results, made if needed",
    )
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the study, write its folder and print the tables."""
    from ..study.commandline import run as run_study

    return run_study(args)
