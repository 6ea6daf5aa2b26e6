"""The command line: every verb of the Python API, with clear errors and exit codes (conventions, section 6).

`--version`, `--help` and completion load no numerics: each verb imports what it uses when it runs.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from typing import Any

import click

from symfive.cli import _check, _plan, _measure, _evaluate, _history, _standards, _import, _files  # noqa: F401  # isort: skip  (order of the help)
from symfive.cli._common import app
from symfive.errors import InputError
from symfive.outputs import by_command

__all__ = ["app", "main"]


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 1 problems found, 2 bad input, 130 interrupted)."""
    with by_command(shlex.join(["symfive", *(sys.argv[1:] if arguments is None else arguments)])):
        code = _guarded(lambda: app.main(arguments, prog_name="symfive", standalone_mode=False))
    if arguments is None:
        sys.exit(code)
    return code


def _guarded(run: Callable[[], Any]) -> int:
    try:
        code = run()  # of `click.exceptions.Exit`
    except (KeyboardInterrupt, click.Abort) as interrupt:
        return _interrupted(interrupt)
    except click.exceptions.NoArgsIsHelpError as request:
        request.show()
        return request.exit_code
    except click.UsageError as error:
        verb = error.ctx.command_path if error.ctx is not None else "symfive"
        click.echo(f"symfive: {InputError(error.format_message(), remedy=f'see `{verb} --help`')}", err=True)
        return error.exit_code
    except Exception as error:
        said = _sentence(error)
        if said is None:
            raise
        click.echo(f"symfive: {said}", err=True)
        return 2
    return code if isinstance(code, int) else 0


def _interrupted(error: BaseException) -> int:
    """Say what is left, as whoever was writing noted it on the interruption."""
    at: BaseException | None = error
    while at is not None and not isinstance(at, KeyboardInterrupt):
        at = at.__cause__ or at.__context__
    left = getattr(at, "__notes__", ["nothing was written"])
    click.echo(f"symfive: interrupted; {'; '.join(left)}.", err=True)
    return 130


def _sentence(error: Exception) -> str | None:
    """What a user can do about an error; None where it is a fault of the program."""
    from numpy.linalg import LinAlgError

    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, LinAlgError):
        return f"the equations cannot be solved ({error}); check priors and noise in the files."
    if isinstance(error, MemoryError):
        return "the recording does not fit into memory; split the campaign."
    if isinstance(error, OSError):
        said = error.strerror or str(error)
        return str(InputError(said, path=error.filename or None, remedy="check the disk and your rights"))
    return None
