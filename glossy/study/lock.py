"""One process in a study's folder at a time.

The file ``study.running.json`` names the process that works there: its number, host and start. It
is made with ``O_EXCL`` or opened, then locked with ``flock``, which the system lets go of when the
process ends, however it ends. So ::

    locked by another process             refused
    free, of this machine, or rebooted    left behind: taken over
    free, but of another machine          refused: not every network file system carries locks
    no locks in this file system          whoever makes the file has it; left behind, it is refused

and a refusal names the holder, and the file to delete where it may be a dead one's.
"""

import contextlib
import datetime
import errno
import json
import os
import pathlib
import platform
import stat
import types
from typing import Any

NAME = "study.running.json"
BOOT = pathlib.Path("/proc/sys/kernel/random/boot_id")
MOST_BYTES = 4096


def _machine() -> dict[str, str]:
    """Host, and the system's start where it is known: containers of one machine share it."""
    try:
        boot = BOOT.read_text().strip()
    except OSError:
        boot = ""
    return {"host": platform.node(), "boot": boot}


class Lock:
    """Keeps other processes out of a folder while it is entered; may be entered again.

    Parameters
    ----------
    folder : path
        Must exist when the lock is entered.

    Raises
    ------
    ValueError
        On entering, in one line: who works there.
    OSError
        On entering: the file cannot be made.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        self.path = folder / NAME
        self._depth, self._file = 0, -1

    def __enter__(self) -> "Lock":
        while self._depth == 0 and not self._taken():
            pass  # the holder removed the file meanwhile
        self._depth += 1
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: types.TracebackType | None,
    ) -> None:
        self._depth -= 1
        if self._depth == 0:
            with contextlib.suppress(OSError):
                self.path.unlink()
            os.close(self._file)

    def _taken(self) -> bool:
        flags = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK
        try:
            file, made = os.open(self.path, flags | os.O_CREAT | os.O_EXCL, 0o644), True
        except FileExistsError:
            try:
                file, made = os.open(self.path, flags), False
            except FileNotFoundError:
                return False
        try:
            done = self._claim(file, made)
        except BaseException:
            os.close(file)
            raise
        if done:
            self._file = file
        else:
            os.close(file)
        return done

    def _claim(self, file: int, made: bool) -> bool:
        if not stat.S_ISREG(os.fstat(file).st_mode):
            raise OSError(f"{self.path}: is not a regular file")
        locked = _locked(file)
        holder = {} if made else _record(file)
        if locked is False:
            raise self._held(holder)
        if locked is None and not made:
            raise self._held(holder, sure=False)
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file), os.lstat(self.path)):
                here = _machine()
                known = [key for key in here if holder.get(key) and here[key]]
                if known and not any(holder[key] == here[key] for key in known):
                    raise self._held(holder, sure=False)
                now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
                text = json.dumps({"pid": os.getpid(), "started": now, **here})
                os.ftruncate(file, 0)
                os.pwrite(file, text.encode(), 0)
                return True
        return False

    def _held(self, holder: dict[str, Any], sure: bool = True) -> ValueError:
        who = "another process"
        if holder:
            who = f"process {holder['pid']} on {holder['host']} since {holder['started']}"
        advice = "" if sure else f"; if that has ended, delete {self.path}"
        return ValueError(f"{self.path.parent}: a study runs here already: {who}{advice}")


def _locked(file: int) -> bool | None:
    """Whether the file could be locked; None where there are no locks."""
    try:
        import fcntl
    except ImportError:  # a system without them: as a file system without locks
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        busy = error.errno in (errno.EWOULDBLOCK, errno.EACCES, errno.EAGAIN)
        return False if busy else None
    return True


def _record(file: int) -> dict[str, Any]:
    """What the holder wrote; empty where that is no record."""
    try:
        found = json.loads(os.pread(file, MOST_BYTES, 0))
        pid, host, started = int(found["pid"]), str(found["host"]), str(found["started"])
        boot = str(found["boot"])
    except (ValueError, KeyError, TypeError, RecursionError, OverflowError):
        return {}
    line = {"host": host, "started": started, "boot": boot}
    return {"pid": pid, **{key: " ".join(text.split())[:64] for key, text in line.items()}}
