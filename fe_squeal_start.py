"""Where the command fe-squeal begins: beside the package, since importing NumPy takes long enough for a Ctrl-C."""

import os
import signal
import sys
from types import FrameType

INTERRUPTED = 130
# What asks a program to end; Windows knows no SIGHUP.
ENDING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def main() -> int:
    """Run the command; a signal before it has begun ends it with one word."""
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup and shells ask for
            signal.signal(number, _end)
    from fe_squeal.cli import main as command

    return command()


def _end(number: int, frame: FrameType | None) -> None:
    try:
        os.write(2, b"interrupted\n")
    finally:
        os._exit(INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
