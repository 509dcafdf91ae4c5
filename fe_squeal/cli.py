"""The command fe-squeal: the list of what it can do, and what an error becomes outside: one line and an exit code."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer

from .commands.info import info
from .commands.prepare import check, mesh, new
from .commands.references import compare, lumped_models
from .commands.show import animate, diff, report
from .commands.solve import accuracy, onset, run, study
from .errors import INTERRUPTED, InputError, NotConvergedError, OutputError, SquealError, one_line
from .process.isolation import import_matplotlib
from .process.ranks import is_helper, process_count
from .process.signals import stopped_by_signals, uncovered
from .process.streams import lasting_streams

app = typer.Typer(
    help="Complex eigenvalue analysis of brake squeal on finite-element meshes.",
    no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
)  # fmt: skip
# Some versions of Typer carry click inside them, others import it. Either way click's base of usage errors is among the
# bases of Typer's own exception.
_UsageError: Any = typer.BadParameter.__bases__[0]


def _version(wanted: bool) -> None:
    if wanted:
        from .version import __version__

        print(f"fe-squeal {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")] = False,
) -> None:
    """Complex eigenvalue analysis of brake squeal on finite-element meshes."""


# In the order of the help.
for _command in (run, new, check, mesh, onset, study, compare, accuracy):
    app.command()(_command)
app.command("lumped")(lumped_models)
app.command()(report)
app.command()(animate)
app.command()(diff)
app.command()(info)


def main(arguments: list[str] | None = None) -> int:
    """Run the command; never shows a traceback for bad input.

    Under mpiexec the first process runs it, and the others take part in its factorisations.
    """
    if process_count() == 1:
        return _run(arguments)
    from .eigen.linear.processes import dismiss, help_out, prepare

    if is_helper():
        return help_out()
    code = InputError.exit_code
    try:
        prepare()
        code = _run(arguments)
    except InputError as error:  # of what has started the processes
        print(one_line(f"error: {error}"), file=sys.stderr)
    finally:
        dismiss(code)
    return code


def _run(arguments: list[str] | None) -> int:
    with lasting_streams() as (out, err):
        try:
            with stopped_by_signals() as came:
                code = _main(arguments, came)
        except KeyboardInterrupt as stop:
            code = INTERRUPTED
            if _unwritten(stop.__cause__):
                why = one_line(str(stop.__cause__))
                print(f"interrupted; what was finished could not be written: {why}", file=sys.stderr)
        if code == INTERRUPTED and not err.used:  # Typer, too, takes up what no command does, and says nothing
            print("interrupted", file=sys.stderr)
        out.flush()
        if out.failure is not None:
            why = one_line(str(out.failure.strerror or out.failure))
            print(f"error: standard output: {why}; what belongs into files is written", file=sys.stderr)
            return code or InputError.exit_code
    return code


def _unwritten(error: BaseException | None) -> bool:
    """Return whether an error says that results cannot be written; a file that cannot be read has another cause."""
    return isinstance(error, OutputError) and isinstance(error.__cause__, OSError | None)


def _main(arguments: list[str] | None, came: list[int]) -> int:
    try:
        with uncovered(came):
            import_matplotlib()
            code = app(arguments, standalone_mode=False, prog_name="fe-squeal")
    except SquealError as error:
        text = f"error: {error}" if not isinstance(error, NotConvergedError) else f"not converged: {error}"
        print(one_line(text), file=sys.stderr)
        return error.exit_code
    except OSError as error:  # a name that the system refuses, a disk that is full
        name = f"{str(error.filename)[:200]}: " if error.filename is not None else ""
        print(one_line(f"error: {name}{error.strerror or error}"), file=sys.stderr)
        return InputError.exit_code
    except MemoryError:
        from .eigen.memory import available_memory, memory_text

        print(f"error: more memory is needed than the {memory_text(available_memory())} that are free", file=sys.stderr)
        return InputError.exit_code
    except _UsageError as error:  # a wrong option or argument; without any argument the help
        if sys.argv[1:] if arguments is None else arguments:
            print(f"error: {error.format_message().rstrip('.')}; see fe-squeal --help", file=sys.stderr)
        else:
            error.show()
        return error.exit_code
    return int(code or 0)
