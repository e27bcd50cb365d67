"""The command line: ``yarnscale COMMAND …``.

Exit status 0 on success, 1 when a solve did not converge, 2 on bad input, 130 when interrupted.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from yarnscale.cli.arguments import parser
from yarnscale.cli.console import collected
from yarnscale.errors import InputError

_LISTS = ("--strain", "--stretch", "--directions", "--curvatures", "--frames")


def _joined(arguments: Sequence[str]) -> list[str]:
    """Tie a list option to its value, which may begin with a minus sign that argparse takes for an option."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] in _LISTS:
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    options = parser().parse_args(_joined(sys.argv[1:] if arguments is None else arguments))
    # One numerical thread: the matrices are small, and workers share the machine.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    try:
        with collected():
            return options.run(options)
    except InputError as error:
        print(f"yarnscale: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as interrupt:
        kept = interrupt.args[0] if interrupt.args else "what was finished is kept"
        print(f"yarnscale: interrupted; {kept}", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader of our output went away; nothing more to say to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ChildProcessError as error:
        print(f"yarnscale: error: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        # A full disk, a folder that went away: nothing that a traceback would explain better.
        print(f"yarnscale: error: {error}", file=sys.stderr)
        return 2
