"""Starting the command as a process of its own."""

import sys

PROLOGUE = (
    "import signal, sys; from glossy.cli import main\n"
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "if __name__ == '__main__': sys.exit(main(sys.argv[1:]))"
)


def interruptible(*words: str) -> list[str]:
    """Program and arguments of ``glossy WORDS`` that answers SIGINT.

    A process inherits that SIGINT is ignored, from ``nohup``, a background job and some runners of
    tests, and Python then leaves it ignored.
    """
    return [sys.executable, "-c", PROLOGUE, *words]
