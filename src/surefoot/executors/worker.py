"""Worker: the execution of a task on the machine where it arrives."""

from __future__ import annotations

import contextlib
import pickle
import traceback
from pathlib import Path

from surefoot.cores import at_most
from surefoot.errors import UserError
from surefoot.executors.envelope import DONE, FAILED, WRONG, Answer
from surefoot.extras import advice

CORES = 1
"""That a task uses."""


def answer(task: bytes, folder: str, where: str) -> Answer:
    """Do a task in the folder of who asked, if it is there too, and answer whatever happens.

    Args:
        task: the pickled function and its arguments; agents are loaded as they are unpickled.
        folder: to which relative paths refer.
        where: the worker, in words.
    """
    try:
        with contextlib.chdir(folder) if Path(folder).is_dir() else contextlib.nullcontext(), at_most(CORES):
            function, arguments = pickle.loads(task)
            return DONE, pickle.dumps(function(*arguments))
    except (UserError, OSError) as error:
        return WRONG, f"{where}: {error}".encode()
    except ModuleNotFoundError as error:
        return WRONG, f"{where}: {advice(error.name) or error}".encode()
    except Exception:
        return FAILED, f"{where}: {traceback.format_exc()}".encode()
