"""What a reader returns: columns that share one clock."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from harness.common.arrays import Floats
from harness.common.errors import UserError


@dataclass(frozen=True)
class Table:
    """Columns of equal length that were sampled together.

    Attributes:
        columns: Values by name, each float64 of shape ``(samples,)``; missing samples are NaN.
        units: Units by column as the file states them; empty where it states none.
        clock: Column that holds the time in s, where the format itself says which one it is.
    """

    columns: dict[str, Floats]
    units: dict[str, str] = field(default_factory=dict)
    clock: str | None = None


def by_length(vectors: dict[str, Floats]) -> list[Table]:
    """Group vectors by their length, the length that most of them share first (the longer if as many do).

    A single value is a parameter and no signal, and is left out.
    """
    lengths: dict[int, dict[str, Floats]] = {}
    for name, values in vectors.items():
        if len(values) > 1:
            lengths.setdefault(len(values), {})[name] = values
    ranked = sorted(lengths, key=lambda n: (len(lengths[n]), n), reverse=True)
    return [Table(lengths[n]) for n in ranked]


@contextmanager
def told_as_damaged(path: str, what: str) -> Iterator[None]:
    """Refuse a file that the library of its format cannot read, whatever that library raises then.

    Libraries check a file by reading it: damaged bytes end in errors of every kind, which are the file's fault.

    Args:
        path: The file.
        what: What it should be, such as ``MATLAB file``.

    Raises:
        UserError: If it cannot be read.
    """
    try:
        yield
    except UserError:
        raise
    except MemoryError:
        raise UserError(f"{path}: is damaged, or needs more memory than there is") from None
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise  # the file itself: no permission, vanished
        said = " ".join(str(error).split())[:200]
        reason = f": {said}" if said else ""
        raise UserError(f"{path}: is damaged or no {what}{reason}; export it again") from error
