"""``glossy stability``: the hard cases, measured and reported."""

import argparse

from . import options
from .inputs import add_force_argument

EXAMPLE = """\
examples:
  glossy stability
  glossy stability -o report.md --plot report.png
  glossy stability --json > report.json

exit code: 0 when every guarantee holds, 1 otherwise, 2 for bad arguments
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command to the ``glossy`` parser."""
    parser = subparsers.add_parser(
        "stability",
        help="measure the hard cases: grazing views, thin lobes, extreme radiance",
        description="Run the catalogue of hard cases in single, double and extended precision and "
        "say what is guaranteed, what was measured and what does not hold. Takes a minute or two.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "-o", "--output", metavar="FILE.md", help="write the report here (default, and -: print it)"
    )
    parser.add_argument("--plot", metavar="FILE.png", help="draw errors and furnace ratios")
    add_force_argument(parser)
    options.add_json_argument(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure everything and print or write the report."""
    for path, suffix, option in ((args.output, ".md", "--output"), (args.plot, ".png", "--plot")):
        if path is not None:
            options.check_output(args, path, (suffix,), option)
    import json

    from ..stability import checks, report

    results, furnace = checks.run(lambda items: options.progress(items, label="hard cases"))
    text = report.markdown(results, furnace)
    if args.output is not None:
        from .._output import write_text

        write_text(args.output, text)
    if args.plot is not None:
        report.plot(results, furnace, args.plot)
    if args.json:
        print(json.dumps(report.to_dict(results, furnace), indent=2))
    elif args.output is None:
        print(text)
    return 0 if all(r.holds for r in results) else 1
